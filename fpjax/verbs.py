"""The verbs of a user: `simulate`, `estimate`, `linearise` of a model, its file or blocks; errors are one sentence."""

import dataclasses
import os
from typing import TYPE_CHECKING, Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax.core import Tracer
from jaxtyping import Array

from .analysis.estimate import Differentiator, Estimated
from .analysis.estimate import estimate as estimate_with
from .blocks.actuators import AbstractActuator
from .blocks.block import with_arrays
from .blocks.controllers import AbstractController
from .blocks.friction import AbstractFriction
from .blocks.loads import AbstractLoad
from .blocks.observers import AbstractObserver
from .blocks.parameters import parameter_names
from .blocks.plants import AbstractPlant
from .blocks.references import AbstractReference
from .blocks.sensors import AbstractSensor
from .errors import InputError
from .logs import Log, read_log
from .model_file import Model, load_model
from .output.run_picture import KINDS, About
from .precision import double_precision as double_precision
from .simulation.loop import ClosedLoop, LoopState
from .simulation.metrics import AbstractMeasure
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


_BLOCKS = (
    ("plant", AbstractPlant, "OneMass(10.0, fp.CoulombViscous(20.0, 2.0))"),
    ("controller", AbstractController, "ProportionalIntegral(150.0, 200.0)"),
    ("observer", AbstractObserver, "ExtendedFriedlandPark(10.0, 100.0, 100.0, steepness=500.0)"),
    ("actuator", AbstractActuator, "IdealActuator()"),
    ("sensor", AbstractSensor, "IdealSensor()"),
)  # of a loop, and what each may be


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
    """Simulate a closed loop, or what a servo.toml describes.

    Given a model or its file, everything else has the file's value, all signals are recorded, and the run is in double
    precision, as on the command line. Given blocks, the precision is the process's: float32 unless
    `jax.config.update("jax_enable_x64", True)` was called first. `print(run)` says which.

    Args:
        loop: the closed loop; a `Model`, or the path (or the text) of a servo.toml.
        reference: what it follows; None for the model's.
        dt: step, or control period when sampled [s]; None for the model's.
        duration: [s]; samples run from 0 to duration, both included; None for the model's.
        samples: number of samples, instead of `duration`.
        solver: "euler", "heun", "ode3" or "rk4" (default); "exact" resolves sticking exactly (sampled stepping).
        stepping: "continuous" (default) or "sampled".
        substeps: solver steps per control period when sampled; 1 by default.
        measures: what to accumulate, by name of your choice.
        record: signals to store, by the names of `Signals`; an estimate as "estimates.coulomb". None: of a model
            everything that a picture shows, of blocks nothing.
        initial: state to start from; None for rest.
        key: `jax.random` key of the sensor's noise; None for none.
        throw: raise where the run diverged, instead of saying so in `status`.

    Returns:
        A `Run`, which prints its numbers, `plot`s itself and becomes a data frame.

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
                substeps=substeps or model.substeps,
                measures=measures,
                record=_names(blocks) if record is None else record,
                initial=initial,
                key=key,
                throw=throw,
            )
        # Double-precision jax arrays in a process that has float32 warn at every operation: a user gets numpy's.
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
        substeps=substeps or 1,
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
            whose known load then holds too.
        load: known load torque (an unbalance, an offset), subtracted from the log's torque; None for the model's.
        average: seconds at the end over which the estimates are averaged (a lap of a periodic program); None for the
            last quarter.
        differentiator: how a log without velocity gets one: "zero_phase" (central difference of the position passed
            forwards and backwards through a low-pass: no delay, not possible online) or "causal" (backward difference
            and a first-order low-pass, as a drive would).
        cutoff: of that low-pass [Hz]; None for a tenth of the control rate. A logged velocity is taken as it is.
        passes: over the log, each starting from the last one's estimates; the last one is returned. Slow gains need
            the time, and are worth it: in their limit the observer solves the normal equations of least squares, while
            fast ones follow friction that depends on direction and place.

    Raises:
        InputError: for a log that is too short, an observer without estimates, or estimates that left the finite range.
    """
    model = None if isinstance(observer, AbstractObserver) else as_model(observer, "estimate", "an observer")
    if model is None and not isinstance(observer, AbstractObserver):
        raise InputError(
            f"estimate got {_shown(observer)} as its observer: give an observer, a Model or the path of a servo.toml."
        )
    if not isinstance(log, Log):
        if not isinstance(log, str | os.PathLike):
            raise InputError(f"estimate got {_shown(log)} as its log: give a Log (fpjax.read_log) or a file's path.")
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
    """Linearise a loop, or what a servo.toml describes, about a steady motion.

    The tangent is jax's, of the very step (or derivative) that is simulated: delays, lags, the hold of a sampled loop
    and the observer's compensation are in it. A rounding passes as if it were not there, a limit counts where it acts,
    and Coulomb friction of a moving mass has no slope.

    Args:
        loop: the closed loop; a `Model`, or the path (or the text) of a servo.toml.
        at: speed of the steady motion [rad/s], reached from rest by simulation; or a state to linearise at.
        dt: control period, or step of the settling simulation in continuous time [s]; None for the model's.
        stepping: "sampled" (default) or "continuous"; None for the model's.
        solver: of the plant; None for the model's, or "rk4".
        substeps: solver steps a period when sampled; None for the model's, or 1.
        reference: r at a given state [rad/s or rad]; with a speed it follows from it.

    Returns:
        A `LinearLoop`, which prints its margins and plots them.

    Raises:
        InputError: where the loop does not settle at that speed, or a state comes without its reference.
    """
    if not isinstance(at, int | float | LoopState):
        raise InputError(f"at = {_shown(at)} is no steady motion: give a speed [rad/s], or a LoopState.")
    from .linear.linearise import linearise as linearise_loop  # scipy's searches, which only margins need

    model = as_model(loop, "linearise")
    if model is None:
        if dt is None:
            raise InputError("linearise needs dt, the control period [s]: give dt=1e-3, or a model, which has its own.")
        return linearise_loop(
            checked_loop(loop, "linearise"), at, dt=dt, stepping=stepping or "sampled", solver=solver or "rk4",
            substeps=substeps or 1, reference=reference,
        )  # fmt: skip
    model.needed_controller()
    with double_precision():
        return linearise_loop(
            astype(model.loop, jnp.float64), at, dt=model.dt if dt is None else dt, stepping=stepping or model.stepping,
            solver=solver or model.solver, substeps=substeps or model.substeps, reference=reference,
        )  # fmt: skip


