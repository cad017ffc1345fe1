"""`fpjax.simulate`: one run of a closed loop, from its settings to a `Run`."""

from enum import IntEnum
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
from jax.core import Tracer
from jaxtyping import Array

from .blocks.controllers import TransferFunction
from .blocks.references import AbstractReference
from .compiled.native import native
from .errors import InputError
from .loop import ClosedLoop, LoopState
from .metrics import AbstractMeasure
from .scan import Stepper, Stepping, make_inputs, make_stepper, roll
from .solvers import AbstractPlantSolver
from .stability import warn_if_stiff


class Status(IntEnum):
    """How a run ended."""

    COMPLETED = 0
    DIVERGED = 1


SENTENCES = {
    Status.COMPLETED: "completed",
    Status.DIVERGED: "diverged: a signal left the range of finite numbers; use smaller gains or a smaller step",
}


class Run(eqx.Module):
    """What a simulation leaves.

    Attributes:
        time: [s], shape (samples,).
        signals: what was recorded, by name, each of shape (samples,).
        measures: what was measured, by name.
        status: a `Status` as an integer.
        final_state: state one step after the last sample.
    """

    time: Array
    signals: dict[str, Array]
    measures: dict[str, Array]
    status: Array
    final_state: LoopState

    @property
    def diverged(self) -> bool:
        """Whether the run left the range of finite numbers."""
        return int(self.status) == Status.DIVERGED

    @property
    def message(self) -> str:
        """The status as a sentence."""
        return SENTENCES[Status(int(self.status))]


def simulate(
    loop: ClosedLoop,
    reference: AbstractReference,
    *,
    dt: Any,
    duration: float | None = None,
    samples: int | None = None,
    solver: str | AbstractPlantSolver = "rk4",
    stepping: Stepping = "continuous",
    substeps: int = 1,
    measures: dict[str, AbstractMeasure] | None = None,
    record: str | tuple[str, ...] = (),
    initial: LoopState | None = None,
    key: Array | None = None,
    throw: bool = False,
) -> Run:
    """Simulate a closed loop.

    Args:
        loop: the closed loop.
        reference: what it follows.
        dt: step, or control period when sampled [s].
        duration: [s]; samples run from 0 to duration, both included.
        samples: number of samples, instead of `duration`.
        solver: "euler", "heun", "ode3" or "rk4"; "exact" resolves sticking exactly (sampled stepping).
        stepping: "continuous" or "sampled".
        substeps: solver steps per control period when sampled.
        measures: what to accumulate, by name of your choice.
        record: signals to store, by the names of `Signals`; an estimate as "estimates.coulomb".
        initial: state to start from; None for rest.
        key: `jax.random` key of the sensor's noise; None for none.
        throw: raise where the run diverged, instead of saying so in `status`.

    Returns:
        A `Run`.

    Raises:
        InputError: for settings that cannot be, or with `throw` for a run that diverged.
    """
    stepper = make_stepper(
        dt=dt, duration=duration, samples=samples, solver=solver, stepping=stepping, substeps=substeps
    )
    if not isinstance(dt, Tracer):
        if stepping == "sampled":
            _check_periods(loop, float(dt))
        warn_if_stiff(loop, float(dt) / (substeps if stepping == "sampled" else 1), stepper.solver)
    run = _run(
        loop, reference, stepper, measures or {}, (record,) if isinstance(record, str) else tuple(record), initial, key
    )
    if throw and run.diverged:
        raise InputError(f"The run {run.message}.")
    return run


def _check_periods(loop: ClosedLoop, dt: float) -> None:
    """A transfer function is discretised when it is built: at another control period it would be another controller."""
    for part in jax.tree.leaves(loop, is_leaf=lambda leaf: isinstance(leaf, TransferFunction)):
        period = part.period if isinstance(part, TransferFunction) else None
        if period is not None and abs(dt / period - 1.0) > 1e-6:
            raise InputError(
                f"The TransferFunction was discretised for a period of {period:g} s, but dt = {dt:g} s: build it with "
                f"period={dt:g}."
            )


@eqx.filter_jit
def _run(
    loop: ClosedLoop,
    reference: AbstractReference,
    stepper: Stepper,
    measures: dict[str, AbstractMeasure],
    record: tuple[str, ...],
    initial: LoopState | None,
    key: Array | None,
) -> Run:
    inputs = make_inputs(loop, reference, stepper, key)
    dynamic, static = eqx.partition((loop, inputs, stepper, measures, initial), eqx.is_array)

    def scan(arrays: Any) -> Any:
        loop, inputs, stepper, measures, initial = eqx.combine(arrays, static)
        return roll(loop, inputs, stepper, measures, record, initial)

    finals, recorded, state = native(scan)(dynamic)
    return Run(inputs.time, recorded, finals, run_status(finals, state), state)


def run_status(finals: dict[str, Array], state: LoopState) -> Array:
    """`Status` of a run from its measures and its final state: anything not finite, or past 1e15, is diverged."""
    leaves = [leaf for leaf in jax.tree.leaves(state) if eqx.is_inexact_array(leaf)]  # a counter cannot diverge
    healthy = jnp.array(True)
    for leaf in leaves:
        healthy = healthy & jnp.all(jnp.abs(leaf) < 1e15)
    for value in finals.values():
        healthy = healthy & jnp.all(~jnp.isnan(value))
    return jnp.where(healthy, int(Status.COMPLETED), int(Status.DIVERGED))
