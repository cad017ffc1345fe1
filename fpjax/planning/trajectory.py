"""Trajectory: a motion of a few numbers that keeps its limits whatever the numbers are.

Speed is a cubic spline through free knots (ramps, holds, slow and fast reversals) plus tones of fixed frequencies and
free size and phase, which a second, coarser spline turns on and off, plus a share of a plain sine and of a sweep, so
that no plan need be worse than they are. It begins and ends at rest at the same place. What goes beyond a limit is
scaled down as a whole, so that the tightest limit just holds: an optimiser of the numbers needs no penalty, and no
motion that it tries is one that the machine must not make.
"""

from dataclasses import dataclass
from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float
from scipy.interpolate import BSpline

from .limits import Limits
from .usual import usual

KNOTS = (12, 40)  # fewest and most of the spline
SPACING = 2.5  # between knots, in the time that the top speed takes at the largest acceleration [1]
TONES = 10
GATES = 7  # knots of the envelope of the tones
HIGHEST = 0.03  # of the control rate: the highest tone; a velocity loop follows little above it
RAMP = 0.04  # of the duration: from rest and back to it
SWEEP = 3  # of the starts, which is a sweep
FULL = 0.999  # of a limit that a motion is scaled to


class Shape(NamedTuple):
    """The free numbers, all of order one.

    Attributes:
        knots: of the speed, shape (knots,).
        gates: of the tones' envelope, a logit, shape (GATES,).
        sizes: of the tones, as the logarithm of a share of the top speed, shape (TONES,).
        phases: [rad], shape (TONES,).
        usual: size of a plain sine and of a sweep [1], shape (2,).
    """

    knots: Float[Array, " knots"]
    gates: Float[Array, " gates"]
    sizes: Float[Array, " tones"]
    phases: Float[Array, " tones"]
    usual: Float[Array, "2"]


class PlannedMotion(NamedTuple):
    """A planned motion, each of shape (samples,): speed [rad/s], acceleration [rad/s^2], position [rad] from 0."""

    speed: Float[Array, " samples"]
    acceleration: Float[Array, " samples"]
    position: Float[Array, " samples"]


