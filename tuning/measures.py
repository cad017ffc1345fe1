"""Measures that only tuning needs: squared errors over a run or over time bins, settled errors, and the noise gain."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, PyTree

from fpjax.blocks.observers import AbstractObserver
from fpjax.blocks.signals import Signals
from fpjax.simulation.metrics import AbstractLargest, AbstractMean, AbstractMeasure, safe_root

# Width of the first time bin, as a fraction of the horizon. The edges are a geometric series from there to the horizon:
# an observer settles exponentially, so that most of the change is in the first per cents of a run.
NARROWEST = 1e-3


class SquaredAfter(AbstractMeasure):
    """Mean square of (quantity - target) / scale after `start`, as one number or as residuals of time bins.

    Each bin gives two residuals: the mean error, signed, so that Gauss-Newton has its slope, and the standard deviation
    about that mean, each weighted by the root of the bin's share of the samples. Their squares sum to the mean square
    over all samples. The bins widen with time because an estimate that settles changes most at the start.

    Attributes:
        quantity: a function of the signals (static); None where `estimate` is given.
        estimate: the name of an estimate (static).
        target: what is subtracted, in the quantity's unit.
        scale: what is divided by, in the quantity's unit.
        start: time [s] before which nothing counts.
        stop: end of the last bin [s].
        bins: number of time bins; 0 for the mean square as one number (static).
    """

    quantity: PyTree = eqx.field(static=True)
    estimate: str | None = eqx.field(static=True)
    target: Array
    scale: Array
    start: Array
    stop: Array
    bins: int = eqx.field(static=True)

    def init(self, zero: Array) -> PyTree:
        """(sum of squares, samples) without bins, or (sums, sums of squares, samples), each of shape (bins,)."""
        # One array for each sum, not one scalar for each bin: XLA spent most of the compile time of a tuning on the
        # 48 scalars (3 sums of 16 bins) and their tangents.
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
        """Begin and end of the bins [s], each of shape (bins,); the last one ends at infinity."""
        place = np.arange(self.bins)
        # Edges at NARROWEST^(1 - i / bins) of the span, i = 0 ... bins; the first bin begins at `start` itself.
        begin = np.where(place == 0, 0.0, NARROWEST ** (1.0 - place / self.bins))
        end = NARROWEST ** (1.0 - (place + 1.0) / self.bins)
        span = self.stop - self.start
        begins = self.start + span * jnp.asarray(begin, time.dtype)
        ends = self.start + span * jnp.asarray(end, time.dtype)
        # The last sample lies on the edge of the last bin, within rounding: an infinite end keeps it in.
        return begins, jnp.where(jnp.asarray(place == self.bins - 1), jnp.inf, ends)

    def final(self, total: PyTree, samples: int) -> Array:
        """The mean square, or the residuals (means, then standard deviations) of shape (2 bins,)."""
        del samples
        if self.bins == 0:
            # A start after the end leaves no sample: 0 / 1 and not 0 / 0.
            return total[0] / jnp.maximum(total[1], 1.0)
        first, second, number = total
        # Counts do not depend on the gains; without this the derivative of sqrt(0) in an empty bin would be NaN.
        number = jax.lax.stop_gradient(number)
        counted = jnp.maximum(jnp.sum(number), 1.0)
        mean = first / jnp.maximum(number, 1.0)
        # n var = sum e^2 - mean sum e; rounding can make it slightly negative.
        spread = jnp.maximum(second - mean * first, 0.0)
        return jnp.concatenate([mean * jnp.sqrt(number / counted), safe_root(spread / counted)])


class SettledError(AbstractMeasure):
    """Relative error of a settled estimate: (its mean after `start` - truth) / |truth|.

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
    """Largest |w| of a run [rad/s]; 0 where the machine never moves."""

    def term(self, signals: Signals) -> Array:
        """w."""
        return signals.velocity


class NoiseGain(AbstractMean):
    """Mean square of g'(w) noise / scale, summed over the estimates.

    An estimate is z - g(w): a velocity error n passes into it at once as g'(w) n, before the dynamics of z filter it.

    Attributes:
        observer: gives the slopes g'(w).
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
