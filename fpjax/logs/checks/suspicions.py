"""Suspicions: wrong units, signs, clocks and columns of a log or a model, found before anything is fitted to it.

Each is one sentence with its number. "stop" means that nothing can be computed from this log (nothing moves, a column
holds values that are not numbers); everything else is printed beside the result, and the user decides. Checks of the
torque against the motion are in `torque_suspicions`, those of the motion's own columns in `motion_suspicions`.
"""

from collections.abc import Iterator
from dataclasses import replace
from typing import Any

import numpy as np

from ..arrays import Values, runs_of
from ..dynamics.derivative import local_polynomial, smooth_motion
from ..log import Log
from ..noise import noise_level, rounding_step
from .clipped_counter import clipped_counter
from .motion_suspicions import position_against_velocity, unit_of_time
from .stamp_jitter import stamp_jitter
from .suspicion import Expected as Expected
from .suspicion import Numbers as Numbers
from .suspicion import Suspicion as Suspicion
from .suspicion import unit_of
from .torque_suspicions import swapped, torque_against_motion

SHORTEST = 64  # [samples]: with fewer, nothing is compared
ONE_WAY = 0.01  # share of the samples in the other direction, below which the motion has one direction only
BOTH_WAYS = 0.2  # share of the moving time in either direction
CLIPPED = 0.005  # share of the samples at an extreme
FEW_LEVELS = 8  # different values: with so few the column is a relay's or a staircase command, not limited
REPEATED = 0.002  # share of the samples that repeat the one before
RESTING = 0.05  # of the speed that a hundredth of the rows exceed
FOLLOWED = 0.8  # correlation of a motion with its reference
OPPOSITE = 0.95  # likewise, with one of the other sign: a loop near its bandwidth answers late, and less alike
FEWEST_AT_REST = 16  # [samples] of one torque: a reading that is not renewed lasts a few periods
LATE = 0.02  # of a period: the stamps of drives and buses with clocks of their own jitter by less
MOST_ROWS = 400_000  # [samples]: a longer log is judged by its middle


def suspicions(log: Log, model: Expected | None = None) -> list[Suspicion]:
    """What looks wrong with a log, or with the model for it; the worst first.

    Args:
        log: in SI units, on one clock.
        model: nominal parameters to compare with; None to look at the log alone.
    """
    found = sorted(_found(log, model), key=lambda s: s.severity == "warn")
    return [replace(one, sentence=f"{log.name}: {one.sentence}") for one in found]


def _found(log: Log, model: Expected | None) -> list[Suspicion]:
    """In the order of the search; the sentences do not name the log."""
    columns = {name: _values(getattr(log, name)) for name in ("time", "torque", "velocity", "position")}
    present = {name: _middle(values) for name, values in columns.items() if values is not None}
    found = [*_missing(present)]
    if len(present["time"]) < SHORTEST:
        return found
    if not found:
        found = [*_still(present)]
    if not any(s.severity == "stop" for s in found):
        found += [*_clock(log, present), *_repeated(log, present), *_off_their_stamps(log, present)]
        found += [*_clipped(present), *_one_way(log, present), *_whole_torque(log, present)]
        found += _magnitude(log, present)
        # A wrong time unit makes wrong accelerations, exchanged columns make wrong signs: the first of these that is
        # found explains those after it, so the search ends there (but for a scale, which the diagnosis fits).
        for look in (
            unit_of_time(log, present),
            swapped(log, present),
            clipped_counter(log, present),
            position_against_velocity(log, present),
            _whole_numbers(log, present),
            torque_against_motion(log, present, model),
            _against_reference(log, present),
        ):
            seen = list(look)
            found += seen
            if any(one.kind != "scale" for one in seen):
                break
    return found


def _missing(columns: dict[str, Values]) -> Iterator[Suspicion]:
    for name, values in columns.items():
        bad = int(np.sum(~np.isfinite(values)))
        if bad:
            yield Suspicion(
                f"{name} is not a number in {bad} of {len(values)} rows (first in row "
                f"{int(np.argmax(~np.isfinite(values)))}): fill or cut these rows.",
                "stop",
                "missing",
            )


