"""Scores of diagnoses against labels: nothing here knows how a diagnosis was made.

What counts as right, set by set:

* one effect: the first of the ranking is the true effect, or an exact twin of it (`accepted` in the
  label), or names the true effect in its `indistinguishable_from` (at most `LARGEST_CLASS` names
  together: a class of everything says nothing). `top1` also wants the verdict `explained` and the
  class among the causes; `name` is the same whatever the verdict; `strict` is without declarations.
* two effects: both (some accepted set, declared confusables count) among the causes.
* no gap: anything but the verdict `no_gap` is a false alarm.
* outside the vocabulary: any asserted cause, or the verdict `explained`, is wrongly confident.

A statement is the class at the top of the ranking (the first effect and those it declares), its
probability the sum of theirs; it is true if a true effect or twin is in the class.
"""

import math
from dataclasses import dataclass, field
from typing import Any

NOMINAL = frozenset({"coulomb_error", "viscous_error", "inertia_error"})
LARGEST_CLASS = 3
Diagnosis = dict[str, Any]
Label = dict[str, Any]


@dataclass
class ParameterScore:
    """One parameter of a cause that was found."""

    effect: str
    name: str
    true: float
    value: float
    relative_error: float
    covered: bool | None


@dataclass
class CaseScore:
    """One case; None where the question is not asked in its set."""

    case: str
    set: str
    system: str
    truth: str
    verdict: str
    asserted: list[str]
    top1: bool | None = None
    name: bool | None = None
    strict: bool | None = None
    top3: bool | None = None
    exact: bool | None = None
    both: bool | None = None
    one: bool | None = None
    both_ranked: bool | None = None
    false_alarm: bool | None = None
    wrongly_confident: bool | None = None
    probability: float | None = None
    statement: bool | None = None
    closed: float | None = None
    column: str = "failed"
    parameters: list[ParameterScore] = field(default_factory=list)
    seconds: float | None = None
    warm: bool = True


def number(value: Any) -> float:
    """A number of the diagnosis: plain, or with an interval as {value, low, high}; NaN if none."""
    if isinstance(value, dict):
        value = value.get("value")
    if value is None or isinstance(value, str):
        return math.nan
    return float(value)


def ranking_of(diagnosis: Diagnosis) -> list[dict[str, Any]]:
    """The ranking, most probable first as the tool wrote it."""
    return list(diagnosis.get("ranking") or [])


def declared(entry: dict[str, Any]) -> set[str]:
    """The class an entry stands for: itself and what it says cannot be told apart from it."""
    names = {entry["effect"], *(entry.get("indistinguishable_from") or [])}
    return names if len(names) <= LARGEST_CLASS else {entry["effect"]}


def single_names(label: Label) -> set[str]:
    """Effects that alone are right: the true one and one-for-one exact twins."""
    return {one[0] for one in label["accepted"] if len(one) == 1}


def is_first(entry: dict[str, Any], causes: set[str], label: Label) -> bool:
    """Whether an entry is the truth or an exact twin; a twin of several causes wants them all."""
    if entry["effect"] in single_names(label):
        return True
    sets = [set(one) for one in label["accepted"] if len(one) > 1]
    return any(entry["effect"] in one and one <= causes for one in sets)


def tolerated(label: Label) -> frozenset[str]:
    """Causes that are true of a case beside its effect: errors put into its nominal model."""
    return NOMINAL if label["set"] == "single_off" else frozenset()


def _exact(causes: set[str], label: Label) -> bool:
    free = tolerated(label)
    return any(set(one) <= causes and causes - set(one) <= free for one in label["accepted"])


def _covers(names: set[str], classes: list[set[str]]) -> bool:
    """Whether every name has a cause of its own, itself or in the class that it declares."""
    if not names:
        return True
    first, *rest = sorted(names, key=lambda n: sum(n in one for one in classes))
    return any(first in one and _covers(set(rest), classes[:i] + classes[i + 1 :]) for i, one in enumerate(classes))


