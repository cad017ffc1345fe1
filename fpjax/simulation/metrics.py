"""Measures of a run: accumulators in the carry of the scan, and step information of a recorded response."""

from abc import abstractmethod
from collections.abc import Callable, Sequence

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jax.typing import ArrayLike
from jaxtyping import Array, PyTree

from ..blocks.block import Block, as_optional, as_parameter
from ..blocks.signals import Signals

Quantity = Callable[[Signals], Array]


class AbstractMeasure(Block):
    """A number computed along a run, accumulated sample by sample without storing the signals."""

    @abstractmethod
    def init(self, zero: Array) -> PyTree:
        """The accumulator before the first sample; `zero` is a scalar of the loop's dtype."""

    @abstractmethod
    def update(self, total: PyTree, signals: Signals) -> PyTree:
        """The accumulator after one more sample."""

    @abstractmethod
    def final(self, total: PyTree, samples: int) -> Array:
        """The measure after `samples` samples."""


class AbstractTerms(AbstractMeasure):
    """A measure whose accumulator is one number, updated by one number per sample, its `term`."""

    def init(self, zero: Array) -> Array:
        """Zero."""
        return zero

    @abstractmethod
    def term(self, signals: Signals) -> Array:
        """The contribution of one sample."""


class AbstractMean(AbstractTerms):
    """Mean of `term` over all samples, t = 0 included."""

    def update(self, total: Array, signals: Signals) -> Array:
        """Add the term."""
        return total + self.term(signals)

    def final(self, total: Array, samples: int) -> Array:
        """The mean."""
        return total / samples


class AbstractLargest(AbstractTerms):
    """Largest |term| over all samples."""

    def update(self, total: Array, signals: Signals) -> Array:
        """Keep the larger."""
        return jnp.maximum(total, jnp.abs(self.term(signals)))

    def final(self, total: Array, samples: int) -> Array:
        """The largest."""
        del samples
        return total


class AbstractLast(AbstractTerms):
    """`term` at the last sample."""

    def update(self, total: Array, signals: Signals) -> Array:
        """Keep the newest."""
        del total
        return self.term(signals)

    def final(self, total: Array, samples: int) -> Array:
        """The last."""
        del samples
        return total


def velocity_error(signals: Signals) -> Array:
    """r - w [rad/s] of `signals`."""
    return signals.reference - signals.velocity


def position_error(signals: Signals) -> Array:
    """r - position [rad] of `signals`, for a position loop."""
    return signals.reference - signals.position


def compensation_error(signals: Signals) -> Array:
    """friction - compensation [N m] of `signals`."""
    return signals.friction - signals.compensation


class MeanAbsolute(AbstractMean):
    """Mean of |quantity| over all samples, t = 0 included.

    Attributes:
        quantity: a function of the signals (static), by default r - w.
    """

    quantity: Quantity = eqx.field(static=True, default=velocity_error)

    def term(self, signals: Signals) -> Array:
        """|quantity|."""
        return jnp.abs(self.quantity(signals))


class RootMeanSquare(AbstractMean):
    """Root of the mean square of a quantity over all samples.

    Attributes:
        quantity: a function of the signals (static), by default r - w.
    """

    quantity: Quantity = eqx.field(static=True, default=velocity_error)

    def term(self, signals: Signals) -> Array:
        """The square."""
        return jnp.square(self.quantity(signals))

    def final(self, total: Array, samples: int) -> Array:
        """The root mean square."""
        return safe_root(total / samples)


class MeanSquare(AbstractMean):
    """Mean square of a quantity over all samples: a better cost, smooth at zero, where `RootMeanSquare` has a kink.

    Attributes:
        quantity: a function of the signals (static), by default r - w.
    """

    quantity: Quantity = eqx.field(static=True, default=velocity_error)

    def term(self, signals: Signals) -> Array:
        """The square."""
        return jnp.square(self.quantity(signals))


