"""The contents of a log (rate, ranges, saturation, quantisation) and what its excitation makes identifiable."""

from dataclasses import dataclass, field

import numpy as np

from ...output.json_object import JsonObject
from ..arrays import runs_of
from ..dynamics.nominal import Nominal, acceleration_of, fit_nominal, speed_of
from ..log import Log, asks_for_a_position
from ..noise import noise_level, rounding_step, velocity_origin
from .suspicions import suspicions

SATURATED = 0.002  # share of the samples at an extreme, from which on the column counts as limited
LONGEST = 1 << 19  # [samples]: a spectrum is taken of no more
APART = 0.7  # ratio of the inertias of the reverse and the forward regression, below which both are named


@dataclass(frozen=True)
class Column:
    """One column of a log.

    Attributes:
        name: canonical name, or the file's own for a column that is not mapped.
        unit: of low, high, rms, noise and step.
        low: smallest value.
        high: largest value.
        rms: root mean square.
        noise: standard deviation of one reading (`fpjax.logs.noise.noise_level`).
        step: rounding step; None where no rounding is seen.
        at_limit: share of the samples at an extreme [1]; 0 where an extreme is only touched.
    """

    name: str
    unit: str
    low: float
    high: float
    rms: float
    noise: float
    step: float | None
    at_limit: float


@dataclass(frozen=True)
class Ability:
    """Whether the excitation can show an effect.

    Attributes:
        what: the effect or quantity.
        can: "yes", "poorly" or "no".
        why: the reason, with the number that decides.
    """

    what: str
    can: str
    why: str


@dataclass(frozen=True)
class Inspection:
    """What `fpjax inspect` found.

    Attributes:
        log: the log.
        columns: ranges, noise and rounding of each column.
        reversals: number of reversals of the motion.
        speed: 99 % quantile of the speed [rad/s].
        travel: range of the position, or of the integrated velocity [rad].
        bandwidth: frequency below which 99 % of the torque's power lies [Hz].
        abilities: what the excitation can show.
        nominal: rigid machine fitted to the log; None where the motion does not determine it.
        warnings: the reader's notes and what looks wrong in the log.
    """

    log: Log
    columns: tuple[Column, ...]
    reversals: int
    speed: float
    travel: float
    bandwidth: float
    abilities: tuple[Ability, ...]
    nominal: Nominal | None
    warnings: tuple[str, ...] = field(default_factory=tuple)

    def to_dict(self) -> JsonObject:
        """The inspection as plain numbers, strings, lists and dicts, for JSON; samples are left out."""
        import dataclasses

        log = self.log
        return {
            "log": log.name,
            "samples": log.samples,
            "dt": log.dt,
            "rate": log.rate,
            "duration": log.duration,
            "jitter": log.jitter,
            "linear": log.linear,
            "torque_unit": log.torque_unit,
            "torque_step": log.torque_step,
            "torque_measured": log.torque_measured,
            "torque_lag": log.torque_lag,
            "resampled": log.resampled,
            "columns": [dataclasses.asdict(column) for column in self.columns],
            "reversals": self.reversals,
            "speed": self.speed,
            "travel": self.travel,
            "bandwidth": self.bandwidth,
            "abilities": [dataclasses.asdict(ability) for ability in self.abilities],
            "nominal": None if self.nominal is None else dataclasses.asdict(self.nominal),
            "warnings": list(self.warnings),
        }


def inspect_log(log: Log) -> Inspection:
    """Ranges, noise, excitation, a nominal model and warnings of a log.

    Args:
        log: with a torque and a motion.
    """
    speed = speed_of(log)
    fast = float(np.quantile(np.abs(speed), 0.99))
    position = log.position if log.position is not None else np.cumsum(speed) * log.dt
    travel, reversals = float(np.ptp(position)), count_reversals(speed, 0.05 * fast)
    nominal = fit_nominal(log)
    rate = "m/s" if log.linear else "rad/s"
    reference = log.motion_unit if asks_for_a_position(log) else rate
    units = {"torque": log.torque_unit, "velocity": rate, "position": log.motion_unit, "reference": reference}
    columns = [describe(name, units[name], values) for name, values in log.columns().items() if name != "time"]
    columns += [describe(name, "", values) for name, values in log.extra.items() if np.all(np.isfinite(values))]
    return Inspection(
        log=log,
        columns=tuple(columns),
        reversals=reversals,
        speed=fast,
        travel=travel,
        bandwidth=bandwidth_of(log.torque, log.dt),
        abilities=tuple(abilities(log, speed, fast, travel, reversals, nominal)),
        nominal=nominal,
        warnings=(*log.warnings, *(one.sentence for one in suspicions(log)), *_about(log, nominal)),
    )


def _about(log: Log, nominal: Nominal | None) -> list[str]:
    """Warnings about the sensors and the inertia that matter for a model of this log."""
    found = []
    if log.velocity is not None and log.position is not None:
        origin = velocity_origin(log.velocity, log.position)
        if origin.derived:
            found.append(
                f"{log.name}: the velocity was derived from the position (but for {origin.left:.2g} of its steps), so "
                f"it is not a second sensor and adds no information."
            )
    if nominal is None or not nominal.plausible:
        return found
    if nominal.reverse:
        found.append(
            f"{log.name}: the inertia is between {nominal.inertia:.3g} (used: the motion taken as exact, the torque "
            f"holds noise or what a loop holds against) and {nominal.most_inertia:.3g} (the torque taken as exact: "
            f"nearer where something else pushed the machine)."
        )
    elif nominal.least_inertia < APART * nominal.inertia:
        found.append(
            f"{log.name}: the inertia is between {max(nominal.least_inertia, 0.0):.3g} (the motion explains the "
            f"torque) and {nominal.inertia:.3g} (the torque explains the motion): the torque holds noise, or "
            f"something acts that follows it, such as a limit."
        )
    return found