def as_model(source: Any, verb: str, also: str = "a ClosedLoop") -> Model | None:
    """The model that was given, read where it is a path or text; None for anything else.

    Args:
        source: what the user gave.
        verb: whose argument it is.
        also: what else it may be, for the sentence; "" for nothing.
    """
    if isinstance(source, Model):
        return source
    if isinstance(source, str | os.PathLike):
        with double_precision():
            return load_model(source)
    if isinstance(source, ClosedLoop | AbstractObserver):
        return None
    raise InputError(
        f"{verb} got {_shown(source)}: give {also}{', ' if also else ''}a Model (fpjax.load_model) or the path of a "
        "servo.toml."
    )


def checked_loop(loop: Any, verb: str) -> ClosedLoop:
    """The loop, its plain numbers as arrays (one that was built under another precision, or by `tree_at`).

    Raises:
        InputError: for what is no loop.
    """
    if not isinstance(loop, ClosedLoop):
        raise InputError(f"{verb} got {_shown(loop)}: give a ClosedLoop, a Model or the path of a servo.toml.")
    for name, kind, example in _BLOCKS:
        block = getattr(loop, name)
        if not isinstance(block, kind):
            raise InputError(f"The loop's {name} is {_shown(block)}: give a block for it, as fp.{example}.")
    law = getattr(loop.plant, "friction", None)
    if law is not None and not isinstance(law, AbstractFriction):
        raise InputError(f"The plant's friction is {_shown(law)}: give a law, as fp.CoulombViscous(20.0, 2.0).")
    return with_arrays(loop)


def checked_reference(reference: Any) -> AbstractReference:
    """The reference.

    Raises:
        InputError: for what is none.
    """
    if not isinstance(reference, AbstractReference):
        hint = "fp.Constant(...)" if isinstance(reference, int | float) else "fp.Sine(amplitude=1.0, frequency=1.0)"
        raise InputError(f"The reference is {_shown(reference)}: give one of the blocks, for instance {hint}.")
    return with_arrays(reference)


def about_model(model: Model) -> About:
    """What a picture of this model's run wants to know."""
    units = ("rad", "rad/s", "N m", *KINDS.values())
    return About(
        tuple((name, value) for name, value in model.nominal.items() if name in KINDS),
        tuple((unit, model.units.name(unit)) for unit in units),
        model.units.reference == "position",
        model.linear,
        model.path.name if model.path else "",
    )


def about_loop(loop: ClosedLoop) -> About:
    """The truths of a loop of blocks, where they are numbers."""
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


def _shown(value: Any) -> str:
    kind = type(value).__name__
    if isinstance(value, eqx.Module):
        return f"a {kind} with {', '.join(parameter_names(value)[:3]) or 'no parameters'}"
    return f"{kind} {str(value)[:40]!r}" if value is not None else "nothing (None)"
