"""The contract of a friction law, and the smooth replacements of sign and |.|."""

from abc import abstractmethod
from collections.abc import Callable
from typing import TYPE_CHECKING, Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, PyTree

from ...compiled.elementary import log
from ...compiled.hyperbolic import tanh
from ...compiled.native import once
from ...errors import InputError
from ..block import Block
from ..signals import Motion

# A speed [rad/s] that is zero in size but still has a sign: it asks a law for its level at rest in one direction.
NEARLY_REST = 1e-30


class Shares(NamedTuple):
    """How much of a law acts on a body.

    Attributes:
        level: share of the set-valued part [1].
        drag: share of the part that is smooth in velocity [1].
    """

    level: Array | float
    drag: Array | float

    def others(self) -> "Shares":
        """What is left for the other body."""
        return Shares(1.0 - self.level, 1.0 - self.drag)


WHOLE = Shares(1.0, 1.0)


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
            state: the law's state, from `init` on, integrated from `derivative`.
            motion: velocity [rad/s], position [rad] and time [s] of the body on which the friction acts.
            applied: the torque [N m] on the body from everything but friction (stiction balances it at rest).
        """

    def general(self) -> "AbstractFriction":
        """This law as a `GeneralFriction`, within `Bristles` where it has memory: one form for a search or a file.

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
        """Magnitude [N m] of the set-valued part, for motion in the direction of `motion.velocity`."""

    def breakaway(self, motion: Motion) -> Array:
        """`level` [N m] at rest, for a motion about to start in the direction of `motion.velocity` (all but zero)."""
        return self.level(motion)

    @abstractmethod
    def drag(self, motion: Motion) -> Array:
        """The part [N m] that is smooth in velocity and zero at rest."""

    def drag_slope(self, motion: Motion) -> Array:
        """Derivative of `drag` by the velocity [N m s/rad]."""

        def at(velocity: Array) -> Array:
            return self.drag(Motion(velocity, motion.position, motion.time, motion.torque))

        return jax.jvp(at, (motion.velocity,), (jnp.ones_like(motion.velocity),))[1]

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
        """The body slides until its speed is zero, then sticks or breaks away.

        The steepness is not used: with the zero crossing resolved, sign(w) needs neither smoothing nor small steps.
        Where the speed would change its sign, the step is cut at the crossing, and the rest of the step goes on with
        the torque that is left above the friction level, soft(T, k) / J. A body at rest stays at rest while |T| <= k.
        Forward mode differentiates this almost everywhere. The smooth part of the torque is taken at the mean speed of
        the step, which is that of a drag with the slope at its start: for a viscous friction right to 0.1 % of what
        the step adds where that is half a time constant long, 1 % at one, 3 % at two, and stable at any; second order
        for another drag.

        Reference: the event is that of Karnopp, "Computer simulation of stick-slip friction in mechanical dynamic
        systems", 1985, resolved in time instead of by a band of speeds.
        """
        # Every evaluation uses the position and time of the step's middle, so that the sines and exponentials of a law
        # are the same expressions and are computed once.
        half = 0.5 * dt
        motion = Motion(start.velocity, start.position + half * start.velocity, start.time + half, torque)
        return *self._advanced(motion, start.position, torque - load(motion), inertia, WHOLE, dt), state

    def turn(self, motion: Motion, free: Array, inertia: Array, shares: Shares, dt: Array) -> Array:
        """Speed [rad/s] of a body after dt [s] under its shares of this law; at rest it sticks exactly.

        Args:
            motion: the velocity at the start of the step, the position and time at its middle.
            free: torque on the body but for friction [N m].
            inertia: of the body [kg m^2].
            shares: of the law, that act on this body.
            dt: length of the step [s].
        """
        return self._advanced(motion, motion.position, free, inertia, shares, dt)[0]

    def net(self, motion: Motion, free: Array, shares: Shares) -> Array:
        """What a body's shares of this law leave of a torque on it [N m]; of one at rest, what is above the level.

        Args:
            motion: of the body.
            free: torque on the body but for friction [N m].
            shares: of the law, that act on this body.
        """
        sliding = self._sliding(motion, free, shares, jnp.sign(motion.velocity))
        return jnp.where(motion.velocity == 0.0, self._above(motion, free, shares), sliding)

    def _sliding(self, motion: Motion, free: Array, shares: Shares, side: Array) -> Array:
        """What is left of a torque on a body that slides in the direction of `side` [N m]."""
        return free - (shares.drag * self.drag(motion) + shares.level * side * self.level(motion))

    def _above(self, motion: Motion, free: Array, shares: Shares) -> Array:
        """soft(T, k) [N m]: what a torque on a body at rest is above the level, at a motion's place and time.

        The body can only start in the direction of what pushes it.
        """
        toward = jnp.where(free < 0.0, -NEARLY_REST, NEARLY_REST)
        level = shares.level * self.breakaway(Motion(toward, motion.position, motion.time, motion.torque))
        return free - jnp.clip(free, -level, level)

    def _advanced(
        self, motion: Motion, position: Array, free: Array, inertia: Array, shares: Shares, dt: Array
    ) -> tuple[Array, Array]:
        """(velocity, position) after dt, from `position`; the other arguments as of `turn`."""
        velocity, side = motion.velocity, jnp.sign(motion.velocity)
        mobility = 1.0 / inertia  # one division, which a loop over time does once
        # At rest the slope of the direction in which the body can start.
        toward = jnp.where(velocity == 0.0, jnp.where(free < 0.0, -NEARLY_REST, NEARLY_REST), velocity)
        slope = self.drag_slope(Motion(toward, motion.position, motion.time, motion.torque))
        fading = shares.drag * slope * mobility
        gained = dt * self._sliding(motion, free, shares, side) * mobility
        final, mean = faded(dt * fading)
        # Where the body stops within the step, its mean speed until then is half of that at the start.
        goes_on = (velocity + final * gained) * side > 0.0
        halfway = velocity + jnp.where(goes_on, mean * gained, -0.5 * velocity)
        middle = Motion(halfway, motion.position, motion.time, motion.torque)
        sliding = self._sliding(middle, free, shares, side) * mobility
        return self._slip(velocity, position, free, sliding, middle, mobility, fading, dt, shares)

    def _slip(
        self,
        velocity: Array,
        position: Array,
        free: Array,
        sliding: Array,
        middle: Motion,
        mobility: Array,
        fading: Array,
        dt: Array,
        shares: Shares,
    ) -> tuple[Array, Array]:
        """(velocity, position) after dt: slides at `sliding` [rad/s^2] until it stops, then sticks or breaks away.

        `mobility` is 1 / inertia [1 / (kg m^2)], `fading` the drag's slope over the inertia [1/s].
        """
        free, sliding = once((free, sliding))
        after = velocity + dt * sliding
        crosses = jnp.sign(velocity) * after <= 0.0  # a body at rest counts as crossing, at time zero
        # `until` is the time of the stop, from w + until w' = 0. The divisor is replaced where it is not used: a
        # division by zero in an unselected branch still makes the gradient NaN.
        safe = jnp.where(crosses & (velocity != 0.0), sliding, 1.0)
        until = jnp.where(velocity != 0.0, -velocity / safe, 0.0)
        # At half its speed a strong drag is a little too large in the mean: without this a body that just stops and one
        # that just does not would differ by 7 % at x = 1.
        faster = fading * until
        slower = 1.0 / (6.0 + faster)
        until = jnp.minimum(until * (1.0 + 0.5 * faster * faster * slower), dt)
        left = dt - until
        # Shares of a whole step, and none of no step: between them a line, which a loop over time need not divide for.
        share = left * (1.0 / dt)
        final, mean = (
            none - (none - whole) * share for none, whole in zip((1.0, 0.5), faded(fading * dt), strict=True)
        )
        gained = self._above(middle, free, shares) * mobility * left
        turned = final * gained
        stopped = position + 3.0 * slower * until * velocity + left * (mean * gained)
        slid = position + dt * middle.velocity
        return once((jnp.where(crosses, turned, after), jnp.where(crosses, stopped, slid)))


