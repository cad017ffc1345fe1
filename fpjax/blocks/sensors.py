"""Sensors: what stands between the plant and the controller."""

from abc import abstractmethod
from typing import ClassVar, Literal, get_args

import equinox as eqx
import jax.numpy as jnp
from jax import lax
from jaxtyping import Array, PyTree

from ..errors import InputError
from .block import Block, as_parameter, require_not_negative, require_positive
from .signals import Measurement, PlantOutput

Side = Literal["load", "motor"]


class AbstractSensor(Block):
    """From the plant's output to a measurement.

    Class attributes:
        noise_channels: how many standard normal random numbers one sample takes.
    """

    noise_channels: ClassVar[int] = 0

    @abstractmethod
    def init(self) -> PyTree:
        """The state before the first sample."""

    @abstractmethod
    def step(
        self, state: PyTree, output: PlantOutput, noise: tuple[Array, ...], dt: Array
    ) -> tuple[PyTree, Measurement]:
        """(next state, what is read at the start of this control period of dt [s]); `noise` holds standard normals."""

    def readout(self, output: PlantOutput) -> Measurement:
        """The reading at any instant (continuous stepping); refused by a sensor that only works at samples."""
        del output
        raise InputError(
            f"{type(self).__name__} only works at sample instants, so continuous stepping cannot use it: "
            'use stepping="sampled", or IdealSensor().'
        )


class IdealSensor(AbstractSensor):
    """Reads the truth on one side of the transmission.

    Attributes:
        side: "load" or "motor" (static).
    """

    side: Side = eqx.field(static=True, default="load")

    def __check_init__(self) -> None:
        _require_side(self)

    def init(self) -> tuple[()]:
        """No state."""
        return ()

    def step(
        self, state: PyTree, output: PlantOutput, noise: tuple[Array, ...], dt: Array
    ) -> tuple[PyTree, Measurement]:
        """The true velocity and position."""
        del noise, dt
        return state, self.readout(output)

    def readout(self, output: PlantOutput) -> Measurement:
        """The true velocity [rad/s] and position [rad]."""
        return _on_side(self.side, output)


class Gyro(AbstractSensor):
    """A rate gyro: scale x w + bias + random-walk bias + white noise; its position is the integral of its rate.

    Attributes:
        noise: standard deviation of one sample [rad/s].
        bias: constant bias [rad/s].
        random_walk: bias random walk [rad/s/sqrt(s)].
        scale: [1].
        side: "load" or "motor" (static).
    """

    noise_channels: ClassVar[int] = 2

    noise: Array = eqx.field(converter=as_parameter)
    bias: Array = eqx.field(converter=as_parameter, default=0.0)
    random_walk: Array = eqx.field(converter=as_parameter, default=0.0)
    scale: Array = eqx.field(converter=as_parameter, default=1.0)
    side: Side = eqx.field(static=True, default="load")

    def __check_init__(self) -> None:
        require_not_negative(self, "noise", "rad/s")
        require_not_negative(self, "random_walk", "rad/s/sqrt(s)")
        _require_side(self)

    def init(self) -> tuple[Array, Array]:
        """(wandering bias [rad/s], integrated angle [rad])."""
        return jnp.zeros_like(self.noise), jnp.zeros_like(self.noise)

    def step(
        self, state: PyTree, output: PlantOutput, noise: tuple[Array, ...], dt: Array
    ) -> tuple[PyTree, Measurement]:
        """A noisy rate [rad/s] and its integral [rad]."""
        wander, angle = state
        true = _on_side(self.side, output)
        rate = self.scale * true.velocity + self.bias + wander + self.noise * noise[0]
        # A random walk's standard deviation grows with the square root of time. What is read now uses the bias and the
        # angle of the sample before: a drive's integral is one period old.
        following = (wander + self.random_walk * jnp.sqrt(dt) * noise[1], angle + dt * rate)
        return following, Measurement(rate, angle)


class Encoder(AbstractSensor):
    """An encoder: position rounded to a step, velocity from its differences through a first-order low-pass.

    Attributes:
        step_size: [rad] per count; 0 for none.
        noise: standard deviation of a reading before rounding [rad].
        filter_time: time constant [s] of the low-pass filter on the difference; 0 for the plain difference.
        side: "load" or "motor" (static).
    """

    noise_channels: ClassVar[int] = 1

    step_size: Array = eqx.field(converter=as_parameter)
    noise: Array = eqx.field(converter=as_parameter, default=0.0)
    filter_time: Array = eqx.field(converter=as_parameter, default=0.0)
    side: Side = eqx.field(static=True, default="load")

    def __check_init__(self) -> None:
        require_not_negative(self, "step_size", "rad")
        require_not_negative(self, "noise", "rad")
        require_not_negative(self, "filter_time", "s")
        _require_side(self)

    def init(self) -> tuple[Array, Array, Array]:
        """(last reading [rad], filtered velocity [rad/s], 0 before the first sample and 1 after)."""
        zero = jnp.zeros_like(self.step_size)
        return zero, zero, zero

    def step(
        self, state: PyTree, output: PlantOutput, noise: tuple[Array, ...], dt: Array
    ) -> tuple[PyTree, Measurement]:
        """A rounded position [rad] and its filtered difference [rad/s]."""
        before, velocity, started = state
        reading = quantise(_on_side(self.side, output).position + self.noise * noise[0], self.step_size)
        # The first sample has no difference: `started` is 0 there, or the position at the start would look like a
        # jump.
        difference = started * (reading - before) / dt
        # The low-pass in backward Euler: stable at any filter_time, and the plain difference at 0.
        velocity = velocity + dt / (dt + self.filter_time) * (difference - velocity)
        return (reading, velocity, jnp.ones_like(started)), Measurement(velocity, reading)


