"""Suspicions: a log or a model that is not what it says it is, found before anything is fitted to it.

Each is one sentence. "stop" means that anything fitted to this log would be wrong; "warn" is said beside the result.
`fpjax inspect` and `estimate` print them all, `diagnose` refuses the log at the first "stop".
"""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any, Literal, Protocol

import numpy as np

from .noise import noise_level
from .noise import quantisation as seen_step
from .nominal import half_window, smooth
from .regression import Regression, regress, travelled

Values = np.ndarray

SHORTEST = 64  # samples: below it nothing is compared
BEYOND = 4.0  # times: an inertia this far off is no effect of the vocabulary but another unit or another machine
ONE_WAY = 0.01  # share of the samples
CLIPPED = 0.005
REPEATED = 0.002
UNITS = {  # factor by which a column is too large: (rotary name, linear name)
    180.0 / np.pi: ("deg/s", ""),
    30.0 / np.pi: ("rpm", ""),
    0.5 / np.pi: ("rev/s", ""),
    1000.0: ("mrad/s", "mm/s"),
    100.0: ("", "cm/s"),
    0.001: ("krad/s", "km/s"),
}
LIKE = 0.08  # relative


class Expected(Protocol):
    """What the nominal model says: `fpjax.gap.rigid.RigidBody`, or `Numbers`."""

    @property
    def inertia(self) -> float:
        """J [kg m^2]."""
        ...

    @property
    def coulomb(self) -> float:
        """k [N m]; 0 where it is not to be compared."""
        ...

    @property
    def viscous(self) -> float:
        """b [N m s/rad]; 0 where it is not to be compared."""
        ...


@dataclass(frozen=True)
class Numbers:
    """Numbers to compare a log with.

    Attributes:
        inertia: J [kg m^2].
        coulomb: k [N m]; 0 where it is not to be compared.
        viscous: b [N m s/rad]; 0 where it is not to be compared.
    """

    inertia: float
    coulomb: float = 0.0
    viscous: float = 0.0


@dataclass(frozen=True)
class Suspicion:
    """One thing that looks wrong.

    Attributes:
        sentence: what it is, with the number, and what to do; the log's name first.
        severity: "stop" or "warn".
        kind: a word for it: unit, sign, swapped, still, one_way, short, nominal, clipped, repeated, clock, missing,
        inconsistent, compensated.
    """

    sentence: str
    severity: Literal["stop", "warn"]
    kind: str


def suspicions(log: Any, model: Expected | None = None) -> list[Suspicion]:
    """What looks wrong with a log, or with the model for it; the worst first.

    Args:
        log: a `fpjax.logs.Log`, or anything with its fields.
        model: what the nominal model says; None to look at the log alone.
    """
    columns = {name: _values(getattr(log, name)) for name in ("time", "torque", "velocity", "position")}
    present = {name: values for name, values in columns.items() if values is not None}
    found = [*_missing(log, present)]
    if len(present["time"]) < SHORTEST:
        return found
    if not found:
        found = [*_still(log, present)]
    if not any(s.severity == "stop" for s in found):
        found += [*_clock(log, present), *_repeated(log, present), *_clipped(log, present), *_one_way(log, present)]
        # the first of these that is seen explains the others
        for look in (
            _swapped(log, present),
            _position_against_velocity(log, present),
            _torque_against_motion(log, present, model),
            _velocity_against_reference(log, present),
        ):
            seen = list(look)
            found += seen
            if seen:
                break
    return sorted(found, key=lambda s: s.severity == "warn")


def _missing(log: Any, columns: dict[str, Values]) -> Iterator[Suspicion]:
    for name, values in columns.items():
        bad = int(np.sum(~np.isfinite(values)))
        if bad:
            yield Suspicion(
                f"{log.name}: {name} is not a number in {bad} of {len(values)} rows (first in row "
                f"{int(np.argmax(~np.isfinite(values)))}): fill or cut these rows.",
                "stop",
                "missing",
            )


