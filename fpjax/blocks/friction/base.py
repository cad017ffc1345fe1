"""The contract of a friction law, and the smooth replacements of sign and |.|."""

from abc import abstractmethod
from typing import Any

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array

from ...compiled.elementary import log
from ...compiled.hyperbolic import tanh
from ..block import Block
from ..signals import Motion


class AbstractFriction(Block):
    """A friction law: a torque [N m] that opposes the motion, positive for positive velocity."""

    def init(self) -> Any:
        """The law's own state at rest; the empty tuple for a static law."""
        return ()

    def derivative(self, state: Any, motion: Motion) -> Any:
        """Time derivative of the state, in the state's unit per second."""
        del state, motion
        return ()

    @abstractmethod
    def readout(self, state: Any, motion: Motion, applied: Array) -> Array:
        """Friction torque [N m].

        Args:
            state: what `init` gave, moved on by `derivative`.
            motion: velocity [rad/s], position [rad] and time [s] of the body that rubs.
            applied: the torque [N m] that all else puts on the body (stiction balances it at rest).
        """


class AbstractStaticFriction(AbstractFriction):
    """A law without memory: `level` x direction(velocity) + `drag`.

    The parts are separate because a solver that resolves sticking exactly needs the set-valued level apart from the
    smooth rest.
    """

    steepness: eqx.AbstractVar[Any]

    @abstractmethod
    def level(self, motion: Motion) -> Array:
        """Magnitude [N m] of the set-valued part for motion in the direction of `motion.velocity`."""

    def breakaway(self, motion: Motion) -> Array:
        """`level` [N m] at rest, for a motion about to start in the direction of `motion.velocity` (all but zero)."""
        return self.level(motion)

    @abstractmethod
    def drag(self, motion: Motion) -> Array:
        """The part [N m] that is smooth in velocity and zero at rest."""

    def readout(self, state: Any, motion: Motion, applied: Array) -> Array:
        """Friction torque [N m]: level x sign(w), or level x tanh(steepness w), plus drag."""
        del state, applied
        return self.level(motion) * direction(motion.velocity, self.steepness) + self.drag(motion)


def direction(velocity: Array, steepness: Array | None) -> Array:
    """sign(w) where `steepness` is None (sign(0) = 0; never differentiate it), else tanh(steepness w)."""
    return jnp.sign(velocity) if steepness is None else tanh(steepness * velocity)


def log_cosh(x: Array) -> Array:
    """ln cosh(x) without overflow; the smooth form of |x| (2.30)."""
    magnitude = jnp.abs(x)
    return magnitude + log(1.0 + jnp.exp(-2.0 * magnitude)) - 0.6931471805599453


def safe_power(base: Array, exponent: Array) -> Array:
    """base ** exponent for base >= 0 with a finite gradient (zero) at base = 0."""
    positive = base > 0.0
    inside = jnp.where(positive, base, jnp.ones_like(base))
    return jnp.where(positive, jnp.exp(exponent * log(inside)), jnp.zeros_like(base))
