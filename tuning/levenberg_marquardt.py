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

# First damping as a fraction of the largest diagonal element of J^T J: almost a Gauss-Newton step, as the residuals are
# almost linear in the coordinates of `Space.linear_below`. A refused step raises it.
DAMPING = 1e-5
FAR = 1e6  # residual in place of those of a diverged point: finite for the linear algebra, and a step that is refused


def levenberg_marquardt(lanes: Lanes, settings: LevenbergMarquardt, stop: Stop) -> Outcome:
    """Levenberg-Marquardt on the residuals of every lane.

    One iteration is one evaluation of residuals and forward-mode Jacobian in the compiled loop, which counts 1 + n
    simulations a case, and one step of optimistix' solver on the linear model that they make. The simulation and the
    linear algebra are programs of their own: a LAPACK call within the loop would forbid compiling it as one kernel.

    Args:
        lanes: starts and references.
        settings: iterations, tolerance.
        stop: target, budget and progress bar.

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
        # Shapes (lanes, m), (lanes, m, n), (lanes,).
        residuals, slopes, cost = lanes.residuals_and_jacobian(trial)
        healthy = np.all(np.isfinite(residuals), axis=1) & np.all(np.isfinite(slopes), axis=(1, 2))
        values = lanes.values(trial)
        for lane in np.flatnonzero(active):
            best.offer(lane, values[lane], float(cost[lane]) if healthy[lane] else np.inf, needed)
        residuals = np.where(healthy[:, None], residuals, FAR).astype(float)
        slopes = np.where(healthy[:, None, None], slopes, 0.0).astype(float)
        if state is None:
            # optimistix starts with a damping of 1 added to J^T J. With the residuals scaled by this factor the largest
            # diagonal element is 1 / DAMPING; the factor is kept for the whole search, as costs are compared.
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
        # The point that optimistix wants evaluated next; `at` is the last accepted one.
        proposed = np.asarray(state.y_eval, dtype=float)
        # A singular J^T J without damping gives NaN: such a lane ends with what it has.
        stuck = ~np.all(np.isfinite(proposed), axis=1)
        active &= ~stuck
        trial = np.where(stuck[:, None], trial, proposed)
        stop.progress(best)
    return best.outcome()


def _in_gains(lanes: Lanes) -> Lanes:
    """The same lanes in the coordinates of `Space.linear_below` the first start; one knee for all lanes."""
    space = lanes.problem.space.linear_below(lanes.start[0])
    return dataclasses.replace(lanes, problem=eqx.tree_at(lambda problem: problem.space, lanes.problem, space))


@functools.lru_cache(maxsize=8)
def _solver(tolerance: float) -> tuple[PyTree, PyTree]:
    """(start, step) of optimistix' solver over lanes; cached, as compiled programs are looked up by their functions."""
    import optimistix

    solver = optimistix.LevenbergMarquardt(rtol=tolerance, atol=tolerance)
    # "bwd" keeps the Jacobian as an array in the state, "fwd" as a function, which cannot be passed between programs.
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
