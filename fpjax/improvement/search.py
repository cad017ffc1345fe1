"""Search by cross-entropy for gains that follow well in nearly all machines; the current gains are a candidate too."""

import dataclasses
from collections.abc import Callable

import numpy as np

from ..gap.data.record import Record
from ..logs.arrays import Values
from ..model_file import Model
from .gains import Gains
from .judge import Judge, Score
from .machines import Machines
from .torque_limit import allowed_torque, largest_torque

# Of a normal distribution nine in ten are below mean + 1.28 standard deviations. The sample quantile of sixteen
# machines would depend on two of them and jump from one to the next; this estimate uses all, and is smooth.
NINE_IN_TEN = 1.28
ROUGHEST = 2.0  # allowed roughness of the torque, relative to the current gains'
SMOOTH = 2e-3  # roughness, relative to the rms torque, that is always allowed
FINE = 20.0  # added to the cost for each 100 % beyond what is allowed
UNSTABLE = 1e3  # error of an unstable machine, in errors of the current gains
# Candidates of the first screening; candidates of a generation; the best of these, which the next one is drawn around.
SCREENED, CANDIDATES, ELITE = 32, 16, 5
GENERATIONS = 12
WIDE, NARROW = 0.25, 0.01  # largest standard deviation of the draws, and smallest at first, in shares of the range
CLOSE = 0.002  # the search ends when every standard deviation is below this


@dataclasses.dataclass(frozen=True)
class AllowedScore:
    """The scale of the cost and the limits of a candidate, from the current gains.

    Attributes:
        error: of the current gains, median over machines: the unit of the cost.
        rough: roughness of the torque with the current gains [N m], see `Score`; at least what is always allowed.
        peak: largest torque that may be commanded [N m].
    """

    error: float
    rough: float
    peak: float


def limits_of(current: Score, record: Record, model: Model) -> AllowedScore:
    """The scale and the limits from the scores of the current gains.

    Args:
        current: scores of the current gains, each of shape (machines,).
        record: of the log.
        model: the nominal model; its file's limits of the torque hold.
    """
    fine = np.isfinite(current.error)
    if not fine.any():
        return AllowedScore(1.0, np.inf, np.inf)
    peak = allowed_torque(model, max(largest_torque(record), float(np.median(current.peak[fine]))))
    rough = float(np.median(allowed_roughness(current)[fine]))
    return AllowedScore(float(np.median(current.error[fine])), rough, max(peak, 1e-300))


def allowed_roughness(current: Score) -> Values:
    """The current gains' roughness of the torque [N m], at least `SMOOTH` of its rms, shape (machines,)."""
    return np.maximum(current.rough, SMOOTH * current.torque)


def robust_costs(score: Score, limits: AllowedScore) -> Values:
    """The cost of each candidate, shape (candidates,).

    It is the mean + 1.28 standard deviations of the tracking error over the machines, in units of the current gains'
    error, plus a penalty for too rough or too large a torque.
    """
    error = np.where(np.isfinite(score.error), score.error / limits.error, UNSTABLE)
    cost = error.mean(axis=1) + NINE_IN_TEN * error.std(axis=1)
    for over, most in ((score.rough, ROUGHEST * limits.rough), (score.peak, limits.peak)):
        mean = np.where(np.isfinite(over), over, 0.0).mean(axis=1)
        cost = cost + FINE * np.maximum(mean / max(most, 1e-300) - 1.0, 0.0)
    return cost


@dataclasses.dataclass(frozen=True)
class Found:
    """The result of a search.

    Attributes:
        values: the best gains, shape (gains,).
        cost: cost of the best gains.
        cost_now: cost of the current gains.
        simulations: number of closed loops that were simulated.
        history: best cost after each generation.
    """

    values: Values
    cost: float
    cost_now: float
    simulations: int
    history: tuple[float, ...]


def search(
    judge: Judge, gains: Gains, machines: Machines, first: Values, limits: AllowedScore, seed: int,
    progress: Callable[[float], None] | None = None,
) -> Found:  # fmt: skip
    """The gains that follow best in nearly all machines.

    Args:
        judge: runs the loops.
        gains: the gains with their ranges.
        machines: to tune on.
        first: gains to try first, the current ones among them, shape (guesses, gains).
        limits: from the current gains.
        seed: of the draws.
        progress: called with the share done.

    References:
        Rubinstein, Kroese, "The cross-entropy method", 2004.
    """
    random = np.random.default_rng(seed)
    count = len(gains.gains)
    # A Latin hypercube: each gain's range is cut into SCREENED equal parts, and each part is used once.
    rows = [random.permutation(SCREENED) for _ in range(count)]
    screen = (np.stack(rows, axis=1) + random.random((SCREENED, count))) / SCREENED
    now = gains.shares(gains.now)
    # Half of the screening covers the whole ranges, the other half a quarter of the range to either side of the current
    # gains.
    near = np.clip(now + 0.5 * (screen[SCREENED // 2 :] - 0.5), 0.0, 1.0)
    shares = np.concatenate([np.stack([now, *(gains.shares(one) for one in first)]), screen[: SCREENED // 2], near])
    costs = robust_costs(judge(gains.values(shares), machines), limits)
    used, cost_now = len(shares) * machines.count, float(costs[0])
    order = np.argsort(costs)
    best, cost = shares[order[0]], float(costs[order[0]])
    middle, deviation = best, np.full(count, WIDE)
    history = [cost]
    for generation in range(GENERATIONS):
        drawn = np.clip(middle + deviation * random.standard_normal((CANDIDATES - 1, count)), 0.0, 1.0)
        drawn = np.concatenate([middle[None], drawn])
        costs = robust_costs(judge(gains.values(drawn), machines), limits)
        used += len(drawn) * machines.count
        elite = drawn[np.argsort(costs)[:ELITE]]
        if costs.min() < cost:
            best, cost = drawn[int(np.argmin(costs))], float(costs.min())
        history.append(cost)
        # The next generation is drawn around a point between the best so far and the mean of the elite. Its deviation
        # follows the elite's spread with some inertia, above a floor that falls to zero, so that it neither collapses
        # early nor wanders late.
        middle = 0.5 * best + 0.5 * elite.mean(axis=0)
        spread = np.sqrt(np.mean((elite - middle) ** 2, axis=0))
        floor = NARROW * (1.0 - generation / GENERATIONS)
        deviation = np.clip(0.3 * deviation + 0.7 * spread, floor, WIDE)
        if progress is not None:
            progress((generation + 1) / GENERATIONS)
        if np.all(deviation < CLOSE):
            break
    return Found(gains.values(best), cost, cost_now, used, tuple(history))
