"""Resolved: whether a log can show an effect at the values where its fit ended."""

import numpy as np

from ..effects.parameters import AMPLITUDES
from ..effects.vocabulary import stiffness_of
from ..fit.candidate import Fit
from ..fit.search import Search
from ..thresholds import THRESHOLDS, Thresholds

PERIODIC = {"cogging": "cogging_periods", "position_dependent_friction": "ripple_periods"}


def resolved(search: Search, fit: Fit, t: Thresholds = THRESHOLDS) -> bool:
    """Whether the effects of a fit are seen, and do not only absorb what is left.

    A spring absorbs at the end of what the data can show, overdamped, or so soft that friction winds it up by a
    good part of the travel: it follows any slow torque, and is no machine's transmission; one that carries next to
    nothing until it is wound up is a backlash. A backlash may be overdamped, its contacts tell of it; with a gap
    that may be none it is such a spring, and at its largest one the load is loose. A ripple that passes faster than
    the samples can tell is one of their own making. A torque amplitude that ends at its largest value, more than
    any torque of the log, is a difference of two large torques that cancel each other over a short travel. A dead
    zone that swallows half of the largest torque stands for a torque that is always there, and so does a friction
    that drives in one direction. A limit that ends at the least that is looked for stands for a friction, one at the
    largest command limits nothing.

    Args:
        search: of the logs.
        fit: finished.
        t: thresholds.
    """
    c, setting = fit.candidate, search.setting
    # How far a known load may be off is a bound of another kind: it says nothing of what stands beside it.
    ends, values = set(c.at_bound()) - set(c.load_error), c.values()
    if any(values[name] != 0.0 for name in AMPLITUDES & ends):
        return False
    if "torque_saturation" in c.structural and "limit" in ends:
        return False
    if "torque_dead_zone" in c.structural and values["dead_zone"] > t.swallowed * setting.torque:
        return False
    if "asymmetric_friction" in c.structural and abs(values["coulomb_difference"]) > values["coulomb"]:
        return False
    speed = np.abs(np.concatenate([record.speed for record in search.records]))
    usual = float(np.median(speed[speed > t.moves * setting.speed]))
    for effect, periods in PERIODIC.items():
        if effect in c.structural and values[periods] * usual / (2.0 * np.pi) > t.ripple / setting.dt:
            return False
    if "compliance" in c.structural:
        if {"frequency", "damping_ratio", "relative_hardening"} & ends:
            return False
        return float(stiffness_of(values)) * t.twist * setting.travel > setting.friction
    if "backlash" in c.structural:
        return "gap" not in ends and values["gap"] > t.clearance * _deviations(fit, held=False)["gap"]
    return True


def blurs(fit: Fit, more: Fit) -> bool:
    """Whether a parameter of a fit's effects is known less well beside a further effect than without it.

    A detail that is there leaves less torque missing, so that all else is known better. One that only stands for
    something else shares the causes' torque with them, and moves their parameters to where nothing is known.

    Args:
        fit: finished.
        more: the same effects and a further one, finished.
    """
    own = {p.name for effect in fit.candidate.effects for p in effect.parameters}
    before, after = _deviations(fit), _deviations(more)
    pushed = own & before.keys() & set(more.candidate.at_bound())  # to where nothing is known of it
    return bool(pushed) or any(after[name] > before[name] for name in own & before.keys() & after.keys())


def _deviations(fit: Fit, *, held: bool = True) -> dict[str, float]:
    """Standard deviation of every free parameter, by the curvature of the cost and its prior; each in its own unit.

    Args:
        fit: finished.
        held: whether a parameter at a bound counts as known, and is left out.
    """
    c = fit.candidate
    ends = {*c.at_bound(), *c.absent()} if held else set()
    named = [(place, name) for place, i in enumerate(c.free) if (name := c.family.parameters[i].name) not in ends]
    places = [place for place, _ in named]
    precision = c.normal[np.ix_(places, places)] + np.diag((c.scale[places] / c.spread[places]) ** 2)
    variance = np.maximum(np.diag(np.linalg.pinv(precision, hermitian=True)), 0.0)
    return {name: float(c.scale[place] * np.sqrt(v)) for (place, name), v in zip(named, variance, strict=True)}