def _still(columns: dict[str, Values]) -> Iterator[Suspicion]:
    for name in ("torque", "velocity", "position"):
        values = columns.get(name)
        if values is None:
            continue
        span, noise = float(np.ptp(values)), noise_level(values)
        others = [other for other in ("velocity", "position") if other in columns and np.ptp(columns[other]) > 0.0]
        if span == 0.0:
            yield Suspicion(
                f"{name} is constant ({values[0]:g}) throughout, so it shows nothing: was the right column "
                f"recorded, and did the machine move?",
                # A coasting machine (constant torque) still shows the ratio of friction to inertia.
                "warn" if others else "stop",
                "still",
            )
        # white noise alone spans 8 to 10 of its standard deviations in 1e4 to 1e6 samples
        elif name != "torque" and span < 12.0 * noise:
            yield Suspicion(
                f"{name} stays within its own noise ({span:.3g} from end to end, noise {noise:.2g}): the "
                f"machine hardly moves; record a run with reversals.",
                "warn",
                "still",
            )


def _one_way(log: Log, columns: dict[str, Values]) -> Iterator[Suspicion]:
    speed, _ = smooth_motion(columns.get("velocity"), columns.get("position"), log.dt)
    moving = np.abs(speed) > 0.05 * np.quantile(np.abs(speed), 0.95)
    forward = float(np.mean(speed[moving] > 0.0)) if np.any(moving) else 0.5
    if min(forward, 1.0 - forward) < ONE_WAY:
        yield Suspicion(
            f"the motion goes in one direction only ({'forward' if forward > 0.5 else 'backward'}), so "
            "friction, a constant torque and a dependence on direction cannot be told apart: record a run with "
            "reversals.",
            "warn",
            "one_way",
        )


def _clock(log: Log, columns: dict[str, Values]) -> Iterator[Suspicion]:
    steps = np.diff(columns["time"])
    if np.any(steps <= 0.0):
        row = int(np.argmax(steps <= 0.0)) + 1
        yield Suspicion(
            f"time does not increase in {int(np.sum(steps <= 0.0))} rows (first in row {row}): remove the "
            f"repeated rows, or split the log where the clock jumps.",
            "stop",
            "clock",
        )
    elif np.any(steps > 1.5 * log.dt):
        lost = int(np.sum(np.round(steps / log.dt) - 1))
        yield Suspicion(
            f"{lost} samples are missing (first after t = "
            f"{columns['time'][int(np.argmax(steps > 1.5 * log.dt))]:g} s): log without drops.",
            "warn",
            "clock",
        )


def _repeated(log: Log, columns: dict[str, Values]) -> Iterator[Suspicion]:
    """Readings that equal the one before exactly, which noise makes impossible unless the reading was not renewed.

    What repeats while the machine rests under a constant torque (a drive that is off) does not count.
    """
    lively = ~_at_rest(log, columns)
    if not np.any(lively):
        return
    for name in ("torque", "velocity", "position"):
        values = columns.get(name)
        if values is None or rounding_step(values) > 0.0:
            continue
        same = (np.diff(values) == 0.0)[lively]
        values = values[1:][lively]
        distinct = len(np.unique(values)) / len(values)
        at_end = np.abs(values) >= 0.9995 * np.max(np.abs(values))
        share = float(np.mean(same & ~at_end))
        # Few distinct values mean rounding; a repetition among many distinct values is a reading that was not renewed.
        if share > REPEATED and distinct > 0.8 * (1.0 - share) and share > 4.0 * (1.0 - distinct - share):
            yield Suspicion(
                f"{share:.2%} of the {name} samples repeat the one before exactly, as if the "
                "reading was not renewed every period: check the logger, or log without drops.",
                "warn",
                "repeated",
            )


