"""Test vectors of a law: its inputs along a simulated run, the outputs expected, and the allowed differences."""

import dataclasses

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, PyTree
from numpy.typing import DTypeLike

from ..blocks.references import AbstractReference, Recorded
from ..blocks.sensors import AbstractSensor
from ..blocks.signals import Measurement, PlantOutput
from ..errors import InputError
from ..simulation.loop import ClosedLoop
from ..simulation.precision import double_precision
from ..simulation.run import simulate
from ..simulation.scan import astype, make_inputs, make_stepper
from ..simulation.solvers import AbstractPlantSolver
from .law import INPUTS, Law, memory_at_rest, run
from .rounding import Trace, run_bound

ULPS = 2.0  # allowed difference of one step [units in the last place], in either precision
UNITS = {"double": 2.0**-53, "float": 2.0**-24}  # relative rounding error of one operation (unit roundoff)


@dataclasses.dataclass(frozen=True)
class Vectors:
    """Test vectors, one row for each sample; every array is float64.

    Attributes:
        inputs: the law's inputs, shape (samples, inputs).
        states: the state before the step, from the simulation, shape (samples, states).
        outputs: the outputs that the step must give, shape (samples, outputs).
        following: the state after the step, shape (samples, states).
        output_ulps: the last place of the largest term behind each output, shape (samples, outputs).
        state_ulps: the last place of the largest term behind each state after the step, shape (samples, states).
        simulated: the outputs of `fpjax.simulate`, shape (samples, outputs).
        bounds: allowed difference from `simulated` of a run that keeps its own state, shape (samples, outputs).
    """

    inputs: np.ndarray
    states: np.ndarray
    outputs: np.ndarray
    following: np.ndarray
    output_ulps: np.ndarray
    state_ulps: np.ndarray
    simulated: np.ndarray
    bounds: np.ndarray

    @property
    def rows(self) -> np.ndarray:
        """All columns in the order in which the test program reads them."""
        return np.hstack([getattr(self, field.name) for field in dataclasses.fields(self)])


class _Normal(AbstractSensor):
    """A sensor without noise; a reading below the smallest normal number of the law's precision is zero.

    A filtered velocity at rest decays to there, and what is zero in one precision has a sign in the other.

    Attributes:
        sensor: what reads.
        smallest: the smallest normal number [the readings' units] (static).
    """

    sensor: AbstractSensor
    smallest: float = eqx.field(static=True)

    def init(self) -> PyTree:
        """The state of the sensor inside."""
        return self.sensor.init()

    def step(
        self, state: PyTree, output: PlantOutput, noise: tuple[Array, ...], dt: Array
    ) -> tuple[PyTree, Measurement]:
        """The reading of the sensor inside, or zero."""
        del noise
        silent = tuple(jnp.zeros_like(dt) for _ in range(self.sensor.noise_channels))
        state, read = self.sensor.step(state, output, silent, dt)
        return state, jax.tree.map(lambda each: jnp.where(jnp.abs(each) < self.smallest, 0.0, each), read)


