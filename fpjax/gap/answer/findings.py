"""The parts of a diagnosis, as data: the ranking, where the gap lies, what each model needs, what else was learned."""

from __future__ import annotations

from dataclasses import asdict, dataclass, field
from typing import Literal

import numpy as np
from jaxtyping import Bool, Float, Int

from ...logs.arrays import Values
from ...output.json_object import JsonObject
from ..effects.estimate import Estimate


@dataclass(frozen=True)
class Ranked:
    """One effect of the ranking.

    Attributes:
        effect: its name in the vocabulary.
        probability: that it is the main cause [1], calibrated on simulated logs; exact twins share theirs equally. Sums
            to at most 1 over the ranking.
        gap_after: missing torque on withheld windows, of a cause with it and the causes before it in the model, of any
            other effect with it in the causes' place and the nominal numbers fitted anew beside it.
        parameters: estimates by the contract's names.
        indistinguishable_from: effects that this log cannot distinguish from it.
        cause_probability: that it is among the causes [1], the main one or not: near 1 for both of a certain pair.
        evidence: log evidence over that of the nominal model [nats], from which the probability follows.
    """

    effect: str
    probability: float
    gap_after: float
    parameters: dict[str, Estimate]
    indistinguishable_from: tuple[str, ...] = ()
    evidence: float = 0.0
    cause_probability: float = float("nan")

    def to_dict(self) -> JsonObject:
        """The contract's keys, and `cause_probability`."""
        return {
            "effect": self.effect,
            "probability": self.probability,
            "cause_probability": self.cause_probability,
            "gap_after": self.gap_after,
            "parameters": {name: estimate.to_dict() for name, estimate in self.parameters.items()},
            "indistinguishable_from": list(self.indistinguishable_from),
        }


@dataclass(frozen=True)
class Share:
    """An interval of an axis (time, velocity, ...) and the share of the missing torque's energy in it.

    Attributes:
        start: in the axis' unit (s, rad/s, rad, Hz).
        stop: in the axis' unit.
        share: of the missing torque's energy [1].
        expected: share that a missing torque of the same size everywhere would have there [1].
    """

    start: float
    stop: float
    share: float
    expected: float = 0.0

    def to_dict(self) -> JsonObject:
        """The contract's keys."""
        return {"from": self.start, "to": self.stop, "share": self.share}


@dataclass(frozen=True)
class Where:
    """Where the missing torque lies, from its course over the windows.

    Attributes:
        time: intervals that stand out [s].
        velocity: likewise [rad/s].
        position: likewise [rad].
        frequency: likewise [Hz].
        regime: share of the energy by regime: reversal, low_speed, acceleration, cruise, limit [1].
        residual: course of the missing torque of the first log [N m], shape (samples in windows,), for the report.
        axes: "time" [s], "velocity" [rad/s] and, where it moves, "position" [rad], each of the shape of `residual`.
        maps: every bin of each axis, not only those that stand out.
    """

    time: tuple[Share, ...] = ()
    velocity: tuple[Share, ...] = ()
    position: tuple[Share, ...] = ()
    frequency: tuple[Share, ...] = ()
    regime: dict[str, float] = field(default_factory=dict)
    residual: np.ndarray | None = None
    axes: dict[str, np.ndarray] = field(default_factory=dict)
    maps: dict[str, tuple[Share, ...]] = field(default_factory=dict)

    def to_dict(self) -> JsonObject:
        """The contract's keys."""
        axes = ("time", "velocity", "position", "frequency")
        return {axis: [share.to_dict() for share in getattr(self, axis)] for axis in axes} | {"regime": self.regime}


@dataclass(frozen=True)
class Comparison:
    """The commanded torque against the torque that each model says the measured motion needed; NaN outside windows.

    Their difference is the missing torque of the model, as far as the sensors show it.

    Attributes:
        name: of the log.
        time: [s], shape (samples,).
        torque: commanded [N m], shape (samples,).
        before: that the nominal model needs [N m], shape (samples,).
        after: that the corrected model needs [N m], shape (samples,).
        withheld: True where the sample was not fitted, shape (samples,).
        window: index of the window of each sample, -1 for none, shape (samples,).
    """

    name: str
    time: Float[Values, " samples"]
    torque: Float[Values, " samples"]
    before: Float[Values, " samples"]
    after: Float[Values, " samples"]
    withheld: Bool[Values, " samples"]
    window: Int[Values, " samples"]


@dataclass(frozen=True)
class FittedParameter:
    """One parameter of the final fit, and how well the log determines it.

    Attributes:
        parameter: its name in the machine, or the contract's.
        value: in `unit`.
        standard_deviation: in `unit`.
        unit: of both.
        verdict: "pinned", "traded off with ...", "flat", "absent" (the law does without it) or "at a bound".
    """

    parameter: str
    value: float
    standard_deviation: float
    unit: str
    verdict: str


@dataclass(frozen=True)
class TrackingError:
    """The closed loop's tracking error on withheld data, where the controller is known.

    The controller follows the recorded reference around the nominal and around the corrected machine, whose sensors
    have the log's noise.

    Attributes:
        unit: of the three errors.
        measured: rms of reference minus measured.
        before: rms that the nominal simulator predicts.
        after: rms that the corrected simulator predicts.
        signal: "velocity" or "position": what the reference is of.
        controller_error: rms of the part of the torque column that the known controller does not make, over the rms of
            that column [1].
    """

    unit: str
    measured: float
    before: float
    after: float
    signal: str = "velocity"
    controller_error: float = 0.0

    def to_dict(self) -> JsonObject:
        """All of it, by name."""
        return asdict(self)


@dataclass(frozen=True)
class Learned:
    """A law learned from the torque that the causes leave: an opposing torque, as friction is, over one variable.

    Attributes:
        of: the variable: "velocity", "position", "torque" or "time".
        share: of the missing torque's energy that is left on withheld windows, which this law removes [1].
        at: points of the table, in the unit of the variable, increasing; a velocity has 0 twice, once a direction.
        torque: at each point [N m]; linear between points.
        low: lower end of the 90 % band [N m].
        high: upper end of the 90 % band [N m].
        period: of the variable, in its unit; None where the law does not repeat.
    """

    of: Literal["velocity", "position", "torque", "time"]
    share: float
    at: tuple[float, ...]
    torque: tuple[float, ...]
    low: tuple[float, ...]
    high: tuple[float, ...]
    period: float | None = None

    def to_dict(self) -> JsonObject:
        """The contract's keys."""
        curve = {name: list(getattr(self, name)) for name in ("at", "torque", "low", "high")}
        return {"of": self.of, "share": self.share, "curve": curve | {"period": self.period}}
