"""A learned law: a torque as a table over one variable, for what no named effect describes."""

import itertools
from collections.abc import Sequence
from typing import Any, Literal

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jax.core import Tracer
from jaxtyping import Array

from ..errors import InputError
from .block import as_optional, as_parameter, require_positive
from .loads import AbstractLoad
from .signals import Motion, driving_torque

Variable = Literal["velocity", "position", "torque", "time"]
Interpolation = Literal["linear", "cubic"]
VARIABLES: tuple[Variable, ...] = ("velocity", "position", "torque", "time")
INTERPOLATIONS: tuple[Interpolation, ...] = ("linear", "cubic")
PERIODIC: tuple[Variable, ...] = ("position", "time")


def _leaves(values: Any) -> Any:
    """A sequence of numbers as a tuple of leaves; a tree transformation's placeholders pass through."""
    if isinstance(values, Sequence | np.ndarray) or (hasattr(values, "ndim") and values.ndim == 1):
        return tuple(as_parameter(value) for value in values)
    return values


class LearnedTorque(AbstractLoad):
    """A torque [N m] that the motor must deliver besides all else, tabulated over one variable.

    It has the sign of positive friction: torque = J dw/dt + friction + load + this. Between the points it is a straight
    line or a monotone cubic, which never leaves the range of its two points (Fritsch, Butland, "A method for
    constructing local monotone piecewise cubic interpolants", 1984). Beyond the first and the last point their values
    are held; with a period the last point joins the first. The table is continuous: a jump at zero velocity is Coulomb
    friction, which must stick, and belongs in the friction law (`split_jump` separates the two).

    Every point is an array leaf of its own, so that arrays of candidates pass through without vmap, as in
    `PositionTorque`.

    Attributes:
        of: "velocity" [rad/s], "position" [rad], "torque" (through the gear, see `Motion`) [N m] or "time" [s]; static.
        at: the points, increasing, in the variable's unit.
        torque: value at each point [N m].
        period: of the position [rad] or of the time [s], longer than the points reach; None where nothing repeats.
        interpolation: "linear" or "cubic" (static).
    """

    of: Variable = eqx.field(static=True)
    at: tuple[Array, ...] = eqx.field(converter=_leaves)
    torque: tuple[Array, ...] = eqx.field(converter=_leaves)
    period: Array | None = eqx.field(converter=as_optional, default=None)
    interpolation: Interpolation = eqx.field(static=True, default="linear")

    def __check_init__(self) -> None:
        if self.of not in VARIABLES:
            raise InputError(f"LearnedTorque: of = {self.of!r} is not known: choose among {', '.join(VARIABLES)}.")
        if self.interpolation not in INTERPOLATIONS:
            raise InputError(
                f"LearnedTorque: interpolation = {self.interpolation!r} is not known: choose linear or cubic."
            )
        if not isinstance(self.at, tuple) or not isinstance(self.torque, tuple):
            return  # a placeholder of a tree transformation
        if len(self.at) != len(self.torque) or len(self.at) < 2:
            raise InputError(
                f"LearnedTorque: at has {len(self.at)} points and torque {len(self.torque)}: give one torque for each "
                f"point, and two points at least."
            )
        require_positive(self, "period", "rad" if self.of == "position" else "s")
        if self.period is not None and self.of not in PERIODIC:
            raise InputError(
                f"LearnedTorque: a table over {self.of} has no period: drop it, or tabulate over position or time."
            )
        points = _concrete(self.at)
        if points is None:
            return
        if not np.all(np.isfinite(points)) or np.any(np.diff(points, axis=0) <= 0.0):
            raise InputError(
                "LearnedTorque: the points in at must be finite and increase: sort them, and give a jump at zero "
                "velocity to the friction law (fpjax.split_jump)."
            )
        period = _concrete((self.period,)) if self.period is not None else None
        if period is not None and np.any(points[-1] - points[0] >= period[0]):
            raise InputError(
                f"LearnedTorque: the points reach over {np.max(points[-1] - points[0]):g}, which is no less than the "
                f"period {np.min(period):g}: drop the point that repeats the first one."
            )

    def readout(self, motion: Motion) -> Array:
        """The table's torque [N m].

        Raises:
            InputError: for a table over the torque where the motion does not hold it.
        """
        x = driving_torque(motion, 'of = "torque"') if self.of == "torque" else getattr(motion, self.of)
        # a table over time has the shape of the time: the zeros broadcast it to a batch of velocities
        return self.value(x) + jnp.zeros_like(motion.velocity)

    def value(self, x: Array) -> Array:
        """The table at x, in the variable's unit; of x's shape.

        The sum of what each interval contributes up to x. That takes no search and no gather, so it vectorizes, and it
        can be differentiated by x, by the points and by their torques. The cost grows with the number of points.
        """
        at, torque = self.at, self.torque
        if self.period is not None:
            turns = jnp.floor((x - at[0]) / self.period)
            x = x - self.period * turns
            # x lies in the first period now, and one more point closes the ring
            at, torque = (*at, at[0] + self.period), (*torque, torque[0])
        widths = [b - a for a, b in itertools.pairwise(at)]
        rises = [b - a for a, b in itertools.pairwise(torque)]
        slopes = self._slopes(widths, rises)
        total = torque[0]
        for i, (start, width, rise) in enumerate(zip(at, widths, rises, strict=False)):
            # 0 before the interval, 1 behind it: an interval that x has passed contributes its whole rise
            share = jnp.clip((x - start) / width, 0.0, 1.0)
            total = total + share * (rise if slopes is None else _hermite(share, rise, width, slopes[i : i + 2]))
        return total

    def _slopes(self, widths: list[Array], rises: list[Array]) -> list[Array] | None:
        if self.interpolation == "linear":
            return None
        secants = [rise / width for rise, width in zip(rises, widths, strict=True)]
        if len(secants) == 1:
            return [secants[0], secants[0]]
        inner = [_inner_slope(widths[i - 1], widths[i], secants[i - 1], secants[i]) for i in range(1, len(secants))]
        if self.period is not None:
            # first and last point are one point of the ring, with one slope
            joined = _inner_slope(widths[-1], widths[0], secants[-1], secants[0])
            return [joined, *inner, joined]
        first = _end_slope(widths[0], widths[1], secants[0], secants[1])
        return [first, *inner, _end_slope(widths[-1], widths[-2], secants[-1], secants[-2])]


