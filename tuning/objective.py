"""Objectives of a tuning: a cost, or a vector of residuals, accumulated in the carry of the scan."""

from abc import abstractmethod
from typing import Any

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from fpjax.blocks.block import Block, as_parameter
from fpjax.errors import InputError
from fpjax.output.json_object import JsonObject
from fpjax.simulation.loop import ClosedLoop
from fpjax.simulation.metrics import AbstractMeasure, EstimateFinal, position_error, safe_root, velocity_error

from .measures import NoiseGain, SquaredAfter

BINS = 16  # time bins of a residual vector, two residuals each (`measures.SquaredAfter`)


def _parameters(values: Any) -> JsonObject:
    return {name: as_parameter(value) for name, value in dict(values).items()}


class AbstractObjective(Block):
    """The cost of one run; a tuning minimises its mean, or its worst value, over all cases.

    Every method compares `cost`. Levenberg-Marquardt minimises the sum of squares of `residuals`: for `Estimation` and
    `Tracking` that sum is the cost itself; for `Thesis`, a sum of magnitudes, the residuals are its signed terms, and
    both are zero at the same gains.
    """

    @abstractmethod
    def measures(self, loop: ClosedLoop, horizon: Array, binned: bool) -> dict[str, AbstractMeasure]:
        """Measures that a run of `horizon` [s] accumulates, by name; `binned` for the residuals."""

    @abstractmethod
    def cost(self, loop: ClosedLoop, finals: dict[str, Array]) -> Array:
        """The cost of a run, from its measures (not binned) [1]."""

    @abstractmethod
    def residuals(self, loop: ClosedLoop, finals: dict[str, Array]) -> Array:
        """The residuals of a run, from its measures (binned) [1], shape (residuals,)."""

    def cost_of(self, residuals: Array) -> Array:
        """The cost of a run from its residuals [1]."""
        return jnp.sum(jnp.square(residuals))

    def check(self, loop: ClosedLoop) -> None:
        """Raise `InputError` where this objective does not suit the loop."""
        del loop


class Thesis(AbstractObjective):
    """|estimate - truth| at the last sample, summed over the estimates: the cost of the thesis' Appendix B.

    The text of the thesis says MAE; its code takes the final value. At the thesis' operating point this cost tunes a
    transient to pass through the truth at t = T, and the observer does not converge to it. `Estimation` asks for that.

    Attributes:
        scales: what each error is divided by, by estimate, in the estimate's unit; 1 where missing (Appendix B adds
            N m and N m s/rad as they are).
        truths: true values by estimate; where missing, the parameter of that name in the plant's friction law.
    """

    scales: dict[str, Array] = eqx.field(converter=_parameters, default_factory=dict)
    truths: dict[str, Array] = eqx.field(converter=_parameters, default_factory=dict)

    def measures(self, loop: ClosedLoop, horizon: Array, binned: bool) -> dict[str, AbstractMeasure]:
        """The last value of every estimate."""
        del horizon, binned
        return {name: EstimateFinal(name) for name in _estimated(loop)}

    def residuals(self, loop: ClosedLoop, finals: dict[str, Array]) -> Array:
        """(estimate - truth) / scale of every estimate."""
        terms = []
        for name in _estimated(loop):
            # Signed: Gauss-Newton needs the sign, which the magnitudes of `cost` lose.
            error = finals[name] - truth_of(loop, name, self.truths)
            terms.append(error / self.scales[name] if name in self.scales else error)
        return jnp.stack(terms)

    def cost(self, loop: ClosedLoop, finals: dict[str, Array]) -> Array:
        """Sum of |residuals|."""
        return self.cost_of(self.residuals(loop, finals))

    def cost_of(self, residuals: Array) -> Array:
        """Sum of |residuals| [1]."""
        return jnp.sum(jnp.abs(residuals))

    def check(self, loop: ClosedLoop) -> None:
        """Require an observer whose true values are known."""
        for name in _estimated(loop):
            truth_of(loop, name, self.truths)


class Tracking(AbstractObjective):
    """Mean square of the tracking error over `scale`.

    Without noise it has no optimum inside any range: larger gains always track better (docs/tuning.md). Use it with a
    noisy sensor, or for the controller's gains.

    Attributes:
        scale: what the error is divided by [rad/s] (or [rad] with `position`).
        start: time [s] from which the error counts.
        position: judge r - position instead of r - velocity (static).
    """

    scale: Array = eqx.field(converter=as_parameter, default=1.0)
    start: Array = eqx.field(converter=as_parameter, default=0.0)
    position: bool = eqx.field(static=True, default=False)

    def measures(self, loop: ClosedLoop, horizon: Array, binned: bool) -> dict[str, AbstractMeasure]:
        """The mean square of the error."""
        del loop
        quantity = position_error if self.position else velocity_error
        error = SquaredAfter(
            quantity, None, jnp.zeros_like(self.scale), self.scale, self.start, horizon, BINS if binned else 0
        )
        return {"error": error}

    def residuals(self, loop: ClosedLoop, finals: dict[str, Array]) -> Array:
        """Mean and spread of the error in every time bin."""
        del loop
        return finals["error"]

    def cost(self, loop: ClosedLoop, finals: dict[str, Array]) -> Array:
        """The mean square [1]."""
        del loop
        return finals["error"]


