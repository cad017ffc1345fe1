"""Measures that only a tuning needs: squared errors after a start, whole or by time bins, and the noise gain."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, PyTree

from fpjax.blocks.observers import AbstractObserver
from fpjax.blocks.signals import Signals
from fpjax.simulation.metrics import AbstractLargest, AbstractMean, AbstractMeasure, safe_root

NARROWEST = 1e-3  # the first time bin, as a fraction of the horizon


class SquaredAfter(AbstractMeasure):
    """Mean square of (quantity - target) / scale after `start`, whole or as the residuals of time bins.

    Each bin leaves two residuals, its mean (signed, so that Gauss-Newton sees its slope) and its spread; the squares
    of all of them sum to the whole's value. The bins widen with time, as what settles does.

    Attributes:
        quantity: a function of the signals (static); None where `estimate` is given.
        estimate: the name of an estimate (static).
        target: what is subtracted, in the quantity's unit.
        scale: what is divided by, in the quantity's unit.
        start: time [s] before which nothing counts.
        stop: end of the last bin [s].
        bins: time bins, 0 for the whole (static).
    """

    quantity: PyTree = eqx.field(static=True)
    estimate: str | None = eqx.field(static=True)
    target: Array
    scale: Array
    start: Array
    stop: Array
    bins: int = eqx.field(static=True)

    def init(self, zero: Array) -> PyTree:
        """(sums of squares, samples) of the whole, or (sums, sums of squares, samples) of the bins, each (bins,)."""
        # One array a sum and not one number a bin: 48 numbers and their tangents took XLA most of its time to compile.
        start = zero if self.bins == 0 else jnp.broadcast_to(zero, (self.bins,))
        return (start, start) if self.bins == 0 else (start, start, start)

    def update(self, total: PyTree, signals: Signals) -> PyTree:
        """Add the error and its square."""
        value = self.quantity(signals) if self.estimate is None else signals.estimates[self.estimate]
        error = (value - self.target) / self.scale
        if self.bins == 0:
            counts = signals.time >= self.start
            return total[0] + jnp.where(counts, jnp.square(error), 0.0), total[1] + jnp.where(counts, 1.0, 0.0)
        begins, ends = self._edges(signals.time)
        inside = (signals.time >= begins) & (signals.time < ends)
        first, second, number = total
        one = jnp.where(inside, error, 0.0)
        return first + one, second + jnp.square(one), number + jnp.where(inside, 1.0, 0.0)

    def _edges(self, time: Array) -> tuple[Array, Array]:
        """Where the bins begin and end [s], each of shape (bins,); the last one does not end."""
        place = np.arange(self.bins)
        # The first bin begins at `start` itself.
        begin = np.where(place == 0, 0.0, NARROWEST ** (1.0 - place / self.bins))
        end = NARROWEST ** (1.0 - (place + 1.0) / self.bins)
        span = self.stop - self.start
        begins = self.start + span * jnp.asarray(begin, time.dtype)
        ends = self.start + span * jnp.asarray(end, time.dtype)
        return begins, jnp.where(jnp.asarray(place == self.bins - 1), jnp.inf, ends)

    def final(self, total: PyTree, samples: int) -> Array:
        """The mean square, or the residuals of shape (2 bins,)."""
        del samples
        if self.bins == 0:
            return total[0] / jnp.maximum(total[1], 1.0)
        first, second, number = total
        number = jax.lax.stop_gradient(number)  # the root of an empty bin's share has no slope
        counted = jnp.maximum(jnp.sum(number), 1.0)
        mean = first / jnp.maximum(number, 1.0)
        spread = jnp.maximum(second - mean * first, 0.0)
        return jnp.concatenate([mean * jnp.sqrt(number / counted), safe_root(spread / counted)])


class SettledError(AbstractMeasure):
    """(mean of an estimate after `start` - truth) / |truth|: how far off it ends.

    Attributes:
        estimate: its name (static).
        truth: in the estimate's unit.
        start: time [s] from which the mean is taken.
    """

    estimate: str = eqx.field(static=True)
    truth: Array
    start: Array

    def init(self, zero: Array) -> tuple[Array, Array]:
        """(sum, samples)."""
        return zero, zero

    def update(self, total: tuple[Array, Array], signals: Signals) -> tuple[Array, Array]:
        """Add the estimate where it counts."""
        counts = signals.time >= self.start
        value = signals.estimates[self.estimate]
        return total[0] + jnp.where(counts, value, 0.0), total[1] + jnp.where(counts, 1.0, 0.0)

    def final(self, total: tuple[Array, Array], samples: int) -> Array:
        """The relative error [1]; not a number where the truth is zero."""
        del samples
        return (total[0] / jnp.maximum(total[1], 1.0) - self.truth) / jnp.abs(self.truth)


class Fastest(AbstractLargest):
    """Largest |w| of a run [rad/s]."""

    def term(self, signals: Signals) -> Array:
        """w."""
        return signals.velocity


class NoiseGain(AbstractMean):
    """Mean square of g'(w) noise / scale, summed over the estimates.

    Attributes:
        observer: whose slopes g' count.
        scales: what each estimate is divided by, in its unit.
        noise: standard deviation of the velocity measurement [rad/s].
    """

    observer: AbstractObserver
    scales: tuple[Array, ...]
    noise: Array

    def term(self, signals: Signals) -> Array:
        """The sum of the squares [1]."""
        total = jnp.zeros_like(signals.velocity)
        for slope, scale in zip(self.observer.slopes(signals.velocity), self.scales, strict=True):
            total = total + jnp.square(slope * self.noise / scale)
        return total
