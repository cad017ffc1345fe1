"""Torques that repeat with position (cogging, unbalance), and several loads at once."""

import cmath

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array

from .block import as_parameter
from .friction.general import fourier
from .loads import AbstractLoad, Unbalance
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


def first_harmonic(load: AbstractLoad) -> complex:
    """A e^(i phase) [N m] of what a load holds of A sin(position + phase), once a turn, in the kinds of loads here."""
    if isinstance(load, Loads):
        return sum(map(first_harmonic, load.parts), 0j)
    if isinstance(load, Unbalance):
        return cmath.rect(float(load.amplitude), float(load.phase))
    if isinstance(load, PositionTorque):
        numbered = enumerate(zip(load.sine, load.cosine, strict=True), 1)
        return sum((complex(sine, cosine) for i, (sine, cosine) in numbered if i * float(load.periods) == 1.0), 0j)
    return 0j


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