@dataclass(frozen=True)
class PlannedCourse:
    """What makes motions of shapes: the tables of splines and tones on one clock.

    Attributes:
        limits: that every motion keeps.
        dt: [s].
        time: [s], shape (samples,).
        spline: shape (samples, knots).
        envelope: shape (samples, GATES).
        ramp: from rest and back, shape (samples,).
        frequencies: of the tones [Hz], shape (TONES,).
        usual: speeds of a sine and of a sweep [1], shape (samples, 2).
    """

    limits: Limits
    dt: float
    time: np.ndarray
    spline: np.ndarray
    envelope: np.ndarray
    ramp: np.ndarray
    frequencies: np.ndarray
    usual: np.ndarray

    def motion(self, shape: Shape, share: Array | float = 1.0) -> PlannedMotion:
        """The motion of a shape, in full or a share of it [1]; differentiable."""
        angle = 2.0 * jnp.pi * self.frequencies * self.time[:, None] + shape.phases[None, :]
        gate = jnp.clip(self.envelope @ (1.0 / (1.0 + jnp.exp(-shape.gates))), 0.0, 1.0)
        speed = self.spline @ jnp.tanh(shape.knots) + gate * (jnp.sin(angle) @ jnp.exp(shape.sizes))
        speed = speed + self.usual @ shape.usual
        return self.within(speed, share)

    def within(self, speed: Array | np.ndarray, share: Array | float = 1.0) -> PlannedMotion:
        """A motion from rest to rest at the same place, made as small as the limits ask for, or a share of that [1].

        Args:
            speed: in top speeds [1], shape (samples,).
            share: of the motion [1].
        """
        limits = self.limits
        speed = jnp.asarray(speed)
        speed = speed - jnp.mean(speed * self.ramp) / np.mean(self.ramp)  # back to where it began
        speed = limits.speed * self.ramp * speed
        acceleration = jnp.asarray(jnp.gradient(speed, self.dt))
        position = jnp.concatenate([jnp.zeros(1), jnp.cumsum(0.5 * self.dt * (speed[1:] + speed[:-1]))])
        over = jnp.stack([
            jnp.max(jnp.abs(speed)) / limits.speed,
            jnp.max(jnp.abs(acceleration)) / limits.acceleration,
            (jnp.max(position) - jnp.min(position)) / limits.travel,
        ])  # fmt: skip
        scale = share * FULL / jnp.maximum(jnp.max(over), FULL)
        return PlannedMotion(scale * speed, scale * acceleration, scale * position)

    def starts(self, seed: int, count: int) -> list[Shape]:
        """Shapes to start from: holds of falling size in both directions, slow reversals, a sweep, random ones.

        Args:
            seed: of the random ones.
            count: how many.
        """
        rng = np.random.default_rng(seed)
        knots, tones = self.spline.shape[1], len(self.frequencies)
        place = np.arange(knots)
        falling = np.geomspace(1.5, 0.05, knots)
        holds = np.where(place // 2 % 2 == 0, 1.0, -1.0) * falling
        slow = 0.12 * np.where(place % 2 == 0, 1.0, -1.0)
        quiet, loud = np.full(tones, -4.0), -1.5 - 0.7 * np.log(self.frequencies / self.frequencies[0])
        late = np.linspace(-4.0, 3.0, GATES)
        plain = [
            (holds, late, loud),
            (np.where(place < knots // 2, 1.2 * np.sin(0.9 * place), slow), late, loud - 0.7),
            (slow, np.linspace(2.0, -4.0, GATES), loud + 0.5),
            (np.zeros(knots), np.full(GATES, -3.0), quiet - 2.0),
        ]
        sizes = [np.array([0.0, float(place == SWEEP)]) for place in range(max(count, len(plain)))]
        for _ in range(max(count - len(plain), 0)):
            size = np.exp(rng.uniform(-2.5, 0.5, knots))
            plain.append((
                size * rng.normal(size=knots),
                rng.normal(0.0, 2.0, GATES),
                np.maximum(loud + rng.normal(0, 1, tones), quiet),
            ))  # fmt: skip
        phases = [rng.uniform(0.0, 2.0 * np.pi, tones) for _ in plain]
        return [
            Shape(*(jnp.asarray(part, float) for part in (*one, phase, size)))
            for one, phase, size in list(zip(plain, phases, sizes, strict=True))[:count]
        ]


def make_course(limits: Limits, dt: float, seconds_resolved: float) -> PlannedCourse:
    """The tables of a run's length.

    Args:
        limits: of the machine.
        dt: control period [s].
        seconds_resolved: shortest time from knot to knot that is useful [s].
    """
    samples = round(limits.duration / dt) + 1
    time = np.arange(samples) * dt
    rise = max(limits.speed / limits.acceleration, seconds_resolved)
    count = int(np.clip(limits.duration / (SPACING * rise), *KNOTS))
    ramp = np.clip(np.minimum(time, time[-1] - time) / (RAMP * limits.duration), 0.0, 1.0)
    lowest, highest = 2.0 / limits.duration, HIGHEST / dt
    tones = np.geomspace(min(4.0 * lowest, 0.2 * highest), highest, TONES)
    return PlannedCourse(
        limits, dt, time, _splines(time, count), _splines(time, GATES), ramp * ramp * (3.0 - 2.0 * ramp),
        tones, usual(limits, time, highest),
    )  # fmt: skip


def _splines(time: np.ndarray, count: int) -> np.ndarray:
    """Cubic B-splines on equal knots, shape (samples, count)."""
    inner = np.linspace(time[0], time[-1], count - 2)
    knots = np.concatenate([[inner[0]] * 3, inner, [inner[-1]] * 3])
    return BSpline.design_matrix(time, knots, 3).toarray()
