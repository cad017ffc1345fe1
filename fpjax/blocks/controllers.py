"""Controllers: P, PI, lead, any transfer function, and a position loop around the velocity loop."""

import dataclasses
import math
from abc import abstractmethod
from collections.abc import Callable
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from ..errors import InputError
from .block import Block, as_optional, as_parameter, require_positive
from .signals import Measurement


class AbstractController(Block):
    """From a reference and a measurement to a control u [N m]."""

    @abstractmethod
    def init(self) -> Any:
        """The state at rest."""

    @abstractmethod
    def derivative(self, state: Any, reference: Array, measurement: Measurement) -> Any:
        """Time derivative of the state (continuous stepping)."""

    @abstractmethod
    def readout(self, state: Any, reference: Array, measurement: Measurement) -> Array:
        """Control u [N m] from reference [rad/s] (or [rad] for a position loop)."""

    def step(self, state: Any, reference: Array, measurement: Measurement, dt: Array) -> Any:
        """The state one control period dt [s] later (sampled stepping): the derivative held over the period."""
        rates = self.derivative(state, reference, measurement)
        return jax.tree.map(lambda value, rate: value + dt * rate, state, rates)

    # A limit holds for what leaves the controller: its control and the observer's compensation together. The loop
    # therefore asks for the control without the limit, adds the compensation, limits the sum, and lets the state
    # follow what was cut off.

    @property
    def bounded(self) -> bool:
        """Whether the output has a limit."""
        return False

    def unbounded(self) -> "AbstractController":
        """The same controller without its limit and its anti-windup."""
        return self

    def limited(self, torque: Array) -> Array:
        """What leaves of a torque [N m], the compensation included."""
        return torque

    def follow(self, excess: Array) -> Any:
        """Anti-windup: what the state's rate gains where the output was moved by `excess` [N m]; None for nothing."""
        del excess
        return None


class Proportional(AbstractController):
    """u = kp (r - w).

    Attributes:
        kp: proportional gain [N m s/rad].
    """

    kp: Array = eqx.field(converter=as_parameter)

    def init(self) -> tuple[()]:
        """No state."""
        return ()

    def derivative(self, state: Any, reference: Array, measurement: Measurement) -> tuple[()]:
        """Nothing moves."""
        del state, reference, measurement
        return ()

    def readout(self, state: Any, reference: Array, measurement: Measurement) -> Array:
        """kp (r - w) [N m]."""
        del state
        return self.kp * (reference - measurement.velocity)


class TorqueInput(AbstractController):
    """No controller: the reference is the torque itself [N m], as in a run driven by a recorded torque."""

    def init(self) -> tuple[()]:
        """No state."""
        return ()

    def derivative(self, state: Any, reference: Array, measurement: Measurement) -> tuple[()]:
        """Nothing moves."""
        del state, reference, measurement
        return ()

    def readout(self, state: Any, reference: Array, measurement: Measurement) -> Array:
        """The reference [N m]."""
        del state, measurement
        return reference


class ProportionalIntegral(AbstractController):
    """u = kp e + integral of ki e, e = r - w; with an output limit and back-calculation anti-windup.

    Attributes:
        kp: proportional gain [N m s/rad].
        ki: integral gain [N m/rad].
        limit: largest |torque| that leaves, an observer's compensation included [N m]; None for no limit.
        tracking_time: anti-windup time constant [s] with which the integral follows the limited output
            (Astrom, Hagglund, "Advanced PID control", 2006, section 3.5); used only with a limit.
    """

    kp: Array = eqx.field(converter=as_parameter)
    ki: Array = eqx.field(converter=as_parameter)
    limit: Array | None = eqx.field(converter=as_optional, default=None)
    tracking_time: Array = eqx.field(converter=as_parameter, default=0.01)

    def __check_init__(self) -> None:
        require_positive(self, "limit", "N m")
        require_positive(self, "tracking_time", "s")

    def init(self) -> Array:
        """Integral torque [N m]."""
        return jnp.zeros_like(self.kp)

    def derivative(self, state: Array, reference: Array, measurement: Measurement) -> Array:
        """ki e [N m/s], plus the anti-windup term while limited."""
        error = reference - measurement.velocity
        rate = self.ki * error
        if self.limit is None:
            return rate
        wanted = self.kp * error + state
        return rate + (jnp.clip(wanted, -self.limit, self.limit) - wanted) / self.tracking_time

    def readout(self, state: Array, reference: Array, measurement: Measurement) -> Array:
        """u [N m], limited where a limit is given."""
        return self.limited(self.kp * (reference - measurement.velocity) + state)

    @property
    def bounded(self) -> bool:
        """Whether there is a limit."""
        return self.limit is not None

    def unbounded(self) -> "ProportionalIntegral":
        """Without the limit."""
        return dataclasses.replace(self, limit=None)

    def limited(self, torque: Array) -> Array:
        """Clipped, where there is a limit [N m]."""
        return torque if self.limit is None else jnp.clip(torque, -self.limit, self.limit)

    def follow(self, excess: Array) -> Array | None:
        """Back-calculation [N m/s]."""
        return None if self.limit is None else excess / self.tracking_time


