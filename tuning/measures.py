"""Measures that only a tuning needs: squared errors after a start, whole or by time bins, and the noise gain."""

from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array

from fpjax import AbstractMeasure, AbstractObserver, Signals
from fpjax.metrics import AbstractMean, safe_root

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

    quantity: Any = eqx.field(static=True)
    estimate: str | None = eqx.field(static=True)
    target: Array
    scale: Array
    start: Array
    stop: Array
    bins: int = eqx.field(static=True)

    def init(self, zero: Array) -> Any:
        """(sums of squares, samples) of the whole, or (sums, sums of squares, samples) of the bins."""
        return (zero, zero) if self.bins == 0 else tuple((zero, zero, zero) for _ in range(self.bins))

    def update(self, total: Any, signals: Signals) -> Any:
        """Add the error and its square."""
        value = self.quantity(signals) if self.estimate is None else signals.estimates[self.estimate]
        error = (value - self.target) / self.scale
        counts = signals.time >= self.start
        if self.bins == 0:
            return total[0] + jnp.where(counts, jnp.square(error), 0.0), total[1] + jnp.where(counts, 1.0, 0.0)
        reached = [counts]
        for place in range(1, self.bins):
            edge = self.start + (self.stop - self.start) * NARROWEST ** (1.0 - place / self.bins)
            reached.append(counts & (signals.time >= edge))
        added = []
        for place, (first, second, number) in enumerate(total):
            inside = reached[place] & ~reached[place + 1] if place + 1 < self.bins else reached[place]
            one = jnp.where(inside, error, 0.0)
            added.append((first + one, second + jnp.square(one), number + jnp.where(inside, 1.0, 0.0)))
        return tuple(added)

    def final(self, total: Any, samples: int) -> Array:
        """The mean square, or the residuals of shape (2 bins,)."""
        del samples
        if self.bins == 0:
            return total[0] / jnp.maximum(total[1], 1.0)
        first, second, number = (jnp.stack(column) for column in zip(*total, strict=True))
        number = jax.lax.stop_gradient(number)  # the root of an empty bin's share has no slope
        counted = jnp.maximum(jnp.sum(number), 1.0)
        mean = first / jnp.maximum(number, 1.0)
        spread = jnp.maximum(second - mean * first, 0.0)
        return jnp.concatenate([mean * jnp.sqrt(number / counted), safe_root(spread / counted)])


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
