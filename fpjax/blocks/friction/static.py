"""Friction laws without memory: Coulomb, its smooth form, viscous, stiction, Stribeck, and levels by direction."""

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, PyTree

from ...compiled.hyperbolic import tanh
from ..block import as_optional, as_parameter, require_not_below, require_not_negative, require_positive
from ..signals import Motion
from .base import AbstractFriction, AbstractStaticFriction, safe_power
from .general import GeneralFriction


class NoFriction(AbstractFriction):
    """A frictionless body."""

    def readout(self, state: PyTree, motion: Motion, applied: Array) -> Array:
        """Zero [N m]."""
        del state, applied
        return jnp.zeros_like(motion.velocity)

    def general(self) -> GeneralFriction:
        """Every term at zero."""
        return GeneralFriction(0.0, 0.0)


class Coulomb(AbstractStaticFriction):
    """Coulomb friction k sign(w) (1.2), set-valued: for comparing with the thesis' figures, never for gradients.

    Attributes:
        coulomb: k [N m].
        steepness: always None; `SmoothCoulomb` is the law with one.
    """

    coulomb: Array = eqx.field(converter=as_parameter)
    steepness: None = None

    def __check_init__(self) -> None:
        require_not_negative(self, "coulomb", "N m")

    def level(self, motion: Motion) -> Array:
        """k [N m]."""
        del motion
        return self.coulomb

    def drag(self, motion: Motion) -> Array:
        """Zero [N m]."""
        return jnp.zeros_like(motion.velocity)

    def general(self) -> GeneralFriction:
        """k alone."""
        return GeneralFriction(self.coulomb, 0.0)


class SmoothCoulomb(AbstractStaticFriction):
    """Smooth Coulomb friction k tanh(lambda w) (4.16); the steepness is a parameter like any other.

    Attributes:
        coulomb: k [N m].
        steepness: lambda [s/rad].
    """

    coulomb: Array = eqx.field(converter=as_parameter)
    steepness: Array = eqx.field(converter=as_parameter)

    def __check_init__(self) -> None:
        require_not_negative(self, "coulomb", "N m")
        require_positive(self, "steepness", "s/rad")

    def level(self, motion: Motion) -> Array:
        """k [N m]."""
        del motion
        return self.coulomb

    def drag(self, motion: Motion) -> Array:
        """Zero [N m]."""
        return jnp.zeros_like(motion.velocity)

    def general(self) -> GeneralFriction:
        """k and lambda alone."""
        return GeneralFriction(self.coulomb, 0.0, steepness=self.steepness)


class Viscous(AbstractStaticFriction):
    """Viscous friction b w, the linear part of (1.3).

    Attributes:
        viscous: b [N m s/rad].
        steepness: always None: there is no set-valued part to smooth.
    """

    viscous: Array = eqx.field(converter=as_parameter)
    steepness: None = None

    def __check_init__(self) -> None:
        require_not_negative(self, "viscous", "N m s/rad")

    def level(self, motion: Motion) -> Array:
        """Zero [N m]."""
        return jnp.zeros_like(motion.velocity)

    def drag(self, motion: Motion) -> Array:
        """b w [N m]."""
        return self.viscous * motion.velocity

    def general(self) -> GeneralFriction:
        """b alone."""
        return GeneralFriction(0.0, self.viscous)


class CoulombViscous(AbstractStaticFriction):
    """k sign(w) + b w (1.3), (2.3); with a steepness k tanh(lambda w) + b w (4.17).

    Attributes:
        coulomb: k [N m].
        viscous: b [N m s/rad].
        steepness: lambda [s/rad]; None for sign.
    """

    coulomb: Array = eqx.field(converter=as_parameter)
    viscous: Array = eqx.field(converter=as_parameter)
    steepness: Array | None = eqx.field(converter=as_optional, default=None)

    def __check_init__(self) -> None:
        require_not_negative(self, "coulomb", "N m")
        require_not_negative(self, "viscous", "N m s/rad")
        require_positive(self, "steepness", "s/rad")

    def level(self, motion: Motion) -> Array:
        """k [N m]."""
        del motion
        return self.coulomb

    def drag(self, motion: Motion) -> Array:
        """b w [N m]."""
        return self.viscous * motion.velocity

    def general(self) -> GeneralFriction:
        """k, b and lambda alone."""
        return GeneralFriction(self.coulomb, self.viscous, steepness=self.steepness)


