"""Weighed: fits by what they are worth, each with the nominal numbers that it takes for wrong."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from ...logs.arrays import Values
from ..data.record import Record
from ..fit.candidate import Fit, nominal_sizes
from ..fit.search import Search
from ..thresholds import THRESHOLDS, Thresholds
from .detectability import resolved
from .dominant import Curve, believed
from .nominal_errors import wrong_numbers

SATURATION = "torque_saturation"
CONTAINED = {"backlash": "compliance"}
"""Effects that hold another one exactly, for one value of a parameter: a gap of zero."""


@dataclass(frozen=True)
class Weighed:
    """A fit with the nominal numbers that it takes for wrong.

    Attributes:
        fit: with those numbers wide.
        evidence: with the prior odds of the numbers [1].
        gain: evidence over the nominal model as given [1].
        left: missing torque, of that of the nominal model as given [1].
        believed: share of its worth that a dominant variable leaves it (`fpjax.gap.select.dominant`) [1].
    """

    fit: Fit
    evidence: float
    gain: float
    left: float
    believed: float = 1.0

    @property
    def worth(self) -> float:
        """By which models are compared: what they gain, times how far they shrink the missing torque (a logarithm).

        On a real machine no model is right. Evidence alone then goes to what follows the fast, small details best, and
        the missing torque alone to what is most flexible; among models that leave next to nothing, evidence decides.
        """
        left = np.clip(self.left, THRESHOLDS.no_better, THRESHOLDS.no_less)
        return self.believed * max(self.gain, 0.0) * float(np.log(1.0 / left))

    def behind(self, chosen: "Weighed") -> float:
        """By how much its worth is less than the chosen model's, in such nats as that one gains."""
        return max(chosen.gain, 0.0) * (1.0 - self.worth / max(chosen.worth, 1e-300))

    @property
    def structural(self) -> tuple[str, ...]:
        """The effects, without wrong nominal numbers."""
        return self.fit.candidate.structural


@dataclass(frozen=True)
class Exact:
    """What every model is weighed against.

    Attributes:
        fit: the nominal model as given.
        judged: windows on which models are compared, one array of indices a record.
        curves: what a table of each recorded variable holds.
        moving: whether missing torque counts as far as it moves the machine alone.
    """

    fit: Fit
    judged: tuple[Values, ...]
    curves: Mapping[str, Curve] = field(default_factory=dict)
    moving: bool = False

    def left(self, fit: Fit) -> float:
        """Missing torque of a model [N m], rms over the judged windows."""
        return fit.missing_rms(self.judged, moving=self.moving)


def judged_windows(
    exact: Fit, fits: Sequence[Fit], moving: Sequence[Values], t: Thresholds = THRESHOLDS
) -> tuple[Values, ...]:
    """All windows but the few in which every model leaves far more missing torque than elsewhere, and takes little.

    A push that nobody recorded can hold most of a log's energy. What a model shrinks of the rest would not show in the
    rms of all. Where they are not few, they are what the log shows.

    Args:
        exact: the nominal model as given.
        fits: models that were tried.
        moving: whether the machine moves in a window, one array (windows,) a record.
        t: thresholds.
    """
    whole = [np.maximum(own, 0.0) for own in exact.missing]
    least = [np.min([fit.missing[which] for fit in fits], axis=0) for which in range(len(whole))]

    def in_motion(values: Sequence[Values]) -> Values:
        # Of windows at rest the median would be next to nothing, and all motion a push.
        return np.concatenate([own[some] for own, some in zip(values, moving, strict=True)])

    usual, mean = float(np.median(in_motion(least))), float(np.mean(in_motion(whole)))
    kept = [
        (low <= t.gross**2 * max(usual, 0.0)) | (low < t.part**2 * own) | (own < mean)
        for own, low in zip(whole, least, strict=True)
    ]
    left_out, count = sum(int(np.sum(~own)) for own in kept), sum(int(np.sum(some)) for some in moving)
    if left_out > t.few * count:
        kept = [np.ones(len(own), bool) for own in kept]
    return tuple(np.flatnonzero(own) for own in kept)


def moving_windows(records: Sequence[Record], t: Thresholds = THRESHOLDS) -> list[Values]:
    """Whether the machine moves in each window, faster than a share of the fastest window's rms speed."""
    speeds = [np.sqrt(np.mean(record.speed[record.rows()] ** 2, axis=1)) for record in records]
    fastest = max((float(np.max(own)) for own in speeds if len(own)), default=0.0)
    return [own >= t.moves * fastest for own in speeds]