def describe(name: str, unit: str, values: np.ndarray) -> Column:
    """Ranges, noise, quantisation and saturation of a column."""
    low, high = float(values.min()), float(values.max())
    largest = max(abs(low), abs(high))  # an unmapped column may hold anything: its square could overflow
    size = largest * float(np.sqrt(np.mean((values / largest) ** 2))) if largest > 0.0 else 0.0
    step = rounding_step(values)
    return Column(name, unit, low, high, size, noise_level(values, step), step or None, _limit(values))


def _limit(values: np.ndarray) -> float:
    span = float(np.ptp(values))
    if span == 0.0:
        return 1.0
    share = 0.0
    for extreme in (values.min(), values.max()):
        if abs(extreme) < 1e-3 * span:  # rest
            continue
        # a column at rest at zero is not limited, even where zero is an end of its range
        at = np.abs(values - extreme) < 1e-6 * span
        # several samples in a row are a limit, a single one is a peak
        if np.any(np.diff(runs_of(at)) >= 5):
            share += float(np.mean(at))
    return share if share > SATURATED else 0.0


def count_reversals(speed: np.ndarray, least: float) -> int:
    """Changes of direction between motions faster than `least`."""
    side = np.sign(speed[np.abs(speed) > least])
    return int(np.count_nonzero(np.diff(side)))


def bandwidth_of(values: np.ndarray, dt: float, share: float = 0.99) -> float:
    """Frequency [Hz] below which that share of the power lies, mean and drift taken out."""
    values = values[:LONGEST]
    # the window keeps the ends of a log that does not begin and end alike from looking like high frequencies
    window = np.hanning(values.size)
    power = np.abs(np.fft.rfft((values - values.mean()) * window)) ** 2
    total = np.cumsum(power)
    if total[-1] == 0.0:
        return 0.0
    return float(np.searchsorted(total, share * total[-1]) / (values.size * dt))


def abilities(
    log: Log, speed: np.ndarray, fast: float, travel: float, reversals: int, nominal: Nominal | None
) -> list[Ability]:
    """What the excitation makes identifiable, each with the number that decides.

    The limits ("poorly", "yes") are rules of thumb and not tests: the diagnosis computes the identifiability itself.
    """
    moving = np.abs(speed) > 0.02 * fast
    # slow but moving: Stribeck and presliding effects act there only, which is at most a few percent of a usual log
    slow = float(np.mean(moving & (np.abs(speed) < 0.1 * fast))) if fast else 0.0
    spread = _spread(np.abs(speed[moving])) if moving.any() else 1.0
    turns = travel / (2.0 * np.pi)
    effort = _acceleration_share(log, nominal)
    both = log.velocity is not None and log.position is not None
    # differences weigh high frequencies more: a lag shows in fast changes of the torque, not in its slow course
    high = bandwidth_of(np.diff(log.torque), log.dt)
    found = [
        _ability("Coulomb friction and offset", reversals, 2, 6, f"{reversals} reversals"),
        _ability("viscous friction and drag", spread, 1.5, 3.0, f"speeds over a factor of {spread:.3g}"),
        _ability("inertia", effort, 0.05, 0.15, f"{100 * effort:.2g} % of the torque accelerates"),
        _ability("Stribeck, presliding", min(slow / 0.01, reversals / 4), 0.5, 1.0,
                 f"{100 * slow:.2g} % of the time slow but moving, {reversals} reversals"),
        _ability("friction drift", log.duration, 5.0, 20.0, f"{log.duration:.3g} s long"),
        _ability("lag, delay, compliance", high * log.dt, 0.02, 0.1, f"torque changes up to {high:.3g} Hz"),
    ]  # fmt: skip
    if not log.linear:
        name = "unbalance, cogging, friction by position"
        found.append(_ability(name, turns, 0.5, 1.0, f"{turns:.2g} turns travelled"))
    why = (
        "velocity and position are there" if both else f"only {'velocity' if log.velocity is not None else 'position'}"
    )
    found.append(Ability("actuator delay apart from sensor delay", "yes" if both else "no", why))
    return found


def _ability(what: str, value: int | float, poor: float, good: float, why: str) -> Ability:
    return Ability(what, "yes" if value >= good else "poorly" if value >= poor else "no", why)


def _spread(speeds: np.ndarray) -> float:
    low, high = np.quantile(speeds, [0.1, 0.9])
    return float(high / low) if low > 0.0 else 1.0


def _acceleration_share(log: Log, nominal: Nominal | None) -> float:
    power = float(np.mean(log.torque**2))
    if nominal is None or power == 0.0:
        return 0.0
    return float(min(np.sqrt(np.mean((nominal.inertia * acceleration_of(log)) ** 2) / power), 1.0))