class Stribeck(AbstractStaticFriction):
    """Stribeck friction (1.4): [F_c + (F_s - F_c) exp(-|w / v_s|^delta)] sign(w) + b w.

    Attributes:
        coulomb: F_c [N m].
        static: F_s [N m], at least F_c.
        stribeck_velocity: v_s [rad/s].
        viscous: b [N m s/rad].
        exponent: delta [1]; 1 is Tustin's curve, 2 the Gaussian.
        steepness: lambda [s/rad]; None for sign.
    """

    coulomb: Array = eqx.field(converter=as_parameter)
    static: Array = eqx.field(converter=as_parameter)
    stribeck_velocity: Array = eqx.field(converter=as_parameter)
    viscous: Array = eqx.field(converter=as_parameter, default=0.0)
    exponent: Array = eqx.field(converter=as_parameter, default=2.0)
    steepness: Array | None = eqx.field(converter=as_optional, default=None)

    def __check_init__(self) -> None:
        require_not_negative(self, "coulomb", "N m")
        require_not_below(self, "static", "coulomb", "N m")
        require_positive(self, "stribeck_velocity", "rad/s")
        require_not_negative(self, "viscous", "N m s/rad")
        require_positive(self, "exponent", "1")
        require_positive(self, "steepness", "s/rad")

    def level(self, motion: Motion) -> Array:
        """F_c + (F_s - F_c) exp(-|w / v_s|^delta) [N m]."""
        return stribeck_curve(motion.velocity, self.coulomb, self.static, self.stribeck_velocity, self.exponent)

    def drag(self, motion: Motion) -> Array:
        """b w [N m]."""
        return self.viscous * motion.velocity

    def general(self) -> GeneralFriction:
        """With F_s - F_c as the Stribeck torque."""
        return GeneralFriction(
            self.coulomb,
            self.viscous,
            stribeck_torque=self.static - self.coulomb,
            stribeck_velocity=self.stribeck_velocity,
            stribeck_exponent=self.exponent,
            steepness=self.steepness,
        )


class CoulombViscousStiction(AbstractStaticFriction):
    """Coulomb and viscous friction with stiction (1.5): at rest it balances the applied torque up to F_s.

    A fixed-step solver does not hit rest exactly, so a band of speeds counts as rest (Karnopp, "Computer simulation of
    stick-slip friction in mechanical dynamic systems", 1985). Within the band friction balances the applied torque and
    brakes the remaining motion with F_s w / stick_velocity, so that a stuck body comes to rest instead of creeping on.
    The solver "exact" needs no band.

    Attributes:
        coulomb: F_c [N m], while sliding.
        static: F_s [N m], to break away; at least F_c.
        viscous: b [N m s/rad].
        stick_velocity: half-width of the band that counts as rest [rad/s].
        steepness: lambda [s/rad] while sliding; None for sign.
    """

    coulomb: Array = eqx.field(converter=as_parameter)
    static: Array = eqx.field(converter=as_parameter)
    viscous: Array = eqx.field(converter=as_parameter, default=0.0)
    stick_velocity: Array = eqx.field(converter=as_parameter, default=1e-3)
    steepness: Array | None = eqx.field(converter=as_optional, default=None)

    def __check_init__(self) -> None:
        require_not_negative(self, "coulomb", "N m")
        require_not_below(self, "static", "coulomb", "N m")
        require_not_negative(self, "viscous", "N m s/rad")
        require_positive(self, "stick_velocity", "rad/s")
        require_positive(self, "steepness", "s/rad")

    def level(self, motion: Motion) -> Array:
        """F_s within the band, F_c beyond [N m]."""
        return jnp.where(jnp.abs(motion.velocity) <= self.stick_velocity, self.static, self.coulomb)

    def drag(self, motion: Motion) -> Array:
        """b w [N m]."""
        return self.viscous * motion.velocity

    def readout(self, state: PyTree, motion: Motion, applied: Array) -> Array:
        """Friction torque [N m]."""
        # Both are computed and one is selected: a branch cannot be batched, and neither of the two can become infinite.
        sliding = CoulombViscous(self.coulomb, self.viscous, self.steepness).readout(state, motion, applied)
        brake = self.static * motion.velocity / self.stick_velocity
        # At the edge of the band the brake alone is F_s, the largest torque that sticking can take.
        stuck = jnp.clip(applied + brake, -self.static, self.static)
        return jnp.where(jnp.abs(motion.velocity) <= self.stick_velocity, stuck, sliding)


