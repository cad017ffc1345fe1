"""Rounding step and noise of a column, and whether a velocity was only differentiated from the position.

The log's checks, `fpjax inspect`, the starter model and the diagnosis all take a sensor's noise from here, so that they
agree. numpy only, float64, any finite input.
"""

from dataclasses import dataclass

import numpy as np

from .arrays import Values

LOOKED_AT = 200_000  # [samples]: a longer column is judged by evenly spaced pieces of it
PIECES = 20
FINEST = 1e7  # [steps in the range]: a finer grid is a float's own spacing, or text with many digits
RARE = 0.1  # of the median level's readings: a level with fewer tells nothing of the grid
ON_LATTICE = 0.97  # share of the levels that must lie on the grid: a clipped end or a repaired value may not
OFF_GRID = 0.05  # of a step: by so much text of few digits and single precision displace a reading
FEW = 8  # [levels]: with fewer, the readings must go through them one by one, or they are the levels of a command
ONE_MOVE = 0.995  # share of the moves: a ramp moves by one amount only
SHORTEST = 8  # [samples]
PIECE = 50  # [samples] over which the noise is taken to be constant
RESTING = 1e-9  # of the largest piece's noise: below it a piece is one reading with the rounding of the arithmetic
FOURTH = np.sqrt(70.0)  # fourth difference of white noise: 1^2 + 4^2 + 6^2 + 4^2 + 1^2 = 70 times its variance


def even_pieces(values: Values, longest: int = LOOKED_AT) -> Values:
    """Evenly spaced pieces of a long column, each of consecutive samples, shape (pieces, samples)."""
    if values.size <= longest:
        return values[None, :]
    size = longest // PIECES
    starts = np.linspace(0, values.size - size, PIECES).astype(np.int64)
    return np.stack([values[start : start + size] for start in starts])


def _scaled(values: Values) -> tuple[Values, float]:
    """Values divided by the largest magnitude, and that magnitude, so that no square or difference overflows."""
    values = np.asarray(values, dtype=np.float64).ravel()
    size = float(np.max(np.abs(values), initial=0.0))
    if size == 0.0 or not np.isfinite(size):
        return np.zeros_like(values), 0.0
    return values / size, size


# ------------------------------------------------------------------------------------------------- rounding


def rounding_step(column: Values) -> float:
    """The step that a column's readings are rounded to, in the column's unit; 0.0 where none is seen.

    All readings of a rounded column lie on a grid `offset + k step`. A run of equal readings counts as one reading, so
    that a coarse encoder (12 bits per turn, slow motion) shows its grid as well as a fine one. Three things only look
    like a grid and give 0: a command of a few levels, a ramp that moves by the same amount every sample, and the
    spacing of floats (more than 1e7 steps in the range).

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
    # A relay's command or a staircase has few levels too, but jumps across several of them at once. A coarse sensor
    # passes from a level to its neighbour in nearly all of its moves.
    if levels.size < FEW and times[sizes == 1.0].sum() < 0.9 * times[moving].sum():
        return 0.0
    return step * size


def _distinct(readings: Values, equal: float) -> Values:
    """The levels that readings take, ascending; without those that hardly any takes, where others are `FEW` or more.

    Where a coarse column was mended, each of a few interpolated readings is a level of its own.
    """
    ordered, counts = np.unique(readings, return_counts=True)
    first = np.flatnonzero(np.concatenate([[True], np.diff(ordered) > equal]))
    levels, counts = ordered[first], np.add.reduceat(counts, first)
    usual = levels[counts >= RARE * np.median(counts)]
    return usual if usual.size >= FEW else levels


def _grid(levels: Values) -> float:
    """The coarsest step whose grid holds the levels; 0.0 where there is none."""
    gaps = np.diff(levels)
    span = float(levels[-1] - levels[0])
    gaps = gaps[gaps > span / FINEST]
    if gaps.size < 2:
        return 0.0
    # Candidates from two sides: quantiles of the distances between neighbouring levels are the step itself where most
    # levels are visited, the common divisor finds it where they lie far apart. Coarse candidates first: every divisor
    # of the true step holds the levels as well.
    sample = levels if levels.size <= 4000 else levels[:: levels.size // 4000]
    starts = [float(np.quantile(gaps, share)) for share in (0.5, 0.25, 0.1, 0.03, 0.0)]
    starts += [_common_divisor(gaps, tolerance * span) for tolerance in (3e-3, 3e-4, 3e-5, 3e-6, 3e-7, 3e-8)]
    for start in sorted({start for start in starts if start > span / FINEST}, reverse=True):
        step = _refined(levels, start)
        if step > span / FINEST and _lies_on(sample, step):
            return step
    return 0.0


def _common_divisor(gaps: Values, tolerance: float) -> float:
    """Euclid's algorithm on distances between levels, each a multiple of one step up to a tolerance."""
    found = 0.0
    for gap in np.sort(gaps)[:60]:
        large, small = max(found, float(gap)), min(found, float(gap))
        while small > tolerance:
            large, small = small, abs(large - small * round(large / small))
        found = large
    return found


