"""Readings: what is wrong with a velocity column, as the encoder beside it shows without any model of the machine.

Where the encoder alone resolves the torques, the machine is judged by the encoder. The velocity reading is then
compared with the encoder's own rate: scale x rate(t - delay) through a lag, + bias. Both sides pass the same
differentiator (the reading is summed to an angle first), so that its bandwidth does not count.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from ...logs.arrays import Values
from ...logs.checks.agreement import BLOCKS, in_another_unit, travelled
from ...logs.dynamics.derivative import local_polynomial
from ...logs.noise import is_derived
from ..data.record import Record
from ..fit.band import highest_of_speed
from ..thresholds import THRESHOLDS, Thresholds

ROUNDING = "velocity_quantisation"
LATE = ("velocity_lag", "velocity_delay")  # what a closed loop notices, however little of the speed it is
HALF_WIDTHS = (4, 8, 16, 32, 64)  # samples on either side of the differentiator, narrowest first
QUIET = 0.02  # noise of the encoder's rate, of its rms, that a wider differentiator is taken to get below
BESIDE = 0.1  # of the least mean square that a lag or a delay leaves, likewise
FEWEST = 60  # independent samples that a comparison needs
FEW = 10  # observations that what both models leave counts as
FAINT = 1e-3  # of the speed's rms: below it an error of the reading is the differentiators', whatever its evidence
NEARLY = 1e-2  # 1 - correlation^2 that two readings of one motion have at least, by their stamps [1]
LATEST = 30.0  # periods: the longest lag or delay that is tried
GRID = 121  # lags and delays that are tried


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
    if is_derived(record.reading.values, record.position.values):
        return []  # its filter is how it was made, and not a fault of a sensor
    dt = record.dt
    late = np.linspace(0.0, LATEST * dt, GRID)
    compared = _compared(record, late)
    if compared is None:
        return []
    true, inside, count, fits = compared
    errors = {name: np.array([fit[2] for fit in some]) for name, some in fits.items()}
    name, other = sorted(errors, key=lambda key: float(np.min(errors[key])))
    # What neither leaves is a fault of both models, and no noise: it counts as few observations, however long the log.
    one, two = (max(float(np.min(errors[key])), 1e-300) for key in (name, other))
    nats = 0.5 * FEW * float(np.log(two / one))
    sure = float(1.0 / (1.0 + np.exp(-nats)))
    place = int(np.argmin(errors[name]))
    scale, bias, least = fits[name][place]
    size = float(np.sqrt(np.mean(true[inside] ** 2)))
    spread = float(np.sqrt(least / count))
    time = _refined(late, errors[name], place)
    shape = _lagged(true, time, dt) if name == "velocity_lag" else _delayed(true, time, dt)
    slope = float(np.sqrt(np.mean(np.gradient(true[inside], dt) ** 2)))
    found = []
    # Log likelihood ratio to a reading that is not late, for normal errors of unknown variance.
    gained = 0.5 * count * float(np.log(errors[name][0] / least)) if least > 0.0 else np.inf
    change = shape - true
    key = "time_constant" if name == "velocity_lag" else "delay"
    # Read off a parabola through three values of the grid: no better known than its rounding, whatever the noise.
    deviation = float(np.hypot(spread / max(slope, 1e-300), (late[1] - late[0]) / np.sqrt(12.0)))

    def made(name: str, values: dict[str, tuple[float, float, str]], change: Values, gained: float) -> Reading:
        rms = float(np.sqrt(np.mean(change[inside] ** 2)))
        return Reading(name, values, rms / size, inertia * _moving(record, change[inside]), float(gained))

    first = made(name, {key: (time, deviation, "s")}, change, gained)
    found.append(replace(first, rival=other, sure=sure))
    deviation = spread / max(float(np.std(true[inside])), 1e-300)
    # What a scale of exactly 1 would cost: half of its squared distance in standard deviations.
    gained = 0.5 * ((scale - 1.0) / max(deviation, 1e-12)) ** 2
    change = (scale - 1.0) * shape
    found.append(made("velocity_scale_error", {"scale": (scale, deviation, "1")}, change, gained))
    gained = 0.5 * (bias / max(spread, 1e-300)) ** 2
    found.append(Reading("velocity_bias", {"bias": (bias, spread, "rad/s")}, abs(bias) / size, 0.0, float(gained)))
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
    return float(np.sqrt(np.mean(_lagged(np.gradient(change, record.dt), corner, record.dt) ** 2)))


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


def _compared(record: Record, late: Values) -> tuple[Values, slice, float, dict[str, list]] | None:
    """(the encoder's rate; where it counts; independent samples there; lines from it to the reading, by effect and by
    how late the reading is), None where too little is recorded.

    A lag smooths the noise of the encoder's rate too, and would be taken for a lag's doing: the differentiator is the
    narrowest whose noise is small beside what any lag or delay leaves.
    """
    assert record.position is not None
    assert record.reading is not None
    dt, found = record.dt, None
    angle = np.concatenate([[0.0], np.cumsum(0.5 * (record.reading.values[1:] + record.reading.values[:-1])) * dt])
    rate = float(np.sqrt(np.mean(record.speed**2)))
    for half in HALF_WIDTHS:
        true = local_polynomial(record.position.values, half, dt=dt, degree=2, derivative=1)
        read = local_polynomial(angle, half, dt=dt, degree=2, derivative=1)
        # Without the filter's ends, and the samples that the longest delay takes from before the log.
        inside = slice(2 * half + int(LATEST) + 1, -(half + 1))
        count = len(true[inside]) / (2 * half + 1)  # the differentiator correlates the samples within its width
        if count < FEWEST or np.std(true[inside]) == 0.0:
            return found
        fits = {
            "velocity_lag": [_line(_lagged(true, t, dt)[inside], read[inside]) for t in late],
            "velocity_delay": [_line(_delayed(true, t, dt)[inside], read[inside]) for t in late],
        }
        found = true, inside, count, fits
        # Standard deviation of the slope of a quadratic through white noise: sigma / sqrt(sum k^2), per sample.
        noise = record.position.noise / dt / np.sqrt(np.sum(np.arange(-half, half + 1.0) ** 2))
        least = min(fit[2] for some in fits.values() for fit in some)
        if noise < QUIET * rate and noise**2 < BESIDE * least:
            break
    return found


def _line(x: Values, y: Values) -> tuple[float, float, float]:
    """(scale, bias, mean square left) of y = scale x + bias.

    Noise of x makes the regression of y on x too flat, noise of y that of x on y too steep; the scale lies between them
    (Frisch, "Statistical confluence analysis", 1934). It is the one nearest to 1: a scale that either side's noise
    explains is no error, nor is the bias that would come of it where the machine turns one way.
    """
    mean_x, mean_y = float(np.mean(x)), float(np.mean(y))
    spread, other = float(np.mean((x - mean_x) ** 2)), float(np.mean((y - mean_y) ** 2))
    product = float(np.mean((x - mean_x) * (y - mean_y)))
    flat = product / max(spread, 1e-300)
    steep = other / product if product > 0.0 else flat
    scale = float(np.clip(1.0, min(flat, steep), max(flat, steep)))
    bias = mean_y - scale * mean_x
    return scale, bias, float(np.mean((y - scale * x - bias) ** 2))


def _lagged(values: Values, time: float, dt: float) -> Values:
    """Through a first-order lag, exact for a line between samples."""
    if time <= 1e-3 * dt:
        return values
    # x' = (u - x) / time over a period in which u goes from one sample to the next in a straight line.
    decay = np.exp(-dt / time)
    gain = time / dt * (1.0 - decay)
    drive = (1.0 - gain) * values[1:] + (gain - decay) * values[:-1]
    return np.concatenate([values[:1], _decaying(drive, decay, float(values[0]))])


def _decaying(drive: Values, decay: float, before: float) -> Values:
    """y[k] = decay y[k - 1] + drive[k], y[-1] = `before`, a block at a time (scipy.signal takes a second to import)."""
    count, block = len(drive), 64
    # Within a block a product with the matrix of powers of the decay; from block to block the last value is carried on.
    rows = np.pad(drive, (0, -count % block)).reshape(-1, block)
    lag = np.arange(block)[:, None] - np.arange(block)
    within = rows @ np.where(lag >= 0, decay ** np.maximum(lag, 0), 0.0).T
    starts = np.empty(len(rows))
    for row, last in enumerate(within[:, -1]):
        starts[row] = before
        before = last + decay**block * before
    return (within + starts[:, None] * decay ** np.arange(1, block + 1)).ravel()[:count]


def _delayed(values: Values, time: float, dt: float) -> Values:
    index = np.arange(len(values)) - time / dt
    return np.interp(index, np.arange(len(values)), values)


def _refined(grid: Values, errors: Values, place: int) -> float:
    """The bottom of the parabola through a minimum and its neighbours."""
    if not 0 < place < len(grid) - 1:
        return float(grid[place])
    a, b, c = errors[place - 1 : place + 2]
    curve = a - 2.0 * b + c
    shift = 0.5 * (a - c) / curve if curve > 0.0 else 0.0
    return float(grid[place] + shift * (grid[1] - grid[0]))
