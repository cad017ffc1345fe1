"""Readings: what is wrong with a velocity column, as the encoder beside it shows without any model of the machine.

Where the encoder alone resolves the torques, the machine is judged by the encoder. The velocity reading is then
compared with the encoder's own rate (`fpjax.gap.data.late_reading`): scale x rate(t - delay) through a lag, + bias.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from ...logs.arrays import Values
from ...logs.checks.agreement import BLOCKS, in_another_unit, travelled
from ...logs.noise import is_derived
from ..data.late_reading import DELAY, LAG, as_late, compared, lagged, lowest
from ..data.record import Record
from ..fit.band import highest_of_speed
from ..thresholds import THRESHOLDS, Thresholds

ROUNDING = "velocity_quantisation"
LATE = (LAG, DELAY)  # what a closed loop notices, however little of the speed it is
FEW = 10  # observations that what both models leave counts as
FAINT = 1e-3  # of the speed's rms: below it an error of the reading is the differentiators', whatever its evidence
NEARLY = 1e-2  # 1 - correlation^2 that two readings of one motion have at least, by their stamps [1]


@dataclass(frozen=True)
class Reading:
    """One thing that is wrong with a velocity column.

    Attributes:
        effect: name of the vocabulary.
        values: {name: (value, standard deviation, unit)}.
        size: rms of what it changes in the reading, of the rate's rms [1].
        torque: rms of the torque [N m] that would make the nominal mass move by what it changes, as far as it would
            move the machine: each frequency weighed as in `fpjax.gap.fit.candidate.Fit.moving`.
        evidence: log likelihood that it brings [nats], independent samples only.
        rival: what the reading may have in its place; empty for nothing.
        sure: probability of the effect beside its rival [1].
        of_sensor: whether the drive's loop has it too: a column in another unit is the logger's doing.
    """

    effect: str
    values: dict[str, tuple[float, float, str]]
    size: float
    torque: float
    evidence: float
    rival: str = ""
    sure: float = 1.0
    of_sensor: bool = True


def readings(record: Record, inertia: float) -> list[Reading]:
    """What is wrong with a record's velocity column, the largest first; nothing without an encoder beside it.

    Args:
        record: with `reading` and `position`.
        inertia: nominal J [kg m^2].
    """
    if record.reading is None or record.position is None or record.velocity is not None:
        return []
    if _in_another_unit(record):
        return [_rescaled(record, inertia)]  # what else is wrong with it shows once that is mended
    derived = is_derived(record.reading.values, record.position.values)
    dt = record.dt
    speed = float(np.sqrt(np.mean(record.speed**2)))
    both = compared(record.reading.values, record.position, speed, dt)
    if both is None:
        return []
    true, inside, count = both.rate, both.inside, both.count
    name, other = both.ranked
    # What neither leaves is a fault of both models, and no noise: it counts as few observations, however long the log.
    errors = both.errors(name)
    time = lowest(both.late, errors)
    if derived and time <= THRESHOLDS.derived_late * dt:
        return []  # its filter is how it was made, and not a fault of a sensor
    one, two = (max(float(np.min(some)), 1e-300) for some in (errors, both.errors(other)))
    nats = 0.5 * FEW * float(np.log(two / one))
    sure = float(1.0 / (1.0 + np.exp(-nats)))
    least = float(np.min(errors))
    size = float(np.sqrt(np.mean(true[inside] ** 2)))
    spread = float(np.sqrt(least / count))
    shape = as_late(true, name, time, dt)
    slope = float(np.sqrt(np.mean(np.gradient(true[inside], dt) ** 2)))
    found = []
    # Log likelihood ratio to a reading that is not late, for normal errors of unknown variance.
    gained = 0.5 * count * float(np.log(errors[0] / least)) if least > 0.0 else np.inf
    change = shape - true
    key = "time_constant" if name == LAG else "delay"
    # Read off a parabola through three values of the grid: no better known than its rounding, whatever the noise.
    deviation = float(np.hypot(spread / max(slope, 1e-300), (both.late[1] - both.late[0]) / np.sqrt(12.0)))
    if both.open_ended:
        deviation = time  # later than all that was tried: next to nothing is known of how much

    def made(name: str, values: dict[str, tuple[float, float, str]], change: Values, gained: float) -> Reading:
        rms = float(np.sqrt(np.mean(change[inside] ** 2)))
        return Reading(name, values, rms / size, inertia * _moving(record, change[inside]), float(gained))

    first = made(name, {key: (time, deviation, "s")}, change, gained)
    found.append(replace(first, rival=other, sure=sure))
    if derived:
        return found
    slow = both.slowly(shape, time, dt)
    if slow is None:
        return found
    # What a scale of exactly 1 would cost: half of its squared distance in standard deviations.
    gained = 0.5 * ((slow.scale - 1.0) / max(slow.scale_deviation, 1e-12)) ** 2
    values = {"scale": (slow.scale, slow.scale_deviation, "1")}
    found.append(made("velocity_scale_error", values, (slow.scale - 1.0) * shape, gained))
    gained = 0.5 * (slow.bias / max(slow.bias_deviation, 1e-300)) ** 2
    values = {"bias": (slow.bias, slow.bias_deviation, "rad/s")}
    found.append(Reading("velocity_bias", values, abs(slow.bias) / size, 0.0, float(gained)))
    return sorted(found, key=lambda reading: -reading.size)


def _rescaled(record: Record, inertia: float) -> Reading:
    """A velocity column that is a multiple of the position's rate: its scale, from the distance travelled."""
    assert record.position is not None
    assert record.reading is not None
    scale, together = travelled(record.reading.values, record.position.values, record.dt)
    deviation = abs(scale) * float(np.sqrt(max(1.0 - together**2, NEARLY) / BLOCKS))
    values, size = {"scale": (scale, deviation, "1")}, abs(scale - 1.0)
    torque = inertia * size * _moving(record, record.speed)
    return Reading("velocity_scale_error", values, size, torque, np.inf, of_sensor=False)