class Lead(AbstractController):
    """G_c(s) = gain (s + zero) / (s + pole) on the velocity error (3.16).

    Attributes:
        gain: K_c [N m s/rad].
        zero: z [rad/s].
        pole: p [rad/s].
    """

    gain: Array = eqx.field(converter=as_parameter)
    zero: Array = eqx.field(converter=as_parameter)
    pole: Array = eqx.field(converter=as_parameter)

    def __check_init__(self) -> None:
        require_positive(self, "pole", "rad/s")

    def init(self) -> Array:
        """The one state of the lead."""
        return jnp.zeros_like(self.gain)

    def derivative(self, state: Array, reference: Array, measurement: Measurement) -> Array:
        """x' = e - p x."""
        return reference - measurement.velocity - self.pole * state

    def readout(self, state: Array, reference: Array, measurement: Measurement) -> Array:
        """gain (e + (z - p) x) [N m]."""
        return self.gain * (reference - measurement.velocity + (self.zero - self.pole) * state)

    def step(self, state: Array, reference: Array, measurement: Measurement, dt: Array) -> Array:
        """Exact for an error held over dt [s] (zero-order hold)."""
        kept = jnp.exp(-self.pole * dt)
        return kept * state + (1.0 - kept) / self.pole * (reference - measurement.velocity)


def design_lead(plant: Callable[[complex], complex], crossover: float, phase_lead: float) -> Lead:
    """A lead controller from its crossover and the phase it is to add (3.20)-(3.26).

    Args:
        plant: transfer function G(s) from control to measured velocity.
        crossover: gain crossover frequency [Hz].
        phase_lead: phase added at the crossover [rad], between 0 and pi/2.

    Raises:
        InputError: where no lead can add that phase.
    """
    if not 0.0 < phase_lead < math.pi / 2.0:
        raise InputError(
            f"phase_lead must lie between 0 and pi/2 rad, which is what one lead adds, got {phase_lead:g} rad: "
            f"ask for less, or put two leads in series."
        )
    if not crossover > 0.0:
        raise InputError(f"crossover must be positive, got {crossover:g} Hz.")
    ratio = (1.0 + math.sin(phase_lead)) / (1.0 - math.sin(phase_lead))  # (3.20)
    omega = 2.0 * math.pi * crossover
    zero = omega / math.sqrt(ratio)  # (3.22), (3.24)
    pole = ratio * zero
    s = 1j * omega
    gain = 1.0 / abs((s + zero) / (s + pole) * plant(s))  # (3.26)
    return Lead(gain, zero, pole)


def phase_lead_for_margin(plant: Callable[[complex], complex], crossover: float, margin: float) -> float:
    """Phase [rad] that a lead must add (3.17)-(3.19).

    Args:
        plant: transfer function G(s) from control to measured velocity.
        crossover: gain crossover frequency [Hz].
        margin: wanted phase margin [rad].
    """
    phase = float(np.angle(plant(2j * math.pi * crossover)))
    if phase > 0.0:
        phase -= 2.0 * math.pi
    return margin - (math.pi + phase)


class TransferFunction(AbstractController):
    """Any proper transfer function on the velocity error, highest power first.

    Continuous stepping integrates it; sampled stepping uses scipy's zero-order-hold discretisation, made for the
    `period` given.

    Attributes:
        transition: A, shape (order, order).
        drive: B, shape (order,).
        output: C, shape (order,).
        through: D.
        sampled_transition: discretised A; None without a period.
        sampled_drive: discretised B; None without a period.
    """

    transition: Array
    drive: Array
    output: Array
    through: Array
    sampled_transition: Array | None
    sampled_drive: Array | None
    period: float | None = eqx.field(static=True)

    def __init__(self, numerator: Any, denominator: Any, *, period: float | None = None) -> None:
        """Realise numerator(s) / denominator(s).

        Args:
            numerator: coefficients, highest power first.
            denominator: coefficients, highest power first.
            period: control period [s] for sampled stepping.
        """
        from scipy import signal

        numerator = np.atleast_1d(np.asarray(numerator, dtype=float))
        denominator = np.atleast_1d(np.asarray(denominator, dtype=float))
        if denominator.size == 0 or denominator[0] == 0.0 or numerator.size > denominator.size:
            raise InputError(
                f"TransferFunction: {numerator.tolist()} / {denominator.tolist()} is not proper: the denominator "
                f"needs a leading coefficient other than zero and at least the numerator's order."
            )
        # The controllable form. scipy's tf2ss drops small leading coefficients of the numerator, with a warning.
        poles = denominator[1:] / denominator[0]
        zeros = np.concatenate([np.zeros(denominator.size - numerator.size), numerator / denominator[0]])
        order = poles.size
        a, b = np.zeros((order, order)), np.zeros((order, 1))
        a[:1], a[1:, :-1], b[:1] = -poles, np.eye(order)[:-1, :-1], 1.0
        c, d = (zeros[1:] - zeros[0] * poles)[None, :], zeros[0]
        self.transition, self.drive = as_parameter(a), as_parameter(b[:, 0])
        self.output, self.through = as_parameter(c[0]), as_parameter(np.asarray(d).reshape(()))
        self.period = period
        self.sampled_transition = self.sampled_drive = None
        if period is not None and denominator.size > 1:
            held: Any = signal.cont2discrete((a, b, c, d), period, method="zoh")
            self.sampled_transition = as_parameter(np.asarray(held[0]))
            self.sampled_drive = as_parameter(np.asarray(held[1])[:, 0])

    def init(self) -> tuple[Array, ...]:
        """The order's states, one scalar each."""
        return tuple(jnp.zeros_like(self.through) for _ in range(self.drive.shape[-1]))

    def derivative(self, state: Any, reference: Array, measurement: Measurement) -> tuple[Array, ...]:
        """A x + B e."""
        return self._move(self.transition, self.drive, state, reference - measurement.velocity)

    def readout(self, state: Any, reference: Array, measurement: Measurement) -> Array:
        """C x + D e [N m]."""
        error = reference - measurement.velocity
        return sum((self.output[i] * x for i, x in enumerate(state)), self.through * error)

    def step(self, state: Any, reference: Array, measurement: Measurement, dt: Array) -> tuple[Array, ...]:
        """A_d x + B_d e."""
        del dt
        if not state:
            return ()
        if self.sampled_transition is None or self.sampled_drive is None:
            raise InputError(
                "TransferFunction has no control period, so sampled stepping cannot discretise it: "
                "build it as TransferFunction(numerator, denominator, period=dt)."
            )
        return self._move(self.sampled_transition, self.sampled_drive, state, reference - measurement.velocity)

    @staticmethod
    def _move(transition: Array, drive: Array, state: Any, error: Array) -> tuple[Array, ...]:
        order = range(len(state))
        return tuple(sum((transition[i, j] * state[j] for j in order), drive[i] * error) for i in order)


