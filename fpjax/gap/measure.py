"""How large the gap is, how sure that is, and whether anything but noise is left.

Intervals come from a moving-block bootstrap (Kuensch, "The jackknife and the bootstrap for general stationary
observations",
1989): neighbouring errors are alike, so blocks of several autocorrelation times are drawn, not samples.
"""

from dataclasses import dataclass
from typing import Literal

import numpy as np

from .diagnosis import Gap
from .record import noise_level, quantisation

Values = np.ndarray
Interval = tuple[float, float]

DRAWS = 500
SEED = 0  # of the bootstrap
CONFIDENCE = 0.9
TIMES_CORRELATION = 4.0  # a block is this many autocorrelation times long
FEWEST_BLOCKS = 8


@dataclass(frozen=True)
class NoiseFloor:
    """What a perfect model would leave.

    Attributes:
        value: rms, in the signal's unit.
        interval: 90 %.
        source: "repeats" (laps of the reference), "sensor" (its high-frequency noise), "rounding" or "made" (a log in
            which the model is right).
    """

    value: float
    interval: Interval
    source: Literal["repeats", "sensor", "rounding", "made"]


def rms(values: Values) -> float:
    """Root mean square of what is finite; NaN of nothing."""
    values = values[np.isfinite(values)]
    return float(np.sqrt(np.mean(values**2))) if len(values) else float("nan")


