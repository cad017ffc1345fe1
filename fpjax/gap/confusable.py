"""Confusable: effects that a log cannot tell apart, exactly or by its data."""

from .attribute import Fitted, Search
from .decide import Decision

CLOSE = 4.0  # log evidence within which the data do not decide
LARGEST_CLASS = 3


def exact_twins(effect: str, decision: Decision, search: Search) -> tuple[str, ...]:
    """Effects whose logs are the same as this one's, whatever the data (the contract's table)."""
    record = search.records[0]
    names = decision.leading.names
    if effect in ("actuator_delay", "velocity_delay") and record.position is None and "friction_drift" not in names:
        return ("velocity_delay" if effect == "actuator_delay" else "actuator_delay",)
    if effect == "constant_torque":
        return ("asymmetric_friction",)
    if effect == "asymmetric_friction":
        return ("constant_torque",)
    return ()


def indistinguishable(
    fitted: Fitted, position: int, rivals: list[Fitted], decision: Decision, search: Search
) -> tuple[str, ...]:
    """Effects that could stand in one place of the causes as well: exact twins, and those whose evidence is as good.

    Args:
        fitted: the chosen model.
        position: which of its effects is asked about.
        rivals: every model tried with as many effects.
        decision: the search's.
        search: the fits.
    """
    name = fitted.names[position]
    others = set(fitted.names) - {name}
    found = list(exact_twins(name, decision, search))
    close = [
        (fitted.evidence - rival.evidence, next(iter(set(rival.names) - others)))
        for rival in rivals
        if len(rival.names) == len(fitted.names)
        and others <= set(rival.names)
        and set(rival.names) != set(fitted.names)
    ]
    # The twin of different Coulomb levels is none where the viscous ones differ as well, and the data tell that.
    known = {other: distance for distance, other in close}
    if name == "asymmetric_friction" and known.get("constant_torque", 0.0) > CLOSE:
        found.remove("constant_torque")
    for distance, other in sorted(close):
        if distance < CLOSE and other not in found:
            found.append(other)
    return tuple(found[: LARGEST_CLASS - 1])
