"""What a report tells, read once from a diagnosis: the contract's answer, and what else the diagnosis holds.

Whatever a diagnosis does not hold (a position channel, intervals, a noise floor, provenance ...) is left out: a report
without it says less, not something else.
"""

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from ...errors import InputError
from ..diagnosis import Comparison, Diagnosis, Identifiability, Ranked, Share, Tracking, Where
from .digits import Estimate, as_estimate, as_number, scale_for, scaled

AXES = ("time", "velocity", "position", "frequency")
VERDICTS = ("no_gap", "explained", "unexplained")


@dataclass(frozen=True)
class Candidate:
    """One effect of the ranking.

    Attributes:
        effect: its name in the contract.
        probability: that it is what the log shows, 0 to 1.
        gap_after: the gap that it leaves on withheld data.
        parameters: what was found, by name.
        twins: effects that this log cannot tell from it.
        at_bound: parameters whose fit ended at the end of what was allowed.
        cause: probability that it is among the causes, the main one or a companion; NaN where not
            known.
    """

    effect: str
    probability: float
    gap_after: Estimate
    parameters: dict[str, Estimate]
    twins: tuple[str, ...]
    at_bound: tuple[str, ...] = ()
    cause: float = math.nan


@dataclass(frozen=True)
class Step:
    """The gap after one more cause.

    Attributes:
        added: the effect.
        gap: what is left of the gap.
    """

    added: str
    gap: Estimate


@dataclass(frozen=True)
class Place:
    """A stretch of one axis and its share of the gap's energy.

    Attributes:
        low: where it begins.
        high: where it ends.
        share: 0 to 1.
        even: the share it would have were the gap spread evenly over the record; NaN where not known.
    """

    low: float
    high: float
    share: float
    even: float = math.nan


@dataclass(frozen=True)
class Left:
    """Where what the corrected model leaves lies.

    Attributes:
        where: the places that stand out, by axis.
        maps: the same with every bin.
        regimes: share of its energy by regime.
    """

    where: dict[str, tuple[Place, ...]]
    maps: dict[str, tuple[Place, ...]]
    regimes: dict[str, float]


@dataclass(frozen=True)
class Series:
    """The withheld part of one log.

    Attributes:
        label: the log's name.
        time: s, shape (samples,).
        measured: the gap's signal as recorded, shape (samples,).
        before: the same from the nominal model, or None.
        after: the same from the corrected model, or None.
        starts: indices at which a new window or block begins: no line is to cross them.
    """

    label: str
    time: np.ndarray
    measured: np.ndarray
    before: np.ndarray | None
    after: np.ndarray | None
    starts: np.ndarray


@dataclass(frozen=True)
class Fixing:
    """How well the log fixes one parameter.

    Attributes:
        parameter: its name.
        estimate: value and 90 % interval.
        state: "pinned", "traded off with ...", "flat", "at a bound".
    """

    parameter: str
    estimate: Estimate
    state: str


