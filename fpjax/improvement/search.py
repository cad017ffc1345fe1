"""Search: gains that follow well in nearly all machines, by cross-entropy; the current ones are in the race."""

import dataclasses
from collections.abc import Callable

import numpy as np

from .gains import Gains
from .judge import Judge, Score
from .machines import Machines

# One sided 90 % of a normal distribution: mean + 1.28 standard deviations is what nine machines in ten stay below. A
# quantile of sixteen samples would hang on two of them and jump from one to the next; this uses all, and is smooth.
NINE_IN_TEN = 1.28
ROUGHEST = 2.0  # times the current gains' roughness of the torque: more is noise in the motor
SMOOTH = 2e-3  # of the torque's rms: roughness that no motor hears
HARDEST = 1.25  # times the largest torque of the log and of the current gains
FINE = 20.0  # on the cost, for each time over
UNSTABLE = 1e3  # cost of a machine that is unstable, in errors of the current gains
SCREENED, CANDIDATES, ELITE = 32, 16, 5  # of the screen; of a generation, and of it those that the next one follows
GENERATIONS = 12
WIDE, NARROW = 0.25, 0.01  # standard deviation of a search's start and of its end, in shares of the range
CLOSE = 0.002  # the search ends when every deviation is below

Values = np.ndarray


@dataclasses.dataclass(frozen=True)
class AllowedScore:
    """What a candidate must not cost, from the current gains.

    Attributes:
        error: of the current gains, median over machines: the unit of the cost.
        rough: roughness of the torque with the current gains [N m], see `Score`; a little is always allowed.
        peak: largest torque that may be asked for [N m].
    """

    error: float
    rough: float
    peak: float


def limits_of(current: Score, largest: float, allowed: float | None = None) -> AllowedScore:
    """What the current gains cost.

    A limit of the actuator is in the machines: a command beyond it comes to nothing there, and winds up what winds up.
    It is no limit of the command.

    Args:
        current: scores of the current gains, each of shape (machines,).
        largest: torque of the log [N m].
        allowed: that the machine may be given, [limits] torque of its file [N m]; None: a quarter more than it was.
    """
    fine = np.isfinite(current.error)
    if not fine.any():
        return AllowedScore(1.0, np.inf, np.inf)
    peak = HARDEST * max(largest, float(np.median(current.peak[fine]))) if allowed is None else allowed
    rough = float(np.median(allowed_roughness(current)[fine]))
    return AllowedScore(float(np.median(current.error[fine])), rough, max(peak, 1e-300))


def allowed_roughness(current: Score) -> Values:
    """Roughness [N m] that others are compared with, shape (machines,)."""
    return np.maximum(current.rough, SMOOTH * current.torque)


def robust_costs(score: Score, limits: AllowedScore) -> Values:
    """The cost of each candidate, shape (candidates,): mean + 1.28 standard deviations of the tracking error over the
    machines, in units of the current gains' error, and a fine for a rougher or harder torque.
    """
    error = np.where(np.isfinite(score.error), score.error / limits.error, UNSTABLE)
    cost = error.mean(axis=1) + NINE_IN_TEN * error.std(axis=1)
    for over, most in ((score.rough, ROUGHEST * limits.rough), (score.peak, limits.peak)):
        mean = np.where(np.isfinite(over), over, 0.0).mean(axis=1)
        cost = cost + FINE * np.maximum(mean / max(most, 1e-300) - 1.0, 0.0)
    return cost


@dataclasses.dataclass(frozen=True)
class Found:
    """Where a search ended.

    Attributes:
        values: the best gains, shape (gains,).
        cost: theirs.
        cost_now: of the current gains.
        simulations: closed loops that were run.
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
        gains: with their ranges.
        machines: samples.
        first: gains to try first, the current ones among them, shape (guesses, gains).
        limits: from the current gains.
        seed: of the draws.
        progress: called with the share done.

    References:
        Rubinstein, Kroese, "The cross-entropy method", 2004.
    """
    random = np.random.default_rng(seed)
    count = len(gains.gains)
    rows = [random.permutation(SCREENED) for _ in range(count)]
    screen = (np.stack(rows, axis=1) + random.random((SCREENED, count))) / SCREENED
    now = gains.shares(gains.now)
    # Half of the screen covers the whole range evenly, the other half lies about where the loop stands.
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
        middle = 0.5 * best + 0.5 * elite.mean(axis=0)
        spread = np.sqrt(np.mean((elite - middle) ** 2, axis=0))
        floor = NARROW * (1.0 - generation / GENERATIONS)
        deviation = np.clip(0.3 * deviation + 0.7 * spread, floor, WIDE)
        if progress is not None:
            progress((generation + 1) / GENERATIONS)
        if np.all(deviation < CLOSE):
            break
    return Found(gains.values(best), cost, cost_now, used, tuple(history))
