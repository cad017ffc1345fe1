"""Algorithm 1 as Appendix B runs it, and a repaired variant; both vmapped over starts and references."""

import itertools

import numpy as np

from fpjax.errors import InputError

from .lanes import Best, Lanes, Outcome
from .methods import GridSearch, RepairedGridSearch
from .stopping import Stop

# Appendix B, lines 31-95: signs of (gain_2, gain_1) in the order in which its four simulations run.
MOVES = ((1.0, 1.0), (-1.0, 1.0), (1.0, -1.0), (-1.0, -1.0))


def algorithm_1(lanes: Lanes, settings: GridSearch, stop: Stop) -> Outcome:
    """Algorithm 1 exactly as the code of Appendix B runs it.

    Its quirks, kept here (`algorithm_1_repaired` has none of them):
    - it moves along the diagonals only, always by the whole step: half the points of the grid are never reached;
    - the best of the four moves is accepted even where it is worse than where it stood;
    - the steps halve where the cost is not below the previous iteration's (`>=`; the text says `>`), and never grow;
    - it returns where it stands, not the best it saw (here: the values and their cost are the best it saw, as of
      every other method; where it stands is kept beside them);
    - the `while` of the printed algorithm is reversed, and 20 iterations are allowed where Table 4.2 lists up to 37;
    - of equal costs the first in the order of the moves counts, and gains may become negative, without bounds.

    Bounds that are given hold: a move that would leave them ends on them, which the print does not know.

    Args:
        lanes: starts and references; the two parameters in the order (gain_2, gain_1) of Appendix B.
        settings: steps, threshold, iterations.
        stop: when a lane is over beyond the settings.
    """
    if lanes.start.shape[1] != 2:
        raise InputError(
            f"Algorithm 1 moves exactly two parameters, not {lanes.start.shape[1]}: use grid_repaired for any number."
        )
    at, steps = lanes.start.copy(), _steps(lanes, settings.steps)
    best, moves = Best(*at.shape), np.array(MOVES)
    previous, standing = np.full(lanes.count, np.inf), np.full(lanes.count, np.inf)
    active = np.ones(lanes.count, bool)
    for _ in range(settings.iterations):
        active &= ~stop.before(best, len(moves) * lanes.cases)
        if not active.any():
            break
        candidates = lanes.problem.space.within(at[:, None, :] + moves[None] * steps[:, None, :])
        costs = lanes.costs(candidates)
        for lane in np.flatnonzero(active):
            chosen = int(np.argmin(np.where(np.isnan(costs[lane]), np.inf, costs[lane])))
            at[lane], standing[lane] = candidates[lane, chosen], costs[lane, chosen]
            if best.iterations[lane] and standing[lane] >= previous[lane]:
                steps[lane] /= 2.0
            previous[lane] = standing[lane]
            best.offer(lane, at[lane], standing[lane], len(moves) * lanes.cases)
            if standing[lane] < settings.threshold:
                active[lane] = False
                best.reasons[lane] = f"reached the threshold {settings.threshold:g}"
        stop.progress(best)
    outcome = best.outcome()
    outcome.standing, outcome.standing_costs = at, standing
    return outcome


def algorithm_1_repaired(lanes: Lanes, settings: RepairedGridSearch, stop: Stop) -> Outcome:
    """Algorithm 1 with its quirks repaired: axis moves too, only improvements accepted, halved on failure.

    Any number of parameters; candidates below zero of a log parameter are reflected to half the way to zero, and
    bounds that are given hold.

    Args:
        lanes: starts and references.
        settings: steps, threshold, iterations.
        stop: when a lane is over beyond the settings.
    """
    at, steps = lanes.start.copy(), _steps(lanes, settings.steps)
    n = at.shape[1]
    moves = np.array([move for move in itertools.product((1.0, 0.0, -1.0), repeat=n) if any(move)])
    best = Best(*at.shape)
    log = np.asarray(lanes.problem.space.logarithmic) > 0
    cost = lanes.costs(at[:, None, :])[:, 0]
    for lane in range(lanes.count):
        best.offer(lane, at[lane], cost[lane], lanes.cases)
        best.iterations[lane] = 0
    active = ~(cost < settings.threshold)
    for _ in range(settings.iterations):
        active &= ~stop.before(best, len(moves) * lanes.cases)
        if not active.any():
            break
        candidates = at[:, None, :] + moves[None] * steps[:, None, :]
        candidates = np.where(log & (candidates <= 0.0), 0.5 * at[:, None, :], candidates)
        candidates = lanes.problem.space.within(candidates)
        costs = lanes.costs(candidates)
        for lane in np.flatnonzero(active):
            chosen = int(np.argmin(np.where(np.isnan(costs[lane]), np.inf, costs[lane])))
            if costs[lane, chosen] < cost[lane]:
                at[lane], cost[lane] = candidates[lane, chosen], costs[lane, chosen]
            else:
                steps[lane] /= 2.0
            best.offer(lane, at[lane], cost[lane], len(moves) * lanes.cases)
            if cost[lane] < settings.threshold:
                active[lane] = False
                best.reasons[lane] = f"reached the threshold {settings.threshold:g}"
        stop.progress(best)
    return best.outcome()


def _steps(lanes: Lanes, steps: tuple[float, ...] | None) -> np.ndarray:
    n = lanes.start.shape[1]
    if steps is None:
        return 0.5 * np.abs(lanes.start)
    if len(steps) != n:
        raise InputError(f"steps = {steps} has {len(steps)} numbers for {n} parameters: give one each.")
    return np.tile(np.asarray(steps, float), (lanes.count, 1))
