"""The result of a diagnosis, as data; the contract's `diagnosis.json` is its `to_dict`."""

from __future__ import annotations

from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from ..effects.estimate import Estimate as Estimate
from ..effects.experiments import Experiment as Experiment
from ..select.dominant import DominantVariable
from ..select.verdict import Word
from .gap import Gap as Gap
from .gap import Step as Step
from .told import told, verdict_sentence

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from .posterior import Posterior


@dataclass(frozen=True)
class Ranked:
    """One effect of the ranking.

    Attributes:
        effect: its name in the vocabulary.
        probability: that it is the main cause [1], calibrated on simulated logs; exact twins share theirs equally. Sums
            to at most 1 over the ranking.
        gap_after: missing torque on withheld windows with this effect (beside the causes before it) in the model.
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

    def to_dict(self) -> dict[str, Any]:
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

    def to_dict(self) -> dict[str, Any]:
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

    def to_dict(self) -> dict[str, Any]:
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
    time: np.ndarray
    torque: np.ndarray
    before: np.ndarray
    after: np.ndarray
    withheld: np.ndarray
    window: np.ndarray


@dataclass(frozen=True)
class FittedParameter:
    """One parameter of the final fit, and how well the log determines it.

    Attributes:
        parameter: its name in the machine, or the contract's.
        value: in `unit`.
        standard_deviation: in `unit`.
        unit: of both.
        verdict: "pinned", "traded off with ...", "flat" or "at a bound".
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

    def to_dict(self) -> dict[str, Any]:
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

    def to_dict(self) -> dict[str, Any]:
        """The contract's keys."""
        curve = {name: list(getattr(self, name)) for name in ("at", "torque", "low", "high")}
        return {"of": self.of, "share": self.share, "curve": curve | {"period": self.period}}


@dataclass(frozen=True)
class Diagnosis:
    """Where the simulation is wrong, which effect causes it, how far the gap shrinks.

    Attributes:
        verdict: "no_gap", "explained", "partly_explained" or "unexplained".
        causes: effects that are asserted, most important first.
        ranking: every effect tried, most probable first.
        gap: before and after, on withheld data.
        steps: the gap after each cause, in the order in which they are added.
        where: places in which the missing torque of the nominal model stands out.
        next_experiment: for effects that this log cannot distinguish.
        model: the corrected model as `servo.toml` text.
        warnings: sentences.
        comparisons: commanded against needed torque, one entry for each log.
        identifiability: of the final fit.
        residual_where: places in which the rest stands out; None where the rest does not matter.
        probability: that the verdict is right [1], calibrated on simulated logs: the causes are exactly these (each
            itself or one that it cannot be distinguished from), or, with no causes stated, no effect tried is one.
        ahead: lead of the first cause [1]: share of the evidence that the best model without it lacks; for a wrong
            nominal number, share of the gap that would come back without it. 0 where nothing leads.
        seconds: time of each stage [s], by its name.
        motion: "rotary" or "linear", as in the model's `[units]`.
        nominal: the model as given, `servo.toml` text, so that a report can show what changed; "" where unknown.
        tracking: closed-loop tracking error, measured and predicted; None where the controller is not known.
        provenance: `command`, `arguments`, `inputs` (a list of {name, role, sha256, samples, windows_fitted,
            windows_withheld}), `windows`, `versions`, `started`, `seeds`.
        allowed: names of the effects that were tried, where the vocabulary was restricted; () for all of it.
        model_missing: why there is no corrected model as text; "" where there is one.
        same_as: exact twins of the causes, a sentence each.
        learned: laws of recorded variables for the torque that the causes leave, largest share first; () for none.
        dominant_variable: the variable that the missing torque is mostly a function of; None where none stands out.
        learned_model: the corrected model with the learned laws beside the causes, as `servo.toml` text; "" without.
        posterior: distribution of the fitted parameters, from which machines can be drawn; None where unknown.
    """

    verdict: Word
    causes: tuple[str, ...]
    ranking: tuple[Ranked, ...]
    gap: Gap
    steps: tuple[Step, ...]
    where: Where
    next_experiment: tuple[Experiment, ...]
    model: str
    warnings: tuple[str, ...]
    comparisons: tuple[Comparison, ...] = ()
    identifiability: tuple[FittedParameter, ...] = ()
    residual_where: Where | None = None
    probability: float = 0.0
    seconds: dict[str, float] = field(default_factory=dict)
    motion: Literal["rotary", "linear"] = "rotary"
    nominal: str = ""
    tracking: TrackingError | None = None
    provenance: dict[str, Any] = field(default_factory=dict)
    allowed: tuple[str, ...] = ()
    model_missing: str = ""
    same_as: tuple[str, ...] = ()
    learned: tuple[Learned, ...] = ()
    learned_model: str = ""
    dominant_variable: DominantVariable | None = None
    ahead: float = 0.0
    posterior: Posterior | None = None

    def plot(self, path: str | Path | None = None) -> Figure:
        """One page: the verdict, measured against simulated, where, and how far the gap shrinks.

        Args:
            path: picture file to write; None to write none.

        Raises:
            InputError: where the file cannot be written.
        """
        from ...output.plotting import saved
        from ..report import draw_overview  # imported here: matplotlib is needed for pictures only

        return saved(draw_overview(self), path)

    def to_dataframe(self) -> Any:
        """The ranking as a `pandas.DataFrame`, the effect as its index: a row for each parameter of each effect tried.

        Columns: cause (whether it is asserted), probability, cause_probability, gap_after; parameter, value, low,
        high (90 % interval), unit.

        Raises:
            InputError: where pandas is not installed.
        """
        from .frame import ranking_frame

        return ranking_frame(self)

    def report(self, path: str | Path) -> Path:
        """Write `report.html` and every picture as PNG.

        Args:
            path: the folder, created if needed.

        Returns:
            The path of `report.html`.
        """
        from ..report import write_report

        return write_report(self, path)

    def to_dict(self) -> dict[str, Any]:
        """The contract's `diagnosis.json` (numbers, strings, lists and dictionaries only), and beside it `ahead`,
        `tracking`, `seconds`, `provenance`, `allowed_effects` and `model_missing`.
        """
        return {
            "verdict": self.verdict,
            "causes": list(self.causes),
            "ranking": [entry.to_dict() for entry in self.ranking],
            "gap": self.gap.to_dict(),
            "steps": [step.to_dict() for step in self.steps],
            "where": self.where.to_dict(),
            "next_experiment": [experiment.to_dict() for experiment in self.next_experiment],
            "model": self.model,
            "warnings": list(self.warnings),
            "probability": self.probability,
            "ahead": self.ahead,
            "same_as": list(self.same_as),
            "learned": [law.to_dict() for law in self.learned],
            "learned_model": self.learned_model,
            "dominant_variable": None if self.dominant_variable is None else self.dominant_variable.to_dict(),
            "model_missing": self.model_missing,
            "tracking": None if self.tracking is None else self.tracking.to_dict(),
            "allowed_effects": list(self.allowed) if self.allowed else "all",
            "seconds": {stage: round(spent, 3) for stage, spent in self.seconds.items()},
            "provenance": self.provenance,
        }

    def __str__(self) -> str:
        return told(self)

    __repr__ = __str__

    def sentence(self) -> str:
        """The verdict in one sentence."""
        return verdict_sentence(self)
