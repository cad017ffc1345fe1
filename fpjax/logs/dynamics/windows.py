"""Windows of a log with free start values, and least squares over them in which an odd window counts little."""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from ..arrays import Values
from ..noise import noise_level
from .derivative import smooth_motion
from .regression import mean_direction, mean_held

FEWEST_SAMPLES, FEWEST_WINDOWS = 16, 8
POINTS = 64  # readings in a window: more are averaged in groups, which keeps the arrays small
MOST_ROWS = 240_000  # [samples]: of a longer log, evenly spaced pieces are used
ROUNDS = 40  # of reweighting
RESTS = 3.0  # of the noise of a point: a window whose points scatter less is at rest [1]
CLEAR = 10.0  # times as far the fastest window must move for noise not to hide which windows rest [1]
BIAS = 0.1  # of the largest speed: a level at rest is less [1]


@dataclass(frozen=True)
class Piece:
    """Consecutive samples: what the sensor read, and every term of the equation of motion over each period."""

    reading: Values  # position [rad] or velocity [rad/s], shape (samples,)
    terms: Values  # shape (samples, 6): u, -sgn v, -v, -1, -sin q, -cos q, means over each period
    noise: float  # standard deviation of one reading
    order: int  # integrals from acceleration to the reading: 2 for a position, 1 for a velocity
    dt: float  # [s]