def _still(log: Any, columns: dict[str, Values]) -> Iterator[Suspicion]:
    for name in ("torque", "velocity", "position"):
        values = columns.get(name)
        if values is None:
            continue
        step = _step(values)
        span, noise = float(np.ptp(values)), max(noise_level(values), step / np.sqrt(12.0))
        if span == 0.0:
            yield Suspicion(
                f"{log.name}: {name} is constant ({values[0]:g}) throughout, so it shows nothing: was the right column "
                f"recorded, and did the machine move?",
                "stop",
                "still",
            )
        elif name != "torque" and span < 12.0 * noise:
            yield Suspicion(
                f"{log.name}: {name} stays within its own noise ({span:.3g} from end to end, noise {noise:.2g}): the "
                f"machine hardly moves; record a run with reversals.",
                "stop",
                "still",
            )


def _one_way(log: Any, columns: dict[str, Values]) -> Iterator[Suspicion]:
    speed = _speed(log, columns)
    moving = np.abs(speed) > 0.05 * np.quantile(np.abs(speed), 0.95)
    forward = float(np.mean(speed[moving] > 0.0)) if np.any(moving) else 0.5
    if min(forward, 1.0 - forward) < ONE_WAY:
        yield Suspicion(
            f"{log.name}: the motion goes in one direction only ({'forward' if forward > 0.5 else 'backward'}), so "
            "friction, a constant torque and a dependence on direction cannot be told apart: record a run with "
            "reversals.",
            "warn",
            "one_way",
        )


def _clock(log: Any, columns: dict[str, Values]) -> Iterator[Suspicion]:
    steps = np.diff(columns["time"])
    if np.any(steps <= 0.0):
        row = int(np.argmax(steps <= 0.0)) + 1
        yield Suspicion(
            f"{log.name}: time does not increase in {int(np.sum(steps <= 0.0))} rows (first in row {row}): remove the "
            f"repeated rows, or split the log where the clock jumps.",
            "stop",
            "clock",
        )
    elif np.any(steps > 1.5 * log.dt):
        lost = int(np.sum(np.round(steps / log.dt) - 1))
        yield Suspicion(
            f"{log.name}: {lost} samples are missing (first after t = "
            f"{columns['time'][int(np.argmax(steps > 1.5 * log.dt))]:g} s): log without drops.",
            "warn",
            "clock",
        )


def _repeated(log: Any, columns: dict[str, Values]) -> Iterator[Suspicion]:
    """Readings that equal the one before exactly, where noise should make that impossible."""
    for name in ("torque", "velocity", "position"):
        values = columns.get(name)
        if values is None or _step(values) > 0.0:
            continue
        same = np.diff(values) == 0.0
        distinct = len(np.unique(values)) / len(values)
        at_end = np.abs(values[1:]) >= 0.9995 * np.max(np.abs(values))
        share = float(np.mean(same & ~at_end))
        # Few distinct values are rounding; a repetition among many is a reading that was not renewed.
        if share > REPEATED and distinct > 0.8 * (1.0 - share) and share > 4.0 * (1.0 - distinct - share):
            yield Suspicion(
                f"{log.name}: {share:.2%} of the {name} samples repeat the one before exactly, as if the "
                "reading was not renewed every period: check the logger, or log without drops.",
                "warn",
                "repeated",
            )


def _clipped(log: Any, columns: dict[str, Values]) -> Iterator[Suspicion]:
    for name in ("torque", "velocity"):
        values = columns.get(name)
        if values is None or _step(values) > 0.05 * np.ptp(values):
            continue
        for end, word in ((np.max(values), "highest"), (np.min(values), "lowest")):
            at = values == end
            runs = int(np.sum(at[1:] & at[:-1]))
            step = _step(values)
            expected = 4.0 * float(np.mean(np.abs(values - end) <= 8.0 * step)) if step > 0.0 else 0.0
            if np.mean(at) > max(CLIPPED, expected) and runs > 0.5 * np.sum(at):
                yield Suspicion(
                    f"{log.name}: {name} stays at its {word} value, {end:.4g}, for {np.mean(at):.1%} of the "
                    "time: it is clipped there, and what happens beyond cannot be seen.",
                    "warn",
                    "clipped",
                )