class StandardDeviation(AbstractMeasure):
    """Standard deviation of a quantity over all samples.

    Attributes:
        quantity: a function of the signals (static).
    """

    quantity: Quantity = eqx.field(static=True)

    def init(self, zero: Array) -> tuple[Array, Array]:
        """(sum, sum of squares)."""
        return zero, zero

    def update(self, total: PyTree, signals: Signals) -> PyTree:
        """Add the quantity and its square."""
        value = self.quantity(signals)
        return total[0] + value, total[1] + jnp.square(value)

    def final(self, total: PyTree, samples: int) -> Array:
        """The standard deviation (population)."""
        # E[x^2] - E[x]^2, so that one pass with two sums is enough. It is a difference of large numbers: in single
        # precision a mean of a thousand times the deviation leaves one digit.
        mean = total[0] / samples
        return safe_root(total[1] / samples - jnp.square(mean))


class Largest(AbstractLargest):
    """Largest |quantity| over all samples.

    Attributes:
        quantity: a function of the signals (static).
    """

    quantity: Quantity = eqx.field(static=True)

    def term(self, signals: Signals) -> Array:
        """The quantity."""
        return self.quantity(signals)


class Final(AbstractLast):
    """The quantity at the last sample.

    Attributes:
        quantity: a function of the signals (static).
    """

    quantity: Quantity = eqx.field(static=True)

    def term(self, signals: Signals) -> Array:
        """The quantity."""
        return self.quantity(signals)


class GradientRootMeanSquare(AbstractMeasure):
    """Root mean square of a quantity's sample-to-sample difference: the "RMSE of gradient" of Table 3.4.

    Attributes:
        quantity: a function of the signals (static), by default r - w.
    """

    quantity: Quantity = eqx.field(static=True, default=velocity_error)

    def init(self, zero: Array) -> tuple[Array, Array, Array]:
        """(sum of squares, last value, samples seen)."""
        return zero, zero, zero

    def update(self, total: PyTree, signals: Signals) -> PyTree:
        """Add the squared difference (none at the first sample)."""
        squares, last, seen = total
        value = self.quantity(signals)
        return squares + jnp.where(seen > 0.0, jnp.square(value - last), 0.0), value, seen + 1.0

    def final(self, total: PyTree, samples: int) -> Array:
        """The root mean square, in the quantity's unit per sample."""
        # Per sample and not per second, as in Table 3.4; so the value depends on the step.
        return safe_root(total[0] / max(samples - 1, 1))


class CoulombTorqueError(AbstractMean):
    """Mean |(k - k_hat) sign(w)| [N m]: the thesis' "friction torque" error.

    Attributes:
        coulomb: the true k [N m].
    """

    coulomb: Array = eqx.field(converter=as_parameter)

    def term(self, signals: Signals) -> Array:
        """|(k - k_hat) sign(w)| [N m]; without an observer k_hat is zero."""
        estimate = signals.estimates.get("coulomb", jnp.zeros_like(signals.velocity))
        # At rest sign(w) is zero: the compensation is zero there too, so an error of the estimate does not count.
        return jnp.abs((self.coulomb - estimate) * jnp.sign(signals.velocity))


class EstimateError(AbstractMeasure):
    """Mean square of (estimate - truth) / scale: one term of the default tuning cost.

    Attributes:
        name: which estimate (static).
        truth: its true value, in its own unit.
        scale: divisor of the error, in the estimate's unit; None for |truth|.
        start: samples before this time do not count [s].
    """

    name: str = eqx.field(static=True)
    truth: Array = eqx.field(converter=as_parameter)
    scale: Array | None = eqx.field(converter=as_optional, default=None)
    start: Array = eqx.field(converter=as_parameter, default=0.0)

    def init(self, zero: Array) -> tuple[Array, Array]:
        """(sum, samples counted)."""
        return zero, zero

    def update(self, total: PyTree, signals: Signals) -> PyTree:
        """Add the squared normalised error once `start` has passed."""
        scale = jnp.abs(self.truth) if self.scale is None else self.scale
        error = (signals.estimates[self.name] - self.truth) / scale
        counts = signals.time >= self.start
        return total[0] + jnp.where(counts, jnp.square(error), 0.0), total[1] + jnp.where(counts, 1.0, 0.0)

    def final(self, total: PyTree, samples: int) -> Array:
        """The mean square [1]."""
        del samples
        return total[0] / jnp.maximum(total[1], 1.0)


class _OfEstimate(eqx.Module):
    """What the measures of one estimate share."""

    name: str = eqx.field(static=True)

    def term(self, signals: Signals) -> Array:
        """The estimate."""
        return signals.estimates[self.name]


class EstimateFinal(_OfEstimate, AbstractLast):
    """An estimate at the last sample, in its own unit.

    Attributes:
        name: which estimate (static).
    """


