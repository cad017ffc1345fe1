"""Lanes: searches from several starts and on several references side by side, and the simulations that each has used.

Every array over lanes has one row a lane, and keeps it to the end of a search: another number of rows would compile
another program, which takes longer (seconds) than most searches run.
"""

import dataclasses
import functools
import math
import time
from collections.abc import Callable

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, PyTree

from fpjax.compiled.gradients import FORWARD_UP_TO, default_scratch, value_and_gradient
from fpjax.compiled.native import native, native_enabled
from fpjax.compiled.programs import Programs

from .parameters import Space
from .problem import Problem, lane_cost, lane_residuals, simulations_of

REVERSE_COUNTS = 4  # simulations that one value and gradient in reverse mode costs, measured (docs/performance.md)

_PROGRAMS = Programs()


@dataclasses.dataclass
class Stopwatch:
    """Seconds spent compiling and computing, and the calls that are timed."""

    compile_seconds: float = 0.0
    run_seconds: float = 0.0

    def call(self, fn: Callable[..., PyTree], *arguments: PyTree) -> PyTree:
        """`fn(*arguments)` compiled as one kernel, its result on the host; compiling is timed separately.

        Compiled once for each `fn`, structure and shape, as long as it is among the programs used last.
        """
        arguments = jax.tree.map(jnp.asarray, _on_device(arguments))
        leaves, structure = jax.tree.flatten(arguments)
        # What a compiled program depends on. jax.jit has a table of its own, but does not time compiling separately.
        key = (fn, structure, tuple((leaf.shape, leaf.dtype) for leaf in leaves), native_enabled())
        begin = time.perf_counter()
        program, made = _PROGRAMS.get(key, lambda: jax.jit(native(fn)).lower(*arguments).compile())
        if made:
            self.compile_seconds += time.perf_counter() - begin
        begin = time.perf_counter()
        # np.asarray waits for the result: jax returns before it is computed.
        result = jax.tree.map(np.asarray, program(*arguments))
        self.run_seconds += time.perf_counter() - begin
        return result

    def step(self, fn: Callable[..., PyTree], *arguments: PyTree) -> PyTree:
        """`fn(*arguments)` for an optimiser's own algebra, result left on the device; compiling is timed separately.

        Compiled once for each `fn`, structure and shape; leaves that are not arrays are static.
        """
        arguments = _on_device(arguments)
        arrays, static = eqx.partition(arguments, eqx.is_array)
        leaves, structure = jax.tree.flatten(arrays)
        key = (fn, structure, str(static), tuple((leaf.shape, leaf.dtype) for leaf in leaves))

        def make() -> PyTree:
            with jax.numpy_dtype_promotion("standard"):  # optax adds integer counters to floats
                return eqx.filter_jit(fn).lower(*arguments).compile()

        begin = time.perf_counter()
        program, made = _PROGRAMS.get(key, make)
        if made:
            self.compile_seconds += time.perf_counter() - begin
        begin = time.perf_counter()
        result = program(*arguments)
        self.run_seconds += time.perf_counter() - begin
        return result


