"""The one measure of a column's rounding step and noise, and of a velocity that is only a derivative.

Everything that asks "how noisy is this reading" asks here: the log's checks, `fpjax inspect`, the starter model and the
diagnosis. numpy only, float64, any finite input.
"""

from dataclasses import dataclass

import numpy as np

Values = np.ndarray

LOOKED_AT = 200_000  # samples: a longer column is judged by evenly spaced pieces of it
PIECES = 20
FINEST = 1e7  # steps in the range: what is finer is a float's own spacing, or text with many digits
ON_LATTICE = 0.97  # share of the levels that must lie on the grid: a clipped end or a repaired value may not
OFF_GRID = 0.05  # of a step: what text of few digits and single precision move a reading by
FEW = 8  # levels: below it the readings must go through them one by one, or they are a command's levels
ONE_MOVE = 0.995  # share of the moves: a ramp moves by one amount only
SHORTEST = 8  # samples
PIECE = 50  # samples over which the noise is taken to be constant
RESTING = 1e-9  # of the largest piece's noise, below which a piece holds one reading and the arithmetic's rounding
FOURTH = np.sqrt(70.0)  # the fourth difference of white noise has 70 times its variance


def even_pieces(values: Values, longest: int = LOOKED_AT) -> Values:
    """Evenly spaced pieces of a long column, each of consecutive samples, shape (pieces, samples)."""
    if values.size <= longest:
        return values[None, :]
    size = longest // PIECES
    starts = np.linspace(0, values.size - size, PIECES).astype(np.int64)
    return np.stack([values[start : start + size] for start in starts])


def _scaled(values: Values) -> tuple[Values, float]:
    """Values over their largest size, and that size: no square or difference overflows."""
    values = np.asarray(values, dtype=np.float64).ravel()
    size = float(np.max(np.abs(values), initial=0.0))
    if size == 0.0 or not np.isfinite(size):
        return np.zeros_like(values), 0.0
    return values / size, size


# ------------------------------------------------------------------------------------------------- rounding


def rounding_step(column: Values) -> float:
    """The step that a column's readings are rounded to, in the column's unit; 0.0 where none is seen.

    All readings of a rounded column lie on a grid `offset + k step`. A run of equal readings counts as one reading, so
    that a coarse encoder (12 bits a turn, slow motion) shows its grid as well as a fine one. What only looks like a
    grid is left out: a command of a few levels, a ramp that moves by the same amount every sample, a float's own
    spacing (a range of more than 1e7 steps).

    Args:
        column: readings, any unit, finite, shape (samples,).
    """
    values, size = _scaled(column)
    if size == 0.0 or values.size < SHORTEST:
        return 0.0
    blocks = even_pieces(values)
    moves = np.diff(blocks, axis=1).ravel()
    # a float carries about 1e-16 of the largest value; the same reading written twice may differ by that much
    equal = 4.0 * np.finfo(np.float64).eps
    readings = np.concatenate([block[np.concatenate([[True], np.abs(np.diff(block)) > equal])] for block in blocks])
    levels = _distinct(readings, equal)
    if levels.size < 3:
        return 0.0
    step = _grid(levels)
    if step == 0.0:
        return 0.0
    sizes, times = np.unique(np.abs(np.round(moves / step)), return_counts=True)
    if sizes[np.argmax(times)] != 0.0 and times.max() > ONE_MOVE * times.sum():
        return 0.0  # a ramp: every multiple of its own move
    moving = sizes != 0.0
    if levels.size < FEW and times[sizes == 1.0].sum() < 0.9 * times[moving].sum():
        return 0.0
    return step * size


def _distinct(readings: Values, equal: float) -> Values:
    ordered = np.unique(readings)
    return ordered[np.concatenate([[True], np.diff(ordered) > equal])]


