"""Exact twins: sets of causes that make exactly the same log, whatever the excitation (the table in docs/gap.md)."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from .estimate import Estimate

Parameters = Mapping[str, Mapping[str, Estimate]]
# Effects that are tied to the position: a scaled velocity integrates to another position, which shows.
LOCKED = frozenset({"unbalance", "cogging", "position_dependent_friction"})
TOLERANCE = 0.04  # relative deviation from a nominal value within which it counts as right
SHORT = 0.5  # rad: over less a sine once a turn and one of several periods a turn are the same arc
DELAYS = ("actuator_delay", "velocity_delay")


@dataclass(frozen=True)
class LogFacts:
    """The facts of a log and its nominal model on which twins depend.

    Attributes:
        position: whether the log has a position channel.
        known_torque: whether the nominal model has a torque besides friction (an offset, a load).
        known_turning: whether that torque depends on the position.
        nominal: `inertia`, `coulomb` and `viscous` of the nominal model.
        unloaded: whether hardly anything but its own friction loads the gear: little is accelerated, and no load is
            known.
        travel: range of the position over all logs [rad]; infinite on a linear axis.
    """

    position: bool
    known_torque: bool
    known_turning: bool
    nominal: Mapping[str, float]
    unloaded: bool = False
    travel: float = math.inf


@dataclass(frozen=True)
class Twin:
    """Two sets of causes that make the same log.

    Attributes:
        causes: some of those found.
        instead: causes that could replace them.
        how: values of the replacing causes, as a part of the sentence.
        untried: whether the fits cannot tell: the replacing cause was not tried with such values.
        exact: whether both make the same log whatever the excitation; else fits found them alike.
    """

    causes: frozenset[str]
    instead: tuple[str, ...]
    how: str = ""
    untried: bool = False
    exact: bool = True

    def sentence(self) -> str:
        """The statement for a reader."""
        names, others = " + ".join(sorted(self.causes)), " + ".join(self.instead)
        return f"{names} and {others}{self.how} {'make exactly the same log' if self.exact else 'fit this log alike'}."


def exact_twins(causes: Sequence[str], found: Parameters, log: LogFacts) -> list[Twin]:
    """Sets of causes that could replace some of the causes.

    Args:
        causes: of the model that was found.
        found: fitted parameters by cause and name.
        log: facts on which twins depend.
    """
    twins = []
    named = set(causes)
    for delay, other in (DELAYS, DELAYS[::-1]):
        # A dead time of the torque delays the whole motion; without a position, so does one of the reading.
        # A drift depends on the time and would distinguish them.
        if delay in named and other not in named and not log.position and "friction_drift" not in named:
            twins.append(Twin(frozenset({delay}), (other,)))
    twins += _directions(named, found, log)
    if "unbalance" in named and "cogging" not in named and log.travel < SHORT:
        how = " (that repeats less than once within the travel)"
        twins.append(Twin(frozenset({"unbalance"}), ("cogging",), how, untried=True))
    # A nominal value of zero stays zero when divided.
    wrong = [name for name in ("inertia", "coulomb", "viscous") if log.nominal.get(name, 0.0) > 0.0]
    if not log.known_torque:
        twins += _scaled(named, found, log, "torque_gain_error", "gain", wrong)
    if log.unloaded:
        twins += _unloaded(named, found, log)
    # Torques tied to the position show the true position, and with it the scale of the velocity.
    moving = named & LOCKED or log.known_turning
    if not log.position and not moving:
        wrong = [name for name in wrong if name != "coulomb"]
        twins += _scaled(named, found, log, "velocity_scale_error", "scale", wrong)
    return twins


def single_twins(log: LogFacts) -> dict[str, frozenset[str]]:
    """By effect, the single effects that make the same log or contain it as a special case."""
    found = {"constant_torque": frozenset({"asymmetric_friction"})}
    if not log.position:
        found |= {delay: frozenset({other}) for delay, other in (DELAYS, DELAYS[::-1])}
    return found


def _directions(named: set[str], found: Parameters, log: LogFacts) -> list[Twin]:
    """Twins between a constant torque and friction that depends on the direction.

    F+ for v > 0 and -F- for v < 0 is (F+ + F-)/2 sign(v) + (F+ - F-)/2: a Coulomb level and a constant torque.
    """
    if {"constant_torque", "coulomb_error"} <= named:
        return [Twin(frozenset({"constant_torque", "coulomb_error"}), ("asymmetric_friction",))]
    if "constant_torque" in named:
        return [Twin(frozenset({"constant_torque"}), ("asymmetric_friction",))]
    if "asymmetric_friction" not in named:
        return []
    sides = found["asymmetric_friction"]
    # A difference in slope is not a constant torque: no twin.
    if not overlap(sides["viscous_positive"], sides["viscous_negative"]):
        return []
    wrong = [f"{name}_error" for name in ("coulomb", "viscous") if not _mean_is_nominal(sides, name, log)]
    return [Twin(frozenset({"asymmetric_friction"}), (*wrong, "constant_torque"))]


def _scaled(named: set[str], found: Parameters, log: LogFacts, one: str, by: str, wrong: list[str]) -> list[Twin]:
    """Twins between one factor on a signal and nominal values that are all divided by it.

    g u = J a + C sign(v) + B v is u = (J/g) a + (C/g) sign(v) + (B/g) v; likewise for a scaled velocity, where the
    Coulomb torque does not change.

    Args:
        named: the causes.
        found: fitted parameters by cause and name.
        log: facts on which twins depend.
        one: the effect with the factor.
        by: the parameter that is the factor.
        wrong: nominal values that it divides.
    """
    errors = [f"{name}_error" for name in wrong]
    if not errors:
        return []
    if one in named and not set(errors) & named:
        return [Twin(frozenset({one}), tuple(errors), f" (all divided by {found[one][by].value:.4g})")]
    if one in named or not set(errors) <= named:
        return []
    # Nominal errors are a twin of the one factor only if all are wrong in one proportion, within their intervals.
    proportion = _proportion(wrong, found, log)
    return [] if proportion is None else [Twin(frozenset(errors), (one,), f" ({by} {1.0 / proportion:.4g})")]


def _unloaded(named: set[str], found: Parameters, log: LogFacts) -> list[Twin]:
    """Twins between friction that grows with the load and more friction of all kinds, where friction is the only load.

    u = (C + mu |u|) sign(v) + B v is u = (C sign(v) + B v) / (1 - mu), as long as u drives.
    """
    one, wrong = "load_dependent_friction", [n for n in ("coulomb", "viscous") if log.nominal.get(n, 0.0) > 0.0]
    errors = [f"{name}_error" for name in wrong]
    if not errors:
        return []
    if one in named and not set(errors) & named:
        rest = 1.0 - found[one]["coefficient"].value
        return [Twin(frozenset({one}), tuple(errors), f" (all divided by {rest:.4g})")]
    if one in named or not set(errors) <= named:
        return []
    # A friction that grows with the load only adds: smaller numbers than the nominal ones are no twin of it.
    proportion = _proportion(wrong, found, log)
    if proportion is None or not proportion > 1.0:
        return []
    return [Twin(frozenset(errors), (one,), f" (coefficient {1.0 - 1.0 / proportion:.4g})")]


def _proportion(wrong: Sequence[str], found: Parameters, log: LogFacts) -> float | None:
    """The one proportion in which several nominal values are wrong [1], within their intervals; None for several."""
    ratios = [_over(found[f"{name}_error"][name], log.nominal[name]) for name in wrong]
    if not all(overlap(a, b) for i, a in enumerate(ratios) for b in ratios[:i]):
        return None
    return sum(ratio.value for ratio in ratios) / len(ratios)


def overlap(a: Estimate, b: Estimate) -> bool:
    """Whether two intervals have a value in common."""
    return a.low <= b.high and b.low <= a.high


def _over(estimate: Estimate, nominal: float) -> Estimate:
    """An estimate as a multiple of the nominal value [1]."""
    return Estimate(estimate.value / nominal, estimate.low / nominal, estimate.high / nominal, "1")


def _mean_is_nominal(sides: Mapping[str, Estimate], name: str, log: LogFacts) -> bool:
    """Whether the mean of both directions is the nominal value, within its interval or `TOLERANCE`."""
    both = [sides[f"{name}_{side}"] for side in ("positive", "negative")]
    # Half width of the mean's interval, if both errors are fully correlated: the mean of the two half widths.
    half = 0.25 * sum(side.high - side.low for side in both)
    nominal = log.nominal.get(name, 0.0)
    return abs(0.5 * sum(side.value for side in both) - nominal) <= max(half, TOLERANCE * abs(nominal))
