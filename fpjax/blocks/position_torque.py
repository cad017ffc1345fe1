"""Torques that repeat with position (cogging, unbalance), and several loads at once."""

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array

from .block import as_parameter
from .friction.general import fourier
from .loads import AbstractLoad
from .signals import Motion


class PositionTorque(AbstractLoad):
    """sum_i cosine_i cos(i n position) + sine_i sin(i n position).

    It is linear in its amplitudes, so that a fit has no phase to search for. The amplitudes are tuples of scalars, so
    that arrays of candidates pass through without vmap.

    Attributes:
        cosine: of the harmonics 1, 2 ... of n [N m]; neutral 0.
        sine: likewise [N m]; neutral 0.
        periods: n [1/rev].
    """

    cosine: tuple[Array, ...]
    sine: tuple[Array, ...]
    periods: Array = eqx.field(converter=as_parameter, default=1.0)

    def readout(self, motion: Motion) -> Array:
        """Load torque [N m]."""
        return fourier(self.cosine, self.sine, self.periods * motion.position)


class ConstantTorque(AbstractLoad):
    """A constant torque that the motor must hold.

    Attributes:
        torque: [N m].
    """

    torque: Array = eqx.field(converter=as_parameter)

    def readout(self, motion: Motion) -> Array:
        """Load torque [N m]."""
        return self.torque + jnp.zeros_like(motion.velocity)


class Loads(AbstractLoad):
    """The sum of several loads.

    Attributes:
        parts: the loads.
    """

    parts: tuple[AbstractLoad, ...]

    def readout(self, motion: Motion) -> Array:
        """Load torque [N m]."""
        total = jnp.zeros_like(motion.velocity)
        for part in self.parts:
            total = total + part.readout(motion)
        return total
