"""The contract of a friction law, and the smooth replacements of sign and |.|."""

from abc import abstractmethod
from collections.abc import Callable
from typing import TYPE_CHECKING

import equinox as eqx
import jax.numpy as jnp
from jax.typing import ArrayLike
from jaxtyping import Array, PyTree

from ...compiled.elementary import log
from ...compiled.hyperbolic import tanh
from ...errors import InputError
from ..block import Block
from ..signals import Motion

NEARLY_REST = 1e-30  # a speed [rad/s] that has a direction and no size


class AbstractFriction(Block):
    """A friction law: a torque [N m] that opposes the motion, positive for positive velocity."""

    def init(self) -> PyTree:
        """The law's own state at rest; the empty tuple for a static law."""
        return ()

    def derivative(self, state: PyTree, motion: Motion) -> PyTree:
        """Time derivative of the state, in the state's unit per second."""
        del state, motion
        return ()

    @abstractmethod
    def readout(self, state: PyTree, motion: Motion, applied: Array) -> Array:
        """Friction torque [N m].

        Args:
            state: what `init` gave, moved on by `derivative`.
            motion: velocity [rad/s], position [rad] and time [s] of the body that rubs.
            applied: the torque [N m] that all else puts on the body (stiction balances it at rest).
        """

    def general(self) -> "AbstractFriction":
        """This law as a `GeneralFriction`, under `Bristles` where it has memory: one form for a search or a file.

        Raises:
            InputError: for a law that has no such form.
        """
        raise InputError(
            f"The friction law {type(self).__name__} has no general form: use coulomb_viscous, stribeck, dahl or "
            "lugre, or define general() in your law."
        )

    def advance_body(
        self,
        state: PyTree,
        start: Motion,
        torque: Array,
        load: Callable[[Motion], Array],
        inertia: Array,
        dt: Array,
    ) -> tuple[Array, Array, PyTree]:
        """One body dt [s] later under a held torque, its sticking resolved within the step.

        Args:
            state: the law's, at the start of the step.
            start: velocity [rad/s], position [rad] and time [s] at the start of the step.
            torque: applied over the step [N m].
            load: the load's torque [N m] at a motion.
            inertia: of the body [kg m^2].
            dt: length of the step [s].

        Returns:
            (velocity [rad/s], position [rad], the law's state).

        Raises:
            InputError: for a law that has no such step.
        """
        del state, start, torque, load, inertia, dt
        raise InputError(
            f"{type(self).__name__} has no exact sticking step: use a static friction law or bristles on one mass, a "
            "static law on a Transmission, or a solver such as rk4 with a steepness."
        )


class AbstractStaticFriction(AbstractFriction):
    """A law without memory: `level` x direction(velocity) + `drag`.

    The parts are separate because a solver that resolves sticking exactly needs the set-valued level apart from the
    smooth rest.
    """

    # For a type checker a property: read as a field it would come first among the constructor's arguments.
    if TYPE_CHECKING:

        @property
        def steepness(self) -> Array | None:
            """lambda [s/rad] of tanh in place of sign; None for sign."""
    else:
        steepness: eqx.AbstractVar[Array | None]

    @abstractmethod
    def level(self, motion: Motion) -> Array:
        """Magnitude [N m] of the set-valued part for motion in the direction of `motion.velocity`."""

    def breakaway(self, motion: Motion) -> Array:
        """`level` [N m] at rest, for a motion about to start in the direction of `motion.velocity` (all but zero)."""
        return self.level(motion)

    @abstractmethod
    def drag(self, motion: Motion) -> Array:
        """The part [N m] that is smooth in velocity and zero at rest."""

    def readout(self, state: PyTree, motion: Motion, applied: Array) -> Array:
        """Friction torque [N m]: level x sign(w), or level x tanh(steepness w), plus drag."""
        del state, applied
        return self.level(motion) * direction(motion.velocity, self.steepness) + self.drag(motion)

    def advance_body(
        self,
        state: PyTree,
        start: Motion,
        torque: Array,
        load: Callable[[Motion], Array],
        inertia: Array,
        dt: Array,
    ) -> tuple[Array, Array, PyTree]:
        """The body slides up to zero speed, then sticks or breaks away.

        The steepness has no say: sign(w) needs neither it nor small steps if the step knows of the crossing. Where the
        speed would change its sign, the step is cut there and goes on with what is left of the torque, soft(T, k) / J,
        in the rest of the time; a body at rest stays there while |T| <= k. Forward mode differentiates this almost
        everywhere. The torque's smooth part is taken at the middle of the step (second order).

        Reference: the event is that of Karnopp, "Computer simulation of stick-slip friction in mechanical dynamic
        systems", 1985, resolved in time instead of by a band of speeds.
        """
        velocity, half = start.velocity, 0.5 * dt
        side = jnp.sign(velocity)
        # Position and time of the middle for every evaluation: then their sines and exponentials are computed once.
        place, moment = start.position + half * velocity, start.time + half
        at_start = Motion(velocity, place, moment, torque)
        free = torque - load(at_start)
        first = free - self.drag(at_start) - side * self.level(at_start)
        halfway = velocity + half * first / inertia
        halfway = jnp.where(halfway * side > 0.0, halfway, 0.5 * velocity)
        middle = Motion(halfway, place, moment, torque)
        sliding = (free - self.drag(middle) - side * self.level(middle)) / inertia
        after, position = self._slip(velocity, start.position, free, sliding, middle, inertia, dt)
        return after, position, state

    def turn(self, motion: Motion, free: Array, inertia: Array, share: Array, dt: Array) -> Array:
        """Speed [rad/s] of a body after dt [s] under a share of this law; at rest it sticks exactly.

        Args:
            motion: at which level and drag are taken; its velocity is that of the start.
            free: torque [N m] of all but friction.
            inertia: of the body [kg m^2].
            share: of the friction that acts on this body [1].
            dt: length of the step [s].
        """
        braking = share * (self.drag(motion) + jnp.sign(motion.velocity) * self.level(motion))
        sliding = (free - braking) / inertia
        return self._slip(motion.velocity, motion.position, free, sliding, motion, inertia, dt, share)[0]

    def _slip(
        self,
        velocity: Array,
        position: Array,
        free: Array,
        sliding: Array,
        middle: Motion,
        inertia: Array,
        dt: Array,
        share: ArrayLike = 1.0,
    ) -> tuple[Array, Array]:
        """(velocity, position) after dt: slides with `sliding` [rad/s^2] up to zero speed, then sticks or breaks."""
        after = velocity + dt * sliding
        crosses = velocity * after <= 0.0
        safe = jnp.where(crosses & (velocity != 0.0), sliding, 1.0)
        until = jnp.where(velocity != 0.0, -velocity / safe, 0.0)
        toward = jnp.where(free < 0.0, -NEARLY_REST, NEARLY_REST)
        rest = Motion(toward, middle.position, middle.time, middle.torque)
        level = share * self.breakaway(rest)
        left = (free - jnp.clip(free, -level, level)) / inertia  # soft(T, k) / J
        turned = left * (dt - until)
        slid = position + 0.5 * dt * (velocity + after)
        stopped = position + 0.5 * until * velocity + 0.5 * (dt - until) * turned
        return jnp.where(crosses, turned, after), jnp.where(crosses, stopped, slid)


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