def _at_rest(log: Log, columns: dict[str, Values]) -> Values:
    """Rows after the first in which the torque is as before, for long, and nothing moves; shape (samples - 1,)."""
    speed, _ = smooth_motion(columns.get("velocity"), columns.get("position"), log.dt)
    still = np.abs(speed[1:]) < RESTING * np.quantile(np.abs(speed), 0.99)
    quiet = (np.diff(columns["torque"]) == 0.0) & still
    for first, last in runs_of(quiet):
        quiet[first:last] = last - first >= FEWEST_AT_REST
    return quiet


def _off_their_stamps(log: Log, columns: dict[str, Values]) -> Iterator[Suspicion]:
    """Jitter of the time stamps, as a program's loop makes it: a position error that grows with the speed."""
    if "velocity" not in columns or "position" not in columns:
        return
    jitter = stamp_jitter(columns["velocity"], columns["position"], log.dt)
    if jitter is None or jitter < LATE * log.dt:
        return
    size = jitter * float(np.sqrt(np.mean(columns["velocity"] ** 2)))
    yield Suspicion(
        f"the positions were read about {1e3 * jitter:.2g} ms (rms) off their stamps: their rate scatters "
        f"around the velocity in proportion to the speed, which makes them {size:.2g} {'m' if log.linear else 'rad'} "
        "uncertain on average; stamp the readings where they are taken, in the drive.",
        "warn",
        "stamps",
    )


def _clipped(columns: dict[str, Values]) -> Iterator[Suspicion]:
    for name in ("torque", "velocity"):
        values = columns.get(name)
        if values is None or _few_levels(values):
            continue
        step = rounding_step(values)
        # a coarse grid fills its last level anyhow, and a rounded velocity rests on one level wherever it is constant
        if step > 0.05 * np.ptp(values) or (step > 0.0 and name == "velocity"):
            continue
        for end, word in ((np.max(values), "highest"), (np.min(values), "lowest")):
            if end == 0.0:  # a drive that is off, or a standstill: no request was cut there
                continue
            at = values == end
            runs = int(np.sum(at[1:] & at[:-1]))
            # A rounded torque touches its last level at every peak, 2.6 times as often as the mean of the eight levels
            # beside it (a parabola's peak: sqrt(0.5) / (sqrt(8.5) - sqrt(0.5)) * 8). A limit holds it there far longer.
            beside = (np.abs(values - end) < 8.5 * step) & ~at
            expected = 4.0 * float(np.mean(beside)) / 8.0
            if np.mean(at) > max(CLIPPED, expected) and runs > 0.5 * np.sum(at):
                yield Suspicion(
                    f"{name} stays at its {word} value, {end:.4g}, for {np.mean(at):.1%} of the "
                    "time: it is clipped there, and what happens beyond cannot be seen.",
                    "warn",
                    "clipped",
                )


def _few_levels(values: Values) -> bool:
    """Whether the column takes only a few different values, as a relay or a staircase command does."""
    return np.unique(values).size <= FEW_LEVELS


def _whole_numbers(log: Log, columns: dict[str, Values]) -> Iterator[Suspicion]:
    """Motion in steps of exactly one SI unit: no sensor of a servo is as coarse as a radian or a metre."""
    for name in ("position", "velocity"):
        values = columns.get(name)
        if values is None or not np.array_equal(values, np.round(values)) or np.unique(values).size <= FEW_LEVELS:
            continue
        counts = "counts/4096" if name == "position" else "counts/s/4096"
        near = "counts*5e-8" if log.linear else "deg" if name == "position" else "rpm"
        yield Suspicion(
            f"{name} holds whole numbers only, up to {np.max(np.abs(values)):.4g} "
            f"{'m' if log.linear else 'rad'}{'' if name == 'position' else '/s'}: these are another unit or "
            f"counts; give it, such as --columns {name}=NAME:{near}{'' if log.linear else f' or {counts}'}.",
            "warn",
            "unit",
        )
        return


