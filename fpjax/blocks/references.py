"""References: what the loop must follow, as functions of time."""

from abc import abstractmethod
from typing import ClassVar

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from ..compiled.elementary import sin
from ..errors import InputError
from .block import Block, as_parameter, require_positive


class AbstractReference(Block):
    """r(t) [rad/s], or [rad] for a position loop."""

    hertz: ClassVar[tuple[str, ...]] = ()
    """Names of the fields that hold frequencies [Hz], which must stay below half the sample rate."""

    @abstractmethod
    def readout(self, time: Array) -> Array:
        """r at time [s]; any shape in, the same shape out."""


class Constant(AbstractReference):
    """A constant.

    Attributes:
        amplitude: [rad/s].
    """

    amplitude: Array = eqx.field(converter=as_parameter)

    def readout(self, time: Array) -> Array:
        """The amplitude."""
        return self.amplitude + jnp.zeros_like(time)


class Sine(AbstractReference):
    """amplitude sin(2 pi frequency t + phase) + offset.

    Attributes:
        amplitude: [rad/s].
        frequency: [Hz].
        phase: [rad].
        offset: [rad/s].
    """

    hertz: ClassVar[tuple[str, ...]] = ("frequency",)
    amplitude: Array = eqx.field(converter=as_parameter)
    frequency: Array = eqx.field(converter=as_parameter)
    phase: Array = eqx.field(converter=as_parameter, default=0.0)
    offset: Array = eqx.field(converter=as_parameter, default=0.0)

    def readout(self, time: Array) -> Array:
        """The sine at time [s]."""
        return self.amplitude * sin(2.0 * jnp.pi * self.frequency * time + self.phase) + self.offset


class Chirp(AbstractReference):
    """A linear frequency sweep: amplitude sin(2 pi (f0 t + (f1 - f0) t^2 / (2 T))); after T it stays at f1.

    Attributes:
        amplitude: [rad/s].
        start_frequency: f0 [Hz] at t = 0.
        end_frequency: f1 [Hz] at t = T.
        sweep_time: T [s].
    """

    hertz: ClassVar[tuple[str, ...]] = ("start_frequency", "end_frequency")
    amplitude: Array = eqx.field(converter=as_parameter)
    start_frequency: Array = eqx.field(converter=as_parameter)
    end_frequency: Array = eqx.field(converter=as_parameter)
    sweep_time: Array = eqx.field(converter=as_parameter)

    def __check_init__(self) -> None:
        require_positive(self, "sweep_time", "s")

    def readout(self, time: Array) -> Array:
        """The chirp at time [s]."""
        rate = (self.end_frequency - self.start_frequency) / self.sweep_time
        # The phase is the integral of the frequency: a quadratic while it sweeps, linear at f1 afterwards.
        sweeping = jnp.minimum(time, self.sweep_time)
        turns = self.start_frequency * sweeping + 0.5 * rate * sweeping * sweeping
        turns = turns + self.end_frequency * (time - sweeping)
        return self.amplitude * sin(2.0 * jnp.pi * turns)


class Triangle(AbstractReference):
    """A triangle wave that starts at zero, rising, like a sine.

    Attributes:
        amplitude: [rad/s].
        frequency: [Hz].
        phase: [rad].
    """

    hertz: ClassVar[tuple[str, ...]] = ("frequency",)
    amplitude: Array = eqx.field(converter=as_parameter)
    frequency: Array = eqx.field(converter=as_parameter)
    phase: Array = eqx.field(converter=as_parameter, default=0.0)

    def readout(self, time: Array) -> Array:
        """The triangle at time [s]."""
        # The position within a cycle, from 0 to 1; a quarter ahead, so that the wave starts at zero and rises.
        cycle = jnp.mod(self.frequency * time + self.phase / (2.0 * jnp.pi) + 0.25, 1.0)
        return self.amplitude * (1.0 - 4.0 * jnp.abs(cycle - 0.5))


