"""Resolved: whether a log can show an effect at the values where its fit ended."""

from collections.abc import Collection, Mapping, Sequence

import numpy as np

from ..effects.parameters import AMPLITUDES, LOAD_SHARE, RIPPLE
from ..effects.shaft import stiffness_of
from ..fit.candidate import Fit
from ..fit.search import Search
from ..thresholds import THRESHOLDS, Thresholds

NONE = 1e-3  # of the friction: a torque below it is none [1]
LIGHT = 1.1  # the lighter mass, over the lightest that is fitted, below which it is none [1]
DRIVES = 0.1  # of its usual level, that a friction by position may be below zero [1]
PERIODIC = {"cogging": "cogging_periods", "position_dependent_friction": "ripple_periods"}


def resolved(search: Search, fit: Fit, t: Thresholds = THRESHOLDS) -> bool:
    """Whether the effects of a fit are seen, and do not only absorb what is left.

    A spring absorbs at the end of what the data can show, overdamped, or so soft that friction winds it up by a good
    part of the travel and so damped that it hardly rings: it follows any slow torque, and is no machine's transmission,
    while one that rings is told by its resonance; one that carries next to nothing until it is wound up is a backlash.
    A mass that is hardly more than a twentieth of all is no second mass. A backlash may be overdamped, its contacts
    tell of it; with a gap that may be none it is such a spring, and at its largest one the load is loose. A ripple that
    passes faster than the samples can tell is one of their own making. A torque amplitude that ends at its largest
    value, more than any torque of the log, is a difference of two large torques that cancel each other over a short
    travel. A dead zone that swallows half of the largest torque stands for a torque that is always there, and so does a
    friction that drives, in one direction or at some positions. A limit that ends at the least that is looked for
    stands for a friction, one at the largest command limits nothing. A Stribeck friction of which the log shows the
    tail alone, at speeds far from rest, is any curvature of the friction.

    Args:
        search: of the logs.
        fit: finished.
        t: thresholds.
    """
    c, setting = fit.candidate, search.setting
    # How far a known load may be off is a bound of another kind: it says nothing of what stands beside it.
    ends, values = set(c.at_bound()) - set(c.load_error), c.values()
    # A friction that ends at none is at its bound, too, up to the rounding of its last step.
    if any(abs(values[name]) > NONE * setting.friction for name in AMPLITUDES & ends):
        return False
    if "torque_saturation" in c.structural and "limit" in ends:
        return False
    if "torque_dead_zone" in c.structural and values["dead_zone"] > t.swallowed * setting.torque:
        return False
    if "asymmetric_friction" in c.structural and abs(values["coulomb_difference"]) > values["coulomb"]:
        return False
    if "position_dependent_friction" in c.structural and _drives(search, values):
        return False
    speed = np.abs(np.concatenate([record.speed for record in search.records]))
    if "stribeck" in c.structural and _tail(values, float(np.min(speed))) < t.tail:
        return False
    usual = float(np.median(speed[speed > t.moves * setting.speed]))
    for effect, periods in PERIODIC.items():
        if effect in c.structural and values[periods] * usual / (2.0 * np.pi) > t.ripple / setting.dt:
            return False
    if {"compliance", "backlash"} & set(c.structural):
        low, high = (side(setting) for side in (LOAD_SHARE.low, LOAD_SHARE.high))
        if min(values["load_share"] / low, (1.0 - values["load_share"]) / (1.0 - high)) < LIGHT:
            return False
    if "compliance" in c.structural:
        # The other end is an undamped spring.
        overdamped = "damping_ratio" in ends and values["damping_ratio"] > t.rings
        if {"frequency", "relative_hardening"} & ends or overdamped:
            return False
        wound = setting.friction / float(stiffness_of(values))
        return wound < t.twist * setting.travel or values["damping_ratio"] < t.rings
    if "backlash" in c.structural:
        return "gap" not in ends and values["gap"] > t.clearance * _Known(fit).deviation("gap")
    return True


