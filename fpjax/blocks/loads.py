"""Known loads on the plant: the torque that the motor must hold besides friction."""

from abc import abstractmethod

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array

from ..compiled.elementary import sin
from .block import Block, as_parameter
from .signals import Motion


class AbstractLoad(Block):
    """A torque [N m] that the motor must hold; it enters with the sign of positive friction."""

    @abstractmethod
    def readout(self, motion: Motion) -> Array:
        """Load torque [N m]."""


class NoLoad(AbstractLoad):
    """Nothing to hold."""

    def readout(self, motion: Motion) -> Array:
        """Zero [N m]."""
        return jnp.zeros_like(motion.velocity)


class Unbalance(AbstractLoad):
    """amplitude x sin(position + phase) + offset: an eccentric mass, and a constant torque.

    Attributes:
        amplitude: A [N m].
        phase: [rad].
        offset: constant torque [N m].
    """

    amplitude: Array = eqx.field(converter=as_parameter)
    phase: Array = eqx.field(converter=as_parameter, default=0.0)
    offset: Array = eqx.field(converter=as_parameter, default=0.0)

    def readout(self, motion: Motion) -> Array:
        """Load torque [N m]."""
        return self.amplitude * sin(motion.position + self.phase) + self.offset


def turns_with_position(load: AbstractLoad, more: float = 0.0) -> bool:
    """Whether a load depends on the position.

    Args:
        load: with any number of periods a revolution, a whole one or not.
        more: by more than this [N m].
    """
    # No load with a whole number of periods a revolution is equal at these three angles. One by one: a user's own load
    # may take one angle alone.
    rest = jnp.zeros(())
    found = [float(load.readout(Motion(rest, jnp.asarray(angle), rest))) for angle in (0.0, 0.7, 1.9)]
    return max(found) - min(found) > more
