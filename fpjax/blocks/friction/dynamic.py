"""Friction laws with memory: Dahl and LuGre bristles."""

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array

from ..block import as_parameter, require_not_below, require_not_negative, require_positive
from ..signals import Motion
from .base import AbstractFriction, safe_power
from .bristles import Bristles
from .general import GeneralFriction
from .static import stribeck_curve


class Dahl(AbstractFriction):
    """Dahl friction (1.6): dF/dt = sigma (1 - F/F_c sign(w))^alpha w, plus viscous b w.

    The power keeps the sign of its base, so that the law stays well defined above F_c.

    Attributes:
        coulomb: F_c [N m].
        stiffness: sigma [N m/rad].
        exponent: alpha [1].
        viscous: b [N m s/rad].
    """

    coulomb: Array = eqx.field(converter=as_parameter)
    stiffness: Array = eqx.field(converter=as_parameter)
    exponent: Array = eqx.field(converter=as_parameter, default=1.0)
    viscous: Array = eqx.field(converter=as_parameter, default=0.0)

    def __check_init__(self) -> None:
        require_positive(self, "coulomb", "N m")
        require_positive(self, "stiffness", "N m/rad")
        require_positive(self, "exponent", "1")
        require_not_negative(self, "viscous", "N m s/rad")

    def init(self) -> Array:
        """The bristles' torque F [N m] at rest, unloaded."""
        return jnp.zeros_like(self.coulomb)

    def derivative(self, state: Array, motion: Motion) -> Array:
        """dF/dt [N m/s]."""
        # 1 unloaded, 0 where the bristles are fully deflected; above 1 when the motion reverses, so that they unload
        # faster
        slack = 1.0 - state / self.coulomb * jnp.sign(motion.velocity)
        shape = jnp.sign(slack) * safe_power(jnp.abs(slack), self.exponent)
        return self.stiffness * shape * motion.velocity

    def readout(self, state: Array, motion: Motion, applied: Array) -> Array:
        """F + b w [N m]."""
        del applied
        return state + self.viscous * motion.velocity

    def general(self) -> Bristles:
        """Bristles of deflection F_c / sigma within k and b."""
        return Bristles(
            GeneralFriction(self.coulomb, self.viscous), self.coulomb / self.stiffness, exponent=self.exponent
        )


class LuGre(AbstractFriction):
    """LuGre friction (1.7)-(1.8): dz/dt = w - sigma_0 |w| z / g(w); F = sigma_0 z + sigma_1 dz/dt + sigma_2 w.

    g(w) = F_c + (F_s - F_c) exp(-|w / v_s|^delta), the Stribeck curve (1.4) without its viscous part (Canudas de Wit,
    Olsson, Astrom, Lischinsky, "A new model for control of systems with friction", 1995).

    Attributes:
        coulomb: F_c [N m].
        static: F_s [N m], at least F_c.
        stribeck_velocity: v_s [rad/s].
        bristle_stiffness: sigma_0 [N m/rad].
        bristle_damping: sigma_1 [N m s/rad].
        viscous: sigma_2 [N m s/rad].
        exponent: delta [1].
    """

    coulomb: Array = eqx.field(converter=as_parameter)
    static: Array = eqx.field(converter=as_parameter)
    stribeck_velocity: Array = eqx.field(converter=as_parameter)
    bristle_stiffness: Array = eqx.field(converter=as_parameter)
    bristle_damping: Array = eqx.field(converter=as_parameter, default=0.0)
    viscous: Array = eqx.field(converter=as_parameter, default=0.0)
    exponent: Array = eqx.field(converter=as_parameter, default=2.0)

    def __check_init__(self) -> None:
        require_positive(self, "coulomb", "N m")
        require_not_below(self, "static", "coulomb", "N m")
        require_positive(self, "stribeck_velocity", "rad/s")
        require_positive(self, "bristle_stiffness", "N m/rad")
        require_not_negative(self, "bristle_damping", "N m s/rad")
        require_not_negative(self, "viscous", "N m s/rad")
        require_positive(self, "exponent", "1")

    def init(self) -> Array:
        """Mean bristle deflection z [rad] at rest, unloaded."""
        return jnp.zeros_like(self.coulomb)

    def derivative(self, state: Array, motion: Motion) -> Array:
        """dz/dt [rad/s] (1.7)."""
        velocity = motion.velocity
        curve = stribeck_curve(velocity, self.coulomb, self.static, self.stribeck_velocity, self.exponent)
        return velocity - self.bristle_stiffness * jnp.abs(velocity) * state / curve

    def readout(self, state: Array, motion: Motion, applied: Array) -> Array:
        """sigma_0 z + sigma_1 dz/dt + sigma_2 w [N m] (1.8)."""
        del applied
        # sigma_1 damps the bristles and not the body: beyond the presliding range dz/dt is 0, and only sigma_2 is
        # left
        rate = self.derivative(state, motion)
        return self.bristle_stiffness * state + self.bristle_damping * rate + self.viscous * motion.velocity

    def general(self) -> Bristles:
        """Bristles of the constant deflection F_c / sigma_0 within Stribeck's curve.

        LuGre's own deflection, g(w) / sigma_0, is larger where the curve is: the two agree above the Stribeck velocity.
        """
        law = GeneralFriction(
            self.coulomb,
            self.viscous,
            stribeck_torque=self.static - self.coulomb,
            stribeck_velocity=self.stribeck_velocity,
            stribeck_exponent=self.exponent,
        )
        return Bristles(law, self.coulomb / self.bristle_stiffness, self.bristle_damping)