class KalmanFusion(AbstractSensor):
    """A gyro and an encoder fused by a Kalman filter with states (angle [rad], gyro bias [rad/s]).

    The gyro's rate drives the angle (error-state form); the encoder corrects angle and bias. The velocity is the
    gyro's rate less the estimated bias: bandwidth of the gyro, drift of the encoder (Lefferts, Markley, Shuster,
    "Kalman filtering for spacecraft attitude estimation", 1982).

    Attributes:
        gyro: the rate sensor.
        encoder: the position sensor.
        angle_noise: standard deviation that the filter assumes for a position reading [rad]; the rounding alone makes
            step_size / sqrt(12), so give at least that.
    """

    noise_channels: ClassVar[int] = 3

    gyro: Gyro
    encoder: Encoder
    angle_noise: Array = eqx.field(converter=as_parameter)

    def __check_init__(self) -> None:
        require_positive(self, "angle_noise", "rad")

    def init(self) -> PyTree:
        """Both sensors' states, (angle, bias), and the covariance (p11, p12, p22)."""
        zero = jnp.zeros_like(self.angle_noise)
        # The bias starts with a standard deviation of 1 rad/s, far above any gyro's: the first readings decide.
        spread = jnp.square(self.angle_noise)
        return self.gyro.init(), self.encoder.init(), (zero, zero), (spread, zero, zero + 1.0)

    def step(
        self, state: PyTree, output: PlantOutput, noise: tuple[Array, ...], dt: Array
    ) -> tuple[PyTree, Measurement]:
        """Fused velocity [rad/s] and position [rad]."""
        gyro_state, encoder_state, (angle, bias), (p11, p12, p22) = state
        gyro_state, rate = self.gyro.step(gyro_state, output, noise[:2], dt)
        encoder_state, reading = self.encoder.step(encoder_state, output, noise[2:], dt)
        # Correct with the encoder (measurement of the angle).
        reading_variance = jnp.square(self.angle_noise)
        innovation = p11 + reading_variance
        gain_angle, gain_bias = p11 / innovation, p12 / innovation
        # The innovation's value; `innovation` above is its variance.
        residual = reading.position - angle
        angle, bias = angle + gain_angle * residual, bias + gain_bias * residual
        # gain x R equals (1 - gain) p11, without the cancellation that leaves float32 no digits where the encoder is
        # far more accurate than the prediction.
        p11, p12, p22 = gain_angle * reading_variance, gain_bias * reading_variance, p22 - gain_bias * p12
        velocity = rate.velocity - bias
        measurement = Measurement(velocity, angle)
        # Predict to the next sample with the rate held; the bias walks.
        angle = angle + dt * velocity
        p11 = p11 - 2.0 * dt * p12 + dt * dt * (p22 + jnp.square(self.gyro.noise))
        p12 = p12 - dt * p22
        p22 = p22 + dt * jnp.square(self.gyro.random_walk)
        return (gyro_state, encoder_state, (angle, bias), (p11, p12, p22)), measurement


def quantise(value: Array, step_size: Array) -> Array:
    """Round to multiples of `step_size` (0: no rounding); the gradient is that of no rounding (straight-through)."""
    positive = step_size > 0.0
    size = jnp.where(positive, step_size, jnp.ones_like(step_size))
    rounded = jnp.round(value / size) * size
    correction = jnp.where(positive, rounded - value, jnp.zeros_like(value))
    return value + lax.stop_gradient(correction)


def _require_side(sensor: "IdealSensor | Gyro | Encoder") -> None:
    """Refuse a side of the transmission that there is not: it would be the load's without a word."""
    if sensor.side not in get_args(Side):
        known = " or ".join(map(repr, get_args(Side)))
        raise InputError(f"The side of {type(sensor).__name__} must be {known}, got {sensor.side!r}.")


def _on_side(side: Side, output: PlantOutput) -> Measurement:
    if side == "motor":
        return Measurement(output.motor_velocity, output.motor_position)
    return Measurement(output.velocity, output.position)
