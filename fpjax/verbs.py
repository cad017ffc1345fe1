"""The public functions `simulate`, `estimate` and `linearise`, for a model, its file, or blocks, with input checks."""

import dataclasses
import os
from typing import TYPE_CHECKING, Any

import jax
import jax.numpy as jnp
import numpy as np
from jax.core import Tracer
from jaxtyping import Array

from .analysis.estimate import Differentiator, Estimated
from .analysis.estimate import estimate as estimate_with
from .blocks.block import with_arrays
from .blocks.loads import AbstractLoad
from .blocks.observers import AbstractObserver
from .blocks.references import AbstractReference
from .errors import InputError
from .logs import Log, read_log
from .model_file import Model
from .model_file.as_model import as_model
from .model_file.picture_labels import about_model
from .output.run_picture import KINDS, About
from .simulation.input_checks import checked_loop, checked_reference, shown
from .simulation.loop import ClosedLoop, LoopState
from .simulation.metrics import AbstractMeasure
from .simulation.precision import double_precision
from .simulation.run import Run
from .simulation.run import simulate as simulate_loop
from .simulation.scan import Stepping, astype
from .simulation.solvers import AbstractPlantSolver

if TYPE_CHECKING:
    from .linear.linear_loop import LinearLoop

DEFAULT_SIGNALS = (
    "reference", "velocity", "position", "measured_velocity", "measured_position",
    "torque", "control", "compensation", "applied", "friction",
)  # fmt: skip


def simulate(
    loop: ClosedLoop | Model | str | os.PathLike[str],
    reference: AbstractReference | None = None,
    *,
    dt: Any = None,
    duration: float | None = None,
    samples: int | None = None,
    solver: str | AbstractPlantSolver | None = None,
    stepping: Stepping | None = None,
    substeps: int | None = None,
    measures: dict[str, AbstractMeasure] | None = None,
    record: str | tuple[str, ...] | None = None,
    initial: LoopState | None = None,
    key: Array | None = None,
    throw: bool = False,
) -> Run:
    """Simulate a closed loop, or the model of a servo.toml.

    For a model or its file all other settings default to the file's, all signals are recorded, and the run is in double
    precision, as on the command line. For blocks the precision is that of the process: float32, unless
    `jax.config.update("jax_enable_x64", True)` was called first. `print(run)` shows which it was.

    Args:
        loop: the closed loop; a `Model`, or the path (or the text) of a servo.toml.
        reference: reference of the loop [rad/s], or [rad] for a position loop; None for the model's.
        dt: step, or control period when sampled [s]; None for the model's.
        duration: [s]; samples run from 0 to duration, both included; None for the model's.
        samples: number of samples, instead of `duration`.
        solver: "euler", "heun", "ode3" or "rk4" (default); "exact" resolves sticking exactly (sampled stepping).
        stepping: "continuous" (default) or "sampled".
        substeps: solver steps per control period when sampled; 1 by default.
        measures: measures to accumulate along the run, by names of your choice.
        record: signals to store, by the names of `Signals`; an estimate as "estimates.coulomb". None records all
            signals of a picture for a model, and nothing for blocks.
        initial: state to start from, at t = 0 of the reference; None for rest.
        key: `jax.random` key of the sensor's noise; None for no noise.
        throw: raise an error where the run diverges, instead of reporting it in `status`.

    Returns:
        A `Run`: it can be printed, plotted and converted to a data frame.

    Raises:
        InputError: for invalid settings.
        DivergedError: with `throw`, for a run that diverged.
    """
    model = as_model(loop, "simulate")
    if model is not None:
        model.needed_controller()
        if duration is None and samples is None:
            duration = model.needed_duration()
        chosen = model.needed_reference() if reference is None else reference
        with double_precision():
            blocks = astype(model.loop, jnp.float64)
            run = simulate_loop(
                blocks,
                astype(checked_reference(chosen), jnp.float64),
                dt=model.dt if dt is None else dt,
                duration=duration,
                samples=samples,
                solver=solver or model.solver,
                stepping=stepping or model.stepping,
                substeps=model.substeps if substeps is None else substeps,
                measures=measures,
                record=_names(blocks) if record is None else record,
                initial=initial,
                key=key,
                throw=throw,
            )
        # In a process with float32, every operation on a float64 jax array warns: so the result holds numpy arrays.
        time, signals, measured = jax.tree.map(_on_host, (run.time, run.signals, run.measures))
        return dataclasses.replace(run, time=time, signals=signals, measures=measured, about=about_model(model))
    blocks = checked_loop(loop, "simulate")
    if dt is None:
        raise InputError("simulate needs dt, the step [s]: give dt=1e-4, or a model, which has its own.")
    run = simulate_loop(
        blocks,
        checked_reference(reference),
        dt=dt,
        duration=duration,
        samples=samples,
        solver=solver or "rk4",
        stepping=stepping or "continuous",
        substeps=1 if substeps is None else substeps,
        measures=measures,
        record=record or (),
        initial=initial,
        key=key,
        throw=throw,
    )
    return dataclasses.replace(run, about=about_loop(blocks))


