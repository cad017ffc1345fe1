"""Resolved: whether a log can show an effect at the values where its fit ended."""

import numpy as np

from ..effects.vocabulary import stiffness_of
from ..fit.candidate import Fit
from ..fit.search import Search

PERIODIC = {"cogging": "cogging_periods", "position_dependent_friction": "ripple_periods"}
RIPPLE = 0.3  # of the sampling frequency: a torque that repeats with the position must mostly pass slower than this
TWIST = 0.2  # of the travel: by which the largest torque may wind up a shaft


def resolved(search: Search, fit: Fit) -> bool:
    """Whether the effects of a fit are seen, and do not only absorb what is left.

    A spring absorbs at the end of what the data can show, overdamped, or so soft that the motor winds it up by a good
    part of the travel: it follows any slow torque, and is no machine's transmission. A backlash may be overdamped, its
    contacts tell of it; without a gap it is such a spring. A ripple that passes faster than the samples can tell is one
    of their own making.

    Args:
        search: of the logs.
        fit: finished.
    """
    c, setting = fit.candidate, search.setting
    ends, values = set(c.at_bound()), c.values()
    usual = float(np.median(np.abs(np.concatenate([record.speed for record in search.records]))))
    for effect, periods in PERIODIC.items():
        if effect in c.structural and values[periods] * usual / (2.0 * np.pi) > RIPPLE / setting.dt:
            return False
    if "compliance" in c.structural:
        if {"frequency", "damping_ratio"} & ends:
            return False
        return float(stiffness_of(values)) * TWIST * setting.travel > setting.torque
    return not ("backlash" in c.structural and "gap" in ends)
