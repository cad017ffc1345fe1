"""The result of `improve`: the predicted effect of other gains, as data; `improve.json` is its `to_dict`."""

from __future__ import annotations

import dataclasses
import math
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Literal

import numpy as np

from ..output.json_object import JsonObject

if TYPE_CHECKING:
    from ..gap import Diagnosis

ALIKE = 5e-3  # difference of two tracking errors, relative, that nobody would change gains for
SEVERAL = 2.0  # ratio of two tracking errors from which on it is told as a factor, not in per cent

Decision = Literal["change", "keep", "cannot_promise", "unstable"]


@dataclass(frozen=True)
class Range:
    """A predicted number with its 90 % interval.

    Attributes:
        value: median over the machines.
        low: 5 % quantile.
        high: 95 % quantile.
        unit: of all three.
    """

    value: float
    low: float
    high: float
    unit: str

    def to_dict(self) -> JsonObject:
        """All of it, by name."""
        return dataclasses.asdict(self)

    def __str__(self) -> str:
        unit = f" {self.unit}" if self.unit not in ("", "1") else ""
        return f"{self.value:.4g} ({self.low:.4g} to {self.high:.4g}){unit}"


@dataclass(frozen=True)
class Side:
    """The predicted behaviour with one set of gains.

    Attributes:
        gains: by their names in the file.
        error: rms of the tracking error over the reference, without the transient of its start.
        reversal: rms of the tracking error around reversals; None for a reference without reversals.
        torque: rms of the commanded torque.
        peak: largest commanded torque.
        headroom: torque limit over `peak` [1]; None where no limit is known.
        rough: size of the torque's second difference from sample to sample, a measure of noise in the torque.
        margins: "modulus", "gain", "phase", "delay" with their intervals; {} where the loop has no steady motion.
        unstable: share of the machines in which the loop is unstable [1].
    """

    gains: dict[str, float]
    error: Range
    reversal: Range | None
    torque: Range
    peak: Range
    headroom: Range | None
    rough: Range
    margins: dict[str, Range]
    unstable: float

    def rows(self) -> list[tuple[str, Range]]:
        """(quantity, value) for a table."""
        # quantities that the log's reference or model does not have (no reversals, no torque limit) get no row
        found = [("tracking error, rms", self.error)]
        found += [("tracking error at reversals, rms", self.reversal)] if self.reversal is not None else []
        found += [("torque, rms", self.torque), ("largest torque", self.peak)]
        found += [("limit over largest torque", self.headroom)] if self.headroom is not None else []
        found += [("roughness of the torque from sample to sample", self.rough)]
        return found + [(f"{name} margin", value) for name, value in self.margins.items()]

    def to_dict(self) -> JsonObject:
        """All of it, by name."""
        plain = {f.name: getattr(self, f.name) for f in dataclasses.fields(self)}
        for name in ("error", "reversal", "torque", "peak", "headroom", "rough"):
            plain[name] = None if plain[name] is None else plain[name].to_dict()
        return plain | {"margins": {name: value.to_dict() for name, value in self.margins.items()}}


@dataclass(frozen=True)
class Change:
    """One gain before and after.

    Attributes:
        gain: its name in the file.
        before: the file's value, in the gain's unit.
        after: the proposed value; the same where it is not changed.
        low: its lower bound.
        high: its upper bound.
        at: "low" or "high" where it ended at that bound, else "".
    """

    gain: str
    before: float
    after: float
    low: float
    high: float
    at: str = ""


@dataclass(frozen=True)
class NominalGains:
    """The gains that the same search finds in the nominal model alone, judged on the machines of the diagnosis.

    Attributes:
        gains: by their names in the file.
        ratio: error with them over error with the gains that the answer leaves (the proposed ones, else the file's),
            over the machines [1]; infinite where they are unstable.
        peak: largest commanded torque with them.
        allowed_peak: largest torque that gains may command [N m]; None where the drive's own limit holds it.
        rough: roughness of the torque with them, over the current gains' [1].
        allowed_rough: largest such roughness that is proposed [1].
        objection: what speaks against them besides their error, "need a torque of ..."; "" for nothing.
        proposed: whether they are the proposed gains.
    """

    gains: dict[str, float]
    ratio: Range
    peak: Range
    allowed_peak: float | None
    rough: Range
    allowed_rough: float
    objection: str
    proposed: bool = False

    @property
    def better(self) -> bool:
        """Whether they follow better than the gains that the answer leaves, in the median machine."""
        return self.ratio.value < 1.0

    def to_dict(self) -> JsonObject:
        """All of it, by name."""
        return dataclasses.asdict(self)

    def sentence(self) -> str:
        """How they follow on these machines, and why they are not proposed."""
        told = "The gains that are best in the nominal model alone"
        if self.proposed:
            return f"{told} are proposed: the search found none that are worth more on these machines."
        if not math.isfinite(self.ratio.value):
            return f"{told} make most of the machines unstable that the log leaves possible."
        ratio = self.ratio.value
        span = f"(error {self.ratio.low:.3g} to {self.ratio.high:.3g} times as large)"
        if abs(ratio - 1.0) < ALIKE:
            but = f", but {self.objection}" if self.objection else ""
            return f"{told} would follow as well on these machines {span}{but}."
        if ratio > SEVERAL:
            return f"{told} would follow with {ratio:.3g} times the error on these machines {span}."
        by = f"{abs(ratio - 1.0):.1%}"
        if not self.better:
            return f"{told} would follow {by} worse on these machines {span}."
        return f"{told} would follow {by} better {span}, but {self.objection or 'worse in the worst of the machines'}."