class Square(AbstractReference):
    """A square wave that starts high.

    Attributes:
        amplitude: [rad/s].
        frequency: [Hz].
        phase: [rad].
    """

    hertz: ClassVar[tuple[str, ...]] = ("frequency",)
    amplitude: Array = eqx.field(converter=as_parameter)
    frequency: Array = eqx.field(converter=as_parameter)
    phase: Array = eqx.field(converter=as_parameter, default=0.0)

    def readout(self, time: Array) -> Array:
        """The square wave at time [s]."""
        cycle = jnp.mod(self.frequency * time + self.phase / (2.0 * jnp.pi), 1.0)
        return jnp.where(cycle < 0.5, self.amplitude, -self.amplitude)


class Multisine(AbstractReference):
    """A sum of sines.

    Attributes:
        amplitudes: [rad/s], shape (tones,).
        frequencies: [Hz], shape (tones,).
        phases: [rad], shape (tones,).
    """

    hertz: ClassVar[tuple[str, ...]] = ("frequencies",)
    amplitudes: Array = eqx.field(converter=as_parameter)
    frequencies: Array = eqx.field(converter=as_parameter)
    phases: Array = eqx.field(converter=as_parameter)

    def __check_init__(self) -> None:
        shapes = {np.shape(leaf) for leaf in (self.amplitudes, self.frequencies, self.phases)}
        if len(shapes) != 1:
            raise InputError(
                f"Multisine: amplitudes, frequencies and phases have the shapes {sorted(shapes)}: give one of each for "
                "every tone."
            )

    def readout(self, time: Array) -> Array:
        """The sum at time [s]."""
        angle = 2.0 * jnp.pi * jnp.expand_dims(time, -1) * self._spread(self.frequencies, time)
        tones = self._spread(self.amplitudes, time) * sin(angle + self._spread(self.phases, time))
        return jnp.sum(tones, axis=-1)

    @staticmethod
    def _spread(values: Array, time: Array) -> Array:
        return jnp.reshape(values, (1,) * time.ndim + values.shape)


class Recorded(AbstractReference):
    """A recorded signal, held from sample to sample (what a drive does) or interpolated.

    Attributes:
        values: r [rad/s] or [rad], shape (samples,).
        interval: time between samples [s].
        hold: hold each value until the next sample (static); else interpolate linearly.
    """

    values: Array = eqx.field(converter=as_parameter)
    interval: Array = eqx.field(converter=as_parameter)
    hold: bool = eqx.field(static=True, default=True)

    def __check_init__(self) -> None:
        require_positive(self, "interval", "s")

    def readout(self, time: Array) -> Array:
        """The recorded value at time [s]; the first and the last value continue outside.

        Raises:
            InputError: for values of another shape than (samples,), or none at all.
        """
        if self.values.ndim != 1 or not self.values.size:  # here, as a batch of records may be made for a vmap
            raise InputError(
                f"Recorded: values have the shape {self.values.shape}: give one number for each sample, at least one."
            )
        place = jnp.clip(time / self.interval, 0.0, self.values.shape[-1] - 1.0)
        # A sample instant computed as k * dt may fall a rounding error short of sample k, which would hold the sample
        # before: a thousandth of an interval is added.
        index = jnp.floor(place + 1e-3).astype(int)
        before = self.values[index]
        if self.hold:
            return before
        after = self.values[jnp.minimum(index + 1, self.values.shape[-1] - 1)]
        return before + jnp.clip(place - index.astype(place.dtype), 0.0, 1.0) * (after - before)

    def ends_between(self, start: Array, end: Array) -> Array:
        """Whether the last sample is at or after `start` [s] and before `end` [s]; shape ()."""
        last = (self.values.shape[-1] - 1.0) * self.interval
        near = 1e-3 * self.interval  # as in `readout`
        return (start <= last + near) & (end > last + near)