def split_jump(at: Sequence[float], torque: Sequence[float]) -> tuple[list[float], list[float], float]:
    """A table over velocity with two values at 0, separated into a continuous table and a Coulomb level.

    A learned law has one curve for each direction. The difference of the two at rest is a set-valued torque that
    sticks: half of this jump is Coulomb friction, and the rest is a table without a jump.

    Args:
        at: velocities [rad/s], increasing; only 0 may occur twice.
        torque: the value at each [N m]; at the two zeros that of the negative, then that of the positive direction.

    Returns:
        (at, torque, coulomb): the points with one zero, their torques without the jump [N m], and half the jump
        [N m], to be added to the friction law's Coulomb level.

    Raises:
        InputError: for points that do not increase, or a jump elsewhere.
    """
    if len(at) != len(torque):
        raise InputError(f"at has {len(at)} points and torque {len(torque)}: give one torque for each point.")
    points, values = [float(each) for each in at], [float(each) for each in torque]
    twice = [i for i, (a, b) in enumerate(itertools.pairwise(points)) if a == b]
    if not twice:
        return points, values, 0.0
    if len(twice) > 1 or points[twice[0]] != 0.0:
        raise InputError(
            f"at = {points[twice[0]]:g} occurs twice: a learned torque may jump only at zero velocity, and only once."
        )
    place = twice[0]
    # Coulomb friction is -half and +half on the two sides of zero: without it both sides meet at the mean of the jump
    half = 0.5 * (values[place + 1] - values[place])
    values = [value + half if i <= place else value - half for i, value in enumerate(values)]
    return [*points[:place], *points[place + 1 :]], [*values[:place], *values[place + 1 :]], half


def _concrete(values: tuple[Any, ...]) -> np.ndarray | None:
    if any(
        isinstance(value, Tracer) or not hasattr(value, "dtype") or not hasattr(value, "__array__") for value in values
    ):
        return None
    return np.stack(np.broadcast_arrays(*(np.asarray(value) for value in values)))


def _hermite(share: Array, rise: Array, width: Array, slopes: list[Array]) -> Array:
    """The rise of an interval's cubic at a share u of its width, divided by u.

    Hermite's cubic with the end slopes m0, m1, over the width h with the whole rise r:
    p(u) = u (m0 h + u (3 r - 2 m0 h - m1 h + u (m0 h + m1 h - 2 r))).
    """
    first, last = slopes[0] * width, slopes[1] * width
    return first + share * (3.0 * rise - 2.0 * first - last + share * (first + last - 2.0 * rise))


def _inner_slope(before: Array, after: Array, left: Array, right: Array) -> Array:
    """Fritsch and Butland's slope at a point: a weighted harmonic mean of both secants, zero at an extreme."""
    same = left * right > 0.0
    # Where the secants differ in sign or vanish the mean is not used; ones in its divisors keep its gradient finite.
    one = jnp.ones_like(left)
    w_left, w_right = 2.0 * after + before, after + 2.0 * before
    mean = (w_left + w_right) / (w_left / jnp.where(same, left, one) + w_right / jnp.where(same, right, one))
    return jnp.where(same, mean, jnp.zeros_like(mean))


def _end_slope(own: Array, next_width: Array, secant: Array, next_secant: Array) -> Array:
    """The slope at an end: that of the parabola through three points, limited so that the cubic stays monotone."""
    slope = ((2.0 * own + next_width) * secant - own * next_secant) / (own + next_width)
    slope = jnp.where(slope * secant > 0.0, slope, jnp.zeros_like(slope))
    # A monotone Hermite cubic allows slopes up to three times the secant.
    steep = (secant * next_secant <= 0.0) & (jnp.abs(slope) > 3.0 * jnp.abs(secant))
    return jnp.where(steep, 3.0 * secant, slope)
