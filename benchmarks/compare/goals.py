"""The goals of the comparison, computed from its rows."""

from fpjax.output.json_object import JsonObject

from .race import DEFAULT, GRADIENTS, SWEEP

FIFTH = 0.2  # share of Algorithm 1's simulated steps that a gradient method may use to reach its best cost
WITHIN = 1.01  # times the minimum of the dense sweep that a gradient method must reach
# A cost below this counts as zero for the second goal: the thesis' cost is 0 on a whole curve, so that ratios of such
# costs mean nothing. 1e-3 is the threshold of Appendix B.
ZERO = {"thesis": 1e-3, "estimation": 0.0}


def goals(rows: list[JsonObject]) -> list[JsonObject]:
    """Both goals for every observer, objective, reference and gradient method.

    Each method is judged alone, and the verdict on the default one is the headline: nobody can choose beforehand the
    method that is the best of three afterwards.
    """
    found = []
    keys = dict.fromkeys((row["observer"], row["objective"], row["reference"]) for row in rows)
    for observer, objective, reference in keys:
        of = {
            row["method"]: row
            for row in rows
            if (row["observer"], row["objective"], row["reference"]) == (observer, objective, reference)
        }
        for method in GRADIENTS:
            common = {
                "observer": observer,
                "objective": objective,
                "reference": reference,
                "method": method,
                "headline": method == DEFAULT,
            }
            found.append({**common, **_steps(of, method)})
            found.append({**common, **_minimum(of, method, ZERO[objective])})
    return found


def _steps(of: dict[str, JsonObject], method: str) -> JsonObject:
    target, theirs = of["algorithm_1"]["cost"], of["algorithm_1"]["simulations_to_best"]
    used = next((number for number, cost in of[method]["history"] if cost is not None and cost <= target), None)
    ratio = None if used is None else used / theirs
    met = ratio is not None and ratio <= FIFTH
    if used is None:
        why = f"{method} did not get below Algorithm 1's {target:.4g}: {_where(of, method)}"
    elif not met:
        why = f"Algorithm 1 needed only {theirs} simulations for its best cost, {method} {used} with its tangents"
    else:
        why = ""
    return {
        "goal": "gradient reaches Algorithm 1's best cost with at most a fifth of its simulated steps",
        "target_cost": target,
        "algorithm_1_simulations": theirs,
        "gradient_simulations": used,
        "ratio": ratio,
        "met": met,
        "why_not": why,
    }


def _minimum(of: dict[str, JsonObject], method: str, zero: float) -> JsonObject:
    least, reached = of[SWEEP]["cost"], of[method]["cost"]
    met = reached <= max(WITHIN * least, zero)
    return {
        "goal": "gradient comes within 1 % of the dense sweep's minimum",
        "sweep_minimum": least,
        "cost": reached,
        "ratio": reached / least if least > 0.0 else None,
        "met": met,
        "why_not": "" if met else _where(of, method),
    }


def _where(of: dict[str, JsonObject], method: str) -> str:
    """A sentence on where the gradient method ended and where the sweep's minimum is: one start reaches one basin."""
    ours, theirs = of[method]["gains"], of[SWEEP]["gains"]
    return (
        f"{method} from the one common start ended at ({ours['gain_2']:.4g}, {ours['gain_1']:.4g}) "
        f"({of[method]['message']}), the sweep's minimum is at ({theirs['gain_2']:.4g}, {theirs['gain_1']:.4g})"
    )
