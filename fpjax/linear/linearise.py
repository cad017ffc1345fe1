"""Linearisation of a whole closed loop by jax; its return ratio is taken at the torque that the drive commands."""

from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax.flatten_util import ravel_pytree
from jaxtyping import Array, PyTree

from ..blocks.actuators import AbstractActuator
from ..blocks.block import as_parameter
from ..blocks.loads import turns_with_position
from ..blocks.references import AbstractReference, Constant, Recorded
from ..blocks.sensors import AbstractSensor
from ..blocks.signals import Motion
from ..errors import InputError
from ..simulation.histories import with_histories
from ..simulation.input_checks import checked_initial
from ..simulation.loop import ClosedLoop, LoopState
from ..simulation.precision import double_precision
from ..simulation.run import simulate
from ..simulation.scan import Stepping, astype
from ..simulation.solvers import AbstractPlantSolver, get_solver
from .linear_loop import LinearLoop
from .state_space import StateSpace

# The steady motion is found by simulation, in chunks of CHUNK samples, CHUNKS of them at most. The loop counts as
# steady when velocity and torque change by less than RESTS, relatively, within the last tenth of a chunk.
CHUNK = 2000
CHUNKS = 50
RESTS = 1e-7
SMALL_LOAD = 1e-3  # change of a load with the position [N m] up to which the loop may settle all the same
ROUNDING = ("step_size", "position_step")  # what sensors call the step to which they round a reading


class Disturbed(AbstractActuator):
    """An actuator with a torque added to its command: the point at which the loop is opened.

    Attributes:
        actuator: the actuator.
        added: torque added to its command [N m].
    """

    actuator: AbstractActuator
    added: Array = eqx.field(converter=as_parameter)

    def init(self) -> PyTree:
        """At rest."""
        return self.actuator.init()

    def derivative(self, state: PyTree, torque: Array) -> PyTree:
        """The actuator's, under the command and the added torque."""
        return self.actuator.derivative(state, torque + self.added)

    def readout(self, state: PyTree, torque: Array, motion: Motion) -> Array:
        """Applied torque [N m]."""
        return self.actuator.readout(state, torque + self.added, motion)

    def step(self, state: PyTree, torque: Array, motion: Motion, dt: Array) -> tuple[PyTree, Array]:
        """(next state, mean applied torque [N m] over the period)."""
        return self.actuator.step(state, torque + self.added, motion, dt)


def linearise(
    loop: ClosedLoop,
    at: float | LoopState = 1.0,
    *,
    dt: float,
    stepping: Stepping = "sampled",
    solver: str | AbstractPlantSolver = "rk4",
    substeps: int = 1,
    reference: float | None = None,
) -> LinearLoop:
    """Linearise a loop about a steady motion.

    The derivative is jax's, of the same step (or derivative) that is simulated: delays, lags, the hold of a sampled
    loop and the observer's compensation are all included. The rounding of a sensor is left out, a limit counts where it
    is active, and Coulomb friction of a moving mass has no slope. It is computed in double precision, whatever that of
    the loop: a position that grows is rounded to more than a steady motion may change in single precision.

    Args:
        loop: the closed loop.
        at: speed of the steady motion [rad/s], reached from rest by simulation; or a state to linearise at.
        dt: control period, or step of the settling simulation in continuous time [s].
        stepping: "sampled" or "continuous".
        solver: of the plant.
        substeps: solver steps a period when sampled.
        reference: r at a given state [rad/s or rad]; where `at` is a speed, r follows from it.

    Raises:
        InputError: where the loop does not settle at that speed, friction holds the machine at rest, or a state comes
            without its reference.
    """
    if stepping not in ("sampled", "continuous"):
        raise InputError(f'stepping = {stepping!r} is not known: choose "continuous" or "sampled".')
    if not dt > 0.0:
        raise InputError(f"dt must be positive, got {dt:g} s; 1e-3 s is usual for a drive.")
    if substeps < 1:
        raise InputError(f"substeps = {substeps} must be at least 1.")
    with double_precision():
        loop, at = astype((loop, at), jnp.float64)
        return _linearised(loop, at, dt, stepping, get_solver(solver), substeps, reference)


