"""Which other sets of causes make exactly the same log (the contract's exact twins)."""

from itertools import product

from .effects import Plan

POSITION_LOCKED = {"unbalance", "cogging", "position_dependent_friction"}


def alternatives(effect: str, plan: Plan, has_position: bool) -> list[frozenset[str]]:
    """Sets of causes that can stand for one effect in this case, itself first."""
    result = [frozenset({effect})]
    physics, effects = plan.physics, set(plan.parameters)
    known = physics.get("known_offset", 0.0) != 0 or physics.get("known_unbalance", 0.0) != 0
    if effect in ("actuator_delay", "velocity_delay"):
        other = {"actuator_delay": "velocity_delay", "velocity_delay": "actuator_delay"}[effect]
        if not has_position and "friction_drift" not in effects:
            result.append(frozenset({other}))
    if effect == "constant_torque":
        result.append(frozenset({"asymmetric_friction"}))
    if effect == "asymmetric_friction":
        law = plan.laws["asymmetric_friction"]
        if law == "opposite Coulomb":
            result.append(frozenset({"constant_torque"}))
        if law == "one Coulomb":
            result.append(frozenset({"constant_torque", "coulomb_error"}))
    if effect == "torque_gain_error" and not known:
        result.append(frozenset({"inertia_error", "coulomb_error", "viscous_error"}))
    if effect == "velocity_scale_error" and not has_position:
        moving = effects & POSITION_LOCKED or physics.get("known_unbalance", 0.0) != 0
        if not moving:
            result.append(frozenset({"inertia_error", "viscous_error"}))
    return result


def accepted(plan: Plan, has_position: bool) -> list[list[str]]:
    """Every set of causes that is right for this case, the true one first."""
    choices = [alternatives(effect, plan, has_position) for effect in plan.parameters]
    sets: list[frozenset[str]] = []
    for combination in product(*choices):
        union = frozenset().union(*combination)
        if union not in sets:
            sets.append(union)
    return [sorted(one) for one in sets]
