"""The verdict on a decision, with the sizes that it is based on: gap, covariance, courses, curves."""

from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace

import numpy as np

from ...logs.arrays import Values
from ..effects.twins import single_twins
from ..fit.candidate import NOMINAL, Fit, nominal_sizes
from ..fit.search import Search
from ..select.decision import Decision, by_numbers
from ..select.dominant import DominantVariable, dominant
from ..select.readings import ROUNDING, Reading, beside_gap
from ..select.shares import absent_friction
from ..select.statement import Seen, Verdict
from ..select.verdict import verdict
from ..select.weighed import CONTAINED, gap_share
from ..thresholds import THRESHOLDS, Thresholds
from .course import Course, course_of
from .curves import Curves, named_share
from .gap import Gap
from .gap_size import gap_of, noise_floor
from .insignificant import insignificant_causes
from .intervals import covariance
from .ranking import log_of
from .rounded import rounding_of


@dataclass(frozen=True)
class Read:
    """What is known of the logs independently of the fits.

    Attributes:
        torque: rms of the commanded torque [N m].
        readings: errors of the velocity column, in any order.
        allowed: effects that may be asserted; empty for all.
        contradicted: whether the logs contradict themselves or the model by more than any effect could.
        slight: of the readings, those that are no causes where anything else is amiss.
    """

    torque: float
    readings: Sequence[Reading]
    allowed: tuple[str, ...]
    contradicted: bool = False
    slight: frozenset[str] = frozenset()


@dataclass(frozen=True)
class Judged:
    """A decision and the verdict on it.

    Attributes:
        decision: the one that is reported: as it was found, or with the nominal numbers alone.
        verdict: on it.
        gap: before and after, on withheld windows.
        spread: covariance of the chosen model's free parameters.
        dominant_variable: the variable that the missing torque is mostly a function of; None where none stands out.
        before: course of the missing torque of the nominal model, one for each log.
        after: likewise, of the chosen model.
    """

    decision: Decision
    verdict: Verdict
    gap: Gap
    spread: Values
    dominant_variable: DominantVariable | None
    before: tuple[Course, ...]
    after: tuple[Course, ...]


def judge(search: Search, decision: Decision, read: Read, curves: Curves, unit: str) -> Judged:
    """The verdict.

    If effects beside wrong nominal numbers are not certain enough to assert, and the nominal numbers alone explain the
    gap or a part of it, the numbers are reported, unless an effect beside them makes them right: else they are wrong
    whichever effect stands beside them. So is friction that the nominal model has none of, on a machine that vibrates,
    if it explains what moves it.

    Args:
        search: of the logs.
        decision: on its fits.
        read: what is known independently of them.
        curves: share of the missing torque that a table of each recorded variable accounts for.
        unit: of the missing torque.
    """
    found = _judge(search, decision, read, curves, unit)
    wrong = decision.nominal.fit.candidate.wide
    if found.verdict.word != "unexplained" or not wrong:
        return found
    misread = {name for one in read.readings for name in (one.effect, one.rival)}
    absent = absent_friction(decision.exact)
    measures = ([False] if decision.chosen.structural else []) + ([True] if absent else [])
    for moving in measures:
        numbers = _judge(search, by_numbers(search, decision, moving=moving), read, curves, unit)
        if numbers.verdict.word not in ("explained", "partly_explained") or not _persist(numbers, decision):
            continue
        if not moving or _moves_without(absent, numbers, decision):
            return replace(numbers, verdict=_with_effects_behind(numbers.verdict, found.verdict, misread))
    return found


def _moves_without(absent: Collection[str], numbers: Judged, decision: Decision) -> bool:
    """Whether the numbers that are asserted are friction that the nominal model has none of, and no effect that is
    likelier takes more of what moves the machine.

    Args:
        absent: errors of such friction.
        numbers: what is asserted.
        decision: with the effects.
    """
    asserted = {name for name in numbers.verdict.causes if name.removesuffix("_error") in NOMINAL}
    windows = [np.arange(len(own)) for own in decision.exact.moving]
    likelier = numbers.decision.chosen.evidence
    effects = [w.fit for w in (decision.chosen, *decision.singles) if w.structural and w.evidence > likelier]
    least = min((_moved(decision.exact, fit, windows) for fit in effects), default=1.0)
    left = 1.0 - numbers.gap.closed_moving
    return asserted <= set(absent) and left**2 - least**2 <= THRESHOLDS.matters


def _with_effects_behind(numbers: Verdict, beside: Verdict, misread: Collection[str]) -> Verdict:
    """The numbers' verdict; behind them, in the room that they leave, the effects that stood beside them.

    Args:
        numbers: what is told.
        beside: the verdict that is not.
        misread: errors of the velocity column and what they may be instead: both verdicts have them.
    """
    known = {*numbers.main, *misread, *(f"{name}_error" for name in NOMINAL)}
    effects = {name: p for name, p in beside.among.items() if name not in known}
    room = max(1.0 - sum(numbers.main.values()), 0.0) / max(sum(effects.values()), 1.0)
    behind = {name: room * p for name, p in effects.items()}
    among = {name: max(p, numbers.among.get(name, 0.0)) for name, p in behind.items()}
    return replace(numbers, main={**numbers.main, **behind}, among={**numbers.among, **among})


