"""Actuators: what stands between the commanded torque and the plant."""

from abc import abstractmethod

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, PyTree

from ..compiled.elementary import sin
from ..errors import InputError
from .block import Block, as_optional, require_not_negative, require_positive
from .signals import Motion


class AbstractActuator(Block):
    """From the commanded torque u_n [N m] to the applied torque [N m]."""

    @abstractmethod
    def init(self) -> PyTree:
        """The state at rest."""

    @abstractmethod
    def derivative(self, state: PyTree, torque: Array) -> PyTree:
        """Time derivative of the state under a commanded torque [N m]."""

    @abstractmethod
    def readout(self, state: PyTree, torque: Array, motion: Motion) -> Array:
        """Applied torque [N m] now."""

    @abstractmethod
    def step(self, state: PyTree, torque: Array, motion: Motion, dt: Array) -> tuple[PyTree, Array]:
        """(next state, mean applied torque [N m] over the control period) for a torque held over dt [s]."""


class IdealActuator(AbstractActuator):
    """The applied torque is the commanded torque."""

    def init(self) -> tuple[()]:
        """No state."""
        return ()

    def derivative(self, state: PyTree, torque: Array) -> tuple[()]:
        """Nothing moves."""
        del state, torque
        return ()

    def readout(self, state: PyTree, torque: Array, motion: Motion) -> Array:
        """The command [N m]."""
        del state, motion
        return torque

    def step(self, state: PyTree, torque: Array, motion: Motion, dt: Array) -> tuple[PyTree, Array]:
        """The command [N m]."""
        del motion, dt
        return state, torque


class ActuatorState(eqx.Module):
    """Lagged torque [N m] (None without lag) and the last commands [N m], newest first (empty without delay)."""

    lagged: Array | None
    history: tuple[Array, ...]


class Actuator(AbstractActuator):
    """Delay, gain, dead zone, lag, limit, offset and cogging, in that order; None leaves a part out.

    Attributes:
        gain: applied = gain x commanded [1].
        lag: first-order time constant [s].
        delay: dead time [s], any fraction of a period; sampled stepping only.
        limit: largest |torque| [N m].
        dead_zone: the first part of the command that is lost [N m]: sign(u) max(|u| - dead_zone, 0).
        offset: constant torque added [N m].
        cogging_amplitude: A of A sin(n position + phase) [N m].
        cogging_periods: n [1/rev].
        cogging_phase: [rad].
        longest_delay: whole periods of history kept (static). A run keeps more where its delay needs more; a
            traced delay (under `jax.grad` or `jax.vmap`) must stay below it.
    """

    gain: Array | None = eqx.field(converter=as_optional, default=None)
    lag: Array | None = eqx.field(converter=as_optional, default=None)
    delay: Array | None = eqx.field(converter=as_optional, default=None)
    limit: Array | None = eqx.field(converter=as_optional, default=None)
    dead_zone: Array | None = eqx.field(converter=as_optional, default=None)
    offset: Array | None = eqx.field(converter=as_optional, default=None)
    cogging_amplitude: Array | None = eqx.field(converter=as_optional, default=None)
    cogging_periods: Array | None = eqx.field(converter=as_optional, default=None)
    cogging_phase: Array | None = eqx.field(converter=as_optional, default=None)
    longest_delay: int = eqx.field(static=True, default=8)

    def __check_init__(self) -> None:
        require_positive(self, "gain", "1")
        require_not_negative(self, "lag", "s")
        require_not_negative(self, "delay", "s")
        require_positive(self, "limit", "N m")
        require_not_negative(self, "dead_zone", "N m")
        if (self.cogging_amplitude is None) != (self.cogging_periods is None):
            raise InputError("Actuator: cogging needs both cogging_amplitude [N m] and cogging_periods [1/rev].")

    def init(self) -> ActuatorState:
        """No torque, no history."""
        lagged = None if self.lag is None else jnp.zeros_like(self.lag)
        past = () if self.delay is None else tuple(jnp.zeros_like(self.delay) for _ in range(self.longest_delay))
        return ActuatorState(lagged, past)

    def derivative(self, state: ActuatorState, torque: Array) -> ActuatorState:
        """Time derivative of the lag's state; a delay is refused, because it is no ordinary differential equation."""
        if self.delay is not None:
            raise InputError(
                "Actuator: a delay needs sampled stepping (a pure delay is no differential equation): "
                'use stepping="sampled", or drop delay.'
            )
        if self.lag is None or state.lagged is None:
            return ActuatorState(None, ())
        return ActuatorState((self.shaped(torque) - state.lagged) / self._lag_floor(), ())

    def readout(self, state: ActuatorState, torque: Array, motion: Motion) -> Array:
        """Applied torque [N m]."""
        held = self.shaped(torque) if state.lagged is None else state.lagged
        return self._finished(held, motion)

    def step(self, state: ActuatorState, torque: Array, motion: Motion, dt: Array) -> tuple[ActuatorState, Array]:
        """(next state, mean applied torque [N m] over the period); the lag is exact for a held command."""
        command, history = torque, state.history
        if self.delay is not None:
            history = (torque, *state.history[:-1])
            command = delayed(history, state.history[-1], self.delay / dt)
        shaped = self.shaped(command)
        if self.lag is None or state.lagged is None:
            return ActuatorState(None, history), self._finished(shaped, motion)
        ratio = dt / self._lag_floor()
        decay = jnp.exp(-ratio)
        # The lag is solved exactly: x(t) = command + (x0 - command) exp(-t / lag). The plant is stepped with the mean
        # torque of the period, which gives the exact change of speed, rather than with the value at either end.
        mean = shaped + (state.lagged - shaped) * (1.0 - decay) / ratio
        after = shaped + (state.lagged - shaped) * decay
        return ActuatorState(after, history), self._finished(mean, motion)

    def _lag_floor(self) -> Array:
        assert self.lag is not None
        return jnp.maximum(self.lag, 1e-9)  # [s]; a lag of zero is the neutral value, and must not divide by zero

    def shaped(self, torque: Array) -> Array:
        """What the lag is driven by [N m]: the command through gain and dead zone."""
        if self.gain is not None:
            torque = self.gain * torque
        if self.dead_zone is not None:
            # Equal to sign(u) max(|u| - dead_zone, 0), with a defined gradient at u = 0.
            torque = torque - jnp.clip(torque, -self.dead_zone, self.dead_zone)
        return torque

    def _finished(self, torque: Array, motion: Motion) -> Array:
        if self.limit is not None:
            torque = jnp.clip(torque, -self.limit, self.limit)
        if self.offset is not None:
            torque = torque + self.offset
        if self.cogging_amplitude is not None and self.cogging_periods is not None:
            angle = self.cogging_periods * motion.position
            if self.cogging_phase is not None:
                angle = angle + self.cogging_phase
            torque = torque + self.cogging_amplitude * sin(angle)
        return torque


def delayed(history: tuple[Array, ...], oldest: Array, periods: Array) -> Array:
    """Mean over one period of a held signal delayed by `periods` (any fraction), newest first in `history`.

    Linear interpolation between neighbouring periods is exact for the mean of a held signal. `oldest` is the value from
    before those in `history`.
    """
    # Triangular weights instead of an index into the history: no gather, which would break the vector loop, and the
    # result has a gradient by the delay. At any delay only two neighbouring weights are not zero.
    values = (*history, oldest)
    total = jnp.zeros_like(values[0])
    for index, value in enumerate(values):
        total = total + jnp.maximum(0.0, 1.0 - jnp.abs(periods - index)) * value
    return total
