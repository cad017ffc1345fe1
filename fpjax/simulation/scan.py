"""The scan over time: every simulation of a closed loop runs through `roll`."""

from typing import Any, Literal, NamedTuple, SupportsFloat

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax.core import Tracer
from jaxtyping import Array, Float, PyTree

from ..blocks.block import as_parameter
from ..blocks.controllers import AbstractController
from ..blocks.references import AbstractReference, Recorded
from ..blocks.signals import Signals
from ..compiled.native import scan_loop
from ..errors import InputError
from .loop import ClosedLoop, LoopState
from .metrics import AbstractMeasure
from .solvers import AbstractPlantSolver, AbstractSolver, get_solver

Stepping = Literal["continuous", "sampled"]
Checkpoint = Literal["auto", "none", "step", "nested"]


class Stepper(eqx.Module):
    """The time steps of a run. The step is an array leaf, so changing it never recompiles; all else is static.

    Attributes:
        dt: step, or control period when sampled [s].
        samples: number of samples, t = 0 included (static).
        solver: the solver (static).
        stepping: "continuous" (the whole loop is one ODE) or "sampled" (torque held over a period) (static).
        substeps: solver steps per control period when sampled (static).
        checkpoint: what is stored for reverse mode, see `native.scan_loop` (static).
    """

    dt: Float[Array, ""]
    samples: int = eqx.field(static=True)
    solver: AbstractPlantSolver = eqx.field(static=True)
    stepping: Stepping = eqx.field(static=True)
    substeps: int = eqx.field(static=True)
    checkpoint: Checkpoint = eqx.field(static=True)


def make_stepper(
    *,
    dt: SupportsFloat,
    duration: float | None = None,
    samples: int | None = None,
    solver: str | AbstractPlantSolver = "rk4",
    stepping: Stepping = "continuous",
    substeps: int = 1,
    checkpoint: Checkpoint = "auto",
) -> Stepper:
    """A `Stepper` from the settings as in `servo.toml`.

    Args:
        dt: step, or control period when sampled [s].
        duration: [s]; the samples then run from 0 to duration, both included. One of `duration` and `samples`.
        samples: number of samples.
        solver: "euler", "heun", "ode3", "rk4", "exact" or a solver.
        stepping: "continuous" or "sampled".
        substeps: solver steps per control period when sampled.
        checkpoint: see `Stepper`.

    Raises:
        InputError: for an invalid step or duration.
    """
    for name, value in (("dt", dt), ("duration", duration)):
        # a tracer has __float__ as well: dt may be differentiated or batched, so only its type is checked
        if isinstance(value, str | bool) or np.ndim(value) or not (value is None or hasattr(value, "__float__")):
            raise InputError(f"{name} must be a number of seconds, got {type(value).__name__} {value!r}.")
    for name, value in (("samples", samples), ("substeps", substeps)):
        if value is not None and not hasattr(value, "__index__"):
            raise InputError(f"{name} must be a whole number, got {type(value).__name__} {value!r}.")
    if not isinstance(dt, Tracer) and not float(dt) > 0.0:
        raise InputError(f"dt must be positive, got {float(dt):g} s; 1e-4 s is usual here.")
    if (duration is None) == (samples is None):
        raise InputError("Give either duration [s] or samples: exactly one of them.")
    if samples is None:
        assert duration is not None
        if not float(dt) <= duration < float("inf"):
            raise InputError(
                f"duration must be finite and at least one step of dt = {float(dt):g} s, got {duration:g} s."
            )
        # rounded and not cut off: 1.0 / 1e-4 is 9999.999... in floating point
        samples = round(duration / float(dt)) + 1
    if samples < 1 or substeps < 1:
        raise InputError(f"samples = {samples} and substeps = {substeps} must both be at least 1.")
    if stepping not in ("continuous", "sampled"):
        raise InputError(f'stepping = {stepping!r} is not known: choose "continuous" or "sampled".')
    chosen = get_solver(solver)
    if stepping == "continuous" and not isinstance(chosen, AbstractSolver):
        raise InputError(
            f'solver = "{chosen.name}" resolves sticking under a held torque, so it needs sampled stepping: '
            'use stepping="sampled", or solver="rk4" with a steepness.'
        )
    return Stepper(as_parameter(dt), samples, chosen, stepping, substeps, checkpoint)