def _grid(levels: Values) -> float:
    """The coarsest step whose grid holds the levels; 0.0 where there is none."""
    gaps = np.diff(levels)
    span = float(levels[-1] - levels[0])
    gaps = gaps[gaps > span / FINEST]
    if gaps.size < 2:
        return 0.0
    sample = levels if levels.size <= 4000 else levels[:: levels.size // 4000]
    starts = [float(np.quantile(gaps, share)) for share in (0.5, 0.25, 0.1, 0.03, 0.0)]
    starts += [_common_divisor(gaps, tolerance * span) for tolerance in (3e-3, 3e-4, 3e-5, 3e-6, 3e-7, 3e-8)]
    for start in sorted({start for start in starts if start > span / FINEST}, reverse=True):
        step = _refined(levels, start)
        if step > span / FINEST and _lies_on(sample, step):
            return step
    return 0.0


def _common_divisor(gaps: Values, tolerance: float) -> float:
    """Euclid's algorithm on gaps that are multiples of one step up to a tolerance: levels may be far apart."""
    found = 0.0
    for gap in np.sort(gaps)[:60]:
        large, small = max(found, float(gap)), min(found, float(gap))
        while small > tolerance:
            large, small = small, abs(large - small * round(large / small))
        found = large
    return found


def _refined(levels: Values, step: float) -> float:
    """A step counted over ever wider spans around the middle level, so that it has as many digits as the range."""
    away = levels - levels[levels.size // 2]
    reach = 4.0 * step
    while True:
        near = np.abs(away) <= reach
        counts = np.round(away[near] / step)
        held = np.abs(away[near] / step - counts) < 0.25  # a clipped end is on no grid
        power = float(counts[held] @ counts[held])
        if power > 0.0:
            step = float(away[near][held] @ counts[held]) / power
        if near.all() or not step > 0.0:
            return step
        reach *= 4.0


def _lies_on(levels: Values, step: float) -> bool:
    phase = levels / step
    phase = phase - np.floor(phase)
    # the grid's offset is the direction that the phases share (torques of 12 bits lie half a step off zero)
    offset = np.angle(np.mean(np.exp(2j * np.pi * phase))) / (2.0 * np.pi)
    away = np.abs(phase - offset - np.round(phase - offset))
    return float(np.mean(away < OFF_GRID)) >= ON_LATTICE


# ---------------------------------------------------------------------------------------------------- noise


def noise_level(column: Values, step: float | None = None) -> float:
    """Standard deviation of one reading, in the column's unit: what is new from sample to sample.

    From fourth differences, which a motion hardly has, in many short pieces, and of these the median, so that corners
    of the motion do not count; of those that move where most hold one reading. At least step / sqrt(12), the rounding's
    own; above zero for any column.

    Args:
        column: readings, any unit, finite, shape (samples,).
        step: the column's rounding step; None to look for it with `rounding_step`.
    """
    values, size = _scaled(column)
    if size == 0.0 or values.size < SHORTEST:
        return float(max((step or 0.0) / np.sqrt(12.0), np.finfo(np.float64).tiny))
    step = rounding_step(column) if step is None else step
    fourth = np.diff(even_pieces(values), 4, axis=1) / FOURTH
    length = min(PIECE, fourth.shape[1])
    whole = fourth[:, : fourth.shape[1] // length * length].reshape(-1, length)
    pieces = np.sqrt(np.mean(whole**2, axis=1))
    moving = pieces > RESTING * np.max(pieces)
    if np.any(moving) and not np.median(moving):
        # A machine that mostly rests shows its reading's noise where it moves: at rest a rounded reading has none.
        pieces, fourth = pieces[moving], whole[moving]
    level = float(np.median(pieces))
    spread = float(1.4826 * np.median(np.abs(fourth - np.median(fourth))))
    level = min(level, spread) if spread > 0.0 else level
    floor = 1e-12 * float(np.median(np.abs(values - np.median(values)))) * size
    return float(max(level * size, step / np.sqrt(12.0), floor, np.finfo(np.float64).tiny))


# ----------------------------------------------------------------------------------------- derived velocity

LAGS, LEADS, OWN = 12, 12, 2
WIDE_LAGS = 48
EXACT = 1e-9  # of the velocity's own steps
INDEPENDENT = 0.5  # of the position's passed noise: see `velocity_origin`


@dataclass(frozen=True)
class VelocityOrigin:
    """Whether a velocity column is a measurement of its own.

    Attributes:
        derived: it was computed from the position column, so it holds nothing new.
        left: rms of what position and its own past do not predict, over the rms of its steps [1]: 1e-12 of an exact
            derivative, about 0.2 of a gyro.
        passed: rms of the position's noise that the prediction carries, over the same [1].
    """

    derived: bool
    left: float
    passed: float


def is_derived(velocity: Values, position: Values) -> bool:
    """Whether the velocity was computed from the position column (by the drive or the logger): `velocity_origin`."""
    return velocity_origin(velocity, position).derived


def velocity_origin(velocity: Values, position: Values) -> VelocityOrigin:
    """Tell a rate sensor from a velocity that was derived from the encoder, filtered and rounded or not.

    The velocity is regressed on its own last two values and on the position's differences around the sample. If it
    came from a sensor of its own, the prediction would carry the position's noise and the velocity would not: nothing
    can be predicted better than the noise that the prediction adds. So a remainder well below the noise that the
    position passes through the fitted filter is proof of a derivative, whatever the filter, and whatever the rounding
    of the result as long as it is finer than that noise. A velocity that was filtered until its noise is below its
    own rounding cannot be told, and is not called derived.

    Args:
        velocity: shape (samples,).
        position: at the same times, shape (samples,); a turn's wrap does not matter.
    """
    rate, size = _scaled(velocity)
    angle, _ = _scaled(position)
    steps = float(np.sqrt(np.mean(np.diff(rate) ** 2))) if rate.size > 1 else 0.0
    if size == 0.0 or rate.size != angle.size or rate.size < 8 * (LAGS + LEADS) or steps == 0.0 or np.ptp(angle) == 0.0:
        return VelocityOrigin(False, 1.0, 0.0)
    count = min(rate.size, 8_000)
    start = (rate.size - count) // 2
    rate, angle = rate[start : start + count], angle[start : start + count]
    # Without a step in sight, what is fast in a position may be motion: then only an exact derivative is believed.
    noise = rounding_step(angle) / np.sqrt(12.0)
    tries = [_predict(rate, angle, noise, OWN, LAGS, LEADS)]
    if count > 12 * WIDE_LAGS:
        # without its own past, which rounding blurs: a longer memory of the position instead
        tries.append(_predict(rate, angle, noise, 0, WIDE_LAGS, LEADS))
    origins = [
        VelocityOrigin(bool(left < EXACT * steps or left < INDEPENDENT * passed), left / steps, passed / steps)
        for left, passed in tries
    ]
    derived = [origin for origin in origins if origin.derived]
    return derived[0] if derived else origins[0]


def _predict(rate: Values, angle: Values, noise: float, own: int, lags: int, leads: int) -> tuple[float, float]:
    """(rms left, rms of the position's noise in the prediction), as noise from sample to sample."""
    moves = np.diff(angle)  # moves[k] = angle[k + 1] - angle[k]
    span = np.ptp(angle)
    # a wrap of a turn is no motion
    moves = np.where(np.abs(moves) > 0.5 * span, np.median(moves), moves)
    first, last = lags, rate.size - leads - 1
    rows = np.arange(first, last)
    columns = [moves[rows - 1 + shift] for shift in range(-lags + 1, leads + 1)]
    columns += [rate[rows - shift] for shift in range(1, own + 1)]
    table = np.column_stack([*columns, np.ones(rows.size)])
    scale = np.maximum(np.sqrt(np.mean(table**2, axis=0)), 1e-300)
    target = rate[rows]
    solution, *_ = np.linalg.lstsq(table / scale, target, rcond=1e-13)
    left = target - (table / scale) @ solution
    weights = (solution / scale)[: lags + leads]
    memory = (solution / scale)[lags + leads : lags + leads + own]
    if own and np.any(np.roots(np.concatenate([[1.0], -memory])).real < -0.8):
        # v[k] + v[k-1] = 2 (q[k] - q[k-1]) / dt is the motion's own identity (a pole at -1), and no drive's filter
        return float(np.sqrt(np.mean(left**2))), 0.0
    by_reading = np.diff(np.concatenate([[0.0], weights, [0.0]]))
    passed = noise * float(np.sqrt(by_reading @ by_reading))
    return float(np.sqrt(np.mean(left**2))), passed
