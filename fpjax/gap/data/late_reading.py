"""Late reading: how late a velocity column is behind the encoder's own rate, by a comparison of both without a model.

Both sides pass the same differentiator (the reading is summed to an angle first), so that its bandwidth does not count.
"""

import math
from dataclasses import dataclass

import numpy as np

from ...logs.arrays import Values
from ...logs.dynamics.derivative import local_polynomial, travel
from .channel import Channel

LAG, DELAY = "velocity_lag", "velocity_delay"
HALF_WIDTHS = (4, 8, 16, 32, 64)  # samples on either side of the differentiator, narrowest first
QUIET = 0.02  # noise of the encoder's rate, of its rms, that a wider differentiator is taken to get below
BESIDE = 0.1  # of the least mean square that a lag or a delay leaves, likewise
FEWEST = 60  # independent samples that a comparison needs
LATEST = (30.0, 120.0)  # periods: the longest lag or delay that is tried, and where the longest is the best
SLOWLY = 8.0  # times of a lag that an average is taken over at least
AVERAGES, FEWEST_AVERAGES = 40, 10  # that at least shall fit into a log, and that must
GRID = 121  # lags and delays that are tried


@dataclass(frozen=True)
class Line:
    """reading = scale x + bias, of which `left` is the mean square that it leaves."""

    scale: float
    bias: float
    left: float


@dataclass(frozen=True)
class Comparison:
    """A velocity column beside the encoder's own rate.

    Attributes:
        rate: the encoder's, shape (samples,).
        read: the column, smoothed as that, shape (samples,).
        inside: samples that count.
        width: samples that are smoothed together, of which one counts as independent.
        late: lags and delays that were tried [s].
        lines: from the encoder's rate, as late as that, to the reading; by what makes it late.
    """

    rate: Values
    read: Values
    inside: slice
    width: int
    late: Values
    lines: dict[str, list[Line]]

    @property
    def count(self) -> float:
        """Independent samples."""
        return len(self.rate[self.inside]) / self.width

    @property
    def ranked(self) -> list[str]:
        """What makes the reading late, the likelier one first."""
        return sorted(self.lines, key=lambda key: float(np.min(self.errors(key))))

    @property
    def open_ended(self) -> bool:
        """Whether the reading is later than all that was tried."""
        return int(np.argmin(self.errors(self.ranked[0]))) == len(self.late) - 1

    def errors(self, key: str) -> Values:
        """Mean square left for each of `late`, shape (GRID,)."""
        return np.array([line.left for line in self.lines[key]])

    def slowly(self, rate: Values, time: float, dt: float) -> "Slow | None":
        """Scale and bias from averages over many times of a lag [s]; None where too few of them fit.

        A filter of another form than a lag or a delay takes more off the fast part of a motion, which is no scale: the
        averages are as long as tells most of the scale, and what half as long ones tell otherwise counts as unknown.
        """
        count = len(rate[self.inside])
        length = max(self.width, min(math.ceil(SLOWLY * time / dt), count // AVERAGES))
        tried = []
        while length <= count // FEWEST_AVERAGES:
            x, y = (_averages(each[self.inside], length) for each in (rate, self.read))
            tried.append((float(np.std(x)) * math.sqrt(len(x)), length))
            length *= 2
        if not tried:
            return None
        length = max(tried)[1]
        lines, known = [], []
        for each in (length, max(length // 2, 1)):
            x, y = (_averages(values[self.inside], each) for values in (rate, self.read))
            lines.append(_line(x, y))
            spread = math.sqrt(lines[-1].left / len(x))
            known.append((spread / max(float(np.std(x)), 1e-300), spread))
        line, shorter = lines
        return Slow(
            line.scale,
            line.bias,
            float(np.hypot(known[0][0], line.scale - shorter.scale)),
            float(np.hypot(known[0][1], line.bias - shorter.bias)),
        )


@dataclass(frozen=True)
class Slow:
    """Scale [1] and bias [rad/s] of a velocity column, and their standard deviations."""

    scale: float
    bias: float
    scale_deviation: float
    bias_deviation: float


def _averages(values: Values, length: int) -> Values:
    number = len(values) // length
    return np.mean(values[: number * length].reshape(number, length), axis=1)


def compared(velocity: Values, position: Channel, rms: float, dt: float) -> Comparison | None:
    """How a velocity column follows the encoder's rate; None where too little is recorded.

    Args:
        velocity: shape (samples,).
        position: the encoder's.
        rms: of the speed [rad/s].
        dt: control period [s].
    """
    found = None
    for latest in LATEST:
        found = _compared(velocity, position, rms, dt, latest) or found
        if found is None or not found.open_ended:
            break
    return found


def _compared(velocity: Values, position: Channel, rms: float, dt: float, latest: float) -> Comparison | None:
    """With lags and delays of up to so many periods.

    A lag smooths the noise of the encoder's rate too, and would be taken for a lag's doing: the differentiator is the
    narrowest whose noise is small beside what any lag or delay leaves.
    """
    found = None
    angle, late = travel(velocity, dt), np.linspace(0.0, latest * dt, GRID)
    for half in HALF_WIDTHS:
        true = local_polynomial(position.values, half, dt=dt, degree=2, derivative=1)
        read = local_polynomial(angle, half, dt=dt, degree=2, derivative=1)
        # Without the filter's ends, and the samples that the longest delay takes from before the log.
        inside = slice(2 * half + int(latest) + 1, -(half + 1))
        width = 2 * half + 1  # the differentiator correlates the samples within it
        if len(true[inside]) < FEWEST * width or np.std(true[inside]) == 0.0:
            return found
        lines = {
            LAG: [_line(lagged(true, t, dt)[inside], read[inside]) for t in late],
            DELAY: [_line(delayed(true, t, dt)[inside], read[inside]) for t in late],
        }
        found = Comparison(true, read, inside, width, late, lines)
        # Standard deviation of the slope of a quadratic through white noise: sigma / sqrt(sum k^2), per sample.
        noise = position.noise / dt / np.sqrt(np.sum(np.arange(-half, half + 1.0) ** 2))
        least = min(line.left for some in lines.values() for line in some)
        if noise < QUIET * rms and noise**2 < BESIDE * least:
            break
    return found


def _line(x: Values, y: Values) -> Line:
    """y = scale x + bias.

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
    return Line(scale, bias, float(np.mean((y - scale * x - bias) ** 2)))


def as_late(values: Values, key: str, time: float, dt: float) -> Values:
    """Values [any unit] through a lag or a delay of some time [s], whichever `key` says."""
    return lagged(values, time, dt) if key == LAG else delayed(values, time, dt)


def lagged(values: Values, time: float, dt: float) -> Values:
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


def delayed(values: Values, time: float, dt: float) -> Values:
    """As they were some time [s] earlier, on lines between the samples."""
    index = np.arange(len(values)) - time / dt
    return np.interp(index, np.arange(len(values)), values)


def lowest(grid: Values, errors: Values) -> float:
    """The bottom of the parabola through the least of some errors and its neighbours."""
    place = int(np.argmin(errors))
    if not 0 < place < len(grid) - 1:
        return float(grid[place])
    a, b, c = errors[place - 1 : place + 2]
    curve = a - 2.0 * b + c
    shift = 0.5 * (a - c) / curve if curve > 0.0 else 0.0
    return float(grid[place] + shift * (grid[1] - grid[0]))
