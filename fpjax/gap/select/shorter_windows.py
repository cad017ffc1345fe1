"""Shorter windows: whether the motion of a machine with a shaft is followed better in windows half as long."""

from ..data.record import half_as_long
from ..fit.search import Search
from ..thresholds import THRESHOLDS
from .decision import Decision


def shorter(search: Search, decision: Decision) -> int:
    """Samples of the windows in which the logs are to be looked at again; 0 where these do.

    A shaft vibrates, and an impact in a backlash makes the next one: what a simulation has wrong at the start of a
    window or in one impact grows until its end, the more so while another cause is missing. Fits then end in a valley
    that leaves most of the missing torque. In a shorter window it grows less.

    Args:
        search: of the logs.
        decision: on its fits.
    """
    shaft = decision.chosen.fit.candidate.family.key[0] == "transmission"
    if not shaft or decision.chosen.left <= THRESHOLDS.closes:
        return 0
    return half_as_long(search.records, search.setting.inertia)


def follows_better(shorter: Decision, decision: Decision) -> bool:
    """Whether the causes that were found in shorter windows leave less, by what a further cause must remove.

    Both as a share of what the nominal model misses in the same windows: a torque slower than these shows in neither.

    Args:
        shorter: the decision in them.
        decision: in windows twice as long.
    """
    return shorter.chosen.left**2 < (1.0 - THRESHOLDS.removes) * decision.chosen.left**2
