"""Improvement: what would change with other gains, as data; `improve.json` is its `to_dict`."""

from __future__ import annotations

import dataclasses
import math
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from ..output.json_object import JsonObject

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from ..gap import Diagnosis

Decision = Literal["change", "keep", "cannot_promise", "unstable"]


@dataclass(frozen=True)
class Range:
    """A predicted number with its 90 % interval.

    Attributes:
        value: median over the machines.
        low: 5 %.
        high: 95 %.
        unit: of the three.
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


_UNKNOWN = Range(math.nan, math.nan, math.nan, "")


@dataclass(frozen=True)
class Side:
    """What one set of gains comes to.

    Attributes:
        gains: by the file's words.
        error: rms of the tracking error over the whole reference.
        reversal: rms while the machine turns round; None for a reference that never does.
        torque: rms of the commanded torque.
        peak: largest commanded torque.
        headroom: limit of the torque over `peak` [1]; None where no limit is known.
        rough: size of the torque's second difference from sample to sample: what noise does to it.
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
        gain: as the file has it.
        before: in its unit.
        after: likewise; the same where it stays.
        low: of its bounds.
        high: likewise.
        at: "low" or "high" where it ended at that bound, else "".
    """

    gain: str
    before: float
    after: float
    low: float
    high: float
    at: str = ""


@dataclass(frozen=True)
class Improvement:
    """What would change with other gains.

    Attributes:
        decision: "change", "keep", "cannot_promise" (what is known of the machine is too little) or "unstable" (the
            corrected model is, with the gains that ran).
        reason: why, in one sentence.
        before: the file's gains around the machines that the diagnosis leaves possible.
        after: the proposed ones; the file's own unless the decision is "change".
        found: the best that the search saw, also where it is not proposed; None where nothing was searched.
        changes: every gain that was free.
        wins: share of the machines, drawn anew, in which `found` follows better than the file's gains [1].
        ratio: error with `found` over error with the file's gains, machine by machine.
        measured: rms of the tracking error in the log, its noise taken out; None where the log does not show it or
            other gains made it.
        model: the corrected model with the proposed gains as servo.toml text; "" where nothing is proposed or the file
            has no words for it.
        model_missing: why there is no such text.
        signal: "velocity" or "position": what is followed.
        verdict: of the diagnosis.
        causes: likewise.
        machines: samples that the gains were judged on.
        tuned_on: samples that they were tuned on, others.
        simulations: closed loops that the search ran.
        notes: sentences.
        seconds: by stage [s].
        diagnosis: that it stands on.
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
    seconds: dict[str, float] = field(default_factory=dict)
    diagnosis: Diagnosis | None = None
    runs: dict[str, np.ndarray] = field(default_factory=dict)
    ratios: np.ndarray | None = None

    @property
    def promised(self) -> bool:
        """Whether the intervals are a promise: of a log that the diagnosis does not explain they are none."""
        return self.verdict != "unexplained"

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
            "seconds": {stage: round(spent, 3) for stage, spent in self.seconds.items()},
        }

    def __str__(self) -> str:
        from .told import told

        return told(self)

    __repr__ = __str__

    def plot(self, path: str | Path | None = None) -> Figure:
        """Tracking error before and after, and how sure the change is.

        Args:
            path: picture file to write; None to write none.

        Raises:
            InputError: where the file cannot be written.
        """
        from ..output.plotting import saved
        from .pictures import draw_overview

        return saved(draw_overview(self), path)

    def to_dataframe(self) -> Any:
        """What is predicted as a `pandas.DataFrame`, the quantity as its index.

        Columns: unit, and of each of before, after and found (where something was searched) its value, low and high
        (90 % interval): before, before_low, before_high, after, ... A quantity that a side lacks is NaN.

        Raises:
            InputError: where pandas is not installed.
        """
        from ..output.frames import to_frame

        sides = {name: dict(side.rows()) for name in ("before", "after", "found") if (side := getattr(self, name))}
        units = {quantity: value.unit for rows in sides.values() for quantity, value in rows.items()}
        columns: dict[str, list[Any]] = {"unit": list(units.values())}
        for name, rows in sides.items():
            found = [rows.get(quantity, _UNKNOWN) for quantity in units]
            columns |= {
                name: [each.value for each in found],
                f"{name}_low": [each.low for each in found],
                f"{name}_high": [each.high for each in found],
            }
        return to_frame(columns, list(units), "quantity")

    def report(self, path: str | Path) -> Path:
        """Write `improve.html`, one self-contained page, and the pictures as PNG.

        Args:
            path: the folder; it is made.

        Returns:
            The path of the page.
        """
        from .page import write_page

        return write_page(self, Path(path))
