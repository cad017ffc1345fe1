"""A diagnosis against what is documented of the record."""

import math
from dataclasses import dataclass
from typing import Any

from ..withheld.score import ASSERTING, SURE, declared, is_learned, number, ranking_of
from .records import Goal

Diagnosis = dict[str, Any]


@dataclass(frozen=True)
class Check:
    """One sentence, whether it holds (None: could not be asked), and what was found."""

    sentence: str
    passed: bool | None
    found: str


def entry_of(diagnosis: Diagnosis, effect: str) -> dict[str, Any]:
    """An effect's entry of the ranking; empty if it has none."""
    return next((entry for entry in ranking_of(diagnosis) if entry["effect"] == effect), {})


def asserted(diagnosis: Diagnosis) -> list[str]:
    """The causes that the verdict asserts."""
    causes = [cause for cause in diagnosis.get("causes") or [] if not is_learned(cause)]
    return causes if diagnosis.get("verdict") in ASSERTING else []


def check_all(diagnosis: Diagnosis, goal: Goal, hidden: tuple[tuple[float, float], ...]) -> list[Check]:
    """Every check that the goal asks for."""
    checks, causes, ranking = [], asserted(diagnosis), ranking_of(diagnosis)
    names = [entry["effect"] for entry in ranking]
    if goal.verdict:
        verdict = str(diagnosis.get("verdict"))
        checks.append(Check(f"verdict {' or '.join(goal.verdict)}", verdict in goal.verdict, verdict))
    if goal.first:
        right = bool(ranking) and bool(declared(ranking[0]) & set(goal.first))
        checks.append(Check(f"first in the ranking: {' or '.join(goal.first)}", right, ", ".join(names[:3]) or "none"))
    if goal.causes:
        right = set(goal.causes) <= set(causes)
        checks.append(Check(f"causes: {', '.join(goal.causes)}", right, ", ".join(causes) or "none"))
    allowed = {*goal.causes, *goal.first, *goal.may}
    sure = [name for name in causes if name not in allowed and probability(entry_of(diagnosis, name)) > SURE]
    others = [name for name in causes if name not in allowed]
    checks.append(Check("nothing else asserted", not others, ", ".join(others) or "nothing"))
    checks.append(Check(f"nothing wrong above {SURE:g}", not sure, ", ".join(sure) or "nothing"))
    checks += [check_parameter(diagnosis, name, wanted) for name, wanted in goal.parameters.items()]
    if goal.after:
        checks.append(check_after(diagnosis, goal.after))
    if goal.located:
        checks += check_located(diagnosis, goal.located, hidden)
    return checks


def probability(entry: dict[str, Any]) -> float:
    """The larger of an entry's probabilities: as the main cause, and among the causes."""
    stated = [number(entry.get(name)) for name in ("probability", "cause_probability")]
    return max((p for p in stated if math.isfinite(p)), default=0.0)


def check_parameter(diagnosis: Diagnosis, name: str, wanted: dict[str, float]) -> Check:
    """A parameter within a share of its documented value."""
    effect, _, parameter = name.rpartition(".")
    given = (entry_of(diagnosis, effect).get("parameters") or {}).get(parameter) or {}
    value, true, within = number(given), wanted["value"], wanted["within"]
    sentence = f"{effect.replace('_', ' ')}: {parameter} {true:g} within {100 * within:.2g} %"
    if not math.isfinite(value):
        return Check(sentence, False, "not given")
    low, high = number(given.get("low")), number(given.get("high"))
    found = f"{value:.4g} {given.get('unit', '')} ({low:.4g} to {high:.4g})"
    return Check(sentence, abs(value / true - 1) <= within, found)


def check_after(diagnosis: Diagnosis, wanted: dict[str, Any]) -> Check:
    """The missing torque that is left on withheld data."""
    gap = diagnosis.get("gap") or {}
    before, after, unit = number(gap.get("before")), number(gap.get("after")), str(gap.get("unit"))
    sentence = f"withheld, at most {wanted['at_most']:g} {wanted['unit']} left"
    fine = after <= wanted["at_most"] if unit == wanted["unit"] else None
    return Check(sentence, fine, f"{before:.3g} -> {after:.3g} {unit}")


def check_located(diagnosis: Diagnosis, wanted: dict[str, Any], hidden: tuple[tuple[float, float], ...]) -> list[Check]:
    """Whether the hidden pushes are among the places in time that stand out, and most places are pushes."""
    places = (diagnosis.get("where") or {}).get("time") or []
    slack = float(wanted.get("slack", 0.1))

    def meets(place: dict[str, float], stretch: tuple[float, float]) -> bool:
        return place["from"] - slack <= stretch[1] and place["to"] + slack >= stretch[0]

    hits = sum(any(meets(place, one) for place in places) for one in hidden)
    elsewhere = sum(not any(meets(place, one) for one in hidden) for place in places)
    fine = hits == len(hidden) and elsewhere <= float(wanted.get("elsewhere", 0.25)) * len(places)
    found = f"{hits} of {len(hidden)} in {len(places)} places, {elsewhere} elsewhere"
    return [Check("what pushed is located in time", fine, found)]