class Inputs(NamedTuple):
    """The inputs of a run, as tables built once outside the scan.

    It is a named tuple, because jax flattens these without calling Python, which counts in a call for one candidate.

    Attributes:
        time: start of each sample [s], shape (samples,).
        references: in continuous stepping one table for each node of the solver, each of shape (samples,) [rad/s]; in
            sampled stepping the reference at the samples, and for a controller that looks ahead also at the next ones.
        noise: one table of standard normal random numbers for each channel of the sensor, each of shape (samples,).
    """

    time: Float[Array, " samples"]
    references: tuple[Float[Array, " samples"], ...]
    noise: tuple[Float[Array, " samples"], ...]


def make_inputs(loop: ClosedLoop, reference: AbstractReference, stepper: Stepper, key: Array | None = None) -> Inputs:
    """Tables of time, reference and noise for `roll`.

    Args:
        loop: gives the dtype and the number of noise channels.
        reference: r(t).
        stepper: the time steps.
        key: a `jax.random` key for the sensor's noise; None for no noise.
    """
    dtype = loop_dtype(loop)
    dt = stepper.dt.astype(dtype)
    # k * dt and not a running sum, whose rounding errors would add up; in float32 it is off by 1e-7, relatively.
    time = jnp.arange(stepper.samples).astype(dtype) * dt
    solver = stepper.solver
    # A reference as a table at the solver's nodes and not a call within the scan: it is evaluated once for all
    # samples, which vectorises, and a batch over gains shares it.
    nodes = (0.0, 1.0) if loop.controller.looks_ahead else (0.0,)
    if isinstance(solver, AbstractSolver) and stepper.stepping == "continuous":
        nodes = solver.nodes
    references = tuple(reference.readout(time + node * dt).astype(dtype) for node in nodes)
    if stepper.stepping == "sampled" and loop.controller.looks_ahead:
        references = (references[0], _past_the_end(loop.controller, reference, time[-1], dt, *references))
    channels = loop.sensor.noise_channels
    if key is None:
        noise = tuple(jnp.zeros(stepper.samples, dtype) for _ in range(channels))
    else:
        noise = tuple(jax.random.normal(jax.random.fold_in(key, i), (stepper.samples,), dtype) for i in range(channels))
    return Inputs(time, references, noise)


def sampled_tables(controller: AbstractController, reference: Array) -> tuple[Array, ...]:
    """`Inputs.references` from a table with one value per sample.

    Args:
        controller: whose need of the next sample decides.
        reference: r [rad/s], or [rad] for a position loop, shape (samples,).
    """
    if not controller.looks_ahead:
        return (reference,)
    return reference, jnp.append(reference[1:], after_last(controller, reference))


def after_last(controller: AbstractController, reference: Any) -> Any:
    """The sample after the last of a table: a position goes on at its last rate, a velocity keeps its last value.

    A position that stopped within one sample would mean an enormous deceleration to a feed-forward.

    Args:
        controller: tells which of the two the reference is.
        reference: r [rad/s], or [rad] for a position loop, shape (samples,).

    Returns:
        A number of the table's kind, shape ().
    """
    moving = controller.follows_position and reference.shape[0] > 1
    return 2.0 * reference[-1] - reference[-2] if moving else reference[-1]


def _past_the_end(
    controller: AbstractController, reference: AbstractReference, last: Array, dt: Array, now: Array, following: Array
) -> Array:
    """The table of the next samples, which for a recording that ends with the run goes on as in `after_last`.

    A run that is longer than its recording follows the stop at the recording's end, as written.
    """
    if not isinstance(reference, Recorded) or not controller.follows_position:
        return following
    after = jnp.where(reference.ends_between(last, last + dt), after_last(controller, now), following[-1])
    return following.at[-1].set(after)