def parameter_scores(diagnosis: Diagnosis, label: Label, found: set[str]) -> list[ParameterScore]:
    """Error and coverage of every labelled parameter of the effects that were found."""
    result = []
    entries = {entry["effect"]: entry for entry in reversed(ranking_of(diagnosis))}
    for effect in found & set(label["parameters"]) & set(entries):
        given = entries[effect].get("parameters") or {}
        for name, true in label["parameters"][effect].items():
            if name not in given:
                continue
            value, low, high = (number(given[name].get(k)) for k in ("value", "low", "high"))
            if not math.isfinite(value):
                continue
            error = abs(value - true["value"]) / abs(true["value"])
            bounded = math.isfinite(low) and math.isfinite(high)
            covered = low <= true["value"] <= high if bounded else None
            result.append(ParameterScore(effect, name, true["value"], value, error, covered))
    return result


def closed_share(diagnosis: Diagnosis, label: Label) -> float | None:
    """Gap closed over what a perfect model closes.

    A perfect model leaves the sensor's noise: from the label where the gap is a velocity or a
    position of the log's own sensor, else the noise floor that the diagnosis states.
    """
    gap = diagnosis.get("gap") or {}
    before, after, floor = (number(gap.get(k)) for k in ("before", "after", "noise_floor"))
    signal, unit = str(gap.get("signal")), str(gap.get("unit"))
    for name, its_unit in (("velocity", "rad/s"), ("position", "rad")):
        if signal.startswith(name) and unit == its_unit:
            floor = label["perfect_gap"][name]
    if not (math.isfinite(before) and math.isfinite(after) and before > floor):
        return None
    return (before - after) / (before - floor)


def score_case(diagnosis: Diagnosis | None, label: Label, seconds: float | None = None, warm: bool = True) -> CaseScore:
    """One case; a diagnosis of None is one that failed, and is wrong in every set."""
    truth = "+".join(label["effects"]) or (label["outside"] or "none")
    kind = label["set"]
    failed = diagnosis is None
    diagnosis = diagnosis or {"verdict": "failed", "causes": [], "ranking": []}
    causes_list = list(diagnosis.get("causes") or [])
    causes, ranking = set(causes_list), ranking_of(diagnosis)
    score = CaseScore(
        label["case"],
        kind,
        label["system"],
        truth,
        str(diagnosis["verdict"]),
        causes_list,
        seconds=seconds,
        warm=warm,
    )
    explained = score.verdict == "explained"
    right_names = {name for one in label["accepted"] for name in one}
    if kind in ("single", "single_off"):
        first = ranking[0] if ranking else {"effect": "nothing"}
        score.strict = is_first(first, causes, label)
        score.name = score.strict or bool(declared(first) & single_names(label))
        score.top1 = bool(score.name and explained and causes & declared(first))
        score.top3 = score.name or any(entry["effect"] in single_names(label) for entry in ranking[:3])
        score.exact = explained and _exact(causes, label)
    if kind == "pairs":
        entries = {entry["effect"]: entry for entry in reversed(ranking)}
        classes = [declared(entries.get(cause, {"effect": cause})) for cause in causes_list]
        sets = [set(one) for one in label["accepted"]]
        score.both = explained and any(_covers(one, classes) for one in sets)
        score.one = any(one & right_names for one in classes)
        leading = [declared(entry) for entry in ranking[:3]]
        score.both_ranked = any(_covers(one, leading) for one in sets if len(one) <= 3)
        score.exact = explained and _exact(causes, label)
        found = causes & set(label["effects"])
        score.parameters = parameter_scores(diagnosis, label, found)
    elif score.strict:
        score.parameters = parameter_scores(diagnosis, label, set(label["effects"]))
    if kind == "none":
        score.false_alarm = score.verdict != "no_gap"
    if kind == "outside":
        score.wrongly_confident = explained or bool(causes)
    if kind not in ("none", "outside"):
        score.closed = closed_share(diagnosis, label) if not failed else 0.0
    if ranking:
        group = declared(ranking[0])
        total = sum(number(e.get("probability")) for e in ranking if e["effect"] in group)
        if math.isfinite(total):
            score.probability = min(max(total, 0.0), 1.0)
            true_names = right_names if kind == "pairs" else single_names(label)
            score.statement = bool(score.strict or group & true_names)
    score.column = _column(score, ranking, label)
    return score


def _column(score: CaseScore, ranking: list[dict[str, Any]], label: Label) -> str:
    """Column of the confusion matrix: the first cause asserted, an exact twin as the truth."""
    if score.verdict in ("no_gap", "unexplained", "failed"):
        return score.verdict
    name = score.asserted[0] if score.asserted else "unexplained"
    if len(label["effects"]) == 1 and score.name and ranking and name in declared(ranking[0]):
        return label["effects"][0]
    return name