def _moving(record: Record, change: Values) -> float:
    """Rms of the rate of a change of the speed [rad/s^2], each frequency weighed by how far it moves the machine."""
    corner = 1.0 / (2.0 * np.pi * highest_of_speed([record]))  # of a first-order lag with those weights [s]
    return float(np.sqrt(np.mean(lagged(np.gradient(change, record.dt), corner, record.dt) ** 2)))


def sure_readings(records: Sequence[Record], inertia: float, t: Thresholds = THRESHOLDS) -> tuple[Reading, ...]:
    """What is wrong with the velocity column for certain, however little: of the first log, or of the first log whose
    velocity is in another unit than its position.

    A lag of a period is hardly a hundredth of the speed, but may be all of a good loop's tracking error.

    Args:
        records: with `reading` and `position`, each in one piece.
        inertia: nominal J [kg m^2].
        t: thresholds.
    """
    record = next((one for one in records if _in_another_unit(one)), records[0])
    return tuple(one for one in readings(record, inertia) if one.evidence > t.decisive and one.size > FAINT)


def _in_another_unit(record: Record) -> bool:
    if record.reading is None or record.position is None:
        return False
    return in_another_unit(record.reading.values, record.position.values, record.dt)


def rounding(records: Sequence[Record], step: float, inertia: float) -> Reading:
    """The error of a velocity that is rounded to steps: uniform over one, and white.

    Args:
        records: with that velocity.
        step: [rad/s].
        inertia: nominal J [kg m^2].
    """
    deviation = step / float(np.sqrt(12.0))
    speed = float(np.sqrt(np.mean(np.concatenate([record.speed for record in records]) ** 2)))
    # White noise, differentiated and weighed as `Fit.moving` is: 2 pi times the highest frequency of the speed.
    rate = 2.0 * np.pi * highest_of_speed(records) * deviation
    # The step is read off the column exactly: its interval is narrow but not empty.
    return Reading(ROUNDING, {"step": (step, 6e-5 * step, "rad/s")}, deviation / speed, inertia * rate, np.inf)


def material(readings: Sequence[Reading], t: Thresholds = THRESHOLDS) -> tuple[Reading, ...]:
    """The readings' errors that are large enough to be causes whatever else is amiss.

    Args:
        readings: that are sure, the largest first.
        t: thresholds.
    """
    return tuple(one for one in readings if one.size > t.reading)


def beside_gap(one: Reading, share: float, moving: float) -> float:
    """How large an error of the velocity column is beside the gap: the ratio of two energies [1].

    Its torque is what an observer that is fed the column takes for missing, as is all of it where there is no encoder
    beside the column. A scale or a bias makes little: it counts as it shows in the speed.

    Args:
        one: the error.
        share: rms of the missing torque, of the commanded one's [1].
        moving: rms of the missing torque as far as it moves the machine [N m].
    """
    parts = [(size, gap) for size, gap in ((one.size, share), (one.torque, moving)) if size > 0.0]
    with np.errstate(divide="ignore", over="ignore"):  # where nothing is missing, whatever is misread is all there is
        return float(max((np.square(np.float64(size) / gap) for size, gap in parts), default=0.0))
