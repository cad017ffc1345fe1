"""Diagnosis: what was found, as data; the contract's `diagnosis.json` is its `to_dict`."""

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
        effect: name of the vocabulary.
        probability: that it is the main cause, calibrated on simulated logs; effects that no log can tell apart divide
            theirs. Sums to at most 1.
        gap_after: missing torque on withheld windows with this effect (beside the causes before it) in the model.
        parameters: by the contract's name.
        indistinguishable_from: effects that this log cannot tell from it.
        cause_probability: that it is among the causes, the main one or not: of a sure pair, the same for either.
        evidence: log evidence less that of the nominal model [1], for those who want to look behind the probability.
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
    """A stretch of an axis and the share of the gap's energy in it.

    Attributes:
        start: in the axis' unit (s, rad/s, rad, Hz).
        stop: in the axis' unit.
        share: of the gap's energy [1].
        expected: of the samples (or of the band) [1], what a gap that is everywhere alike would have.
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
        time: stretches that stand out [s].
        velocity: [rad/s].
        position: [rad].
        frequency: [Hz].
        regime: shares by name: reversal, low_speed, acceleration, cruise, limit.
        residual: the course of the missing torque [N m], shape (samples,), and its axes, for the report.
        axes: "time", "velocity", "position" (None where unknown), each of shape (samples,).
        maps: for each axis every bin, not only those that stand out.
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

    What they differ by is the model's missing torque, as far as the sensors show it.

    Attributes:
        name: the log's.
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
    """What the final fit knows about each of its parameters.

    Attributes:
        parameter: dotted name or the contract's.
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
        unit: of the three.
        measured: rms of reference less measured.
        before: rms that the nominal simulator predicts.
        after: rms that the corrected simulator predicts.
        signal: "velocity" or "position", as the reference is.
        controller_error: share of the torque column [1] that the known controller does not account for.
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
    """A law that was learned from what is left: a torque that opposes, as friction does, as a table of one variable.

    Attributes:
        of: "velocity", "position", "torque" or "time".
        share: of the energy of what is left on withheld windows that it takes [1].
        at: points, in the unit of `of`, increasing; a velocity has 0 twice, once for each direction.
        torque: at each point [N m]; between them straight lines.
        low: lower end of the 90 % band [N m].
        high: upper end of the 90 % band [N m].
        period: of the variable, in its unit; None where nothing repeats.
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
        causes: what is asserted, most important first.
        ranking: every effect tried, most probable first.
        gap: before and after, on withheld data.
        steps: the ladder.
        where: places that stand out.
        next_experiment: for effects that this log cannot tell apart.
        model: the corrected model as `servo.toml` text.
        warnings: sentences.
        comparisons: measured against simulated, one entry a log.
        identifiability: of the final fit.
        residual_where: where what is left lies, unless that is nothing that matters.
        probability: that the verdict is right, calibrated: the causes are exactly these (each itself or one that it
            cannot be told from), or with no causes stated, that none of the effects tried is one.
        ahead: how far the leading cause is beyond the others: share of the evidence that the best model without it
            lacks [1]; of a wrong nominal number, what would come back without it. 0 where nothing leads.
        seconds: time spent by stage [s].
        motion: "rotary" or "linear", as in the model's `[units]`.
        nominal: the model as given, `servo.toml` text, so that a report can show what changed; "" where unknown.
        tracking: closed-loop tracking error, measured and predicted; None where the controller is not known.
        provenance: `command`, `arguments`, `inputs` (a list of {name, role, sha256, samples, windows_fitted,
            windows_withheld}), `windows`, `versions`, `started`, `seeds`.
        allowed: names of the effects that were tried, where the vocabulary was restricted; () for all of it.
        model_missing: why there is no corrected model as text; "" where there is one.
        same_as: exact twins of the causes, a sentence each.
        learned: what is left as laws of what was recorded, the largest share first; () where none could be learned.
        dominant_variable: that the missing torque is a law of; None where no table of one variable stands out.
        learned_model: the corrected model with the learned laws beside the causes, as `servo.toml` text; "" without.
        posterior: what is known of the machine, with its correlations, for drawing machines from; None where unknown.
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
        from ..report import draw_overview  # here, because a diagnosis is data that needs no pictures

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
            path: the folder; it is made.

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