def estimate(
    log: Log | str | os.PathLike[str],
    observer: AbstractObserver | Model | str | os.PathLike[str],
    *,
    load: AbstractLoad | None = None,
    average: float | None = None,
    differentiator: Differentiator = "zero_phase",
    cutoff: float | None = None,
    passes: int = 1,
) -> Estimated:
    """Run an observer over a log.

    Args:
        log: torque and velocity or position on one clock, or the path of its file.
        observer: with its gains and the axis' inertia; or a `Model`, or the path of a servo.toml, with an [observer],
            whose known load is then used too.
        load: known load torque (an unbalance, an offset), subtracted from the log's torque; None for the model's.
        average: length of the window at the end over which the estimates are averaged, for instance a lap of a periodic
            program [s]; None for the last quarter.
        differentiator: how the velocity is computed for a log without one: "zero_phase" (central difference of the
            position, filtered forwards and backwards by a low-pass: no delay, but not possible online) or "causal"
            (backward difference and a first-order low-pass, as in a drive).
        cutoff: cutoff frequency of that low-pass [Hz]; None for a tenth of the control rate. A logged velocity is used
            as it is.
        passes: passes over the log, each starting from the estimates of the one before; the last one is returned. Slow
            gains need more passes. In the limit of slow gains the observer solves the normal equations of least
            squares, while fast gains follow friction that depends on direction and position.

    Raises:
        InputError: for a log that is too short, an observer without estimates, or estimates that left the finite range.
    """
    model = None if isinstance(observer, AbstractObserver) else as_model(observer, "estimate", "an observer")
    if model is None and not isinstance(observer, AbstractObserver):
        raise InputError(
            f"estimate got {shown(observer)} as its observer: give an observer, a Model or the path of a servo.toml."
        )
    if not isinstance(log, Log):
        if not isinstance(log, str | os.PathLike):
            raise InputError(f"estimate got {shown(log)} as its log: give a Log (fpjax.read_log) or a file's path.")
        log = read_log(log, linear=None if model is None else model.linear)
    settings: Any = {"average": average, "differentiator": differentiator, "cutoff": cutoff, "passes": passes}
    if model is None:
        return estimate_with(log, with_arrays(observer), load=load, **settings)
    with double_precision():
        known: Any = model.loop.plant.load if load is None else load
        return estimate_with(log, astype(model.loop.observer, jnp.float64), load=astype(known, jnp.float64), **settings)


def linearise(
    loop: ClosedLoop | Model | str | os.PathLike[str],
    at: float | LoopState = 1.0,
    *,
    dt: float | None = None,
    stepping: Stepping | None = None,
    solver: str | AbstractPlantSolver | None = None,
    substeps: int | None = None,
    reference: float | None = None,
) -> "LinearLoop":
    """Linearise a loop, or the model of a servo.toml, about a steady motion.

    The derivative is jax's, of the same step (or derivative) that is simulated: delays, lags, the hold of a sampled
    loop and the observer's compensation are all included. The rounding of a sensor is left out, a limit counts where it
    is active, and Coulomb friction of a moving mass has no slope.

    Args:
        loop: the closed loop; a `Model`, or the path (or the text) of a servo.toml.
        at: speed of the steady motion [rad/s], reached from rest by simulation; or a state to linearise at.
        dt: control period, or step of the settling simulation in continuous time [s]; None for the model's.
        stepping: "sampled" (default) or "continuous"; None for the model's.
        solver: of the plant; None for the model's, or "rk4".
        substeps: solver steps per control period when sampled; None for the model's, or 1.
        reference: r at a given state [rad/s or rad]; where `at` is a speed, r follows from it.

    Returns:
        A `LinearLoop`: it prints its margins and can be plotted.

    Raises:
        InputError: where the loop does not settle at that speed, or a state comes without its reference.
    """
    if not isinstance(at, int | float | LoopState):
        raise InputError(f"at must be a speed [rad/s] or a LoopState, got {shown(at)}.")
    from .linear.linearise import linearise as linearise_loop  # here, because it imports scipy's root searches

    model = as_model(loop, "linearise")
    if model is None:
        if dt is None:
            raise InputError("linearise needs dt, the control period [s]: give dt=1e-3, or a model, which has its own.")
        return linearise_loop(
            checked_loop(loop, "linearise"), at, dt=dt, stepping=stepping or "sampled", solver=solver or "rk4",
            substeps=1 if substeps is None else substeps, reference=reference,
        )  # fmt: skip
    model.needed_controller()
    with double_precision():
        return linearise_loop(
            astype(model.loop, jnp.float64), at, dt=model.dt if dt is None else dt, stepping=stepping or model.stepping,
            solver=solver or model.solver,
            substeps=model.substeps if substeps is None else substeps, reference=reference,
        )  # fmt: skip


def about_loop(loop: ClosedLoop) -> About:
    """True values for the picture of a run of a loop of blocks, where they are single numbers."""
    law = loop.plant.friction
    found = {name: getattr(law, name, None) for name in KINDS}
    numbers = {
        name: float(value)
        for name, value in found.items()
        if isinstance(value, jax.Array) and not isinstance(value, Tracer) and np.ndim(value) == 0
    }
    return About(tuple(numbers.items()))


def _on_host(leaf: Any) -> Any:
    return leaf if isinstance(leaf, Tracer) else np.asarray(leaf)


def _names(loop: ClosedLoop) -> tuple[str, ...]:
    return (*DEFAULT_SIGNALS, *(f"estimates.{name}" for name in loop.observer.estimated))