class Estimation(AbstractObjective):
    """Time average of the squared normalised estimate errors, summed over the estimates: the default.

    Over several true plants it asks for gains that estimate, not for gains whose transient passes the truth.

    Attributes:
        start: time [s] from which errors count. Gains that speed the slow mode up let an estimate swing far beyond the
            truth at first; an average that includes this transient prefers gains that never leave the initial value.
        scales: what each error is divided by, by estimate, in the estimate's unit; |truth| where missing.
        truths: true values by estimate; where missing, the parameter of that name in the plant's friction law.
        noise: standard deviation of the velocity measurement [rad/s] for the noise-gain penalty.
        noise_weight: weight of the penalty [1], the mean square of g'(w) noise / scale: the velocity noise that reaches
            the estimate z - g(w) without delay; 0 for none.
    """

    start: Array = eqx.field(converter=as_parameter, default=0.0)
    scales: dict[str, Array] = eqx.field(converter=_parameters, default_factory=dict)
    truths: dict[str, Array] = eqx.field(converter=_parameters, default_factory=dict)
    noise: Array = eqx.field(converter=as_parameter, default=0.0)
    noise_weight: Array = eqx.field(converter=as_parameter, default=0.0)

    def measures(self, loop: ClosedLoop, horizon: Array, binned: bool) -> dict[str, AbstractMeasure]:
        """The mean square error of every estimate, and the noise gain."""
        bins = BINS if binned else 0
        found: dict[str, AbstractMeasure] = {}
        for name in _estimated(loop):
            truth = truth_of(loop, name, self.truths)
            found[name] = SquaredAfter(None, name, truth, self._scale(name, truth), self.start, horizon, bins)
        scales = tuple(self._scale(name, truth_of(loop, name, self.truths)) for name in _estimated(loop))
        found["noise"] = NoiseGain(loop.observer, scales, self.noise)
        return found

    def _scale(self, name: str, truth: Array) -> Array:
        return self.scales[name] if name in self.scales else jnp.abs(truth)

    def residuals(self, loop: ClosedLoop, finals: dict[str, Array]) -> Array:
        """Mean and spread of every estimate's error in every time bin, and the weighted noise gain."""
        # Its square is the penalty in `cost`: residuals and cost describe one function.
        noise = jnp.reshape(safe_root(self.noise_weight * finals["noise"]), (1,))
        return jnp.concatenate([*(finals[name] for name in _estimated(loop)), noise])

    def cost(self, loop: ClosedLoop, finals: dict[str, Array]) -> Array:
        """The sum of the mean squares [1]."""
        total = self.noise_weight * finals["noise"]
        for name in _estimated(loop):
            total = total + finals[name]
        return total

    def check(self, loop: ClosedLoop) -> None:
        """Require an observer whose true values are known, and not zero where errors are divided by them."""
        for name in _estimated(loop):
            truth = np.asarray(truth_of(loop, name, self.truths))
            if name not in self.scales and not np.all(np.abs(truth) > 0):
                raise InputError(
                    f"The true {name} is 0, so its error cannot be divided by it: give "
                    f"Estimation(scales={{'{name}': ...}}) in the unit of {name}."
                )


OBJECTIVES: dict[str, type[AbstractObjective]] = {"thesis": Thesis, "tracking": Tracking, "estimation": Estimation}


def get_objective(objective: str | AbstractObjective) -> AbstractObjective:
    """An objective by its name ("thesis", "tracking", "estimation"); an objective is passed through.

    Raises:
        InputError: for a name that is not known.
    """
    if isinstance(objective, AbstractObjective):
        return objective
    if objective not in OBJECTIVES:
        raise InputError(f"objective = {objective!r} is not known: choose one of {', '.join(OBJECTIVES)}.")
    return OBJECTIVES[objective]()


def truth_of(loop: ClosedLoop, name: str, truths: dict[str, Array]) -> Array:
    """The true value of an estimate, in its unit: from `truths`, or else the plant's friction law.

    Raises:
        InputError: where neither has it.
    """
    value = truths[name] if name in truths else getattr(loop.plant.friction, name, None)
    if value is None:
        raise InputError(
            f"{type(loop.plant.friction).__name__} has no {name}, so the estimate's true value is not known: "
            f"give the objective truths={{'{name}': ...}}."
        )
    return value


def _estimated(loop: ClosedLoop) -> tuple[str, ...]:
    names = loop.observer.estimated
    if not names:
        raise InputError("This loop has no observer, so there is no estimate to judge: use objective='tracking'.")
    return names