@dataclass(frozen=True)
class Answer:
    """The predicted effect of other gains, as data; `fpjax.improvement.Improvement` also prints and plots it.

    Attributes:
        decision: "change", "keep", "cannot_promise" (too little is known of the machine) or "unstable" (the corrected
            model is unstable with the gains that ran).
        reason: why, in one sentence.
        before: prediction with the file's gains, over the machines that the diagnosis leaves possible.
        after: prediction with the proposed gains; equal to `before` unless the decision is "change".
        found: prediction with the best gains of the search, also where they are not proposed; None without a search.
        changes: every gain that was free.
        wins: share of the judging machines in which `found` has a smaller error than the file's gains [1].
        ratio: error with `found` over error with the file's gains, over the machines.
        measured: rms of the tracking error in the log, corrected for sensor noise; None where the log does not show it
            or other gains made the log.
        model: the corrected model with the proposed gains as servo.toml text; "" where nothing is proposed or the file
            cannot hold the model.
        model_missing: why there is no such text.
        signal: "velocity" or "position", the quantity that is followed.
        verdict: of the diagnosis.
        causes: asserted by the diagnosis.
        machines: number of machines on which the gains were judged.
        tuned_on: number of (other) machines on which they were tuned.
        simulations: closed loops that the search ran.
        notes: sentences for the user.
        nominal: the gains of the nominal model alone, on these machines; None without a search.
        seconds: time by stage [s].
        diagnosis: the diagnosis that was used.
        runs: for the pictures: "time", "reference", and "before", "after", "found" of shape (3, samples): low, median
            and high of the tracking error.
        ratios: error with `found` over error with the file's gains in each machine, for the pictures.
    """

    decision: Decision
    reason: str
    before: Side
    after: Side
    found: Side | None
    changes: tuple[Change, ...]
    wins: float
    ratio: Range | None
    measured: float | None
    model: str
    model_missing: str
    signal: str
    verdict: str
    causes: tuple[str, ...]
    machines: int
    tuned_on: int
    simulations: int
    notes: tuple[str, ...]
    nominal: NominalGains | None = None
    seconds: dict[str, float] = field(default_factory=dict)
    diagnosis: Diagnosis | None = None
    runs: dict[str, np.ndarray] = field(default_factory=dict)
    ratios: np.ndarray | None = None

    @property
    def promised(self) -> bool:
        """Whether the intervals can be relied on; not of a log that is not explained, or a machine hardly known."""
        return self.verdict != "unexplained" and self.decision in ("change", "keep")

    def to_dict(self) -> JsonObject:
        """Numbers, strings, lists and dictionaries only; without the diagnosis and the pictures' arrays."""
        return {
            "decision": self.decision,
            "promised": self.promised,
            "reason": self.reason,
            "signal": self.signal,
            "before": self.before.to_dict(),
            "after": self.after.to_dict(),
            "found": None if self.found is None else self.found.to_dict(),
            "changes": [dataclasses.asdict(change) for change in self.changes],
            "wins": self.wins,
            "ratio": None if self.ratio is None else self.ratio.to_dict(),
            "measured": self.measured,
            "model": self.model,
            "model_missing": self.model_missing,
            "verdict": self.verdict,
            "causes": list(self.causes),
            "machines": self.machines,
            "tuned_on": self.tuned_on,
            "simulations": self.simulations,
            "notes": list(self.notes),
            "nominal": None if self.nominal is None else self.nominal.to_dict(),
            "seconds": {stage: round(spent, 3) for stage, spent in self.seconds.items()},
        }
