"""Late torque: whether the torque column is recorded later than the torque acted."""

from collections.abc import Mapping

import numpy as np

from ..effects.always import LATE_TORQUE
from ..fit.candidate import NOMINAL, Fit, Start
from ..fit.search import Search
from ..thresholds import THRESHOLDS
from .decision import Decision
from .weighed import Exact

(DELAY,) = (parameter.name for parameter in LATE_TORQUE.parameters)


def late_torque(search: Search, decision: Decision) -> float:
    """By how much the torque is recorded later than it acted [s]; 0 where no such delay is sure.

    A current that the drive measures is filtered before it is logged, and of some logs each row holds the torque of the
    row before. The machine then answers before it is asked to, which no cause of the vocabulary makes. Tried beside the
    chosen ones, a dead time below zero must take more than half of what they leave: on a real machine, whose laws
    nobody knows, it bends some of it. What is recorded late was no later on the machine, so that the column is mended
    and the diagnosis made again (`fpjax.gap.verb`).

    Args:
        search: of the logs.
        decision: on its fits.
    """
    c, given = decision.chosen.fit.candidate, decision.exact.candidate.values()
    held = {parameter.name for effect in c.effects for parameter in effect.parameters}
    # Beside a dead time of the actuator, of the nominal model or fitted, the two would be one number.
    if given.get(DELAY) != 0.0 or DELAY in held:
        return 0.0
    exact = Exact(decision.exact, decision.judged)
    left, torque = exact.left(decision.chosen.fit), np.concatenate([record.torque for record in search.records])
    if left < THRESHOLDS.nothing * float(np.sqrt(np.mean(torque**2))):
        return 0.0
    # Also without the chosen causes, which may stand for it alone.
    starts = [
        Start((*effects, LATE_TORQUE), wide, like.values() | start, like)
        for effects, wide, like in ((c.effects, tuple(c.wide), c), ((), NOMINAL, search.base))
        for start in LATE_TORQUE.starts(search.setting)
    ]
    best = max(search.fitted(starts), key=lambda fit: fit.evidence)
    # A nat for each nominal number that is free, as `settled` counts them.
    gain = best.evidence - len(best.candidate.wide) - decision.chosen.evidence
    taken = exact.left(best) < THRESHOLDS.part * left and _in_every_log(best, decision.chosen.fit)
    if not taken or gain <= THRESHOLDS.decisive or DELAY in best.candidate.at_bound():
        return 0.0
    return -best.candidate.values()[DELAY]


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


def least_missing(searches: Mapping[float, Search], decision: Decision) -> float:
    """The key of the search in whose logs the chosen causes, or none, leave the least torque missing.

    Args:
        searches: of the same logs, with the torque as it may have acted.
        decision: on fits of the logs as recorded.
    """
    c = decision.chosen.fit.candidate
    starts = [Start(c.effects, tuple(c.wide), c.values()), Start((), NOMINAL, {})]

    def left(search: Search) -> float:
        # Not by evidence: each search has measured the noise anew.
        windows = [np.arange(len(record.starts)) for record in search.records]
        return min(fit.missing_rms(windows) for fit in search.fitted(starts))

    missing = {key: left(search) for key, search in searches.items()}
    return min(missing, key=lambda key: missing[key])