def block_length(values: Values) -> int:
    """Samples of a bootstrap block: several integrated autocorrelation times of the squared values, so that bursts
    stay whole.

    Args:
        values: residual, shape (samples,); what is not finite is left out.
    """
    values = values[np.isfinite(values)]
    count = len(values)
    if count < 2 * FEWEST_BLOCKS:
        return 1
    longest = max(1, count // FEWEST_BLOCKS)
    times = [_correlation_time(series, longest) for series in (values, values**2)]
    return int(np.clip(np.ceil(TIMES_CORRELATION * max(times)), 1, longest))


def measure_gap(
    before: Values,
    after: Values,
    floor: NoiseFloor,
    *,
    signal: str,
    unit: str,
    draws: int = DRAWS,
    seed: int = SEED,
) -> Gap:
    """The gap on withheld data, with a 90 % interval of each figure.

    Before, after and the share closed are drawn together, block by block, because the same stretch is hard for both.

    Args:
        before: measured less simulated with the nominal model, withheld samples in order, shape (samples,).
        after: the same samples with the causes in.
        floor: from `noise_floor`.
        signal: "velocity", "position" or "torque".
        unit: of all of them.
        draws: of the bootstrap.
        seed: of the draws.
    """
    known = np.isfinite(before) & np.isfinite(after)
    before, after = before[known], after[known]
    if len(before) == 0:
        nan = float("nan")
        unknown = (nan, nan)
        return Gap(signal, unit, nan, nan, floor.value, nan, unknown, unknown, floor.interval, unknown)
    size = max(block_length(before), block_length(after))
    means = _block_means(np.stack([before**2, after**2]), size, draws, seed)
    drawn_before, drawn_after = np.sqrt(means)
    value_before, value_after = rms(before), rms(after)
    random = np.random.default_rng(seed + 1)
    width = (floor.interval[1] - floor.interval[0]) / 3.29  # 90 % of a normal law is 3.29 standard deviations wide
    drawn_floor = np.maximum(floor.value + width * random.standard_normal(draws), 0.0)
    return Gap(
        signal,
        unit,
        value_before,
        value_after,
        floor.value,
        share_closed(value_before, value_after, floor.value),
        _quantiles(drawn_before),
        _quantiles(drawn_after),
        floor.interval,
        _quantiles(np.array([share_closed(*at) for at in zip(drawn_before, drawn_after, drawn_floor, strict=True)])),
    )


def share_closed(before: float, after: float, floor: float) -> float:
    """(before - after) / (before - noise floor), 0 where there was no gap to close and at most 1."""
    closable = before - floor
    if not closable > 1e-3 * before:
        return 0.0
    return float(min((before - after) / closable, 1.0))


def rms_interval(values: Values, *, draws: int = DRAWS, seed: int = SEED) -> Interval:
    """90 % block-bootstrap interval of the rms of values of shape (samples,)."""
    values = values[np.isfinite(values)]
    if len(values) == 0:
        return float("nan"), float("nan")
    return _quantiles(np.sqrt(_block_means(values[None] ** 2, block_length(values), draws, seed)[0]))


def noise_floor(
    measured: Values, residual: Values | None = None, reference: Values | None = None, *, seed: int = SEED
) -> NoiseFloor:
    """What a perfect model would leave of a sensor's column.

    From laps, where the reference repeats itself and a residual is given: half the mean square of the difference
    between one
    lap and the next, which holds the sensor's noise and whatever of the machine does not repeat. Else from the
    sensor's own
    high-frequency noise, or its rounding.

    Args:
        measured: the sensor's column, uniformly sampled, shape (samples,).
        residual: of the best model, on the same samples (NaN where there is none), in the same unit.
        reference: what the controller was asked to follow, on the same samples.
        seed: of the bootstrap.
    """
    step = quantisation(measured)
    level = noise_level(measured, step)
    if residual is not None and reference is not None:
        lap = lap_length(reference)
        if lap:
            difference = (residual[lap:] - residual[:-lap]) / np.sqrt(2.0)
            difference = difference[np.isfinite(difference)]
            value = rms(difference) if len(difference) >= lap // 4 else 0.0
            # Laps of a quiet simulation differ by the sensor's noise alone, and then the sensor tells it more exactly.
            if value > 1.05 * level:
                return NoiseFloor(value, rms_interval(difference, seed=seed), "repeats")
    rounding = step / np.sqrt(12.0)
    if step > 0.0 and level <= 1.3 * rounding:
        # Rounding is not white where the motion is slow, which fourth differences take for a higher level.
        return NoiseFloor(rounding, (rounding, level), "rounding")
    fourth = np.diff(measured, 4)
    pieces = fourth[: len(fourth) // 50 * 50].reshape(-1, 50)
    spread = 0.5 / np.sqrt(
        max(len(pieces) * 50 / 5.0, 1.0)
    )  # fourth differences leave a fifth of the samples independent
    return NoiseFloor(level, (level * (1.0 - 1.645 * spread), level * (1.0 + 1.645 * spread)), "sensor")


def lap_length(reference: Values) -> int:
    """Samples after which a reference repeats itself; 0 where it does not, is constant, or is not seen twice."""
    count = len(reference)
    centred = reference - np.mean(reference)
    power = float(np.sum(centred**2))
    if power <= 1e-20 * count * max(float(np.max(np.abs(reference))), 1e-300) ** 2:
        return 0
    size = 1 << int(np.ceil(np.log2(2 * count)))
    spectrum = np.abs(np.fft.rfft(centred, size)) ** 2
    together = np.fft.irfft(spectrum, size)[:count]
    squares = np.concatenate([[0.0], np.cumsum(centred**2)])
    lag = np.arange(1, count // 2 + 1)
    # mean square of x[k + lag] - x[k], relative to that of two unrelated stretches
    unlike = (squares[count] - squares[lag] + squares[count - lag] - 2.0 * together[lag]) / (count - lag)
    unlike = unlike / (2.0 * power / count)
    alike = unlike < 1e-3
    away = np.flatnonzero(~alike)
    if len(away) == 0:
        return 0
    later = np.flatnonzero(alike[away[0] :])
    if len(later) == 0:
        return 0
    first = away[0] + later[0]
    stretch = first + np.argmax(~alike[first:]) if np.any(~alike[first:]) else len(alike)
    return int(lag[first + int(np.argmin(unlike[first:stretch]))])


def correlation_time(rows: Values) -> float:
    """Integrated autocorrelation time of residuals [samples]: of so many samples one is independent; 1 for white noise.

    Correlations within four standard deviations of chance count as none, so that noise gives exactly 1.

    Args:
        rows: residuals of equally long stretches that are not joined, shape (samples, stretches).
    """
    count, stretches = rows.shape
    size = 1 << int(np.ceil(np.log2(2 * count)))
    spectrum = np.sum(np.abs(np.fft.rfft(rows, size, axis=0)) ** 2, axis=1)
    longest = max(count // 2, 1)
    together = np.fft.irfft(spectrum, size)[: longest + 1]
    if not together[0] > 0.0:
        return 1.0
    pairs = count - np.arange(longest + 1)
    correlation = together / pairs * count / together[0]
    correlation = np.where(np.abs(correlation) < 4.0 / np.sqrt(pairs * stretches), 0.0, correlation)
    return max(_sokal(correlation[1:]), 1.0)


def sure_gain(before: Values, after: Values, *, draws: int = DRAWS, seed: int = 0) -> bool:
    """Whether a model is better on withheld windows beyond chance: in 95 % of the bootstrap's draws of blocks.

    Args:
        before: loss of each withheld window, in order, shape (windows,).
        after: of the richer model.
        draws: of the bootstrap.
        seed: of the draws.
    """
    gain = before - after
    if len(gain) < 2 or not np.all(np.isfinite(gain)):
        return False
    size = min(2, len(gain) // 2)  # what is withheld is withheld in pairs of windows
    means = _block_means(gain[None], max(size, 1), draws, seed)[0]
    return bool(np.quantile(means, 0.05) > 0.0)


def _correlation_time(values: Values, longest: int) -> float:
    centred = values - np.mean(values)
    count = len(centred)
    size = 1 << int(np.ceil(np.log2(2 * count)))
    spectrum = np.abs(np.fft.rfft(centred, size)) ** 2
    together = np.fft.irfft(spectrum, size)[: longest + 1]
    if together[0] <= 0.0:
        return 1.0
    return float(np.clip(_sokal(together[1:] / together[0]), 1.0, longest))


def _sokal(correlation: Values) -> float:
    # summed up to a window of five times the sum itself (Sokal), so that the tail's noise does not count
    total = 1.0 + 2.0 * np.cumsum(correlation)
    lags = np.arange(1, len(total) + 1)
    enough = np.flatnonzero(lags >= 5.0 * total)
    return float(total[enough[0]] if len(enough) else total[-1])


def _block_means(squares: Values, size: int, draws: int, seed: int) -> Values:
    """Bootstrap means of rows of shape (rows, samples): (rows, draws), the same blocks for each."""
    count = squares.shape[1]
    wrapped = np.concatenate([squares, squares[:, : size - 1]], axis=1) if size > 1 else squares
    total = np.concatenate([np.zeros((len(squares), 1)), np.cumsum(wrapped, axis=1)], axis=1)
    means = (total[:, size:] - total[:, :-size]) / size
    blocks = max(1, round(count / size))
    chosen = np.random.default_rng(seed).integers(0, count, (draws, blocks))
    return np.mean(means[:, chosen], axis=2)


def _quantiles(draws: Values) -> Interval:
    low, high = np.quantile(draws, [0.5 * (1 - CONFIDENCE), 0.5 * (1 + CONFIDENCE)])
    return float(low), float(high)
