"""Measures that only a tuning needs: squared errors after a start, whole or by time bins, and the noise gain."""

from typing import Any

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array

from fpjax import AbstractMeasure, AbstractObserver, Signals


def safe_root(value: Array) -> Array:
    """sqrt with slope zero at zero."""
    positive = value > 0.0
    return jnp.where(positive, jnp.sqrt(jnp.where(positive, value, 1.0)), 0.0)


class SquaredAfter(AbstractMeasure):
    """Mean square of (quantity - target) / scale after `start`, whole or as the roots of time bins.

    The squares of the bins' values sum to the whole's value.

    Attributes:
        quantity: a function of the signals (static); None where `estimate` is given.
        estimate: the name of an estimate (static).
        target: what is subtracted, in the quantity's unit.
        scale: what is divided by, in the quantity's unit.
        start: time [s] before which nothing counts.
        stop: end of the last bin [s].
        bins: time bins, 0 for the whole (static); they divide the counted samples evenly only to a sample.
    """

    quantity: Any = eqx.field(static=True)
    estimate: str | None = eqx.field(static=True)
    target: Array
    scale: Array
    start: Array
    stop: Array
    bins: int = eqx.field(static=True)

    def init(self, zero: Array) -> tuple[Any, Array]:
        """(sums, samples counted)."""
        return (zero if self.bins == 0 else tuple(zero for _ in range(self.bins))), zero

    def update(self, total: Any, signals: Signals) -> Any:
        """Add the square."""
        value = self.quantity(signals) if self.estimate is None else signals.estimates[self.estimate]
        square = jnp.square((value - self.target) / self.scale)
        sums, counted = total
        counts = signals.time >= self.start
        counted = counted + jnp.where(counts, 1.0, 0.0)
        if self.bins == 0:
            return sums + jnp.where(counts, square, 0.0), counted
        place = (signals.time - self.start) / (self.stop - self.start) * self.bins
        added = []
        for index, part in enumerate(sums):
            above = counts if index == 0 else place >= index
            inside = above if index == self.bins - 1 else above & (place < index + 1)
            added.append(part + jnp.where(inside, square, 0.0))
        return tuple(added), counted

    def final(self, total: Any, samples: int) -> Array:
        """The mean square, or the bins' roots of shape (bins,)."""
        del samples
        sums, counted = total
        counted = jnp.maximum(counted, 1.0)
        return sums / counted if self.bins == 0 else safe_root(jnp.stack(sums) / counted)


class NoiseGain(AbstractMeasure):
    """Mean square of g'(w) noise / scale, summed over the estimates.

    Attributes:
        observer: whose slopes g' count.
        scales: what each estimate is divided by, in its unit.
        noise: standard deviation of the velocity measurement [rad/s].
    """

    observer: AbstractObserver
    scales: tuple[Array, ...]
    noise: Array

    def init(self, zero: Array) -> Array:
        """Zero."""
        return zero

    def update(self, total: Array, signals: Signals) -> Array:
        """Add the squares."""
        for slope, scale in zip(self.observer.slopes(signals.velocity), self.scales, strict=True):
            total = total + jnp.square(slope * self.noise / scale)
        return total

    def final(self, total: Array, samples: int) -> Array:
        """The mean [1]."""
        return total / samples