def roll(
    loop: ClosedLoop,
    inputs: Inputs,
    stepper: Stepper,
    measures: dict[str, AbstractMeasure],
    record: tuple[str, ...] = (),
    initial: LoopState | None = None,
) -> tuple[dict[str, Float[Array, "..."]], dict[str, Float[Array, " samples"]], LoopState]:
    """The scan over time. It is a pure function of arrays, so it can be jitted, vmapped and differentiated.

    Args:
        loop: the closed loop.
        inputs: from `make_inputs`.
        stepper: the time steps.
        measures: accumulated in the carry of the scan, by name.
        record: names of the signals to store.
        initial: state to start from; None for rest.

    Returns:
        (measures by name, recorded signals by name with shape (samples,), state one step after the last sample).
    """
    dt = stepper.dt.astype(loop_dtype(loop))
    state = loop.init() if initial is None else initial
    if stepper.stepping == "sampled":
        state = loop.sampled(state)
    zero = jnp.zeros_like(dt)
    totals = {name: measure.init(zero) for name, measure in measures.items()}

    def step(carry: PyTree, sample: Inputs) -> tuple[PyTree, dict[str, Array]]:
        state, totals = carry
        state, signals = advance(loop, state, sample, dt, stepper)
        totals = {name: measure.update(totals[name], signals) for name, measure in measures.items()}
        return (state, totals), {name: signal(signals, name) for name in record}

    (state, totals), recorded = scan_loop(step, (state, totals), inputs, checkpoint=stepper.checkpoint)
    finals = {name: measure.final(totals[name], stepper.samples) for name, measure in measures.items()}
    return finals, recorded, state


def advance(
    loop: ClosedLoop, state: LoopState, sample: Inputs, dt: Array, stepper: Stepper
) -> tuple[LoopState, Signals]:
    """One step, continuous or sampled, from one row of the inputs."""
    if stepper.stepping == "continuous":
        assert isinstance(stepper.solver, AbstractSolver)  # checked by `make_stepper`
        return loop.advance_continuous(state, sample.references, sample.time, dt, stepper.solver)
    reference, *following = sample.references
    return loop.advance_sampled(
        state, reference, sample.time, dt, sample.noise, stepper.solver, stepper.substeps, *following
    )


def signal(signals: Signals, name: str) -> Array:
    """A signal by name; an estimate as "estimates.coulomb".

    Raises:
        InputError: for a name that this loop does not have.
    """
    if name.startswith("estimates."):
        estimate = name.removeprefix("estimates.")
        if estimate in signals.estimates:
            return signals.estimates[estimate]
    elif name != "estimates" and name in Signals.__dataclass_fields__:
        return getattr(signals, name)
    known = [field for field in Signals.__dataclass_fields__ if field != "estimates"]
    known += [f"estimates.{estimate}" for estimate in signals.estimates]
    raise InputError(f"record = {name!r} is not a signal of this loop: choose among {', '.join(known)}.")


def loop_dtype(tree: PyTree) -> np.dtype:
    """The floating dtype of a block's leaves.

    Raises:
        InputError: where blocks mix float32 and float64.
    """
    dtypes = {leaf.dtype for leaf in jax.tree.leaves(tree) if eqx.is_inexact_array(leaf)}
    if len(dtypes) > 1:
        raise InputError(
            f"The loop mixes dtypes {sorted(str(d) for d in dtypes)}: build all blocks under one precision, or convert "
            f"with fpjax.astype(loop, jnp.float64)."
        )
    return dtypes.pop() if dtypes else jnp.result_type(float)


# `Any`, because jax.typing.DTypeLike contains a protocol without isinstance, and the tests check types at run time.
def astype(tree: PyTree, dtype: Any) -> PyTree:
    """A copy of `tree` (a block, a loop, a reference) with every floating leaf in `dtype`."""
    return jax.tree.map(lambda leaf: leaf.astype(dtype) if eqx.is_inexact_array(leaf) else leaf, tree)
