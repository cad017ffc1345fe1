"""Adam and L-BFGS (optax) in log-gain space, all starts and references side by side."""

import functools
import math

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import PyTree

from .lanes import Best, Lanes, Outcome
from .methods import LBFGS, Adam
from .stopping import Stop

ARMIJO = 1e-4  # fraction of the predicted descent that a step must reach (Nocedal and Wright, 2nd ed., (3.4))
SHORTEST = 1e-7  # step length [e-folds] below which a lane ends: the gain no longer changes in single precision


def adam(lanes: Lanes, settings: Adam, stop: Stop) -> Outcome:
    """Adam; a lane that reaches a diverged point goes back to its best point with its moment estimates at zero.

    Args:
        lanes: starts and references.
        settings: rate, iterations, tolerance, mode.
        stop: target, budget and progress bar.
    """

    def rate(iteration: int) -> float:
        """Step length [e-folds]: a cosine from the settings' rate down to a tenth of it."""
        return settings.rate * (0.1 + 0.45 * (1.0 + math.cos(math.pi * iteration / settings.iterations)))

    begin, turn = _mover()
    at = lanes.problem.space.coordinates(lanes.start)
    best, kept = Best(*at.shape), at.copy()
    state = lanes.clock.step(begin, at)
    needed = lanes.gradient_simulations(settings.mode)
    active = np.ones(lanes.count, bool)
    for iteration in range(settings.iterations):
        active &= ~stop.before(best, needed)
        if not active.any():
            break
        cost, slope = lanes.value_and_gradient(at, settings.mode)
        healthy = np.isfinite(cost) & np.all(np.isfinite(slope), axis=1)
        values = lanes.values(at)
        for lane in np.flatnonzero(active):
            improved = healthy[lane] and cost[lane] < best.costs[lane]
            best.offer(lane, values[lane], cost[lane] if healthy[lane] else np.inf, needed)
            if improved:
                kept[lane] = at[lane]
            if not np.isfinite(best.costs[lane]):
                active[lane] = False  # the start itself diverged: there is no point to go back to
            elif healthy[lane] and np.linalg.norm(slope[lane]) <= settings.tolerance * abs(cost[lane]):
                active[lane], best.reasons[lane] = False, "the gradient vanished"
        # NaN would stay in the moments for ever, even of a lane that goes back.
        slope = np.where(healthy[:, None], slope, 0.0)
        moves, state = lanes.clock.step(turn, slope, state, healthy)
        # Ended lanes stay in the batch, unchanged: another number of rows would compile another program.
        moved = at - rate(iteration) * np.asarray(moves)
        # Diverged lanes go back to `kept`, the coordinates of their best point; ended ones stay where they are.
        at = np.where(active[:, None], np.where(healthy[:, None], moved, kept), at)
        stop.progress(best)
    return best.outcome()


