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

ARMIJO = 1e-4  # fraction of the expected descent that a step must bring
SHORTEST = 1e-7  # shortest step [e-folds] before a lane gives up


def adam(lanes: Lanes, settings: Adam, stop: Stop) -> Outcome:
    """Adam; a lane that meets a diverged point goes back to its best one and forgets its momentum.

    Args:
        lanes: starts and references.
        settings: rate, iterations, tolerance, mode.
        stop: when a lane is over beyond the settings.
    """

    def rate(iteration: int) -> float:
        """From the settings' rate to a tenth of it by a cosine."""
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
                active[lane] = False  # a start that diverged is dropped
            elif healthy[lane] and np.linalg.norm(slope[lane]) <= settings.tolerance * abs(cost[lane]):
                active[lane], best.reasons[lane] = False, "the gradient vanished"
        slope = np.where(healthy[:, None], slope, 0.0)
        moves, state = lanes.clock.step(turn, slope, state, healthy)
        moved = at - rate(iteration) * np.asarray(moves)
        at = np.where(active[:, None], np.where(healthy[:, None], moved, kept), at)
        stop.progress(best)
    return best.outcome()


def lbfgs(lanes: Lanes, settings: LBFGS, stop: Stop) -> Outcome:
    """L-BFGS directions from optax, and a backtracking line search that never leaves a lane worse off.

    Every trial step costs one value and gradient, of all lanes at once, so that an accepted one is at once the next
    iteration's.

    Args:
        lanes: starts and references.
        settings: iterations, tolerance, memory, longest, mode.
        stop: when a lane is over beyond the settings.
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
        tried, tried_slope = lanes.value_and_gradient(trial, settings.mode)
        healthy = np.isfinite(tried) & np.all(np.isfinite(tried_slope), axis=1)
        expected = ARMIJO * length * np.sum(direction * slope, axis=1)
        # The start is compared with infinity: any start that ran is accepted.
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
            norm = np.linalg.norm(direction, axis=1)
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
    """(initial state, update of the accepted lanes) of optax' L-BFGS, the same functions each time."""
    import optax

    transform = optax.scale_by_lbfgs(memory_size=memory)

    def turn(slope: PyTree, state: PyTree, at: PyTree, accepted: PyTree) -> PyTree:
        direction, turned = transform.update(slope, state, at)
        return direction, jax.tree.map(lambda new, old: jnp.where(accepted, new, old), turned, state)

    return jax.vmap(transform.init), jax.vmap(turn)


@functools.lru_cache(maxsize=1)
def _mover() -> tuple[PyTree, PyTree]:
    """(initial state, moves and state of all lanes) of optax' Adam, the same functions each time."""
    import optax

    optimizer = optax.scale_by_adam(b1=0.8, b2=0.95)

    def turn(slope: PyTree, state: PyTree, healthy: PyTree) -> PyTree:
        return optimizer.update(slope, _forgotten(state, healthy))

    return optimizer.init, turn


def _downhill(direction: np.ndarray, slope: np.ndarray) -> np.ndarray:
    """The direction, or the steepest one (an e-fold long) where it does not descend: a kink spoils the curvature."""
    steepest = -slope / np.maximum(np.linalg.norm(slope, axis=1, keepdims=True), 1e-300)
    descends = np.sum(direction * slope, axis=1) < 0.0
    return np.where(descends[:, None] & np.all(np.isfinite(direction), axis=1, keepdims=True), direction, steepest)


def _forgotten(state: PyTree, keep: PyTree) -> PyTree:
    """Adam's state with the momentum of the lanes not kept at zero."""

    def leaf(leaf: PyTree) -> PyTree:
        return jnp.where(keep[:, None], leaf, 0.0) if jnp.ndim(leaf) == 2 else leaf

    return jax.tree.map(leaf, state)