def _persist(numbers: Judged, decision: Decision, t: Thresholds = THRESHOLDS) -> bool:
    """Whether the numbers that are asserted without an effect are wrong beside the likeliest effects too.

    Alone they bend after a law that none of them is (a Coulomb level after a Stribeck curve), to a bound at last.
    """
    given, alone, beside = (
        fit.candidate.values() for fit in (decision.exact, numbers.decision.chosen.fit, decision.chosen.fit)
    )
    asserted = {name.removesuffix("_error") for name in numbers.verdict.causes} & set(NOMINAL)
    bound = set(numbers.decision.chosen.fit.candidate.at_bound())
    return (
        bool(asserted)
        and not asserted & bound
        and all(
            (beside[name] - given[name]) * np.sign(alone[name] - given[name])
            >= t.persists * abs(alone[name] - given[name])
            for name in asserted
        )
    )


def _moved(before: Fit, after: Fit, windows: Sequence[Values]) -> float:
    """Missing torque of one fit over that of another [1], as far as it moves the machine, rms over windows."""
    first, then = (
        np.concatenate([m[w] for m, w in zip(fit.moving, windows, strict=True)]).sum() for fit in (before, after)
    )
    return float(np.sqrt(max(then, 0.0) / first)) if first > 0.0 else 1.0


def _withheld_shows(before: float, floor: float, closed: float) -> float:
    """Missing torque over all windows [N m], of which as much is closed beyond their noise as of the withheld ones.

    Args:
        before: of the nominal model [N m].
        floor: what noise alone would show [N m].
        closed: share closed on the withheld windows [1].
    """
    return min(floor, before) + (1.0 - closed) * max(before - floor, 0.0)


def _beside_gap(exact: Fit, read: Read, missing: float, rounded: float) -> dict[str, float]:
    """How large each error of the velocity column is beside the missing torque of the nominal model.

    Args:
        exact: the nominal model as given.
        read: what is known of the logs.
        missing: torque of that model [N m].
        rounded: missing torque that the velocity's rounding makes, where the machine is judged by that column [N m].
    """
    share = missing / max(read.torque, 1e-300)
    moving = float(np.sqrt(max(np.mean(np.concatenate(exact.moving)), 0.0)))
    found = {one.effect: beside_gap(one, share, moving) for one in read.readings}
    if ROUNDING in found and missing > 0.0:
        found[ROUNDING] = max(found[ROUNDING], (rounded / missing) ** 2)
    return found


def _meaning(search: Search, decision: Decision) -> dict[str, str]:
    """Rivals' effects that are the cause that they hold as a special case: a backlash whose gap may be none."""
    told, found = decision.chosen.structural, {}
    for general, special in CONTAINED.items():
        rivals = [w for w in (*decision.singles, *decision.rivals) if general in w.structural]
        if special not in told or general in told or not rivals:
            continue
        best = max(rivals, key=lambda w: w.gain).fit
        if general in insignificant_causes(search, best, covariance(search, best)):
            found[general] = special
    return found


def _alone(decision: Decision) -> list[Fit]:
    """The effects of the chosen model, each alone."""
    return [w.fit for w in decision.singles if w.structural[0] in decision.chosen.structural]


def _judge(search: Search, decision: Decision, read: Read, curves: Curves, unit: str) -> Judged:
    """The verdict on one decision, as it is."""
    gap, chosen = gap_of(search, decision, unit), decision.chosen.fit
    spread = covariance(search, chosen)
    logs = range(len(search.records))
    before = tuple(course_of(search, decision.exact, which) for which in logs)
    after = tuple(course_of(search, chosen, which) for which in logs)
    windows = [np.arange(len(record.starts)) for record in search.records]
    first, then = (fit.missing_rms(windows) for fit in (decision.exact, chosen))
    withheld = [np.flatnonzero(record.withheld) for record in search.records]
    moved = max(_moved(decision.exact, chosen, windows), _moved(decision.exact, chosen, withheld))
    gap = replace(gap, closed_moving=1.0 - moved)
    floor = noise_floor(search, windows)
    of_rounding, of_velocity = rounding_of(search, chosen, windows)
    seen = Seen(
        before=first,
        after=max(then, _withheld_shows(first, floor, gap.closed)),
        floor=floor,
        of_rounding=of_rounding,
        share=gap_share(search, decision.exact),
        sizes=nominal_sizes(search.setting),
        readings=tuple(one.effect for one in read.readings),
        misread=_beside_gap(decision.exact, read, first, of_velocity),
        slight=read.slight,
        rounded=max((one.size for one in read.readings if one.effect == ROUNDING), default=0.0),
        moved=moved,
        moved_by_numbers=_moved(decision.exact, decision.nominal.fit, windows),
        allowed=frozenset(read.allowed),
        doubts={one.effect: (one.rival, one.sure) for one in read.readings if one.rival},
        twins=single_twins(log_of(search)),
        unshown=insignificant_causes(search, chosen, spread),
        meaning=_meaning(search, decision),
        follows={effect.name: effect.follows for effect in search.effects},
        curves=curves.by,
        named=max(named_share(search, fit, curves) for fit in (chosen, *_alone(decision))),
        contradicted=read.contradicted,
    )
    variable = dominant(curves.by)
    if variable is not None:
        variable = replace(variable, named=float(np.clip(seen.named, 0.0, 1.0)))
    return Judged(decision, verdict(decision, seen), gap, spread, variable, before, after)