def lbfgs(lanes: Lanes, settings: LBFGS, stop: Stop) -> Outcome:
    """L-BFGS directions from optax, with a backtracking line search that accepts descent only.

    An iteration is one trial step of all lanes. Its value and gradient are computed together, so that an accepted trial
    starts the next iteration without a further simulation.

    Args:
        lanes: starts and references.
        settings: iterations, tolerance, memory, longest, mode.
        stop: target, budget and progress bar.
    """
    initial, turn = _turner(settings.memory)
    at = lanes.problem.space.coordinates(lanes.start)
    best = Best(*at.shape)
    needed = lanes.gradient_simulations(settings.mode)
    cost, slope = np.full(lanes.count, np.inf), np.zeros_like(at)
    state: PyTree = lanes.clock.step(initial, at)
    direction, length = np.zeros_like(at), np.ones(lanes.count)
    trial = at.copy()
    active = np.ones(lanes.count, bool)
    for iteration in range(settings.iterations):
        active &= ~stop.before(best, needed)
        if not active.any():
            break
        # Shapes: at, trial, direction, slope (lanes, n); cost, tried, length (lanes,).
        tried, tried_slope = lanes.value_and_gradient(trial, settings.mode)
        healthy = np.isfinite(tried) & np.all(np.isfinite(tried_slope), axis=1)
        # Armijo: f(x + a d) <= f(x) + c a grad f . d; `expected` is negative.
        expected = ARMIJO * length * np.sum(direction * slope, axis=1)
        # The first trial is the start itself, with no cost to compare with: it is accepted unless it diverged.
        accepted = active & healthy & (tried <= cost + expected if iteration else True)
        values = lanes.values(trial)
        for lane in np.flatnonzero(active):
            best.offer(lane, values[lane], tried[lane] if healthy[lane] else np.inf, needed)
        at = np.where(accepted[:, None], trial, at)
        cost = np.where(accepted, tried, cost)
        slope = np.where(accepted[:, None], tried_slope, slope)
        if accepted.any():
            preconditioned, state = lanes.clock.step(turn, slope, state, at, accepted)
            direction = np.where(accepted[:, None], _downhill(-np.asarray(preconditioned), slope), direction)
            # In coordinates of e-folds: a Newton step of 10 would multiply a gain by 22,000.
            norm = np.linalg.norm(direction, axis=1)
            # A new direction is tried at its full (quasi-Newton) length, a refused one at a quarter of the last.
            limit = np.minimum(1.0, settings.longest / np.maximum(norm, 1e-300))
            length = np.where(accepted, limit, 0.25 * length)
        else:
            length = 0.25 * length
        for lane in np.flatnonzero(active):
            if not np.isfinite(cost[lane]):
                active[lane] = False
            elif np.linalg.norm(slope[lane]) <= settings.tolerance * abs(cost[lane]):
                active[lane], best.reasons[lane] = False, "the gradient vanished"
            elif length[lane] * np.linalg.norm(direction[lane]) < SHORTEST:
                active[lane], best.reasons[lane] = False, "no step descends further"
        trial = at + length[:, None] * direction
        stop.progress(best)
    return best.outcome()


@functools.lru_cache(maxsize=8)
def _turner(memory: int) -> tuple[PyTree, PyTree]:
    """(initial state, update of the accepted lanes) of optax' L-BFGS.

    Cached, so that the same function objects come back: compiled programs are looked up by them.
    """
    import optax

    transform = optax.scale_by_lbfgs(memory_size=memory)

    def turn(slope: PyTree, state: PyTree, at: PyTree, accepted: PyTree) -> PyTree:
        direction, turned = transform.update(slope, state, at)
        return direction, jax.tree.map(lambda new, old: jnp.where(accepted, new, old), turned, state)

    return jax.vmap(transform.init), jax.vmap(turn)


@functools.lru_cache(maxsize=1)
def _mover() -> tuple[PyTree, PyTree]:
    """(initial state, moves and state of all lanes) of optax' Adam; cached for the reason that `_turner` is."""
    import optax

    # Averages over about 5 and 20 steps. optax' defaults (0.9, 0.999: 10 and 1000 steps) would remember the start
    # throughout a search of 100 steps.
    optimizer = optax.scale_by_adam(b1=0.8, b2=0.95)

    def turn(slope: PyTree, state: PyTree, healthy: PyTree) -> PyTree:
        return optimizer.update(slope, _forgotten(state, healthy))

    return optimizer.init, turn


def _downhill(direction: np.ndarray, slope: np.ndarray) -> np.ndarray:
    """The direction, or steepest descent (one e-fold long) where it does not descend or is not finite.

    The cost has kinks (|.| of an error that changes sign), across which gradient differences are no curvature.
    """
    steepest = -slope / np.maximum(np.linalg.norm(slope, axis=1, keepdims=True), 1e-300)
    descends = np.sum(direction * slope, axis=1) < 0.0
    return np.where(descends[:, None] & np.all(np.isfinite(direction), axis=1, keepdims=True), direction, steepest)


def _forgotten(state: PyTree, keep: PyTree) -> PyTree:
    """Adam's state with the moments of the lanes that are not kept set to zero; the common step count stays."""

    def leaf(leaf: PyTree) -> PyTree:
        return jnp.where(keep[:, None], leaf, 0.0) if jnp.ndim(leaf) == 2 else leaf

    return jax.tree.map(leaf, state)