def _position_against_velocity(log: Any, columns: dict[str, Values]) -> Iterator[Suspicion]:
    velocity, position = columns.get("velocity"), columns.get("position")
    if velocity is None or position is None:
        return
    ratio, together = travelled(velocity, position, log.dt)
    unit = "m" if getattr(log, "linear", False) else "rad"
    if not np.isfinite(ratio) or together < 0.5:
        yield Suspicion(
            f"{log.name}: velocity is not the rate of change of position (correlation {together:.2f}): one of them "
            f"belongs to another axis, or has another time.",
            "warn",
            "inconsistent",
        )
        return
    named = _unit_of(abs(ratio), linear=unit == "m")
    inverse = _unit_of(1.0 / abs(ratio), linear=unit == "m") if ratio else None
    if named:
        yield Suspicion(
            f"{log.name}: velocity looks like {named}: {abs(ratio):.3g} x the rate of change of position; give"
            f" its unit, such as --columns velocity=velocity:{named}.",
            "stop",
            "unit",
        )
    elif inverse:
        angle = inverse.removesuffix("/s").replace("rpm", "rev/min")
        yield Suspicion(
            f"{log.name}: position looks like {angle}: its rate of change is {1 / abs(ratio):.3g} x the "
            f"velocity; give its unit, such as --columns position=position:{angle}.",
            "stop",
            "unit",
        )
    elif ratio < 0.0:
        yield Suspicion(
            f"{log.name}: velocity has the opposite sign of the rate of change of position ({ratio:.3g} x): "
            "turn one of them round.",
            "stop",
            "sign",
        )
    elif not 0.5 < ratio < 2.0:
        yield Suspicion(
            f"{log.name}: velocity is {ratio:.3g} x the rate of change of position: check the units of both.",
            "stop",
            "unit",
        )


def _velocity_against_reference(log: Any, columns: dict[str, Values]) -> Iterator[Suspicion]:
    """Only a velocity without a position needs it, and only a reference that is followed in another unit can tell."""
    reference = _values(getattr(log, "reference", None))
    if "position" in columns or "velocity" not in columns or reference is None or not np.all(np.isfinite(reference)):
        return
    half = half_window(log)
    velocity, wanted = smooth(columns["velocity"], half), smooth(reference, half)
    size, power = float(wanted @ wanted), float(velocity @ velocity)
    if size == 0.0 or power == 0.0 or float(velocity @ wanted) < 0.8 * np.sqrt(size * power):
        return
    ratio = float(np.sqrt(power / size))
    named = _unit_of(ratio, linear=bool(getattr(log, "linear", False)))
    if named:
        yield Suspicion(
            f"{log.name}: velocity looks like {named}: {ratio:.3g} x the reference; give its unit, such as --columns "
            f"velocity=velocity:{named}.",
            "stop",
            "unit",
        )


def _swapped(log: Any, columns: dict[str, Values]) -> Iterator[Suspicion]:
    if "velocity" not in columns:
        return
    torque, velocity = columns["torque"], columns["velocity"]
    straight, swapped = regress(torque, velocity, log.dt), regress(velocity, torque, log.dt)
    better = swapped.explained > straight.explained + 0.2
    # a short noise-free log explains much either way round: then the right one leaves far less
    better = better or (swapped.coulomb > 0.0 and 1.0 - swapped.explained < 0.2 * (1.0 - straight.explained))
    if better and swapped.explained > 0.9 and swapped.inertia > 0.0:
        yield Suspicion(
            f"{log.name}: torque and velocity look exchanged: with the columns exchanged, inertia and friction "
            f"explain {swapped.explained:.0%} of the torque, as they are {max(straight.explained, 0.0):.0%}.",
            "stop",
            "swapped",
        )


