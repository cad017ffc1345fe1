"""The gains that may change, their bounds, and the values that a search tries first."""

import dataclasses
import functools
from collections.abc import Mapping, Sequence

import numpy as np

from ..blocks.controllers import Limited, PositionLoop
from ..blocks.feedforward import AbstractFeedforward, Feedforward, PositionFeedforward
from ..blocks.observers import NoObserver
from ..blocks.parameters import get_parameter, set_parameters
from ..errors import InputError
from ..logs.arrays import Numbers, Values
from ..logs.dynamics.derivative import slope
from ..model_file import Model
from ..model_file.bounds import gain_names
from ..simulation.scan import astype

FREE = ("observer", "feedforward", "controller")
# Default bounds, where none are written:
CONTROLLER = (0.25, 4.0)  # of a controller's gain, times the file's value
OBSERVER = (1e-2, 1e2)  # of an observer's gain, times the file's value
BELIEVED = (0.5, 2.0)  # of an observer's inertia, coulomb and viscous, times the corrected machine's value
FORWARD = 2.0  # upper bound of a feed-forward's friction, times the corrected machine's value
FORWARD_INERTIA = 1.5  # upper bound of a feed-forward's inertia, times the corrected machine's value
RATE = 1.2  # upper bound of the share of a position reference's rate that is fed forward
TURNING = 0.02  # width of a new feed-forward's friction reversal, as a share of the reference's speed
EDGE = 0.02  # share of the range within which a gain counts as at its bound


@dataclasses.dataclass(frozen=True)
class Gain:
    """One gain that may change.

    Attributes:
        word: its name in the file, "controller.kp".
        name: its name in the loop.
        now: the file's value, in its unit.
        low: lower bound.
        high: upper bound.
        logarithmic: whether the search works in its logarithm.
        written: whether the bounds are the user's own.
    """

    word: str
    name: str
    now: float
    low: float
    high: float
    logarithmic: bool
    written: bool

    def value(self, share: Numbers) -> Numbers:
        """The gain at a share of its range, 0 to 1."""
        if self.logarithmic:
            return self.low * (self.high / self.low) ** share
        return self.low + (self.high - self.low) * share

    def share(self, value: float) -> float:
        """Where a value lies in the range, 0 to 1."""
        value = min(max(value, self.low), self.high)
        if self.logarithmic:
            return float(np.log(value / self.low) / np.log(self.high / self.low))
        return (value - self.low) / (self.high - self.low)

    def edge(self, value: float) -> str:
        """The bound that a value is at, "low", "high" or ""; a lower bound of zero does not count, as it is natural."""
        share = self.share(value)
        if share > 1.0 - EDGE:
            return "high"
        return "low" if share < EDGE and self.low > 0.0 else ""


@dataclasses.dataclass(frozen=True)
class Gains:
    """The gains that may change, and a model that contains all of them.

    Attributes:
        model: the nominal model, with a feed-forward where one was asked for.
        gains: the gains, in the order of every array of gains.
        added: sections that the model did not have.
    """

    model: Model
    gains: tuple[Gain, ...]
    added: tuple[str, ...]

    @property
    def names(self) -> tuple[str, ...]:
        """Their names in the loop."""
        return tuple(gain.name for gain in self.gains)

    @property
    def now(self) -> Values:
        """The file's values, shape (gains,)."""
        return np.array([gain.now for gain in self.gains])

    def values(self, shares: Values) -> Values:
        """Gains at shares of their ranges, shape (..., gains)."""
        return np.stack([gain.value(shares[..., i]) for i, gain in enumerate(self.gains)], axis=-1)

    def shares(self, values: Values) -> Values:
        """Shares of their ranges at gains of shape (gains,)."""
        return np.array([gain.share(float(value)) for gain, value in zip(self.gains, values, strict=True)])

    def apply(self, model: Model, values: Values) -> Model:
        """Another model, for instance the corrected one, with this model's control law and these gains."""
        law = astype((self.model.loop.controller, self.model.loop.observer), float)
        loop = dataclasses.replace(model.loop, controller=law[0], observer=law[1])
        loop = set_parameters(loop, {name: float(value) for name, value in zip(self.names, values, strict=True)})
        sections = {**model.sections, "controller": self.model.sections.get("controller", {})}
        return dataclasses.replace(model, loop=loop, controller_known=True, bounds=self.model.bounds, sections=sections)


