"""The contract's numbers of laws of another form: those of the contract's law that is nearest over the log's motion.

Where a law has no number of the contract's name, its own parameter is another thing than what a diagnosis is asked for.
Least squares over the true motion of the log, one value for each period, is what the label holds then.
"""

import numpy as np

from .cases import Case
from .world import Trace

EFFECTS = ("compliance", "load_dependent_friction")  # whose labels hold equivalents where their law has another form
# of each the values of a `World` with which its law is the contract's
CONTRACT_FORM = {"compliance": {"hardening": 0.0}, "load_dependent_friction": {"geared": 1.0}}
MOVING = 0.02  # share of the machine's top speed above which it moves, as `Scales.moving` counts it


def stiffness_of(twist: np.ndarray, rate: np.ndarray, transmitted: np.ndarray) -> float:
    """Stiffness of the linear spring and damper that transmit most nearly the torque [N m/rad]."""
    return float(_fit([twist, rate], transmitted)[0])


def coefficient_of(level: np.ndarray, delivered: np.ndarray) -> float:
    """Slope of a friction level on the size of the torque delivered beyond friction, beside a constant level [1]."""
    return float(_fit([np.abs(delivered), np.ones(len(delivered))], level)[0])


def _fit(columns: list[np.ndarray], wanted: np.ndarray) -> np.ndarray:
    matrix = np.stack(columns, axis=1)
    # Columns of unit size: a rank is then one of the motion and not of the units.
    sizes = np.sqrt(np.mean(matrix**2, axis=0)) if len(matrix) else np.zeros(matrix.shape[1])
    if not np.all(sizes > 0):
        raise ArithmeticError("a log without motion has no equivalent")
    return np.linalg.lstsq(matrix / sizes, wanted)[0] / sizes


def _kept(course: np.ndarray | None) -> np.ndarray:
    if course is None:
        raise ValueError("the simulation kept nothing of this part of the machine")
    return course


def equivalents(case: Case, trace: Trace) -> dict[str, dict[str, float]]:
    """By effect the contract's parameters, of those effects of the case whose law has another form."""
    found, values = {}, case.world.values
    other = set(case.plan.other_form) & set(case.plan.parameters)
    if "compliance" in other:
        stiffness = stiffness_of(_kept(trace.twist), _kept(trace.twist_rate), _kept(trace.transmitted))
        reduced = values["inertia"] * values["load_share"] * (1 - values["load_share"])
        found["compliance"] = {"frequency": float(np.sqrt(stiffness / reduced) / (2 * np.pi)), "stiffness": stiffness}
    if "load_dependent_friction" in other:
        moves = np.abs(trace.true_velocity) > MOVING * case.plan.drawn.kind.speed
        coefficient = coefficient_of(_kept(trace.load_level)[moves], _kept(trace.delivered)[moves])
        found["load_dependent_friction"] = {"coefficient": coefficient}
    return found