def make_vectors(
    law: Law,
    reference: AbstractReference,
    *,
    samples: int,
    solver: str | AbstractPlantSolver = "rk4",
    substeps: int = 1,
    loop: ClosedLoop | None = None,
) -> Vectors:
    """Vectors of a law from a sampled run of its loop in double precision.

    Args:
        law: from `trace_law`.
        reference: what the loop follows.
        samples: length of the run.
        solver: of the plant.
        substeps: solver steps per control period.
        loop: the loop in double precision, where the law's own is rounded to float; None for the law's own.

    Raises:
        InputError: for a run that diverges.
    """
    with double_precision():
        exact = astype(law.loop if loop is None else loop, np.float64)
        exact = dataclasses.replace(exact, sensor=_Normal(exact.sensor, float(np.finfo(law.dtype).tiny)))
        estimates = [f"estimates.{name.removesuffix('_estimate')}" for name in law.outputs[3:]]
        outputs = ("torque", "control", "compensation", *estimates)
        read = ("reference", "measured_velocity", "measured_position")
        assert len(read) == len(INPUTS)
        reference, ahead = astype(reference, np.float64), law.inputs != INPUTS
        if ahead:
            # The law reads r_k+1 now and as r_k in the next step. A formula evaluated for both may differ in the last
            # bit; a table does not.
            stepper = make_stepper(dt=law.dt, samples=samples, solver=solver, stepping="sampled", substeps=substeps)
            now, following = make_inputs(exact, reference, stepper).references
            table = np.append(now, following[-1])
            reference = Recorded(table, law.dt)
        found = simulate(
            exact, reference, dt=law.dt, samples=samples, stepping="sampled", solver=solver,
            substeps=substeps, record=(*read, *outputs),
        )  # fmt: skip
        if found.diverged:
            raise InputError(
                f"The sampled loop diverges at a control period of {law.dt:g} s, so there is nothing to compare with: "
                f'use smaller gains or a smaller period, and try fpjax simulate with [simulation] stepping = "sampled".'
            )
        signals = {name: np.asarray(values, dtype=float) for name, values in found.signals.items()}
        columns = [signals[name] for name in read]
        if ahead:
            columns.append(table[1:])
        inputs = np.stack(columns, axis=1).astype(law.dtype)
        states, answers, following = _stepped(law, inputs)
        trace = Trace(law.program, np.hstack([inputs.astype(float), states]))
        unit = UNITS[law.precision]
        ulps = _last_places(trace.term_sizes(), law.dtype)
        bounds = run_bound(trace, len(law.inputs), (unit, UNITS["double"]), law.precision == "float")
    count = len(law.outputs)
    simulated = np.stack([signals[name] for name in outputs], axis=1)
    # The bound is first order in the rounding: 1 % covers its second order, and one last place the comparison itself.
    bounds = np.where(np.isfinite(bounds), 1.01 * bounds, np.inf) + ulps[:, :count]
    return Vectors(
        inputs.astype(float), states, answers, following, ulps[:, :count], ulps[:, count:], simulated, bounds
    )


def _last_places(sizes: np.ndarray, dtype: DTypeLike) -> np.ndarray:
    """The last place of every size, shape (samples, columns).

    A size that is less than the rounding of the column's largest one is taken for that rounding: a filtered velocity at
    rest decays into the subnormal numbers, which XLA replaces by zero and C does not.
    """
    limits = np.finfo(dtype)
    largest = np.max(np.where(np.isfinite(sizes), sizes, 0.0), axis=0)
    return np.spacing(np.maximum(sizes, np.maximum(limits.eps * largest, limits.tiny)).astype(dtype)).astype(float)


def _stepped(law: Law, inputs: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """(states, outputs, next states) of the law along given inputs, computed by jax.

    The states come from one compiled loop. Each step is then evaluated from these states one operation at a time, for
    all samples side by side. Compiled as a whole, XLA would contract a * b + c into one operation with one rounding
    where the processor has it. C99 may not, and this alone changes a step by up to 4 units in the last place. The
    parameters are repeated for every sample too: XLA divides many numbers by a single one as a product with its
    reciprocal, which is two roundings instead of one.
    """
    dynamic, static = eqx.partition(law.loop, eqx.is_array)
    rows = tuple(jnp.asarray(column) for column in inputs.T)
    period = jnp.asarray(law.dt, law.dtype)
    start = memory_at_rest(law.loop)

    @jax.jit
    def walk(arrays: PyTree, start: PyTree, rows: PyTree) -> PyTree:
        loop = eqx.combine(arrays, static)
        return jax.lax.scan(lambda state, row: (run(loop, row, state, period)[1], state), start, rows)[1]

    states = walk(dynamic, start, rows)
    with jax.disable_jit():
        spread = jax.tree.map(lambda leaf: jnp.broadcast_to(leaf, (len(inputs), *leaf.shape)), (dynamic, period))
        answers, following = jax.vmap(
            lambda given, row, state: run(eqx.combine(given[0], static), row, state, given[1])
        )(spread, rows, states)
    torque, control, compensation, found = answers
    estimates = [found[name.removesuffix("_estimate")] for name in law.outputs[3:]]
    shown = np.stack([np.asarray(each, dtype=float) for each in (torque, control, compensation, *estimates)], axis=1)
    return _columns(states, len(inputs)), shown, _columns(following, len(inputs))


def _columns(state: PyTree, samples: int) -> np.ndarray:
    """A state's numbers along a run in the order of `Law.states`, shape (samples, states)."""
    parts = [np.asarray(leaf, dtype=float).reshape(samples, -1) for leaf in jax.tree.leaves(state)]
    return np.hstack(parts) if parts else np.zeros((samples, 0))
