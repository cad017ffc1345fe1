"""The goals of the comparison, computed from its rows."""

from typing import Any

from .race import GRADIENTS, SWEEP

FIFTH = 0.2
WITHIN = 1.01
# A cost below this counts as zero for the second goal: the thesis' cost has its minimum, 0, on a whole curve.
ZERO = {"thesis": 1e-3, "estimation": 0.0}


def goals(rows: list[dict[str, Any]]) -> list[dict[str, Any]]:
    """Of every observer, objective and reference: steps against Algorithm 1's, and cost against the sweep's minimum."""
    found = []
    keys = dict.fromkeys((row["observer"], row["objective"], row["reference"]) for row in rows)
    for observer, objective, reference in keys:
        of = {
            row["method"]: row
            for row in rows
            if (row["observer"], row["objective"], row["reference"]) == (observer, objective, reference)
        }
        where = {"observer": observer, "objective": objective, "reference": reference}
        found.append({**where, **_steps(of)})
        found.append({**where, **_minimum(of, ZERO[objective])})
    return found


def _steps(of: dict[str, dict[str, Any]]) -> dict[str, Any]:
    target, theirs = of["algorithm_1"]["cost"], of["algorithm_1"]["simulations_to_best"]
    used = {}
    for method in GRADIENTS:
        reached = [number for number, cost in of[method]["history"] if cost <= target]
        used[method] = reached[0] if reached else None
    arrived = {method: number for method, number in used.items() if number is not None}
    best = min(arrived, key=lambda method: arrived[method]) if arrived else None
    ratio = arrived[best] / theirs if best else None
    met = ratio is not None and ratio <= FIFTH
    if best is None:
        why = f"no gradient method got below Algorithm 1's {target:.4g}: {_where(of)}"
    elif not met:
        why = (
            f"Algorithm 1 needed only {theirs} simulations for its best cost, {best} {arrived[best]} with its tangents"
        )
    else:
        why = ""
    return {
        "goal": "gradient reaches Algorithm 1's best cost with at most a fifth of its simulated steps",
        "target_cost": target,
        "algorithm_1_simulations": theirs,
        "gradient_simulations": used,
        "method": best,
        "ratio": ratio,
        "met": met,
        "why_not": why,
    }


def _minimum(of: dict[str, dict[str, Any]], zero: float) -> dict[str, Any]:
    least = of[SWEEP]["cost"]
    best = min(GRADIENTS, key=lambda method: of[method]["cost"])
    reached = of[best]["cost"]
    met = reached <= max(WITHIN * least, zero)
    return {
        "goal": "gradient comes within 1 % of the dense sweep's minimum",
        "sweep_minimum": least,
        "method": best,
        "cost": reached,
        "ratio": reached / least if least > 0.0 else None,
        "met": met,
        "why_not": "" if met else _where(of),
    }


def _where(of: dict[str, dict[str, Any]]) -> str:
    """Where the gradient ended and where the sweep's minimum lies: one start sees one basin."""
    best = min(GRADIENTS, key=lambda method: of[method]["cost"])
    ours, theirs = of[best]["gains"], of[SWEEP]["gains"]
    return (
        f"{best} from the one common start ended at ({ours['gain_2']:.4g}, {ours['gain_1']:.4g}) "
        f"({of[best]['message']}), the sweep's minimum is at ({theirs['gain_2']:.4g}, {theirs['gain_1']:.4g})"
    )