class EstimatePeak(_OfEstimate, AbstractLargest):
    """Largest |estimate| on the way, in its own unit.

    Attributes:
        name: which estimate (static).
    """


class SettlingTime(AbstractMeasure):
    """Time [s] after which an estimate stays within `tolerance` of the truth; infinite if it ends outside.

    Attributes:
        name: which estimate (static).
        truth: its true value.
        tolerance: fraction of |truth| [1].
    """

    name: str = eqx.field(static=True)
    truth: Array = eqx.field(converter=as_parameter)
    tolerance: Array = eqx.field(converter=as_parameter, default=0.05)

    def init(self, zero: Array) -> tuple[Array, Array]:
        """(time of the last entry into the band [s], 1 while outside the band)."""
        return zero, zero + 1.0

    def update(self, total: PyTree, signals: Signals) -> PyTree:
        """Remember when the band was entered."""
        entered, was_outside = total
        error = jnp.abs(signals.estimates[self.name] - self.truth)
        # Written as multiples of the carry, so that the carry keeps its dtype and its batch axes. NaN compares as
        # outside.
        outside = jnp.where(error <= self.tolerance * jnp.abs(self.truth), 0.0 * was_outside, 0.0 * was_outside + 1.0)
        return jnp.where(was_outside > outside, signals.time, entered), outside

    def final(self, total: PyTree, samples: int) -> Array:
        """The settling time [s]."""
        del samples
        return jnp.where(total[1] > 0.0, jnp.inf, total[0])


def safe_root(value: Array) -> Array:
    """Square root; 0 with slope 0 where the value is not positive; NaN stays NaN.

    The slope of the square root is infinite at zero, and infinity times the zero slope of a square is NaN. As gradients
    pass through both branches of a `where`, the argument of the root is replaced by 1 where the root is not used.
    """
    rest = value <= 0.0
    return jnp.where(rest, 0.0, jnp.sqrt(jnp.where(rest, 1.0, value)))


def control_effort() -> RootMeanSquare:
    """Root mean square of the commanded torque [N m]."""
    return RootMeanSquare(_torque)


def _torque(signals: Signals) -> Array:
    return signals.torque


def step_info(
    time: ArrayLike | Sequence[float],
    response: ArrayLike | Sequence[float],
    *,
    final_value: float | None = None,
    settling: float = 0.02,
    rise: tuple[float, float] = (0.1, 0.9),
) -> dict[str, float]:
    """Step information of a recorded response, by the names that python-control uses.

    Args:
        time: [s], shape (samples,).
        response: shape (samples,).
        final_value: the steady state; None for the last value.
        settling: half-width of the settling band as a fraction of the final value [1].
        rise: fractions of the final value between which the rise time counts [1].

    Returns:
        RiseTime, SettlingTime, PeakTime [s], Overshoot, Undershoot [%], Peak, SteadyStateValue; NaN where undefined.
    """
    time, response = np.asarray(time, dtype=float), np.asarray(response, dtype=float)
    target = float(response[-1]) if final_value is None else float(final_value)
    nothing = float("nan")
    names = ("RiseTime", "SettlingTime", "PeakTime", "Overshoot", "Undershoot", "Peak", "SteadyStateValue")
    if target == 0.0 or not np.all(np.isfinite(response)):
        return dict.fromkeys(names, nothing)
    # relative to the final value, so that a step downwards is measured like one upwards
    relative = response / target
    # first crossings of the two levels, as python-control counts; a response that starts above `low` has it at sample
    # 0
    low, high = (np.flatnonzero(relative >= fraction) for fraction in rise)
    outside = np.flatnonzero(np.abs(relative - 1.0) > settling)
    # Settled after the last sample outside the band: a response that leaves the band again had not settled.
    settled = 0 if outside.size == 0 else int(outside[-1]) + 1
    peak = int(np.argmax(np.abs(response)))
    values = (
        float(time[high[0]] - time[low[0]]) if low.size and high.size else nothing,
        float(time[settled] - time[0]) if settled < time.size else nothing,
        float(time[peak] - time[0]),
        100.0 * max(0.0, float(relative.max()) - 1.0),
        100.0 * max(0.0, -float(relative.min())),
        float(abs(response[peak])),
        target,
    )
    return dict(zip(names, values, strict=True))