def _whole_torque(log: Log, columns: dict[str, Values]) -> Iterator[Suspicion]:
    """A torque in steps of exactly one unit: drives count per mille of the rated torque, milliamperes, PWM."""
    torque, unit = columns["torque"], log.torque_unit
    if unit not in ("N m", "N", "A", "Arms") or not np.array_equal(torque, np.round(torque)) or _few_levels(torque):
        return
    yield Suspicion(
        f"torque holds whole numbers only, up to {np.max(np.abs(torque)):.4g} {unit}: drives record per mille of the "
        f"rated torque, mA or counts so; give its unit, such as --columns torque=NAME:‰, or torque=NAME:‰*0.0024 "
        f"with {'N' if log.linear else 'N m'} for one of them.",
        "warn",
        "counts",
    )


def _magnitude(log: Log, columns: dict[str, Values]) -> Iterator[Suspicion]:
    """A torque without signs, as from a current sensor that measures magnitudes, of a motion that goes both ways."""
    torque = columns["torque"]
    speed, _ = smooth_motion(columns.get("velocity"), columns.get("position"), log.dt)
    moving = np.abs(speed) > 0.05 * np.quantile(np.abs(speed), 0.95)
    forward = float(np.mean(speed[moving] > 0.0)) if np.any(moving) else 0.0
    size = np.abs(torque)
    # what holds a weight has one sign too, but does not come down to zero
    down = np.quantile(size, 0.05) < 0.1 * np.quantile(size, 0.95)
    if (torque.min() < 0.0 < torque.max()) or not down or not BOTH_WAYS < forward < 1.0 - BOTH_WAYS:
        return
    yield Suspicion(
        f"torque is never {'negative' if torque.max() > 0.0 else 'positive'}, while the motion goes forward for "
        f"{forward:.0%} of its time and comes back: is it recorded without its sign? Friction cannot be told then.",
        "warn",
        "magnitude",
    )


def _against_reference(log: Log, columns: dict[str, Values]) -> Iterator[Suspicion]:
    """Unit of a reference that is followed, beside that of the motion; of the velocity where no position shows it."""
    reference = _values(log.reference)
    if reference is None or not np.all(np.isfinite(reference)):
        return
    half = max(1, min(round(0.01 / log.dt), len(reference) // 20))
    wanted, found = local_polynomial(_middle(reference), half, degree=1), []
    for name in ("velocity", "position"):
        if name in columns:
            # only changes of a position: it counts from anywhere
            pair = np.stack([local_polynomial(columns[name], half, degree=1), wanted])
            motion, asked = pair - pair.mean(axis=1, keepdims=True) if name == "position" else pair
            power, size = float(motion @ motion), float(asked @ asked)
            if size > 0.0 and power > 0.0:
                found.append((float(motion @ asked) / np.sqrt(size * power), np.sqrt(power / size), name))
    least, _, against = min(found, default=(0.0, 1.0, ""))
    together, ratio, name = max(found, default=(0.0, 1.0, ""))
    if together < FOLLOWED:
        if least < -OPPOSITE:
            yield Suspicion(
                f"the reference runs against the {against} (correlation {least:.3g}): if its sign is the other one, "
                "give it, with --columns reference=NAME*-1.",
                "warn",
                "reference",
            )
        return
    named, other = (unit_of(factor, linear=log.linear) for factor in (ratio, 1.0 / ratio))
    if named and "position" not in columns:
        yield Suspicion(
            f"velocity looks like {named}: {ratio:.3g} x the reference; give its unit, such as --columns "
            f"velocity=NAME:{named}.",
            "warn",
            "unit",
        )
    elif other and not (name == "position" and other == "rpm"):  # no angle is counted in rpm
        unit = other if name == "velocity" else other.removesuffix("/s")
        yield Suspicion(
            f"the reference looks like {unit}: {1.0 / ratio:.3g} x the {name}; give its unit, such as --columns "
            f"reference=NAME:{unit}.",
            "warn",
            "reference",
        )


def _middle(values: Values) -> Values:
    if values.size <= MOST_ROWS:
        return values
    start = (values.size - MOST_ROWS) // 2
    return values[start : start + MOST_ROWS]


def _values(column: Any) -> Values | None:
    return None if column is None else np.asarray(getattr(column, "values", column), float)