def _refined(levels: Values, step: float) -> float:
    """The step, fitted over ever wider spans around the middle level, for as many digits as the range allows.

    Counting steps over the whole range at once would fail: a start value that is wrong by 1 % is wrong by a whole step
    after 100 levels.
    """
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
    # The grid's offset is the circular mean of the phases (torques of 12 bits lie half a step off zero).
    offset = np.angle(np.mean(np.exp(2j * np.pi * phase))) / (2.0 * np.pi)
    away = np.abs(phase - offset - np.round(phase - offset))
    return float(np.mean(away < OFF_GRID)) >= ON_LATTICE


# ---------------------------------------------------------------------------------------------------- noise


def noise_level(column: Values, step: float | None = None) -> float:
    """Standard deviation of the noise of one reading, in the column's unit.

    Estimated from fourth differences, in which a smooth motion hardly shows. The column is cut into short pieces, and
    the median of their noise is taken, so that corners of the motion do not count. Where most pieces are at rest (they
    hold one rounded reading), only the others are used. The result is at least step / sqrt(12), the standard deviation
    of the rounding itself, and above zero for any column.

    Args:
        column: readings, any unit, finite, shape (samples,).
        step: the column's rounding step; None to look for it with `rounding_step`.
    """
    values, size = _scaled(column)
    if size == 0.0 or values.size < SHORTEST:
        return float(max((step or 0.0) / np.sqrt(12.0), np.finfo(np.float64).tiny))
    step = rounding_step(column) if step is None else step
    parts = even_pieces(values)
    fourth = np.diff(parts, 4, axis=1) / FOURTH
    # Where a drive repeats most of its readings, five equal ones tell nothing of the noise.
    same = np.abs(np.diff(parts, axis=1)) <= 4.0 * np.finfo(np.float64).eps
    alike = same[:, :-3] & same[:, 1:-2] & same[:, 2:-1] & same[:, 3:]
    length = min(PIECE, fourth.shape[1])
    whole, held = (each[:, : fourth.shape[1] // length * length].reshape(-1, length) for each in (fourth, alike))
    pieces = np.sqrt(np.mean(whole**2, axis=1))
    moving = pieces > RESTING * np.max(pieces)
    if np.any(moving) and not np.median(moving):
        # A machine that mostly rests shows its reading's noise where it moves: at rest a rounded reading has none.
        pieces, fourth, alike = pieces[moving], whole[moving], held[moving]
    level = float(np.median(pieces))
    if np.median(alike) and not np.all(alike):
        fourth = fourth[~alike]
    # 1.4826 times the median absolute deviation is the standard deviation of Gaussian noise, and ignores outliers.
    # The smaller of the two estimates is taken: what motion leaves in the differences only adds to either.
    spread = float(1.4826 * np.median(np.abs(fourth - np.median(fourth))))
    level = min(level, spread) if spread > 0.0 else level
    # a noise-free simulated column still needs a positive noise: the fits divide by it
    floor = 1e-12 * float(np.median(np.abs(values - np.median(values)))) * size
    return float(max(level * size, step / np.sqrt(12.0), floor, np.finfo(np.float64).tiny))


# ----------------------------------------------------------------------------------------- derived velocity

LAGS, LEADS, OWN = 12, 12, 2  # [samples] of the position before and after, and of the velocity's own past
WIDE_LAGS = 48  # [samples]
EXACT = 1e-9  # of the velocity's steps: a smaller remainder is the rounding of the arithmetic
FEWEST_MOVING = 200  # [samples] in which the velocity's reading changes, to know how much of a remainder is rounding
SURE = 3.0  # standard deviations of the mean square of that rounding
INDEPENDENT = 0.5  # of the position noise in the prediction: with less left, the velocity holds the same noise


@dataclass(frozen=True)
class VelocityOrigin:
    """Whether a velocity column is a measurement of its own.

    Attributes:
        derived: it was computed from the position column, so it holds no information of its own.
        left: rms of what the position and the velocity's own past do not predict, divided by the rms of the velocity's
            steps [1]: 1e-12 for an exact derivative, about 0.2 for a gyro.
        passed: rms of the position's noise in the prediction, divided by the same [1].
    """

    derived: bool
    left: float
    passed: float


def is_derived(velocity: Values, position: Values) -> bool:
    """Whether the velocity was computed from the position column (by the drive or the logger): `velocity_origin`."""
    return velocity_origin(velocity, position).derived


def velocity_origin(velocity: Values, position: Values) -> VelocityOrigin:
    """Tell a rate sensor from a velocity that was derived from the encoder, filtered and rounded or not.

    The velocity is regressed on its own last two values and on the position's differences around the sample. If the
    velocity came from a sensor of its own, the prediction would contain the position's noise and the velocity would
    not, so the remainder could not be smaller than that noise and the velocity's own rounding together. A remainder
    that exceeds the rounding by well below the position noise that the fitted filter passes is therefore proof of a
    derivative, whatever the filter. A velocity that was filtered until hardly any of that noise is left beside its own
    rounding cannot be recognised, and is not called derived.

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
    # Only rounding is surely noise: without a rounding step, what is fast in a position may be motion. The noise is 0
    # then, and only an exact derivative is recognised.
    noise = rounding_step(angle) / np.sqrt(12.0)
    step = rounding_step(rate)
    tries = [_predict(rate, angle, noise, step, OWN, LAGS, LEADS)]
    if count > 12 * WIDE_LAGS:
        # A coarsely rounded velocity spoils its own past as a regressor (errors in variables): a longer memory of the
        # position takes its place.
        tries.append(_predict(rate, angle, noise, step, 0, WIDE_LAGS, LEADS))
    origins = [
        VelocityOrigin(bool(left < EXACT * steps or unrounded < INDEPENDENT * passed), left / steps, passed / steps)
        for left, unrounded, passed in tries
    ]
    derived = [origin for origin in origins if origin.derived]
    return derived[0] if derived else origins[0]


def _predict(
    rate: Values, angle: Values, noise: float, step: float, own: int, lags: int, leads: int
) -> tuple[float, float, float]:
    """(rms of the remainder, what of it may be more than rounding, rms of the position's noise in the prediction).

    All in the velocity's unit.
    """
    moves = np.diff(angle)  # moves[k] = angle[k + 1] - angle[k]
    span = np.ptp(angle)
    # a wrap at a full turn is not motion
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
    size = float(np.sqrt(np.mean(left**2)))
    unrounded = min(size, _beyond_rounding(left, rate[first - 1 : last + 1], step))
    weights = (solution / scale)[: lags + leads]
    memory = (solution / scale)[lags + leads : lags + leads + own]
    if own and np.any(np.roots(np.concatenate([[1.0], -memory])).real < -0.8):
        # v[k] + v[k-1] = 2 (q[k] - q[k-1]) / dt is the motion's own identity (a pole at -1), and no drive's filter
        return size, unrounded, 0.0
    # the filter's weights are on differences of the position: by reading, they are the differences of these weights
    by_reading = np.diff(np.concatenate([[0.0], weights, [0.0]]))
    passed = noise * float(np.sqrt(by_reading @ by_reading))
    return size, unrounded, passed


def _beyond_rounding(left: Values, readings: Values, step: float) -> float:
    """Upper bound of the rms of a remainder without the rounding of the readings it belongs to, in their unit.

    The rounding is uniform over a step where the reading moves on by a step at every sample; where the machine rests or
    turns steadily it is whatever it happens to be.

    Args:
        left: shape (samples,).
        readings: with one more at either end, shape (samples + 2,).
        step: of the rounding; 0 for none.
    """
    moves = np.abs(np.diff(readings)) > 0.5 * step
    rows = moves[:-1] & moves[1:]
    if step == 0.0 or np.sum(rows) < FEWEST_MOVING:
        return np.inf
    # Mean square of a uniform error: step^2 / 12, its variance step^4 / 180.
    doubt = SURE * step**2 / np.sqrt(180.0 * np.sum(rows))
    return float(np.sqrt(max(np.mean(left[rows] ** 2) - step**2 / 12.0, 0.0) + doubt))