def _linearised(
    loop: ClosedLoop, at: float | LoopState, dt: float, stepping: Stepping, chosen: AbstractPlantSolver, substeps: int,
    reference: float | None,
) -> LinearLoop:  # fmt: skip
    """The linearised loop of one in double precision; arguments as of `linearise`."""
    loop = eqx.tree_at(lambda each: each.sensor, loop, _unrounded(loop.sensor))
    if stepping == "sampled":
        loop = with_histories(loop, dt)
    position, zero = loop.controller.follows_position, jnp.zeros(())
    if isinstance(at, int | float):
        if not np.isfinite(at):
            raise InputError(f"at = {at:g} rad/s is not a speed: give a finite one.")
        refuse_turning_load(loop, float(at))
        state, value = _settled(loop, float(at), dt, stepping, chosen, substeps, position)
        speed = float(at)
    else:
        if reference is None:
            raise InputError("A state needs its reference too: give reference= [rad/s] (or [rad] for a position loop).")
        state, value = checked_initial(at, loop, stepping, "at"), float(reference)
        output = loop.plant.readout(state.plant, zero, zero)
        speed = float(output.velocity)
    if stepping == "sampled":
        state = loop.sampled(state)
    point, rebuild = ravel_pytree(state)  # the whole state as one vector, shape (states,)

    def moved(values: Array, inputs: Array) -> tuple[Array, Array]:
        cut = eqx.tree_at(lambda each: each.actuator, loop, Disturbed(loop.actuator, inputs[1]))
        now, zero = rebuild(values), jnp.zeros_like(inputs[0])
        if stepping == "sampled":
            silent = tuple(zero for _ in range(loop.sensor.noise_channels))
            period = jnp.asarray(dt, inputs.dtype)
            # A position reference goes on at the steady speed; held, it would look like a stop to a feed-forward.
            following = inputs[0] + speed * dt if position else None
            after, signals = cut.advance_sampled(now, inputs[0], zero, period, silent, chosen, substeps, following)
        else:
            after, signals = cut.derivative(now, inputs[0], zero), cut.signals(now, inputs[0], zero)
        shown = jnp.stack([signals.measured_velocity, signals.measured_position, signals.torque])
        return ravel_pytree(after)[0], shown

    # Inputs: the reference and the added torque. The Jacobians of (next state, outputs) by (state, inputs) are A, B
    # and C, D.
    inputs = jnp.asarray([value, 0.0], point.dtype)
    (a, b), (c, d) = (
        [np.asarray(each, dtype=float) for each in pair] for pair in jax.jit(jax.jacfwd(moved, (0, 1)))(point, inputs)
    )
    if not all(np.isfinite(each).all() for each in (a, b, c, d)):
        raise InputError(
            f"The loop has no tangent at {speed:g} rad/s (a slope there is infinite): choose another speed."
        )
    if not _moves(a, b[:, 1], c[0], d[0, 1]) and float(loop.plant.readout(state.plant, zero, zero).velocity) == 0.0:
        raise InputError(
            f"The machine rests at {speed:g} rad/s: friction holds it, and no small torque moves it, so there are no "
            f"margins: choose a speed at which it moves (--at 0.5, linearise(0.5))."
        )
    period = dt if stepping == "sampled" else None
    outputs = ("velocity", "position", "torque")
    whole = StateSpace(a, b, c, d, period, ("reference", "disturbance"), outputs)
    # The actuator gets v = y + d, the commanded torque y plus the added torque d. With the loop opened, v is the input:
    # d = v - y put into x+ = A x + B d, y = C x gives x+ = (A - B C) x + B v, and L = -y / v.
    answer = c[2:3]
    ratio = StateSpace(a - b[:, 1:2] @ answer, b[:, 1:2], -answer, np.zeros((1, 1)), period, ("torque",), ("return",))
    return LinearLoop(whole, ratio, "position" if position else "velocity", speed)


def _moves(a: np.ndarray, b: np.ndarray, c: np.ndarray, d: float) -> bool:
    """Whether the output c x + d u answers the input u of x+ = a x + b u (or dx/dt) at all, sooner or later."""
    found = d != 0.0
    for _ in range(len(b)):  # as many powers of a as it has rows: the others are sums of these (Cayley, Hamilton)
        found, b = found or bool(np.any(c @ b != 0.0)), a @ b
    return found


def _unrounded(sensor: AbstractSensor) -> AbstractSensor:
    """A sensor without rounding, under which no motion is steady: an encoder's counts come and go at every sample."""

    def without(path: tuple[Any, ...], leaf: Array) -> Array:
        return jnp.zeros_like(leaf) if path and getattr(path[-1], "name", None) in ROUNDING else leaf

    return jax.tree_util.tree_map_with_path(without, sensor)


def refuse_turning_load(loop: ClosedLoop, speed: float) -> None:
    """Refuse a steady motion at a speed [rad/s] where the load depends on the position: there is rest alone.

    Raises:
        InputError: for such a load. One that is small is left to the simulation of the motion.
    """
    if speed != 0.0 and turns_with_position(loop.plant.load, SMALL_LOAD):
        raise InputError(
            "The load depends on the position, so the loop has no steady motion at any speed but zero, and no margins "
            "about one: take those at rest (--at 0, linearise(0.0)), or of the model with a constant load."
        )


def _settled(
    loop: ClosedLoop, speed: float, dt: float, stepping: Stepping, solver: AbstractPlantSolver, substeps: int,
    position: bool,
) -> tuple[LoopState, float]:  # fmt: skip
    """(the state of the steady motion at a speed [rad/s], the reference there [rad/s or rad])."""
    state: PyTree = None
    tail = CHUNK // 10
    for chunk in range(CHUNKS):
        start = chunk * CHUNK * dt
        following = _ramp(speed, start, dt) if position else Constant(speed)
        run = simulate(
            loop, following, dt=dt, samples=CHUNK, solver=solver, stepping=stepping, substeps=substeps,
            record=("velocity", "torque"), initial=state,
        )  # fmt: skip
        if run.diverged:
            break
        state = run.final_state
        ends = [np.asarray(run.signals[name])[-tail:] for name in ("velocity", "torque")]
        rests = [np.ptp(end) <= RESTS * max(float(np.abs(end).max()), abs(speed), 1e-9) for end in ends]
        if all(rests):
            return state, speed * (start + CHUNK * dt) if position else speed
    seconds = CHUNKS * CHUNK * dt
    raise InputError(
        f"The loop does not settle at {speed:g} rad/s within {seconds:g} s (a limit cycle, friction or cogging that "
        f"depends on the position, or an unstable loop), so it has no single linearisation there: look at fpjax "
        f"simulate, try another speed with --at, or give a state."
    )


def _ramp(speed: float, start: float, dt: float) -> AbstractReference:
    return Recorded(speed * (start + dt * np.arange(CHUNK + 1)), dt, hold=False)
