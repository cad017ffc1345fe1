"""Bristles within any static law: the level builds up over a travel of the order of the deflection (pre-sliding)."""

import dataclasses
from collections.abc import Callable

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array

from ...compiled.elementary import log
from ..block import as_parameter, require_not_negative, require_positive
from ..signals import Motion
from .base import NEARLY_REST, AbstractFriction, AbstractStaticFriction

_SMALLEST = 1e-30  # keeps a logarithm finite where bristles are fully deflected


class Bristles(AbstractFriction):
    """Pre-sliding: the share s of the law's level that acts (the state, from -1 to 1) follows the travel.

    ds = sign(w) (1 - s sign(w))^alpha |w| dt / deflection; friction = level (s + damping ds/dt) + drag. With alpha = 1
    it is LuGre's z / z_ss (1.7) and Dahl's F / F_c (1.6); other exponents are Dahl's. The stiffness at rest is level /
    deflection.

    Attributes:
        law: the static law that gives level and drag.
        deflection: level / stiffness [rad], above zero.
        damping: sigma_1 [N m s/rad] of (1.8), at zero speed; it acts on the bristles' rate.
        exponent: alpha [1].
    """

    law: AbstractStaticFriction
    deflection: Array = eqx.field(converter=as_parameter)
    damping: Array = eqx.field(converter=as_parameter, default=0.0)
    exponent: Array = eqx.field(converter=as_parameter, default=1.0)

    def __check_init__(self) -> None:
        require_positive(self, "deflection", "rad")
        require_not_negative(self, "damping", "N m s/rad")
        require_positive(self, "exponent", "1")

    def init(self) -> Array:
        """Unloaded bristles [1]."""
        return jnp.zeros_like(self.deflection)

    def derivative(self, state: Array, motion: Motion) -> Array:
        """ds/dt [1/s]."""
        side = jnp.sign(motion.velocity)
        slack = jnp.maximum(1.0 - state * side, _SMALLEST)
        return jnp.exp(self.exponent * log(slack)) * motion.velocity / self.deflection

    def readout(self, state: Array, motion: Motion, applied: Array) -> Array:
        """Friction torque [N m]."""
        del applied
        rate = self.derivative(state, motion) * self.deflection
        return self.law.level(motion) * state + self.damping * rate + self.law.drag(motion)

    def general(self) -> "Bristles":
        """The same bristles with the law in its general form."""
        return dataclasses.replace(self, law=self.law.general())

    def advance_body(
        self,
        state: Array,
        start: Motion,
        torque: Array,
        load: Callable[[Motion], Array],
        inertia: Array,
        dt: Array,
    ) -> tuple[Array, Array, Array]:
        """Half a step of travel, the speed with the bristles' share in the middle of the step, the other half.

        The bristles themselves move by their exact solution over a travel (`advance`).
        """
        law, half = self.law, 0.5 * dt
        velocity, share = start.velocity, state
        place, moment = start.position + half * velocity, start.time + half
        at_start = Motion(velocity, place, moment, torque)
        free = torque - load(at_start)
        # The share that acts over the step: after the travel of half a step at the speed that the step begins with.
        between = self.advance(share, half * velocity)
        # The drag is taken implicitly as well, by its slope: a step may be as long as it takes to come to rest.
        drag, fading = law.drag(at_start), half * law.drag_slope(at_start)
        halfway = velocity + half * (free - drag - law.level(at_start) * between) / (inertia + fading)
        middle = Motion(halfway, place, moment, torque)
        side = jnp.where(halfway < 0.0, -1.0, 1.0)
        slack = jnp.maximum(1.0 - between * side, NEARLY_REST)
        # The torque sigma_1 ds/dt x deflection is taken implicitly in the speed (trapezoidal rule), so that a stiff
        # damper does not limit the step.
        damper = self.damping * jnp.exp(self.exponent * log(slack))
        level = law.level(middle) * self.advance(share, half * halfway)
        pulled = torque - load(middle) - drag - level
        slope = (pulled - damper * velocity) / (inertia + half * damper + fading)
        after = velocity + dt * slope
        travel = half * (velocity + after)
        return after, start.position + travel, self.advance(share, travel)

    def advance(self, state: Array, travel: Array) -> Array:
        """The state after a travel [rad] in one direction: exact, whatever its length.

        y = 1 - s sign(travel) obeys dy/d|travel| = -y^alpha / deflection, so y^(1 - alpha) is linear in the travel, and
        for alpha = 1 y is an exponential of it.
        """
        side = jnp.where(travel < 0.0, -1.0, 1.0)
        slack = jnp.maximum(1.0 - state * side, _SMALLEST)
        beyond = self.exponent - 1.0
        # y = y0 (1 + (alpha - 1) y0^(alpha - 1) d)^(-1 / (alpha - 1)), d = |travel| / deflection. Near alpha = 1 this
        # is 1^infinity and loses its digits: within 1e-4 of it the exponential is used, to which it converges.
        near_one = jnp.abs(beyond) < 1e-4
        safe = jnp.where(near_one, 1e-4, beyond)
        distance = side * travel / self.deflection
        scaled = safe * jnp.exp(safe * log(slack)) * distance
        # Below zero only for alpha < 1, whose bristles are fully deflected after a finite travel.
        inside = jnp.maximum(1.0 + scaled, _SMALLEST)
        general = slack * jnp.exp(-log(inside) / safe)
        remaining = jnp.where(near_one, slack * jnp.exp(-distance), general)
        return side * (1.0 - remaining)
