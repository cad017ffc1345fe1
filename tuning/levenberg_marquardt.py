"""Levenberg-Marquardt (optimistix) on the residual vector, all starts and references side by side."""

import dataclasses
import functools

import equinox as eqx
import jax
import numpy as np
from jaxtyping import PyTree

from fpjax.errors import InputError

from .lanes import Best, Lanes, Outcome
from .methods import LevenbergMarquardt
from .stopping import Stop

DAMPING = 1e-5  # first damping, as a fraction of the largest diagonal element of J^T J
FAR = 1e6  # stands for the residuals of a diverged point, so that the step to it is refused


def levenberg_marquardt(lanes: Lanes, settings: LevenbergMarquardt, stop: Stop) -> Outcome:
    """Levenberg-Marquardt.

    One iteration is one pass of residuals and forward-mode Jacobian through the native loop, which counts 1 + n
    simulations a case, and one step of optimistix' solver on that linear model: its linear algebra stays out of the
    kernel that simulates.

    Args:
        lanes: starts and references.
        settings: iterations, tolerance.
        stop: when a lane is over beyond the settings.

    Raises:
        InputError: for aggregate="worst", which is no sum of squares.
    """
    if lanes.problem.aggregate != "mean":
        raise InputError(
            "Levenberg-Marquardt needs a sum of squares, not the worst case: use 'lbfgs' or 'adam' for it."
        )
    lanes = _in_gains(lanes)
    trial = lanes.problem.space.coordinates(lanes.start)
    best = Best(*trial.shape)
    needed = lanes.gradient_simulations("forward")
    start, step = _solver(settings.tolerance)
    state: PyTree = None
    factor = np.ones(lanes.count)
    at: PyTree = trial
    active = np.ones(lanes.count, bool)
    for _ in range(settings.iterations):
        active &= ~stop.before(best, needed)
        if not active.any():
            break
        residuals, slopes, cost = lanes.residuals_and_jacobian(trial)
        healthy = np.all(np.isfinite(residuals), axis=1) & np.all(np.isfinite(slopes), axis=(1, 2))
        values = lanes.values(trial)
        for lane in np.flatnonzero(active):
            best.offer(lane, values[lane], float(cost[lane]) if healthy[lane] else np.inf, needed)
        residuals = np.where(healthy[:, None], residuals, FAR).astype(float)
        slopes = np.where(healthy[:, None, None], slopes, 0.0).astype(float)
        if state is None:
            # optimistix begins with a damping of 1: the residuals are scaled so that this means what DAMPING says.
            largest = np.max(np.linalg.norm(slopes, axis=1), axis=1)
            factor = 1.0 / (np.sqrt(DAMPING) * np.where(largest > 0.0, largest, 1.0))
        residuals, slopes = factor[:, None] * residuals, factor[:, None, None] * slopes
        model = (trial, residuals, slopes)
        if state is None:
            state = lanes.clock.step(start, at, model)
        at, state, ended = lanes.clock.step(step, at, model, state)
        ended = np.asarray(ended)
        for lane in np.flatnonzero(active):
            if not np.isfinite(best.costs[lane]):
                active[lane] = False
            elif ended[lane]:
                active[lane], best.reasons[lane] = False, "parameters and residuals no longer change"
        proposed = np.asarray(state.y_eval, dtype=float)
        stuck = ~np.all(np.isfinite(proposed), axis=1)
        active &= ~stuck
        trial = np.where(stuck[:, None], trial, proposed)
        stop.progress(best)
    return best.outcome()


def _in_gains(lanes: Lanes) -> Lanes:
    """The same lanes in coordinates that are linear in the gains below the first start."""
    space = lanes.problem.space.linear_below(lanes.start[0])
    return dataclasses.replace(lanes, problem=eqx.tree_at(lambda problem: problem.space, lanes.problem, space))


@functools.lru_cache(maxsize=8)
def _solver(tolerance: float) -> tuple[PyTree, PyTree]:
    """(start, step) of optimistix' solver over lanes."""
    import optimistix

    solver = optimistix.LevenbergMarquardt(rtol=tolerance, atol=tolerance)
    # "bwd": the Jacobian is an array in the state, which may then cross from one jit to the next.
    options, tags = {"jac": "bwd"}, frozenset()

    def linear(at: PyTree, model: PyTree) -> PyTree:
        origin, residuals, slopes = model
        return residuals + slopes @ (at - origin), None

    def start(at: PyTree, model: PyTree) -> PyTree:
        def one(at: PyTree, model: PyTree) -> PyTree:
            shape = jax.eval_shape(lambda: linear(at, model)[0])
            return solver.init(linear, at, model, options, shape, None, tags)

        return eqx.filter_vmap(one)(at, model)

    def step(at: PyTree, model: PyTree, state: PyTree) -> PyTree:
        def one(at: PyTree, model: PyTree, state: PyTree) -> PyTree:
            at, state, _ = solver.step(linear, at, model, options, state, tags)
            return at, state, state.terminate

        return eqx.filter_vmap(one)(at, model, state)

    return start, step