def faded(x: Any) -> tuple[Any, Any]:
    """Shares (of the final speed, of the mean speed) of what a torque adds in a step, against a drag [1].

    A body that a torque alone would make faster by g is (1 - e^-x) / x g faster in the end, (e^-x - 1 + x) / x^2 g in
    the mean, with x the drag's slope times the step over the inertia [1]. e^-x is its Pade approximation of order
    (1, 2), 0.1 % off at x = 0.5, 1 % at 1, and never beyond 1: any step is stable. Beyond 3 it is negative, and a step
    overshoots its steady speed by up to 10 %. A number or an array.
    """
    whole = 1.0 / (6.0 + x * (4.0 + x))
    return (6.0 + x) * whole, (3.0 + x) * whole


def direction(velocity: Array, steepness: Array | None) -> Array:
    """sign(w) where `steepness` is None (sign(0) = 0; never differentiate it), else tanh(steepness w)."""
    return jnp.sign(velocity) if steepness is None else tanh(steepness * velocity)


def log_cosh(x: Array) -> Array:
    """ln cosh(x) without overflow; the smooth form of |x| (2.30)."""
    magnitude = jnp.abs(x)
    # cosh x = e^|x| (1 + e^(-2 |x|)) / 2: the exponential cannot overflow, and log 2 comes off.
    return magnitude + log(1.0 + jnp.exp(-2.0 * magnitude)) - 0.6931471805599453


def safe_power(base: Array, exponent: Array) -> Array:
    """base ** exponent for base >= 0 with a finite gradient (zero) at base = 0."""
    positive = base > 0.0
    # base^exponent = exp(exponent log base). The base is replaced by 1 where it is zero, because the gradient of a log
    # at zero is infinite, and infinite times zero, in the branch that is not selected, is NaN.
    inside = jnp.where(positive, base, jnp.ones_like(base))
    return jnp.where(positive, jnp.exp(exponent * log(inside)), jnp.zeros_like(base))