def freed(model: Model, machine: Mapping[str, float], reference: Values, free: Sequence[str] = ()) -> Gains:
    """The gains that may change.

    These are the gains of the observer and of the feed-forward, where the file has them. The controller's are free only
    where [bounds] or `free` names them: changing a loop's own gains is the user's decision.

    Args:
        model: the nominal model.
        machine: inertia, coulomb and viscous of the corrected machine.
        reference: of the loop, shape (samples,).
        free: further gains: "controller", "feedforward" (added where there is none), "observer", or a gain by its name
            in the file, "controller.kp", or with bounds, "controller.kp=1:5".

    Raises:
        InputError: where nothing may change, or a name or bounds are not valid.
    """
    model.needed_controller()
    model, added = _with_feedforward(model, reference, free)
    known = gain_names(model.loop)
    bounds = dict(model.bounds)
    wanted: dict[str, None] = {}
    for word in known:
        section, _, key = word.partition(".")
        usual = section == "observer" and (key.startswith("gain") or key == "inertia")
        usual |= section == "feedforward" and key != "speed"
        if usual or word in bounds:
            wanted[word] = None
    for word in free:
        name, equals, span = word.partition("=")
        if name in FREE and not equals:
            own = [each for each in known if each.startswith(f"{name}.") and not each.endswith(".speed")]
            if not own:
                raise InputError(f"The model has no {name} whose gains could change: write [{name}], or drop it.")
            wanted |= dict.fromkeys(own)
            continue
        if name not in known:
            raise InputError(
                f"{name!r} is not a gain of this loop: free {', '.join(FREE)}, or one of {', '.join(known)}."
            )
        wanted[name] = None
        if equals:
            bounds[name] = _span(word, span)
    if not wanted:
        what = "it has no observer and no feed-forward" if isinstance(model.loop.observer, NoObserver) else ""
        raise InputError(
            f"Nothing may change in this model{f' ({what})' if what else ''}: free the controller's gains (--free "
            f"controller, or [bounds] controller.kp = [low, high] in the model), or add a feed-forward (--free "
            f"feedforward)."
        )
    model = dataclasses.replace(model, bounds={word: pair for word, pair in bounds.items() if word in known})
    return Gains(model, tuple(_gain(model, word, known[word], bounds, machine) for word in wanted), added)


def _gain(model: Model, word: str, name: str, bounds: Mapping[str, tuple[float, float]], machine: Mapping[str, float]):
    """A gain with its bounds: the user's, or the default ones of its kind."""
    now = float(np.asarray(get_parameter(model.loop, name)))
    section, _, key = word.partition(".")
    if word in bounds:
        low, high = bounds[word]
        if not low <= now <= high:
            raise InputError(
                f"{word} = {now:g} lies outside its own bounds [{low:g}, {high:g}]: widen them, or correct the gain."
            )
    elif word == "feedforward.velocity":
        low, high = 0.0, max(RATE, 1.2 * now)
    elif section == "feedforward" and key != "speed":
        most = FORWARD_INERTIA * machine["inertia"] if key == "inertia" else FORWARD * machine.get(key, 0.0)
        # The last term only keeps the range from being empty where the machine has no such friction.
        low, high = 0.0, max(most, 1.2 * now, 1e-3 * machine["inertia"])
    elif section == "observer" and key in ("inertia", "coulomb", "viscous"):
        right = machine.get(key, now) or now
        low, high = min(BELIEVED[0] * right, 0.9 * now), max(BELIEVED[1] * right, 1.1 * now)
    else:
        span = CONTROLLER if section in ("controller", "feedforward") else OBSERVER
        if not now > 0.0:
            raise InputError(
                f"{word} = {now:g} gives no scale for its bounds: write them, [bounds] {word} = [low, high]."
            )
        low, high = span[0] * now, span[1] * now
    # A range of more than a factor of three is searched in the logarithm.
    return Gain(word, name, now, low, high, low > 0.0 and high > 3.0 * low, word in bounds)


def guesses(gains: Gains, machine: Mapping[str, float]) -> Values:
    """Gains to try first, shape (guesses, gains).

    The file's; those with the corrected machine's values in observer and feed-forward; and these with 1.5 times the
    controller's gains.
    """
    believed = gains.now.copy()
    for place, gain in enumerate(gains.gains):
        section, _, key = gain.word.partition(".")
        if gain.word == "feedforward.velocity":
            believed[place] = np.clip(1.0, gain.low, gain.high)
        elif section in ("feedforward", "observer") and key in machine:
            believed[place] = np.clip(machine[key], gain.low, gain.high)
    most = believed.copy()
    for place, gain in enumerate(gains.gains):
        if gain.word.startswith("controller."):
            most[place] = np.clip(1.5 * gain.now, gain.low, gain.high)
    return np.unique(np.stack([gains.now, believed, most]), axis=0)


def _with_feedforward(model: Model, reference: Values, free: Sequence[str]) -> tuple[Model, tuple[str, ...]]:
    """(the model, with a feed-forward of zero gains if one was asked for and is missing; the sections added)."""
    asked = any(word.partition("=")[0].partition(".")[0] == "feedforward" for word in free)
    known = model.loop.controller
    if not asked or isinstance(known, AbstractFeedforward):
        return model, ()
    inner, position = known.controller if isinstance(known, Limited) else known, model.units.reference == "position"
    if position and not isinstance(inner, PositionLoop):
        raise InputError(
            f"The feed-forward of a position reference needs a velocity loop inside, which {type(inner).__name__} does "
            "not have: leave out --free feedforward."
        )
    moving = slope(reference, model.dt) if position else reference
    speed = max(TURNING * float(np.quantile(np.abs(moving), 0.95)), 1e-12)
    kind = functools.partial(PositionFeedforward, velocity=0.0) if position else Feedforward
    controller = kind(controller=known, inertia=0.0, coulomb=0.0, viscous=0.0, speed=speed, lag=model.dt)
    loop = dataclasses.replace(model.loop, controller=controller)
    return dataclasses.replace(model, loop=loop), ("feedforward",)


def _span(word: str, span: str) -> tuple[float, float]:
    parts = span.split(":")
    try:
        low, high = (float(part) for part in parts)
    except ValueError:
        raise InputError(f"{word!r} is not NAME=LOW:HIGH: write for instance controller.kp=1:5.") from None
    if not (np.isfinite(high) and 0.0 <= low < high):
        raise InputError(f"{word!r} is not an interval: LOW must be zero or more and below HIGH.")
    return low, high
