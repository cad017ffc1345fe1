"""Shown: which effects of a model a log tells from nothing."""

import math

import numpy as np

from ..fit.candidate import Fit
from ..fit.search import Search
from .intervals import estimates

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


def not_shown(search: Search, fit: Fit, spread: np.ndarray) -> frozenset[str]:
    """Effects of a model whose size has zero in its 90 % interval: a gap that may be none is no backlash.

    Args:
        search: of the logs.
        fit: the chosen model.
        spread: its covariance (`fpjax.gap.answer.intervals.covariance`).
    """
    found = set()
    for effect in fit.candidate.effects:
        if effect.name in SIZES:
            size = estimates(search, fit, effect, spread)[SIZES[effect.name]]
            # One that ended at its bound of zero has no interval.
            known = math.isfinite(size.low) and math.isfinite(size.high)
            if (size.low <= 0.0 <= size.high) if known else size.value == 0.0:
                found.add(effect.name)
    return frozenset(found)