@dataclass(frozen=True)
class Contents:
    """All that a report tells.

    Attributes:
        verdict: no_gap, explained or unexplained.
        causes: effects asserted, most important first.
        confidence: probability that the verdict is right, NaN where it is not known.
        ranking: every candidate, most probable first.
        signal: what the gap is measured in, such as `velocity`.
        unit: its unit.
        before: the nominal model's gap on withheld data.
        after: the corrected model's.
        floor: what a perfect model would leave.
        closed: share of the closable gap that is closed.
        steps: the gap as each cause is added.
        where: the places that stand out, by axis.
        maps: the same with every bin, where the diagnosis has it.
        regimes: share of the gap's energy by regime.
        left: where what the corrected model leaves lies; None where nothing is left to place.
        residual: one-step torque residual [N m], shape (samples,), or None.
        residual_axes: `time`, `velocity`, `position` of each sample of it, where known.
        experiments: what would tell the classes apart: effects and what to do.
        model: the corrected model as servo.toml text.
        nominal: the nominal one, "" where it is not known.
        warnings: sentences.
        identifiability: how well the log fixes each parameter.
        tracking: closed-loop tracking error `measured`, `before`, `after`; empty where not known.
        provenance: command, inputs, versions, times, seeds.
        seconds: time spent by stage [s].
        series: the withheld part of each log.
        motion: rotary or linear.
        allowed: effects that were tried, where the vocabulary was restricted; empty for all of it.
        model_missing: why there is no corrected model, "" where there is one.
        same_as: exact twins of the causes, a sentence each.
    """

    verdict: str
    causes: tuple[str, ...]
    confidence: float
    ranking: tuple[Candidate, ...]
    signal: str
    unit: str
    before: Estimate
    after: Estimate
    floor: Estimate
    closed: Estimate
    steps: tuple[Step, ...] = ()
    where: dict[str, tuple[Place, ...]] = field(default_factory=dict)
    maps: dict[str, tuple[Place, ...]] = field(default_factory=dict)
    regimes: dict[str, float] = field(default_factory=dict)
    left: Left | None = None
    residual: np.ndarray | None = None
    residual_axes: dict[str, np.ndarray] = field(default_factory=dict)
    experiments: tuple[tuple[tuple[str, ...], str], ...] = ()
    model: str = ""
    nominal: str = ""
    warnings: tuple[str, ...] = ()
    identifiability: tuple[Fixing, ...] = ()
    tracking: dict[str, Estimate] = field(default_factory=dict)
    provenance: dict[str, Any] = field(default_factory=dict)
    seconds: dict[str, float] = field(default_factory=dict)
    series: tuple[Series, ...] = ()
    motion: str = "rotary"
    allowed: tuple[str, ...] = ()
    model_missing: str = ""
    same_as: tuple[str, ...] = ()

    def readable(self, gap: Estimate) -> Estimate:
        """A gap in the one unit that suits them all: that in which the nominal model's reads best."""
        return scaled(gap, *self.scale)

    @property
    def scale(self) -> tuple[float, str]:
        """Factor and unit in which gaps are shown."""
        return scale_for(self.before.value, self.unit)

    def twins_of(self, effect: str) -> tuple[str, ...]:
        """Effects that this log cannot tell from the given one."""
        return next((c.twins for c in self.ranking if c.effect == effect), ())

    def classes(self) -> list[tuple[str, ...]]:
        """The classes of effects that this log cannot tell apart, the most probable first.

        "Cannot tell apart" is followed from effect to effect: what is joined by a chain is one class. Classes whose
        probability is negligible are left out, unless a cause is in them.
        """
        groups: list[set[str]] = []
        for candidate in self.ranking:
            if not candidate.twins or (candidate.probability < 0.005 and candidate.effect not in self.causes):
                continue
            joined = {candidate.effect, *candidate.twins}
            for group in [g for g in groups if g & joined]:
                joined |= group
                groups.remove(group)
            groups.append(joined)
        order = {c.effect: i for i, c in enumerate(self.ranking)}
        places = [tuple(sorted(g, key=lambda e: (order.get(e, len(order)), e))) for g in groups]
        return sorted(places, key=lambda group: order.get(group[0], len(order)))


def read(diagnosis: Diagnosis) -> Contents:
    """What a report tells of a diagnosis; numbers are those of `diagnosis.to_dict()`, the contract.

    Args:
        diagnosis: what `fpjax.gap.diagnose` found.

    Raises:
        InputError: the verdict is none of the contract's three.
    """
    answer = diagnosis.to_dict()
    if answer["verdict"] not in VERDICTS:
        raise InputError(f"The diagnosis' verdict is {answer['verdict']!r}; a report knows {', '.join(VERDICTS)}.")
    gap, where = answer["gap"], answer["where"]
    unit = str(gap["unit"])
    intervals = gap.get("interval", {})
    ranking = tuple(
        _candidate(entry, found, unit) for entry, found in zip(answer["ranking"], diagnosis.ranking, strict=True)
    )
    causes = tuple(answer["causes"])
    return Contents(
        verdict=answer["verdict"],
        causes=causes,
        # a diagnosis that does not say it leaves it to the ranking
        confidence=diagnosis.probability or _confidence(answer["verdict"], causes, ranking),
        ranking=ranking,
        signal=str(gap["signal"]),
        unit=unit,
        before=as_estimate(gap["before"], unit, intervals.get("before")),
        after=as_estimate(gap["after"], unit, intervals.get("after")),
        floor=as_estimate(gap["noise_floor"], unit, intervals.get("noise_floor")),
        closed=as_estimate(gap["closed"], "", intervals.get("closed")),
        steps=tuple(Step(s["added"], as_estimate(s["gap_after"], unit, s.get("interval"))) for s in answer["steps"]),
        where={axis: _places(getattr(diagnosis.where, axis)) for axis in AXES},
        maps={axis: _places(diagnosis.where.maps.get(axis, ())) for axis in AXES},
        regimes={str(k): as_number(v) for k, v in where["regime"].items()},
        left=_left(diagnosis.residual_where),
        residual=diagnosis.where.residual,
        residual_axes=dict(diagnosis.where.axes),
        experiments=tuple((tuple(e["separates"]), str(e["do"])) for e in answer["next_experiment"]),
        model=answer["model"],
        nominal=diagnosis.nominal,
        warnings=tuple(answer["warnings"]),
        identifiability=tuple(map(_fixing, diagnosis.identifiability)),
        tracking=_tracking(diagnosis.tracking),
        provenance=dict(diagnosis.provenance),
        seconds=dict(diagnosis.seconds),
        series=tuple(filter(None, (_series(c, str(gap["signal"])) for c in diagnosis.comparisons))),
        motion=diagnosis.motion,
        allowed=diagnosis.allowed,
        model_missing=diagnosis.model_missing,
        same_as=diagnosis.same_as,
    )


