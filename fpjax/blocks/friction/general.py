"""A friction law with every static effect that a servo shows; each has a neutral value at which it vanishes."""

import equinox as eqx
import jax.numpy as jnp
from jax.typing import ArrayLike
from jaxtyping import Array

from ...compiled.elementary import sincos
from ...compiled.hyperbolic import tanh
from ..block import as_optional, as_parameter, require_below, require_positive
from ..signals import Motion, driving_torque
from .base import AbstractStaticFriction, safe_power


class GeneralFriction(AbstractStaticFriction):
    """Coulomb and viscous friction that may depend on direction, speed, position and time.

    With side the sign of w::

        level(w, theta, t, T) = k + side dk + F_s exp(-|w / v_s|^delta) + drift exp(-t / tau) + mu |T|
                                + sum_i (c_i cos(i n theta) + s_i sin(i n theta)), at least zero
        drag(w) = (b + side db) w + c w |w|

    Stribeck's curve is (1.4); the rest are the usual extensions (Armstrong-Helouvry, Dupont, Canudas de Wit, "A survey
    of models, analysis tools and compensation methods for the control of machines with friction", 1994).

    The load-dependent term mu |T| is the friction of a gear. T (`Motion.torque`) is the torque that drives the body
    through the gear: the applied motor torque for one mass, the shaft's torque for a body behind a spring. The inertia
    torque is not taken off. So the level does not depend on the acceleration, J dw/dt = T - load - side (k + mu |T|) -
    drag is explicit, and a body at rest sticks while |T - load| <= k + mu |T|. Below mu = 1 a motor can always break
    away; at 1 the gear locks itself. Bittencourt, Gunnarsson, "Static friction in a robot joint - modeling and
    identification of load and temperature effects", 2012, find the level to be linear in the load torque.

    Attributes:
        coulomb: k, mean of both directions [N m].
        viscous: b, mean of both directions [N m s/rad].
        coulomb_difference: dk, half of positive less negative direction [N m]; neutral 0.
        viscous_difference: db, half of positive less negative direction [N m s/rad]; neutral 0.
        stribeck_torque: F_s, what static friction has above Coulomb [N m]; neutral 0; None: the term is not computed.
        stribeck_velocity: v_s [rad/s].
        stribeck_exponent: delta [1]; 1 is Tustin's curve, 2 the Gaussian.
        position_cosine: c_i [N m] for the harmonics 1, 2, 3 ... of n; neutral 0.
        position_sine: s_i [N m]; neutral 0.
        position_periods: n [1/rev].
        drift_amplitude: extra level at t = 0 [N m]; neutral 0; None: the term is not computed.
        drift_time: tau [s].
        load_coefficient: mu of mu |T| [1], below 1; neutral 0; None: the term is not computed.
        drag_coefficient: c of c w |w| [N m s^2/rad^2]; neutral 0.
        steepness: lambda [s/rad] of tanh in place of sign; None for sign.
    """

    coulomb: Array = eqx.field(converter=as_parameter)
    viscous: Array = eqx.field(converter=as_parameter)
    coulomb_difference: Array = eqx.field(converter=as_parameter, default=0.0)
    viscous_difference: Array = eqx.field(converter=as_parameter, default=0.0)
    stribeck_torque: Array | None = eqx.field(converter=as_optional, default=None)
    stribeck_velocity: Array = eqx.field(converter=as_parameter, default=1.0)
    stribeck_exponent: Array = eqx.field(converter=as_parameter, default=2.0)
    position_cosine: tuple[Array, ...] = ()
    position_sine: tuple[Array, ...] = ()
    position_periods: Array = eqx.field(converter=as_parameter, default=1.0)
    drift_amplitude: Array | None = eqx.field(converter=as_optional, default=None)
    drift_time: Array = eqx.field(converter=as_parameter, default=1.0)
    drag_coefficient: Array = eqx.field(converter=as_parameter, default=0.0)
    steepness: Array | None = eqx.field(converter=as_optional, default=None)
    load_coefficient: Array | None = eqx.field(converter=as_optional, default=None)

    def __check_init__(self) -> None:
        require_positive(self, "stribeck_velocity", "rad/s")
        require_positive(self, "stribeck_exponent", "1")
        require_positive(self, "drift_time", "s")
        require_positive(self, "steepness", "s/rad")
        require_below(self, "load_coefficient", 1.0)

    def level(self, motion: Motion) -> Array:
        """Magnitude of the set-valued part [N m] for motion in the direction of `motion.velocity`."""
        if self.stribeck_torque is None:
            return self._level(motion, 0.0)
        falling = safe_power(jnp.abs(motion.velocity) / self.stribeck_velocity, self.stribeck_exponent)
        return self._level(motion, self.stribeck_torque * jnp.exp(-falling))

    def breakaway(self, motion: Motion) -> Array:
        """`level` at rest [N m], where Stribeck's exponential is 1 and need not be computed."""
        return self._level(motion, 0.0 if self.stribeck_torque is None else self.stribeck_torque)

    def _level(self, motion: Motion, more: ArrayLike) -> Array:
        level = self.coulomb + self._side(motion) * self.coulomb_difference + more
        if self.drift_amplitude is not None:
            level = level + self.drift_amplitude * jnp.exp(-motion.time / self.drift_time)
        if self.load_coefficient is not None:
            level = level + self.load_coefficient * jnp.abs(driving_torque(motion, "load_coefficient"))
        level = level + fourier(self.position_cosine, self.position_sine, self.position_periods * motion.position)
        # A harmonic or a drift larger than the rest must not make friction drive the body.
        return jnp.maximum(level, 0.0)

    def drag(self, motion: Motion) -> Array:
        """Viscous and quadratic torque [N m]."""
        viscous = self.viscous + self._side(motion) * self.viscous_difference
        return (viscous + self.drag_coefficient * jnp.abs(motion.velocity)) * motion.velocity

    def general(self) -> "GeneralFriction":
        """Itself."""
        return self

    def _side(self, motion: Motion) -> Array:
        return jnp.sign(motion.velocity) if self.steepness is None else tanh(self.steepness * motion.velocity)


def fourier(cosine: tuple[Array, ...], sine: tuple[Array, ...], angle: Array) -> Array:
    """sum_i cosine_i cos(i angle) + sine_i sin(i angle), i from 1; of the shape of `angle` [rad]."""
    total = jnp.zeros_like(angle)
    if not cosine:
        return total
    # Only one sine and one cosine are computed; the higher harmonics follow by the addition theorem.
    s, c = sincos(angle)
    c_i, s_i = c, s
    for a, b in zip(cosine, sine, strict=True):
        total = total + a * c_i + b * s_i
        c_i, s_i = c_i * c - s_i * s, s_i * c + c_i * s
    return total