def _torque_against_motion(log: Any, columns: dict[str, Values], model: Expected | None) -> Iterator[Suspicion]:
    torque = columns["torque"]
    speed = _speed(log, columns)
    # a position's central difference sits at the sample, between two held torques
    held = torque if "velocity" in columns else 0.5 * (torque + np.concatenate([torque[:1], torque[:-1]]))
    found = regress(held, speed, log.dt)
    if found.explained < 0.3:
        return
    sure = abs(found.inertia) > 8.0 * found.inertia_error
    if found.inertia < 0.0 and sure and found.coulomb <= 0.0:
        yield Suspicion(
            f"{log.name}: torque and motion have opposite signs (the motion accelerates against the torque): "
            "turn the sign of one of them, such as --columns torque=torque*-1.",
            "stop",
            "sign",
        )
    elif found.inertia > 0.0 and sure and found.explained > 0.5 and found.coulomb < -0.1 * found.torque:
        yield Suspicion(
            f"{log.name}: friction comes out negative ({found.coulomb:.3g}): does a compensation act that the torque "
            "column leaves out?",
            "warn",
            "compensated",
        )
    elif model is not None and found.explained > 0.5:
        yield from _nominal(log, found, model, speed, sure=sure)


def _nominal(log: Any, found: Regression, model: Expected, speed: Values, *, sure: bool) -> Iterator[Suspicion]:
    linear = bool(getattr(log, "linear", False))
    what, unit = ("mass", "kg") if linear else ("inertia", "kg m^2")
    ratio = model.inertia / max(found.inertia, 1e-300)
    if sure and found.inertia > 0.0 and not 1.0 / BEYOND < ratio < BEYOND:
        named = _unit_of(ratio, linear=linear)
        level = found.coulomb / model.coulomb if model.coulomb > 0.0 else np.nan
        seen = (
            f"the log's torque and acceleration ask for {found.inertia:.3g} {unit}, the model has {model.inertia:.3g}"
        )
        if named and (not np.isfinite(level) or 0.5 < level < 2.0):
            column = "velocity" if log.velocity is not None else "position"
            named = named if column == "velocity" else named.removesuffix("/s")
            yield Suspicion(
                f"{log.name}: {column} looks like {named}: {ratio:.3g} x what the model expects ({seen}); give"
                f" its unit, such as --columns {column}={column}:{named}, or correct the model's {what}.",
                "stop",
                "unit",
            )
        else:
            yield Suspicion(
                f"{log.name}: the model does not belong to this log: {seen}, {max(ratio, 1 / ratio):.3g} x "
                f"off; check the unit of the {what} and the scale of the torque.",
                "stop",
                "nominal",
            )
        return
    fast = float(np.quantile(np.abs(speed), 0.95))
    for name, unit, here, there, size in (
        ("coulomb", "N" if linear else "N m", found.coulomb, model.coulomb, 1.0),
        ("viscous", "N s/m" if linear else "N m s/rad", found.viscous, model.viscous, fast),
    ):
        excess = (there - here) * size
        if there > 0.0 and excess > 2.0 * found.torque and there > 5.0 * max(here, 0.0):
            yield Suspicion(
                f"{log.name}: the model's {name} friction of {there:.3g} {unit} asks for more torque than the "
                f"log holds (about {max(here, 0.0):.3g} would fit): is it ten times off?",
                "warn",
                "nominal",
            )


def _step(values: Values) -> float:
    return seen_step(values) or 0.0


def _unit_of(factor: float, *, linear: bool) -> str | None:
    for size, names in UNITS.items():
        name = names[linear]
        if name and abs(factor / size - 1.0) < LIKE:
            return name
    return None


def _speed(log: Any, columns: dict[str, Values]) -> Values:
    if "velocity" in columns:
        return columns["velocity"]
    return np.gradient(columns["position"], log.dt)


def _values(column: Any) -> Values | None:
    return None if column is None else np.asarray(getattr(column, "values", column), float)
