"""Effects of a model whose size cannot be distinguished from zero, so that they are not asserted."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from ..effects.estimate import NINETY
from ..effects.parameters import COGGING, RIPPLE
from ..fit.candidate import Fit
from ..fit.search import Search
from ..select.simpler import FACTORS
from ..thresholds import THRESHOLDS
from .intervals import estimates

SIZES = {
    # Absent, both are infinitely stiff; one of unknown stiffness follows any slow torque.
    "compliance": "frequency",
    "presliding": "bristle_deflection",
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
"""By effect, the reported parameter whose interval holds 0 when the log does not tell the effect from nothing."""
WAVES = {"position_dependent_friction": RIPPLE, "cogging": COGGING}
"""By effect, amplitudes that are all zero when the effect is absent."""
MISREAD = {
    "velocity_scale_error": ("scale", "speed"),
    "velocity_bias": ("bias", ""),
    "velocity_lag": ("velocity_lag", "acceleration"),
    "velocity_delay": ("velocity_delay", "acceleration"),
}
"""By error of the velocity reading, its parameter, and of what its product is the error [rad/s]; "" for one that is."""


def insignificant_causes(search: Search, fit: Fit, spread: np.ndarray) -> frozenset[str]:
    """Causes whose 90 % interval contains their neutral value, and errors of the velocity reading that are slight.

    A clearance that may be zero is not asserted as backlash; a nominal number whose interval holds the number as given
    is not asserted to be wrong.

    Args:
        search: of the logs.
        fit: the chosen model.
        spread: covariance of its free parameters (`intervals.covariance`), shape (free, free).
    """
    c, found = fit.candidate, set()
    added = replace(search.setting, turning_load=0.0)  # an unbalance by what it adds to a known one
    for effect in c.effects:
        neutral = 1.0 if effect.name in FACTORS else 0.0
        name = (FACTORS if effect.name in FACTORS else SIZES).get(effect.name)
        if name is not None:
            if _slight(search, effect.name, c.values()):
                found.add(effect.name)
                continue
            size = estimates(search, fit, effect, spread, added)[name]
            # A size that ended at its bound has no interval: it is neutral only if it is exactly the neutral value.
            known = math.isfinite(size.low) and math.isfinite(size.high)
            if (size.low <= neutral <= size.high) if known else size.value == neutral:
                waves = [p.name for p in WAVES.get(effect.name, ())]
                if not waves or _may_be_none(fit, waves, spread):
                    found.add(effect.name)
    names = [c.family.parameters[index].name for index in c.free]
    for number in c.wide:
        place = names.index(number)
        half = NINETY * float(np.sqrt(max(spread[place, place], 0.0)))
        if abs(c.values()[number] - getattr(search.setting, number)) <= half:
            found.add(f"{number}_error")
    return frozenset(found)


def _slight(search: Search, effect: str, values: Mapping[str, float]) -> bool:
    """Whether an effect is an error of the velocity reading of less than a hundredth of the speed (`reading`).

    Every sensor has that, and where an encoder is fitted beside it a fit follows it however little torque it makes.
    """
    if effect not in MISREAD:
        return False

    def size(motion: str) -> float:
        return float(np.sqrt(np.mean(np.concatenate([getattr(one, motion) for one in search.records]) ** 2)))

    name, of = MISREAD[effect]
    off = abs(values[name] - (1.0 if effect in FACTORS else 0.0))
    return off * (size(of) if of else 1.0) < THRESHOLDS.reading * size("speed")


def _may_be_none(fit: Fit, amplitudes: Sequence[str], spread: np.ndarray) -> bool:
    """Whether some amplitudes may all be zero, by their 90 % region.

    Over a travel of hardly a period each harmonic may stand for the others, and none is known for itself.
    """
    from scipy.special import chdtri  # scipy.stats takes a second to import

    c = fit.candidate
    names = [c.family.parameters[index].name for index in c.free]
    places = [names.index(name) for name in amplitudes]
    values, own = c.vector[c.free][places], spread[np.ix_(places, places)]
    free = np.diag(own) > 0.0  # one that is not counts as known
    if np.any(values[~free] != 0.0):
        return False
    size = values[free] / np.sqrt(np.diag(own)[free])
    between = own[np.ix_(free, free)] / np.sqrt(np.outer(np.diag(own)[free], np.diag(own)[free]))
    distance = float(size @ np.linalg.pinv(between, hermitian=True) @ size)
    return distance <= float(chdtri(max(int(np.sum(free)), 1), 0.1))  # the 90 % quantile of a chi-square