def _candidate(entry: Mapping[str, Any], found: Ranked, unit: str) -> Candidate:
    return Candidate(
        effect=str(entry["effect"]),
        probability=as_number(entry["probability"]),
        gap_after=as_estimate(entry["gap_after"], unit),
        parameters={str(k): as_estimate(v) for k, v in entry["parameters"].items()},
        twins=tuple(entry["indistinguishable_from"]),
        at_bound=tuple(str(name) for name, estimate in found.parameters.items() if estimate.at_bound),
        cause=found.cause_probability,
    )


def _places(shares: Iterable[Share]) -> tuple[Place, ...]:
    shares = tuple(shares)
    even = any(share.expected > 0.0 for share in shares)
    found = [Place(s.start, s.stop, s.share, s.expected if even else math.nan) for s in shares]
    found = [p for p in found if all(map(math.isfinite, (p.low, p.high, p.share)))]
    return tuple(sorted(found, key=lambda place: place.low))


def _left(found: Where | None) -> Left | None:
    if found is None:
        return None
    return Left(
        where={axis: _places(getattr(found, axis)) for axis in AXES},
        maps={axis: _places(found.maps.get(axis, ())) for axis in AXES},
        regimes={str(k): as_number(v) for k, v in found.regime.items()},
    )


def _series(comparison: Comparison, signal: str) -> Series | None:
    """The withheld part of one log; None where it has none, or speaks of another signal."""
    withheld = np.asarray(comparison.withheld, bool)
    if comparison.signal != signal or np.count_nonzero(withheld) < 2:
        return None
    time = np.asarray(comparison.time, float)[withheld]
    parts = [np.asarray(part, float)[withheld] for part in (comparison.measured, comparison.before, comparison.after)]
    known = [part if np.isfinite(part).any() else None for part in parts]
    if known[0] is None:
        return None
    # a line must not join what two windows, or two withheld blocks, have left
    window = np.asarray(comparison.window)[withheld]
    step = np.median(np.diff(time))
    starts = np.flatnonzero((np.diff(window) != 0) | (np.diff(time) > 2.5 * step)) + 1
    return Series(comparison.name, time, known[0], known[1], known[2], starts)


def _fixing(found: Identifiability) -> Fixing:
    # 1.645 standard deviations: the 90 % that every interval of a diagnosis has. At a bound there is none: it counts as
    # known there, and an interval of no width would look like certainty.
    deviation = found.standard_deviation
    half = 1.645 * deviation if math.isfinite(deviation) and deviation > 0.0 else math.nan
    estimate = Estimate(found.value, found.value - half, found.value + half, found.unit)
    return Fixing(found.parameter, estimate, found.verdict)


def _tracking(found: Tracking | None) -> dict[str, Estimate]:
    if found is None:
        return {}
    pairs = (("measured", found.measured), ("before", found.before), ("after", found.after))
    return {name: Estimate(value, unit=found.unit) for name, value in pairs if math.isfinite(value)}


def _confidence(verdict: str, causes: tuple[str, ...], ranking: tuple[Candidate, ...]) -> float:
    """The probability that the verdict states: that of the causes' classes, or what is left for "none of these"."""
    known = [c for c in ranking if math.isfinite(c.probability)]
    if not known:
        return math.nan
    if verdict == "explained":
        stated = set(causes).union(*(c.twins for c in known if c.effect in causes))
        return min(sum(c.probability for c in known if c.effect in stated), 1.0)
    return min(max(1.0 - sum(c.probability for c in known), 0.0), 1.0)