class PositionLoop(AbstractController):
    """A proportional position loop around a velocity controller: the inner reference is kp (r - position).

    With `Proportional` inside it is the P/P cascade of a machine axis (EMPS).

    Attributes:
        kp: position gain [1/s].
        velocity_controller: the inner loop.
    """

    kp: Array = eqx.field(converter=as_parameter)
    velocity_controller: AbstractController

    def init(self) -> Any:
        """The inner controller's state."""
        return self.velocity_controller.init()

    def derivative(self, state: Any, reference: Array, measurement: Measurement) -> Any:
        """The inner controller's."""
        return self.velocity_controller.derivative(state, self._inner(reference, measurement), measurement)

    def readout(self, state: Any, reference: Array, measurement: Measurement) -> Array:
        """u [N m] from a position reference [rad]."""
        return self.velocity_controller.readout(state, self._inner(reference, measurement), measurement)

    def step(self, state: Any, reference: Array, measurement: Measurement, dt: Array) -> Any:
        """The inner controller's."""
        return self.velocity_controller.step(state, self._inner(reference, measurement), measurement, dt)

    def _inner(self, reference: Array, measurement: Measurement) -> Array:
        return self.kp * (reference - measurement.position)

    @property
    def bounded(self) -> bool:
        """Whether the inner controller's output has a limit."""
        return self.velocity_controller.bounded

    def unbounded(self) -> "PositionLoop":
        """Without the inner controller's limit."""
        return PositionLoop(self.kp, self.velocity_controller.unbounded())

    def limited(self, torque: Array) -> Array:
        """By the inner controller [N m]."""
        return self.velocity_controller.limited(torque)

    def follow(self, excess: Array) -> Any:
        """The inner controller's."""
        return self.velocity_controller.follow(excess)


class Limited(AbstractController):
    """Any controller with its output clipped (no anti-windup but the one that the controller has itself).

    Attributes:
        controller: what is limited.
        limit: largest |torque| that leaves, an observer's compensation included [N m].
    """

    controller: AbstractController
    limit: Array = eqx.field(converter=as_parameter)

    def __check_init__(self) -> None:
        require_positive(self, "limit", "N m")

    def init(self) -> Any:
        """The wrapped controller's."""
        return self.controller.init()

    def derivative(self, state: Any, reference: Array, measurement: Measurement) -> Any:
        """The wrapped controller's."""
        return self.controller.derivative(state, reference, measurement)

    def readout(self, state: Any, reference: Array, measurement: Measurement) -> Array:
        """u [N m], clipped."""
        return jnp.clip(self.controller.readout(state, reference, measurement), -self.limit, self.limit)

    def step(self, state: Any, reference: Array, measurement: Measurement, dt: Array) -> Any:
        """The wrapped controller's."""
        return self.controller.step(state, reference, measurement, dt)

    @property
    def bounded(self) -> bool:
        """It has a limit."""
        return True

    def unbounded(self) -> AbstractController:
        """What is limited, without."""
        return self.controller.unbounded()

    def limited(self, torque: Array) -> Array:
        """Clipped [N m]."""
        return jnp.clip(self.controller.limited(torque), -self.limit, self.limit)

    def follow(self, excess: Array) -> Any:
        """The wrapped controller's."""
        return self.controller.follow(excess)