@dataclasses.dataclass
class Lanes:
    """Independent searches that run side by side.

    Attributes:
        problem: what is minimised.
        start: shape (lanes, n), in the parameters' units.
        index: the one reference that each lane is tuned on, shape (lanes,); None for all references together.
        clock: seconds of compiling and computing.
    """

    problem: Problem
    start: np.ndarray
    index: np.ndarray | None
    clock: Stopwatch = dataclasses.field(default_factory=Stopwatch)

    @property
    def count(self) -> int:
        """Number of lanes."""
        return self.start.shape[0]

    @property
    def cases(self) -> int:
        """Number of simulations of one cost."""
        return simulations_of(self.problem, self.index is not None)

    def gradient_simulations(self, mode: str) -> int:
        """Simulations that one value and gradient of a lane counts as: for each case 1 + n forward, 4 in reverse."""
        n = self.start.shape[1]
        forward = mode == "forward" or (mode == "auto" and n <= FORWARD_UP_TO)
        return self.cases * (1 + n if forward else REVERSE_COUNTS)

    def costs(self, values: np.ndarray) -> np.ndarray:
        """Costs of candidates of shape (lanes, candidates, n), in the parameters' units: shape (lanes, candidates)."""
        lanes, candidates, n = values.shape
        # One row for each lane and candidate; every candidate of a lane has the reference of its lane.
        flat = np.reshape(values, (lanes * candidates, n)).astype(self.problem.dtype)
        index = None if self.index is None else np.repeat(self.index, candidates)
        return self.clock.call(_costs, flat, index, self.problem).reshape(lanes, candidates).astype(float)

    def value_and_gradient(self, at: np.ndarray, mode: str) -> tuple[np.ndarray, np.ndarray]:
        """(costs of shape (lanes,), gradients of shape (lanes, n)) at unbounded coordinates of shape (lanes, n)."""
        # float64 on the host, whatever the precision of the loop, for norms and line searches.
        fn = _gradient_function(mode, max(1, self.cases))
        value, gradient = self.clock.call(fn, at.astype(self.problem.dtype), self.index, self.problem)
        return value.astype(float), gradient.astype(float)

    def residuals_and_jacobian(self, at: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """(residuals (lanes, m), Jacobians (lanes, m, n), costs (lanes,)) at unbounded coordinates (lanes, n).

        m = cases x residuals of a case. The squares of the residuals sum to the mean over the cases.
        """
        return self.clock.call(_residuals_and_jacobian, at.astype(self.problem.dtype), self.index, self.problem)

    def residuals(self, at: np.ndarray) -> np.ndarray:
        """Residuals of shape (lanes, m) at unbounded coordinates of shape (lanes, n), without derivatives."""
        return self.clock.call(_residuals, at.astype(self.problem.dtype), self.index, self.problem).astype(float)

    def values(self, at: np.ndarray) -> np.ndarray:
        """Parameter values at unbounded coordinates of shape (..., n)."""
        space = self.problem.space
        # Computed as in the kernels, so that reported gains are exactly those whose cost was computed.
        flat = np.reshape(at, (-1, at.shape[-1])).astype(self.problem.dtype)
        return np.asarray(self.clock.step(_values, space, flat), dtype=float).reshape(at.shape)


@dataclasses.dataclass
class Outcome:
    """The result of a search, by lane.

    Attributes:
        values: best parameters found, shape (lanes, n).
        costs: their costs, shape (lanes,); infinite where every candidate of a lane diverged.
        simulations: simulations used, shape (lanes,).
        iterations: iterations done, shape (lanes,).
        history: of each lane, (simulations so far, best cost so far) after every iteration.
        paths: of each lane, the parameters after every iteration, each of shape (n,).
        reasons: of each lane, why it ended.
        standing: last point of Algorithm 1, shape (lanes, n), not necessarily the best it saw; None for other methods.
        standing_costs: the costs there, shape (lanes,).
    """

    values: np.ndarray
    costs: np.ndarray
    simulations: np.ndarray
    iterations: np.ndarray
    history: list[list[tuple[int, float]]]
    paths: list[list[np.ndarray]]
    reasons: list[str]
    standing: np.ndarray | None = None
    standing_costs: np.ndarray | None = None


class Best:
    """The best point of every lane so far, and its history."""

    def __init__(self, lanes: int, n: int):
        self.values = np.full((lanes, n), np.nan)
        self.costs = np.full(lanes, np.inf)
        self.simulations = np.zeros(lanes, int)
        self.iterations = np.zeros(lanes, int)
        self.history: list[list[tuple[int, float]]] = [[] for _ in range(lanes)]
        self.paths: list[list[np.ndarray]] = [[] for _ in range(lanes)]
        self.reasons = ["stopped at its number of iterations"] * lanes

    def offer(self, lane: int | np.intp, values: np.ndarray, cost: float, simulations: int) -> None:
        """Count one more iteration of a lane: its point, that point's cost, and the simulations that it used."""
        self.simulations[lane] += simulations
        self.iterations[lane] += 1
        if cost < self.costs[lane]:
            self.costs[lane], self.values[lane] = cost, values
        self.history[lane].append((int(self.simulations[lane]), float(self.costs[lane])))
        self.paths[lane].append(np.array(values, dtype=float))

    def outcome(self) -> Outcome:
        """As an `Outcome`."""
        for lane in range(len(self.reasons)):
            if not np.isfinite(self.costs[lane]):
                self.reasons[lane] = "diverged"
        return Outcome(
            self.values, self.costs, self.simulations, self.iterations, self.history, self.paths, self.reasons
        )


def _on_device(tree: PyTree) -> PyTree:
    """numpy arrays put on the device; jnp.asarray would compile a copy program for each shape."""
    return jax.tree.map(lambda leaf: jax.device_put(leaf) if isinstance(leaf, np.ndarray) else leaf, tree)


def _values(space: Space, at: Array) -> Array:
    return jax.vmap(space.values)(at)


def _costs(values: Array, index: Array | None, problem: Problem) -> Array:
    return jax.vmap(lane_cost, (0, None if index is None else 0, None))(values, index, problem)


@functools.lru_cache(maxsize=32)
def _gradient_function(mode: str, cases: int) -> Callable[..., PyTree]:
    """(costs, gradients) of lanes; cached, as `Stopwatch.call` looks programs up by the function object.

    The scratch memory of reverse mode is for one lane, which holds as many simulations as it has cases.
    """

    def costs(at: Array, index: Array | None, problem: Problem) -> Array:
        return _costs(jax.vmap(problem.space.values)(at), index, problem)

    return value_and_gradient(costs, mode=mode, batched=True, scratch=max(1, default_scratch() // cases))


def _residuals(at: Array, index: Array | None, problem: Problem) -> Array:
    def one(at: Array, index: Array | None) -> Array:
        rows = lane_residuals(problem.space.values(at), index, problem)
        # 1 / sqrt(cases): the sum of squares is then the mean cost over the cases.
        return jnp.ravel(rows) / math.sqrt(rows.shape[0])

    return jax.vmap(one, (0, None if index is None else 0))(at, index)


def _residuals_and_jacobian(at: Array, index: Array | None, problem: Problem) -> tuple[Array, Array, Array]:
    def one(at: Array, index: Array | None) -> tuple[Array, Array, Array]:
        def residuals(at: Array) -> PyTree:
            return lane_residuals(problem.space.values(at), index, problem)

        tangents = jnp.eye(at.shape[0], dtype=at.dtype)
        # out_axes None: the residuals do not depend on the tangent, so that they come out once and not n times. The
        # slopes, of shape (cases, residuals, n), get the tangent as last axis.
        rows, slopes = jax.vmap(lambda tangent: jax.jvp(residuals, (at,), (tangent,)), out_axes=(None, 2))(tangents)
        cost = jnp.mean(jax.vmap(problem.objective.cost_of)(rows))
        share = 1.0 / math.sqrt(rows.shape[0])
        return share * jnp.ravel(rows), share * slopes.reshape(-1, at.shape[0]), cost

    return jax.vmap(one, (0, None if index is None else 0))(at, index)
