"""Checks of a diagnosis against what is documented of the record."""

import math
from dataclasses import dataclass
from typing import Any

from fpjax.output.json_object import JsonObject

from ..withheld.score import ASSERTING, SURE, declared, is_learned, number, ranking_of
from .records import Goal

Diagnosis = JsonObject


@dataclass(frozen=True)
class Check:
    """One check: a sentence, whether it holds (None where it cannot be asked), and what was found."""

    sentence: str
    passed: bool | None
    found: str


@dataclass(frozen=True)
class Figure:
    """A documented number beside that of the diagnosis.

    Attributes:
        name: "effect.parameter", or "missing torque left".
        documented: value, or the most that may be left.
        within: relative deviation that is allowed [1]; None where `documented` is an upper limit.
        value: of the diagnosis; None where it has none.
        low, high: its 90 % interval; None where there is none.
        unit: of what was found.
        passed: None where it could not be asked.
    """

    name: str
    documented: float
    within: float | None
    value: float | None
    low: float | None
    high: float | None
    unit: str
    passed: bool | None


def figures_of(diagnosis: Diagnosis, goal: Goal) -> list[Figure]:
    """Every documented number of a goal beside that of the diagnosis."""
    found = [parameter_figure(diagnosis, name, wanted) for name, wanted in goal.parameters.items()]
    return [*found, *([after_figure(diagnosis, goal.after)] if goal.after else [])]


def parameter_figure(diagnosis: Diagnosis, name: str, wanted: dict[str, float]) -> Figure:
    """A parameter beside its documented value."""
    effect, _, parameter = name.rpartition(".")
    given = (entry_of(diagnosis, effect).get("parameters") or {}).get(parameter) or {}
    value, low, high = (_finite(given.get(key)) for key in ("value", "low", "high"))
    passed = value is not None and abs(value / wanted["value"] - 1) <= wanted["within"]
    return Figure(name, wanted["value"], wanted["within"], value, low, high, str(given.get("unit", "")), passed)


def after_figure(diagnosis: Diagnosis, wanted: JsonObject) -> Figure:
    """The missing torque that is left on withheld data, beside the most that may be."""
    gap = diagnosis.get("gap") or {}
    value, unit = _finite(gap.get("after")), str(gap.get("unit"))
    low, high = (_finite(one) for one in (gap.get("interval") or {}).get("after") or (None, None))
    asked = value is not None and unit == wanted["unit"]
    passed = value is not None and value <= wanted["at_most"] if asked else None
    return Figure("missing torque left", wanted["at_most"], None, value, low, high, unit, passed)


def _finite(given: Any) -> float | None:
    value = number(given)
    return value if math.isfinite(value) else None


def entry_of(diagnosis: Diagnosis, effect: str) -> JsonObject:
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
    # A wrong assertion is one check, one above SURE another: the second must never fail.
    allowed = {*goal.causes, *goal.first, *goal.may}
    sure = [name for name in causes if name not in allowed and probability(entry_of(diagnosis, name)) > SURE]
    others = [name for name in causes if name not in allowed]
    checks.append(Check("nothing else asserted", not others, ", ".join(others) or "nothing"))
    checks.append(Check(f"nothing wrong above {SURE:g}", not sure, ", ".join(sure) or "nothing"))
    checks += [check_parameter(parameter_figure(diagnosis, name, one)) for name, one in goal.parameters.items()]
    if goal.after:
        checks.append(check_after(diagnosis, goal.after))
    if goal.located:
        checks += check_located(diagnosis, goal.located, hidden)
    return checks


def probability(entry: JsonObject) -> float:
    """The larger of an entry's probabilities: as the main cause, and among the causes."""
    stated = [number(entry.get(name)) for name in ("probability", "cause_probability")]
    return max((p for p in stated if math.isfinite(p)), default=0.0)


def check_parameter(figure: Figure) -> Check:
    """A parameter within a share of its documented value."""
    effect, _, parameter = figure.name.rpartition(".")
    within = 100 * (figure.within or 0.0)
    sentence = f"{effect.replace('_', ' ')}: {parameter} {figure.documented:g} within {within:.2g} %"
    return Check(sentence, figure.passed, "not given" if figure.value is None else _said(figure))


def _said(figure: Figure) -> str:
    band = "" if figure.low is None or figure.high is None else f" ({figure.low:.4g} to {figure.high:.4g})"
    return f"{figure.value:.4g} {figure.unit}{band}"


def check_after(diagnosis: Diagnosis, wanted: JsonObject) -> Check:
    """The missing torque that is left on withheld data."""
    figure = after_figure(diagnosis, wanted)
    sentence = f"withheld, at most {wanted['at_most']:g} {wanted['unit']} left"
    if figure.value is None:
        return Check(sentence, None, "not given")
    before = number((diagnosis.get("gap") or {}).get("before"))
    return Check(sentence, figure.passed, f"{before:.3g} -> {figure.value:.3g} {figure.unit}")


def check_located(diagnosis: Diagnosis, wanted: JsonObject, hidden: tuple[tuple[float, float], ...]) -> list[Check]:
    """Whether all hidden pushes are among the places in time that stand out, and most of these places are pushes.

    Args:
        diagnosis: with `where.time`.
        wanted: slack [s] by which a place may miss a push, and share of places that may be elsewhere [1].
        hidden: (start, end) of the pushes [s].
    """
    places = (diagnosis.get("where") or {}).get("time") or []
    slack = float(wanted.get("slack", 0.1))

    def meets(place: dict[str, float], stretch: tuple[float, float]) -> bool:
        return place["from"] - slack <= stretch[1] and place["to"] + slack >= stretch[0]

    hits = sum(any(meets(place, one) for place in places) for one in hidden)
    elsewhere = sum(not any(meets(place, one) for one in hidden) for place in places)
    fine = hits == len(hidden) and elsewhere <= float(wanted.get("elsewhere", 0.25)) * len(places)
    found = f"{hits} of {len(hidden)} in {len(places)} places, {elsewhere} elsewhere"
    return [Check("what pushed is located in time", fine, found)]
