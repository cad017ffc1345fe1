"""A motion from a few free numbers that keeps its limits whatever these numbers are.

The speed is a sum of three parts. A cubic spline with free coefficients makes ramps, holds, and slow and fast
reversals. Tones of fixed frequencies have free size and phase, under an envelope that is a second, coarser spline. And
a plain sine and a sweep have free sizes, so that the search can do at least as well as they do. The motion begins and
ends at rest at the same position. A motion beyond a limit is scaled down as a whole until the tightest limit just
holds. So an optimiser needs no penalty, and every motion that it tries is admissible for the machine.
"""

from dataclasses import dataclass
from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float
from scipy.interpolate import BSpline

from .limits import Limits
from .plain_references import plain_references

KNOTS = (12, 40)  # fewest and most coefficients of the speed's spline
SPACING = 2.5  # time between knots, in times from rest to the top speed at the largest acceleration [1]
TONES = 10
GATES = 7  # coefficients of the tones' envelope
HIGHEST = 0.03  # share of the control rate at the highest tone; a velocity loop follows little above it
RAMP = 0.04  # share of the duration for the ramp from rest, and for the one back to rest
SWEEP = 0  # index of the start that is a sweep
FULL = 0.999  # share of a limit to which a motion is scaled


class Shape(NamedTuple):
    """The free numbers of a motion, all of order one.

    Attributes:
        knots: spline coefficients of the speed, before a tanh, shape (knots,).
        gates: spline coefficients of the tones' envelope, as logits, shape (GATES,).
        sizes: logarithms of the tones' amplitudes in top speeds, shape (TONES,).
        phases: of the tones [rad], shape (TONES,).
        usual: amplitudes of a plain sine and of a sweep [1], shape (2,).
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
    """The map from shapes to motions: tables of splines and tones at the samples of a run.

    Attributes:
        limits: of every motion.
        dt: sample period [s].
        time: [s], shape (samples,).
        spline: basis of the speed's spline, shape (samples, knots).
        envelope: basis of the envelope's spline, shape (samples, GATES).
        ramp: factor that goes from 0 to 1 and back to 0, shape (samples,).
        frequencies: of the tones [Hz], shape (TONES,).
        usual: speeds of a sine and of a sweep, in top speeds [1], shape (samples, 2).
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
        """The motion of a shape, times `share` [1]; differentiable."""
        angle = 2.0 * jnp.pi * self.frequencies * self.time[:, None] + shape.phases[None, :]
        gate = jnp.clip(self.envelope @ (1.0 / (1.0 + jnp.exp(-shape.gates))), 0.0, 1.0)
        speed = self.spline @ jnp.tanh(shape.knots) + gate * (jnp.sin(angle) @ jnp.exp(shape.sizes))
        speed = speed + self.usual @ shape.usual
        return self.within(speed, share)

    def within(self, speed: Array | np.ndarray, share: Array | float = 1.0) -> PlannedMotion:
        """A motion from rest to rest at the same position, scaled to the limits and then by `share`.

        Args:
            speed: in top speeds [1], shape (samples,).
            share: factor on the whole motion [1].
        """
        limits = self.limits
        speed = jnp.asarray(speed)
        # The mean speed under the ramp is taken off, so that the motion ends where it began.
        speed = speed - jnp.mean(speed * self.ramp) / np.mean(self.ramp)
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
        """Start shapes: a sweep, holds of falling speed in both directions, slow reversals, and random shapes.

        The sweep is the first: however little time there is, a plan is no worse than it.

        Args:
            seed: of the random shapes.
            count: number of shapes.
        """
        rng = np.random.default_rng(seed)
        knots, tones = self.spline.shape[1], len(self.frequencies)
        place = np.arange(knots)
        falling = np.geomspace(1.5, 0.05, knots)
        holds = np.where(place // 2 % 2 == 0, 1.0, -1.0) * falling
        slow = 0.12 * np.where(place % 2 == 0, 1.0, -1.0)
        quiet, loud = np.full(tones, -4.0), -1.5 - 0.7 * np.log(self.frequencies / self.frequencies[0])
        late = np.linspace(-4.0, 3.0, GATES)
        # (knots, gates, sizes) of the four start shapes that are not random.
        plain = [
            (np.zeros(knots), np.full(GATES, -3.0), quiet - 2.0),
            (holds, late, loud),
            (np.where(place < knots // 2, 1.2 * np.sin(0.9 * place), slow), late, loud - 0.7),
            (slow, np.linspace(2.0, -4.0, GATES), loud + 0.5),
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
    """The course of a run.

    Args:
        limits: of the run.
        dt: control period [s].
        seconds_resolved: a shorter time than this between two knots is of no use [s].
    """
    samples = round(limits.duration / dt) + 1
    time = np.arange(samples) * dt
    rise = max(limits.speed / limits.acceleration, seconds_resolved)
    count = int(np.clip(limits.duration / (SPACING * rise), *KNOTS))
    ramp = np.clip(np.minimum(time, time[-1] - time) / (RAMP * limits.duration), 0.0, 1.0)
    lowest, highest = 2.0 / limits.duration, HIGHEST / dt  # [Hz]; the slow motion is the spline's part
    tones = np.geomspace(min(4.0 * lowest, 0.2 * highest), highest, TONES)
    return PlannedCourse(
        limits, dt, time, _splines(time, count), _splines(time, GATES), ramp * ramp * (3.0 - 2.0 * ramp),
        tones, plain_references(limits, time, highest),
    )  # fmt: skip


def _splines(time: np.ndarray, count: int) -> np.ndarray:
    """Cubic B-splines on equal knots, shape (samples, count)."""
    inner = np.linspace(time[0], time[-1], count - 2)
    knots = np.concatenate([[inner[0]] * 3, inner, [inner[-1]] * 3])
    return BSpline.design_matrix(time, knots, 3).toarray()