def _tail(values: Mapping[str, float], slowest: float) -> float:
    """Share of a Stribeck friction's torque at rest that acts at the slowest speed of a log [rad/s]."""
    return float(np.exp(-((slowest / values["stribeck_velocity"]) ** values["stribeck_exponent"])))


def _drives(search: Search, values: Mapping[str, float]) -> bool:
    """Whether a Coulomb level by position is below zero where the machine was: by more than a tenth of its usual size.

    Of both directions' mean, without a Stribeck friction.

    Over a short travel that repeats, its waves, turned over with the speed, are any torque of position and direction:
    inertial torque, a lag, a spring.
    """
    turned = values["ripple_periods"] * np.concatenate([record.angle for record in search.records])
    cosine, sine = (
        [values[p.name] for p in RIPPLE if p.name.startswith(f"ripple_{kind}")] for kind in ("cosine", "sine")
    )
    waves = [
        a * np.cos(i * turned) + b * np.sin(i * turned) for i, (a, b) in enumerate(zip(cosine, sine, strict=True), 1)
    ]
    level = values["coulomb"] + np.sum(waves, axis=0)
    return bool(np.min(level) < -DRIVES * np.median(np.abs(level)))


def blurs(fit: Fit, more: Fit) -> bool:
    """Whether the parameters of a fit's effects are known less well beside a further effect than without it.

    A detail that is there leaves less torque missing, so that all else is known better. One that only stands for
    something else shares the causes' torque with them, and moves their parameters to where nothing is known. Known as a
    whole, by the volume in which the parameters may lie: one of them may be less so beside others that are better known
    by a decade.

    Args:
        fit: finished.
        more: the same effects and a further one, finished.
    """
    own = {p.name for effect in fit.candidate.effects for p in effect.parameters}
    if own & set(more.candidate.at_bound()) - _ends(fit):
        return True  # to where nothing is known of it
    # A parameter at a bound counts as known, as in the intervals; but not where only one of the fits holds it there:
    # beside it the others of that fit would look better known than they are.
    doubtful = _free(fit) & _free(more) - (_ends(fit) & _ends(more))
    before, after = (_Known(each, _ends(each) - doubtful) for each in (fit, more))
    shared = [name for name in before.names if name in own and name in after.names]
    return after.log_volume(shared) > before.log_volume(shared)


def _free(fit: Fit) -> set[str]:
    return {fit.candidate.family.parameters[i].name for i in fit.candidate.free}


def _ends(fit: Fit) -> set[str]:
    return {*fit.candidate.at_bound(), *fit.candidate.absent()}


class _Known:
    """What a fit knows of its free parameters, by the curvature of the cost and their prior.

    Args:
        fit: finished.
        held: parameters that count as known exactly, and are left out.
    """

    def __init__(self, fit: Fit, held: Collection[str] = ()):
        c = fit.candidate
        named = [(place, name) for place, i in enumerate(c.free) if (name := c.family.parameters[i].name) not in held]
        places = [place for place, _ in named]
        self.names = [name for _, name in named]
        self._scale = c.scale[places]
        self._precision = c.normal[np.ix_(places, places)] + np.diag((c.scale[places] / c.spread[places]) ** 2)

    def log_volume(self, names: Sequence[str]) -> float:
        """Logarithm of the determinant of the covariance of some parameters, each in its own unit; infinite where the
        fit knows nothing of a combination of them.
        """
        own = [self.names.index(name) for name in names]
        rest = [place for place in range(len(self.names)) if place not in own]
        # What is left of their precision beside the others, which are free too (Schur's complement).
        across = self._precision[np.ix_(rest, own)]
        taken = across.T @ np.linalg.lstsq(self._precision[np.ix_(rest, rest)], across, rcond=None)[0] if rest else 0.0
        sign, size = np.linalg.slogdet(self._precision[np.ix_(own, own)] - taken)
        return float(2.0 * np.sum(np.log(self._scale[own])) - size) if sign > 0.0 else np.inf

    def deviation(self, name: str) -> float:
        """Standard deviation of a parameter in its unit; infinite where nothing is known of it."""
        return float(np.exp(0.5 * self.log_volume([name])))
