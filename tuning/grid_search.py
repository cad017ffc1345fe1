"""Algorithm 1 as the code of the thesis' Appendix B runs it, and a repaired variant; both over all lanes at once."""

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
    - the best of the four moves is accepted even where it costs more than the current point;
    - the steps halve where the cost is not below the previous iteration's (`>=`; the text says `>`), and never grow;
    - it returns its last point, not the best one (here `values` and `costs` are the best it saw, as for every other
      method, and the last point is `standing`);
    - the `while` of the printed algorithm is reversed, and 20 iterations are allowed where Table 4.2 lists up to 37;
    - of equal costs the first in the order of the moves wins, and gains may become negative: there are no bounds.

    Bounds given by the caller hold, which print does not know: a move beyond one ends on it.

    Args:
        lanes: starts and references; the two parameters in the order (gain_2, gain_1) of Appendix B.
        settings: steps, threshold, iterations.
        stop: target, budget and progress bar.
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
        # Shape (lanes, moves, 2).
        candidates = lanes.problem.space.within(at[:, None, :] + moves[None] * steps[:, None, :])
        costs = lanes.costs(candidates)
        for lane in np.flatnonzero(active):
            chosen = int(np.argmin(np.where(np.isnan(costs[lane]), np.inf, costs[lane])))
            at[lane], standing[lane] = candidates[lane, chosen], costs[lane, chosen]
            # Not at the first iteration, which has no cost to compare with: Appendix B does not evaluate the start.
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

    Any number of parameters. Where a move would take a log parameter to zero or below, it is halved instead; bounds
    given by the caller hold.

    Args:
        lanes: starts and references.
        settings: steps, threshold, iterations.
        stop: target, budget and progress bar.
    """
    at, steps = lanes.start.copy(), _steps(lanes, settings.steps)
    n = at.shape[1]
    # All 3^n - 1 neighbours on the grid of steps, the axes among them; shape (moves, n).
    moves = np.array([move for move in itertools.product((1.0, 0.0, -1.0), repeat=n) if any(move)])
    best = Best(*at.shape)
    log = np.asarray(lanes.problem.space.logarithmic) > 0
    cost = lanes.costs(at[:, None, :])[:, 0]
    for lane in range(lanes.count):
        best.offer(lane, at[lane], cost[lane], lanes.cases)
        # The cost of the start is counted as simulations, but is no iteration.
        best.iterations[lane] = 0
    # `not <` and not `>=`: a start whose cost is not finite may still find a neighbour that runs.
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
    """First step of every parameter in its unit, shape (lanes, n): those given, or half the start."""
    n = lanes.start.shape[1]
    if steps is None:
        return 0.5 * np.abs(lanes.start)
    if len(steps) != n:
        raise InputError(f"steps = {steps} has {len(steps)} numbers for {n} parameters: give one each.")
    return np.tile(np.asarray(steps, float), (lanes.count, 1))
