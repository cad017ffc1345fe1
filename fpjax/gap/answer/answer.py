"""The answer to a log, as data; the contract's `diagnosis.json` is its `to_dict`."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any, Literal

from ...output.json_object import JsonObject
from ..effects.experiments import Experiment
from ..select.dominant import DominantVariable
from ..select.statement import Word
from .findings import Comparison, FittedParameter, Learned, Ranked, TrackingError, Where
from .free_replay import FreeReplay
from .gap import Gap, Step, closed
from .posterior import Posterior


@dataclass(frozen=True)
class Answer:
    """What a diagnosis found, as data; `fpjax.gap.Diagnosis` also prints, plots and reports it.

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
            nominal number, what would come back without it, of what all causes take of the gap (of half of it where
            they take less). 0 where nothing leads.
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
        free_replay: how far free simulations leave the motion, before and after; None where unknown.
        undecided: causes of the corrected model that take a part of the gap and are not asserted, since others would do
            nearly as well; `steps` holds them last.
        contradiction: of an unexplained gap, what of the logs cannot be so (a unit, a sign, a column, the model of
            another machine), so that no cause is asserted; "" for nothing.
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
    free_replay: FreeReplay | None = None
    contradiction: str = ""
    undecided: tuple[str, ...] = ()

    @property
    def only_misread(self) -> bool:
        """Whether errors of the velocity column are all there is: they leave of the gap what was there."""
        return self.verdict == "explained" and self.gap.after == self.gap.before

    @property
    def nothing_missing(self) -> bool:
        """Whether the simulation of the machine misses no torque that matters."""
        return self.verdict == "no_gap" or self.only_misread

    @property
    def closed_by_causes(self) -> float:
        """Share of the gap that the causes alone close [1], without what is undecided beside them."""
        left = [step.gap_after for step in self.steps if step.added in self.causes]
        if not self.undecided or not left:
            return self.gap.closed
        return float(closed(self.gap.before, left[-1], self.gap.noise_floor))

    def to_dict(self) -> JsonObject:
        """The contract's `diagnosis.json` (numbers, strings, lists and dictionaries only), and beside it `ahead`,
        `tracking`, `free_replay`, `contradiction`, `undecided`, `closed_by_causes`, `seconds`, `provenance`,
        `allowed_effects` and `model_missing`.
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
            "free_replay": None if self.free_replay is None else self.free_replay.to_dict(),
            "contradiction": self.contradiction,
            "undecided": list(self.undecided),
            "closed_by_causes": self.closed_by_causes,
            "allowed_effects": list(self.allowed) if self.allowed else "all",
            "seconds": {stage: round(spent, 3) for stage, spent in self.seconds.items()},
            "provenance": self.provenance,
        }