class AsymmetricCoulombViscous(AbstractStaticFriction):
    """Coulomb and viscous friction with a level for each direction.

    With a steepness the two levels blend through tanh: k(s) = (k+ + k-)/2 + (k+ - k-)/2 s, s = tanh(lambda w).

    Attributes:
        coulomb_positive: k for w > 0 [N m].
        coulomb_negative: k for w < 0 [N m], a magnitude.
        viscous_positive: b for w > 0 [N m s/rad].
        viscous_negative: b for w < 0 [N m s/rad].
        steepness: lambda [s/rad]; None for sign.
    """

    coulomb_positive: Array = eqx.field(converter=as_parameter)
    coulomb_negative: Array = eqx.field(converter=as_parameter)
    viscous_positive: Array = eqx.field(converter=as_parameter)
    viscous_negative: Array = eqx.field(converter=as_parameter)
    steepness: Array | None = eqx.field(converter=as_optional, default=None)

    def __check_init__(self) -> None:
        require_not_negative(self, "coulomb_positive", "N m")
        require_not_negative(self, "coulomb_negative", "N m")
        require_not_negative(self, "viscous_positive", "N m s/rad")
        require_not_negative(self, "viscous_negative", "N m s/rad")
        require_positive(self, "steepness", "s/rad")

    def level(self, motion: Motion) -> Array:
        """Coulomb level of this direction [N m]."""
        side = jnp.sign(motion.velocity) if self.steepness is None else tanh(self.steepness * motion.velocity)
        mean = 0.5 * (self.coulomb_positive + self.coulomb_negative)
        return mean + 0.5 * (self.coulomb_positive - self.coulomb_negative) * side

    def drag(self, motion: Motion) -> Array:
        """Viscous torque of this direction [N m]."""
        # At zero speed either direction's value will do: it is multiplied by zero.
        viscous = jnp.where(motion.velocity > 0.0, self.viscous_positive, self.viscous_negative)
        return viscous * motion.velocity

    def general(self) -> GeneralFriction:
        """Means and half differences of both directions; with a steepness the viscous parts blend through tanh."""
        return GeneralFriction(
            0.5 * (self.coulomb_positive + self.coulomb_negative),
            0.5 * (self.viscous_positive + self.viscous_negative),
            0.5 * (self.coulomb_positive - self.coulomb_negative),
            0.5 * (self.viscous_positive - self.viscous_negative),
            steepness=self.steepness,
        )


def stribeck_curve(velocity: Array, coulomb: Array, static: Array, stribeck_velocity: Array, exponent: Array) -> Array:
    """F_c + (F_s - F_c) exp(-|w / v_s|^delta) [N m] (1.4), with a finite gradient at w = 0 for every delta."""
    decay = safe_power(jnp.abs(velocity) / stribeck_velocity, exponent)
    return coulomb + (static - coulomb) * jnp.exp(-decay)
