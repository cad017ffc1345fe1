"""The sensor of a real servo: its side, lag and dead time, scale and bias, rounding step and noise."""

from typing import ClassVar

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array

from .actuators import delayed
from .block import as_parameter, require_not_negative, require_positive
from .sensors import AbstractSensor, quantise
from .signals import Measurement, PlantOutput


class ServoSensorState(eqx.Module):
    """State of `ServoSensor`.

    Attributes:
        lagged: the lag's output at the last sample [rad/s].
        before: the true rate at the last sample [rad/s].
        history: earlier outputs of the lag, newest first [rad/s].
        started: 0 before the first sample, then 1.
    """

    lagged: Array
    before: Array
    history: tuple[Array, ...]
    started: Array


class ServoSensor(AbstractSensor):
    """The rate with lag, dead time, scale, bias, noise and rounding, in that order; the position with its own noise
    and rounding.

    Every field has a neutral value at which it has no effect.

    Attributes:
        load_side: 1 reads the load, 0 the motor, values between a mixture [1]. It is an array leaf, so that candidates
            of both sides run in one batch.
        scale: reading = scale x rate + bias [1]; neutral 1.
        bias: [rad/s]; neutral 0.
        lag: first-order time constant [s]; neutral 0.
        delay: dead time [s], any fraction of a period; neutral 0.
        noise: standard deviation of a rate reading [rad/s].
        step_size: rate is rounded to it [rad/s]; neutral 0.
        position_noise: [rad].
        position_step: [rad]; neutral 0.
        longest_delay: whole periods of history kept (static). A run keeps more where its delay needs more; a
            traced delay (under `jax.grad` or `jax.vmap`) must stay below it.
    """

    noise_channels: ClassVar[int] = 2

    load_side: Array = eqx.field(converter=as_parameter, default=1.0)
    scale: Array = eqx.field(converter=as_parameter, default=1.0)
    bias: Array = eqx.field(converter=as_parameter, default=0.0)
    lag: Array = eqx.field(converter=as_parameter, default=0.0)
    delay: Array = eqx.field(converter=as_parameter, default=0.0)
    noise: Array = eqx.field(converter=as_parameter, default=0.0)
    step_size: Array = eqx.field(converter=as_parameter, default=0.0)
    position_noise: Array = eqx.field(converter=as_parameter, default=0.0)
    position_step: Array = eqx.field(converter=as_parameter, default=0.0)
    longest_delay: int = eqx.field(static=True, default=16)

    def __check_init__(self) -> None:
        require_positive(self, "scale", "1")
        for name, unit in (("lag", "s"), ("delay", "s"), ("noise", "rad/s"), ("step_size", "rad/s")):
            require_not_negative(self, name, unit)
        require_not_negative(self, "position_noise", "rad")
        require_not_negative(self, "position_step", "rad")

    def init(self) -> ServoSensorState:
        """At rest."""
        zero = jnp.zeros_like(self.scale)
        return ServoSensorState(zero, zero, tuple(zero for _ in range(self.longest_delay)), zero)

    def step(
        self, state: ServoSensorState, output: PlantOutput, noise: tuple[Array, ...], dt: Array
    ) -> tuple[ServoSensorState, Measurement]:
        """Rate [rad/s] and position [rad] read now."""
        rate, angle = self.seen(output)
        lagged = jnp.where(state.started > 0.0, self.follow(state.lagged, state.before, rate, dt), rate)
        history = (lagged, *state.history[:-1])
        late = delayed(history, state.history[-1], self.delay / dt)
        reading = quantise(self.reading(late) + self.noise * noise[0], self.step_size)
        position = quantise(angle + self.position_noise * noise[1], self.position_step)
        return ServoSensorState(lagged, rate, history, jnp.ones_like(rate)), Measurement(reading, position)

    def seen(self, output: PlantOutput) -> tuple[Array, Array]:
        """True rate [rad/s] and position [rad] on the sensor's side."""
        rate = output.motor_velocity + self.load_side * (output.velocity - output.motor_velocity)
        angle = output.motor_position + self.load_side * (output.position - output.motor_position)
        return rate, angle

    def follow(self, lagged: Array, before: Array, rate: Array, dt: Array) -> Array:
        """The lag's output [rad/s] after a period in which the rate went from `before` to `rate` in a straight line."""
        # The exact response to a ramp: it follows the ramp late by lag x slope, and the difference at the start
        # decays. The floor keeps the division finite for the neutral lag of 0, which the last line replaces.
        lag = jnp.maximum(self.lag, 1e-6 * dt)
        slope = lag * (rate - before) / dt
        late = rate - slope + (lagged - before + slope) * jnp.exp(-dt / lag)
        return jnp.where(self.lag > 0.0, late, rate)

    def reading(self, rate: Array) -> Array:
        """scale x rate + bias [rad/s]."""
        return self.scale * rate + self.bias