def pieces_of(torque: Values, velocity: Values | None, position: Values | None, dt: float) -> Iterator[Piece]:
    """A log as one piece, or a long one as a dozen, evenly spaced; the arguments are those of `fit_rigid`."""
    size = torque.size
    starts = [0] if size <= MOST_ROWS else np.linspace(0, size - MOST_ROWS // 12, 12).astype(int)
    length = size if size <= MOST_ROWS else MOST_ROWS // 12
    noise: float | None = None
    for start in starts:
        part = slice(int(start), int(start) + length)
        rate = None if velocity is None else velocity[part]
        place = None if position is None else position[part]
        # A drive's own velocity is delayed by its filter: the position shows better when the motion reverses.
        speed, angle = smooth_motion(None if place is not None else rate, place, dt)
        reading = place if place is not None else rate
        assert reading is not None
        noise = noise_level(reading) if noise is None else noise
        columns = [
            torque[part], -mean_direction(speed), -mean_held(speed), -np.ones(speed.size), -mean_held(np.sin(angle)),
            -mean_held(np.cos(angle)),
        ]  # fmt: skip
        yield Piece(reading, np.stack(columns, axis=1), noise, 2 if place is not None else 1, dt)


@dataclass(frozen=True)
class Cut:
    """Windows of one length, start values eliminated."""

    y: Values  # readings, shape (windows, points)
    x: Values  # terms integrated up to the reading, shape (windows, points, terms)
    noise: float  # standard deviation of one point
    seconds: float
    order: int  # as of `Piece`

    @property
    def noise_energy(self) -> float:
        """Expected sum of squares of the noise in one window."""
        return self.noise**2 * (self.y.shape[1] - self.order)

    @property
    def noise_share(self) -> float:
        """Share of noise in the readings' energy [1]."""
        return self.noise_energy * len(self.y) / max(float(np.sum(self.y**2)), 1e-300)

    @property
    def moved(self) -> float:
        """Rms reading, without its best constant or line, that a constant unit acceleration makes in a window.

        It moves the position by t^2 / 2 and the velocity by t: T^2 / sqrt(720) and T / sqrt(12) over a length T.
        """
        return self.seconds**2 / np.sqrt(720.0) if self.order == 2 else self.seconds / np.sqrt(12.0)


def windows_of(pieces: list[Piece], seconds: float, count: int) -> Cut | None:
    """All windows of a length, without those at rest where these are the most; None for too few.

    At rest any torque below the static friction is held. Most of all windows would set the residual from which on one
    counts little, and those that move would be the odd ones.
    """
    dt = pieces[0].dt
    size = round(seconds / dt)
    group = max(1, size // POINTS)
    size = size // group * group
    if size < FEWEST_SAMPLES:
        return None
    readings, terms = [], []
    for piece in pieces:
        many = (piece.reading.size - 1) // size
        if many:
            readings.append(piece.reading[: many * size].reshape(many, size))
            terms.append(piece.terms[: many * size, :count].reshape(many, size, count))
    if not readings:
        return None
    order, noise = pieces[0].order, pieces[0].noise / np.sqrt(group)
    y = _means(np.concatenate(readings), group)
    moves = _moving(y, noise, order)
    if np.mean(moves) > 0.5:
        moves[:] = True
    if np.count_nonzero(moves) < FEWEST_WINDOWS:
        return None
    y, x = y[moves], _means(_integrated(np.concatenate(terms)[moves], dt, order), group)
    # Start angle and speed of each window are eliminated by projecting readings and regressors onto what is
    # orthogonal to a constant (velocity) or to a constant and a line (position).
    time = np.linspace(0.0, 1.0, y.shape[1])
    free, _ = np.linalg.qr(np.stack([time**power for power in range(order)], axis=1))
    y = y - (y @ free) @ free.T
    x = x - np.einsum("nj,wjk->wnk", free, np.einsum("wnk,nj->wjk", x, free))
    return Cut(y, x, noise, seconds, order)


def _moving(y: Values, noise: float, order: int) -> Values:
    """Whether the machine moves in each window; in all of them where noise could hide which do, shape (windows,).

    A velocity's level at rest, a sensor's bias, is that of most windows where it is small beside the fastest.
    """
    level = np.median(np.mean(y, axis=1)) if order == 1 else np.mean(y, axis=1, keepdims=True)
    if order == 1 and abs(level) > BIAS * np.max(np.abs(y)):
        level = 0.0
    moved = np.sqrt(np.mean((y - level) ** 2, axis=1))
    clear = np.max(moved) > CLEAR * RESTS * noise
    return (moved > RESTS * noise) | (not clear)


def _integrated(terms: Values, dt: float, order: int) -> Values:
    """Speed (order 1) or position (order 2) at the start of each period, of an acceleration held over each period.

    The integration of a held value is exact. Shapes in and out: (windows, samples, terms).
    """
    zero = np.zeros((terms.shape[0], 1, terms.shape[2]))
    speed = np.concatenate([zero, np.cumsum(terms, axis=1)[:, :-1]], axis=1) * dt
    if order == 1:
        return speed
    return np.concatenate([zero, np.cumsum(speed * dt + 0.5 * dt * dt * terms, axis=1)[:, :-1]], axis=1)


def _means(values: Values, group: int) -> Values:
    shape = (values.shape[0], values.shape[1] // group, group, *values.shape[2:])
    return values.reshape(shape).mean(axis=2)


@dataclass(frozen=True)
class Solved:
    """Least squares over windows with a weight each."""

    solution: Values  # shape (terms,)
    spread: Values  # its covariance, shape (terms, terms)
    left: Values  # rms residual of each window, shape (windows,)
    weight: Values  # of each window, shape (windows,)

    @property
    def middle(self) -> float:
        """Median rms residual."""
        return float(np.median(self.left))


def robust(target: Values, table: Values, noise_energy: float = 0.0, rounds: int = ROUNDS) -> Solved | None:
    """Least squares over all windows, each weighted by its rms residual; None where a term is not identifiable.

    Iteratively reweighted with Cauchy's weights (Holland, Welsch, 1977), one weight per window. Covariance by the
    sandwich estimator with a window as a cluster (Liang, Zeger, 1986): readings within a window share its model error,
    so they are not independent, but windows are. Its last factor corrects for the number of fitted parameters.

    Args:
        target: shape (windows, points).
        table: shape (windows, points, terms).
        noise_energy: sum of squares of the noise in the first term of one window, which is taken off its energy.
        rounds: of reweighting; with one, all windows count alike.
    """
    count = table.shape[2]
    gram = np.einsum("wnk,wnl->wkl", table, table)
    gram[:, 0, 0] -= noise_energy
    right = np.einsum("wnk,wn->wk", table, target)
    scale = np.sqrt(np.maximum(np.einsum("wkk->k", gram), 0.0))
    if not (scale[0] > 0.0 and np.all(np.isfinite(scale))):
        return None
    # columns to length one, as in `regression.solved`: torque and angle differ by orders of magnitude
    scale[scale == 0.0] = 1.0
    gram, right = gram / np.outer(scale, scale), right / scale
    weight = np.ones(len(target))
    solution, left = np.zeros(count), np.zeros(len(target))
    for turn in range(rounds):
        total = np.einsum("w,wkl->kl", weight, gram)
        solution, _, rank, _ = np.linalg.lstsq(total, weight @ right, rcond=1e-12)
        if rank < count:  # one direction or one speed only: the parameters are not identifiable
            return None
        left = np.sqrt(np.mean((target - table @ (solution / scale)) ** 2, axis=1))
        middle = float(np.median(left))
        if middle == 0.0 or turn + 1 == rounds == 1:
            break
        weight = 1.0 / (1.0 + (left / middle) ** 2)
    slopes = weight[:, None] * (right - np.einsum("wkl,l->wk", gram, solution))
    inverse = np.linalg.pinv(np.einsum("w,wkl->kl", weight, gram), rcond=1e-12)
    spread = inverse @ (slopes.T @ slopes) @ inverse * len(target) / max(len(target) - count, 1)
    return Solved(solution / scale, spread / np.outer(scale, scale), left, weight)
