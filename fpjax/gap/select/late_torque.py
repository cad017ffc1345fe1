"""Late torque: whether the torque column is recorded later than the torque acted."""

from collections.abc import Mapping, Sequence
from typing import TypeVar

import numpy as np

from ..effects.always import LATE_TORQUE
from ..fit.candidate import NOMINAL, Fit, Start
from ..fit.search import Search
from ..thresholds import THRESHOLDS
from .decision import Alone, Decision
from .detectability import resolved
from .weighed import Exact, judged_windows, moving_windows

Key = TypeVar("Key")
(DELAY,) = (parameter.name for parameter in LATE_TORQUE.parameters)


def late_beside_numbers(search: Search, first: Alone) -> float:
    """By how much the torque is recorded later than it acted [s], before a cause is chosen; 0 where that is unsure.

    A measured current is that of a moment and not of the row for which it is taken, so that it is half a row late; one
    that the drive filters is later, and of some logs each row holds the torque of the row before. The machine then
    answers before it is asked to, which no cause of the vocabulary makes. Some take much of it nevertheless (a shaft
    lets the motor turn before its load does), and it takes much of them. Beside the numbers alone a dead time below
    zero must take what a further cause would have to, and bring most of what the likeliest effect brings. What is
    recorded late was no later on the machine, so that the column is mended (`fpjax.gap.verb`).

    Args:
        search: of the logs.
        first: its fits of the numbers and of every effect alone.
    """
    numbers = max((fit for fit in first.fits if not fit.candidate.structural), key=lambda fit: fit.evidence)
    exact = Exact(first.given, judged_windows(first.given, first.fits, moving_windows(search.records)))
    late = _late(search, exact, numbers, numbers.evidence - len(NOMINAL), [], 1.0 - THRESHOLDS.removes)
    if late is None:
        return 0.0
    rivals = [fit.evidence for fit in first.fits if fit.candidate.structural and resolved(search, fit)]
    brings = max(rivals, default=-np.inf) - numbers.evidence
    return _delay(late) if late.evidence - numbers.evidence > THRESHOLDS.stands_in * brings else 0.0


def late_torque(search: Search, decision: Decision) -> float:
    """By how much the torque is recorded later than it acted [s], beside the causes that were chosen; 0 for unsure.

    A dead time below zero must take more than half of what they leave: on a real machine, whose laws nobody knows, it
    bends some of it. The diagnosis is made again then.

    Args:
        search: of the logs.
        decision: on its fits.
    """
    c, exact = decision.chosen.fit.candidate, Exact(decision.exact, decision.judged)
    beside = [Start((*c.effects, LATE_TORQUE), tuple(c.wide), {**c.values(), **one}, c) for one in _late_by(search)]
    chosen = decision.chosen.fit
    late = _late(search, exact, chosen, chosen.evidence - len(chosen.candidate.wide), beside, THRESHOLDS.part**2)
    return 0.0 if late is None else _delay(late)


def _late_by(search: Search) -> Sequence[Mapping[str, float]]:
    """Start values of a late torque."""
    return LATE_TORQUE.starts(search.setting)


def _late(search: Search, exact: Exact, fit: Fit, evidence: float, beside: Sequence[Start], most: float) -> Fit | None:
    """A fit with a late torque: beside what is chosen, or beside the numbers alone, for which causes may only stand.

    Args:
        search: of the logs.
        exact: what models are weighed against.
        fit: with what is chosen so far.
        evidence: of it, less a nat for each nominal number that is free, as `best` below is counted [nats].
        beside: starts of it with a late torque.
        most: share of its missing energy that may be left [1].
    """
    held = {parameter.name for effect in fit.candidate.effects for parameter in effect.parameters}
    # Beside a dead time of the actuator, of the nominal model or fitted, the two would be one number.
    if exact.fit.candidate.values().get(DELAY) != 0.0 or DELAY in held:
        return None
    left, torque = exact.left(fit), np.concatenate([record.torque for record in search.records])
    if left < THRESHOLDS.nothing * float(np.sqrt(np.mean(torque**2))):
        return None
    without = [Start((LATE_TORQUE,), NOMINAL, {**search.base.values(), **one}, search.base) for one in _late_by(search)]
    best = max(search.fitted([*beside, *without]), key=lambda one: one.evidence)
    gain = best.evidence - len(best.candidate.wide) - evidence
    taken = exact.left(best) ** 2 < most * left**2 and _in_every_log(best, fit)
    if not taken or gain <= THRESHOLDS.decisive or DELAY in best.candidate.at_bound():
        return None
    return best


def _delay(late: Fit) -> float:
    """How late the torque of a fit is [s]."""
    return -late.candidate.values()[DELAY]


def _in_every_log(best: Fit, chosen: Fit) -> bool:
    """Whether no log has more torque missing for it: logs of which one alone is late are left as they are."""
    return all(np.mean(late) <= np.mean(now) for late, now in zip(best.missing, chosen.missing, strict=True))


def lags(late: float, dt: float) -> list[float]:
    """How much of the time by which a torque is recorded late [s] a filter may have made, and no dead time [s].

    None, all of it, or all but a row: a drive that reads its filter before it commands logs it a row later.

    Args:
        late: as `late_torque` gives it.
        dt: of the log [s].
    """
    return [0.0, late, *([late - dt] if late > dt else [])]


def least_missing(searches: Mapping[Key, Search], chosen: Fit | None) -> Key:
    """The key of the search in whose logs the chosen causes, or none, leave the least torque missing.

    Args:
        searches: of the same logs, with a column as it may have been.
        chosen: the causes' fit to the logs as recorded; None before any was chosen.
    """
    starts = [Start((), NOMINAL, {})]
    if chosen is not None:
        c = chosen.candidate
        starts = [Start(c.effects, tuple(c.wide), c.values()), *starts]

    def left(search: Search) -> float:
        # Not by evidence: each search has measured the noise anew.
        windows = [np.arange(len(record.starts)) for record in search.records]
        return min(fit.missing_rms(windows) for fit in search.fitted(starts))

    missing = {key: left(search) for key, search in searches.items()}
    return min(missing, key=lambda key: missing[key])