def weigh(search: Search, exact: Exact, fits: Sequence[Fit]) -> list[Weighed]:
    """The fits by their worth, each with the nominal numbers that it needs."""
    sizes = nominal_sizes(search.setting)
    found = [weighed_fit(search, exact, fit, wrong_numbers(fit, sizes)[0]) for fit in fits]
    # An effect that the log does not resolve goes behind the model of the nominal numbers alone, whatever it absorbs:
    # one nat less of evidence, and at least as much missing torque.
    plain = max((w.evidence for w in found if not w.structural), default=exact.fit.evidence)
    most = max((w.left for w in found if not w.structural), default=1.0)
    found = [
        w if resolved(search, w.fit) else replace(w, evidence=min(w.evidence, plain - 1.0), left=max(w.left, most))
        for w in found
    ]
    found = [w if resolved(search, w.fit) else replace(w, gain=w.evidence - exact.fit.evidence) for w in found]
    found = sorted(found, key=lambda w: (-w.worth, -w.evidence))
    best: dict[tuple[str, ...], Weighed] = {}  # of the same effects with more and with fewer wrong numbers
    for weighed in found:
        best.setdefault(weighed.structural, weighed)
    return sorted(no_better_than_contained(list(best.values())), key=lambda w: (-w.worth, -w.evidence))


def no_better_than_contained(found: Sequence[Weighed]) -> list[Weighed]:
    """The models; one that is less likely than another that it contains leaves no less torque than that one.

    It has not found its best, and what it leaves less is chance: a backlash that is less likely than its compliance.
    """
    by_names = {frozenset(w.structural): w for w in found}
    kept = []
    for w in found:
        for general, special in CONTAINED.items():
            names = frozenset(special if name == general else name for name in w.structural)
            other = by_names.get(names) if general in w.structural else None
            if other is not None and other.evidence > w.evidence:
                w = replace(w, left=max(w.left, other.left), gain=min(w.gain, other.gain))
        kept.append(w)
    return kept


def weighed_fit(search: Search, exact: Exact, fit: Fit, evidence: float) -> Weighed:
    """A fit with its evidence and prior odds of its wrong numbers [nats], and what it leaves of the missing torque."""
    whole = exact.left(exact.fit)
    left = exact.left(fit) / whole if whole > 0.0 else 1.0  # where the nominal model misses nothing, nothing is taken
    # Wrong numbers follow none: every model has them.
    follows = {variable for effect in fit.candidate.effects for variable in effect.follows}
    share = believed(exact.curves, follows) if fit.candidate.effects else 1.0
    return Weighed(fit, evidence, evidence - exact.fit.evidence, left, share)


def gap_share(search: Search, exact: Fit) -> float:
    """Missing torque of the nominal model over the commanded one [1], each rms over the log where that is the most."""
    return max(
        float(np.sqrt(max(np.mean(missing), 0.0) / max(np.mean(record.torque**2), 1e-300)))
        for missing, record in zip(exact.missing, search.records, strict=True)
    )


def whole_gap(search: Search, exact: Exact, fit: Fit) -> float:
    """The missing torque that a model's causes are shares of [N m]: all that the nominal model as given misses.

    Where the model limits the torque, no more than what that leaves of the commanded one: what a drive is asked for and
    cannot give is missing to a model without a limit, and would hide all that is missing beside it. A limit that leaves
    more than the drive gives then explains nothing.

    Args:
        search: of the logs.
        exact: what models are weighed against.
        fit: of the model.
    """
    c, whole = fit.candidate, exact.left(exact.fit)
    if SATURATION not in c.structural:
        return whole
    judged = zip(search.records, exact.judged, strict=True)
    commanded = np.concatenate([record.torque[record.rows(windows)] for record, windows in judged])
    values = c.values()
    gain = values.get("gain", float(np.asarray(c.family.machine.actuator.gain)))
    given = np.clip(gain * commanded, -values["limit"], values["limit"])
    most = float(np.sqrt(np.mean(given**2)))
    return min(whole, most)


def settled(search: Search, exact: Exact, weighed: Weighed) -> Weighed:
    """The same effects fitted once more with only those nominal numbers wide that are wrong."""
    evidence, wrong = wrong_numbers(weighed.fit, nominal_sizes(search.setting))
    if set(wrong) == set(weighed.fit.candidate.wide):
        return weighed
    fit = search.refit(weighed.fit, wrong)
    return weighed_fit(search, exact, fit, max(evidence, wrong_numbers(fit, nominal_sizes(search.setting))[0]))


def first_settled(search: Search, exact: Exact, ordered: Sequence[Weighed]) -> Weighed:
    """The likeliest of some models that is still resolved once only its wrong numbers are wide."""
    for weighed in ordered:
        again = settled(search, exact, weighed)
        if again is weighed or resolved(search, again.fit):
            return again
    return ordered[0]
