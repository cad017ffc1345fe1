"""Twins: sets of causes whose logs are exactly the same, whatever the data (the table in docs/gap.md)."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from .estimate import Estimate

Parameters = Mapping[str, Mapping[str, Estimate]]
LOCKED = frozenset({"unbalance", "cogging", "position_dependent_friction"})
TOLERANCE = 0.04  # relative, as far as the fit lets nominal values go
DELAYS = ("actuator_delay", "velocity_delay")


@dataclass(frozen=True)
class LogFacts:
    """What decides whether two sets of causes are twins in a log.

    Attributes:
        position: a position channel is there.
        known_torque: the nominal model knows a torque besides friction (an offset, a load).
        known_turning: that torque depends on the position.
        nominal: `inertia`, `coulomb` and `viscous` of the nominal model.
    """

    position: bool
    known_torque: bool
    known_turning: bool
    nominal: Mapping[str, float]


@dataclass(frozen=True)
class Twin:
    """Two sets of causes that make the same log.

    Attributes:
        causes: some of those found.
        instead: what could stand in their place.
        how: what the others' values then are, for a sentence.
    """

    causes: frozenset[str]
    instead: tuple[str, ...]
    how: str = ""

    def sentence(self) -> str:
        """For the reader."""
        names, others = " + ".join(sorted(self.causes)), " + ".join(self.instead)
        return f"{names} and {others}{self.how} make exactly the same log."


def exact_twins(causes: Sequence[str], found: Parameters, log: LogFacts) -> list[Twin]:
    """What could stand in place of some of the causes.

    Args:
        causes: of the model that was found.
        found: fitted parameters by cause and name.
        log: what the log holds.
    """
    twins = []
    named = set(causes)
    for delay, other in (DELAYS, DELAYS[::-1]):
        if delay in named and other not in named and not log.position and "friction_drift" not in named:
            twins.append(Twin(frozenset({delay}), (other,)))
    twins += _directions(named, found, log)
    wrong = [name for name in ("inertia", "coulomb", "viscous") if log.nominal.get(name, 0.0) > 0.0]
    if not log.known_torque:
        twins += _scaled(named, found, log, "torque_gain_error", "gain", wrong)
    moving = named & LOCKED or log.known_turning
    if not log.position and not moving:
        wrong = [name for name in wrong if name != "coulomb"]
        twins += _scaled(named, found, log, "velocity_scale_error", "scale", wrong)
    return twins


def single_twins(log: LogFacts) -> dict[str, frozenset[str]]:
    """Of each effect, what alone makes the same log in its place, or holds it as a special case."""
    found = {"constant_torque": frozenset({"asymmetric_friction"})}
    if not log.position:
        found |= {delay: frozenset({other}) for delay, other in (DELAYS, DELAYS[::-1])}
    return found


def _directions(named: set[str], found: Parameters, log: LogFacts) -> list[Twin]:
    """Friction that depends on the direction, against a torque that does not."""
    if {"constant_torque", "coulomb_error"} <= named:
        return [Twin(frozenset({"constant_torque", "coulomb_error"}), ("asymmetric_friction",))]
    if "constant_torque" in named:
        return [Twin(frozenset({"constant_torque"}), ("asymmetric_friction",))]
    if "asymmetric_friction" not in named:
        return []
    sides = found["asymmetric_friction"]
    if not overlap(sides["viscous_positive"], sides["viscous_negative"]):
        return []
    wrong = [f"{name}_error" for name in ("coulomb", "viscous") if not _mean_is_nominal(sides, name, log)]
    return [Twin(frozenset({"asymmetric_friction"}), (*wrong, "constant_torque"))]


def _scaled(named: set[str], found: Parameters, log: LogFacts, one: str, by: str, wrong: list[str]) -> list[Twin]:
    """One factor on a signal, against nominal values all divided by it."""
    errors = [f"{name}_error" for name in wrong]
    if not errors:
        return []
    if one in named and not set(errors) & named:
        return [Twin(frozenset({one}), tuple(errors), f" (all divided by {found[one][by].value:.4g})")]
    if one in named or not set(errors) <= named:
        return []
    ratios = [_over(found[error][name], log.nominal[name]) for error, name in zip(errors, wrong, strict=True)]
    if all(overlap(a, b) for i, a in enumerate(ratios) for b in ratios[:i]):
        mean = sum(ratio.value for ratio in ratios) / len(ratios)
        return [Twin(frozenset(errors), (one,), f" ({by} {1.0 / mean:.4g})")]
    return []


def overlap(a: Estimate, b: Estimate) -> bool:
    """Whether two intervals have a value in common."""
    return a.low <= b.high and b.low <= a.high


def _over(estimate: Estimate, nominal: float) -> Estimate:
    return Estimate(estimate.value / nominal, estimate.low / nominal, estimate.high / nominal, "1")


def _mean_is_nominal(sides: Mapping[str, Estimate], name: str, log: LogFacts) -> bool:
    """Whether the mean of both directions is the nominal value, within its interval or what that may be off."""
    both = [sides[f"{name}_{side}"] for side in ("positive", "negative")]
    half = 0.25 * sum(side.high - side.low for side in both)
    nominal = log.nominal.get(name, 0.0)
    return abs(0.5 * sum(side.value for side in both) - nominal) <= max(half, TOLERANCE * abs(nominal))
