"""Shown: which effects of a model a log tells from nothing."""

import math

import numpy as np

from ..fit.candidate import Fit
from ..fit.search import Search
from .intervals import NINETY, estimates

SIZES = {
    "stribeck": "stribeck_torque",
    "position_dependent_friction": "amplitude",
    "friction_drift": "amplitude",
    "load_dependent_friction": "coefficient",
    "quadratic_drag": "coefficient",
    "backlash": "gap",
    "unbalance": "amplitude",
    "cogging": "amplitude",
    "constant_torque": "torque",
    "torque_dead_zone": "width",
    "actuator_lag": "time_constant",
    "actuator_delay": "delay",
    "velocity_lag": "time_constant",
    "velocity_delay": "delay",
    "velocity_bias": "bias",
}
"""The reported parameter that is zero where an effect is not there."""
FACTORS = {"torque_gain_error": "gain", "velocity_scale_error": "scale"}
"""Likewise, that is one."""


def not_shown(search: Search, fit: Fit, spread: np.ndarray) -> frozenset[str]:
    """Causes whose size has in its 90 % interval what it is without them: a gap that may be none is no backlash, a
    nominal number whose interval holds the number as given is not wrong.

    Args:
        search: of the logs.
        fit: the chosen model.
        spread: its covariance (`fpjax.gap.answer.intervals.covariance`).
    """
    c, found = fit.candidate, set()
    for effect in c.effects:
        neutral = 1.0 if effect.name in FACTORS else 0.0
        name = (FACTORS if effect.name in FACTORS else SIZES).get(effect.name)
        if name is not None:
            size = estimates(search, fit, effect, spread)[name]
            # One that ended at its bound of zero has no interval.
            known = math.isfinite(size.low) and math.isfinite(size.high)
            if (size.low <= neutral <= size.high) if known else size.value == neutral:
                found.add(effect.name)
    names = [c.family.parameters[index].name for index in c.free]
    for number in c.wide:
        place = names.index(number)
        half = NINETY * float(np.sqrt(max(spread[place, place], 0.0)))
        if abs(c.values()[number] - getattr(search.setting, number)) <= half:
            found.add(f"{number}_error")
    return frozenset(found)
