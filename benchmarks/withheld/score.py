"""Scores of diagnoses against labels; only the content of diagnosis.json is used.

What counts as right, set by set:

* one effect: the first of the ranking is the true effect, or an exact twin of it (`accepted` in the label), or names
  the true effect in its `indistinguishable_from` (at most `LARGEST_CLASS` names together: a class of everything is no
  information). `name` is that, whatever the verdict; `right` also wants the class among the causes that are asserted.
  In the sets whose nominal is off, errors of the nominal that are truly there may stand before it in the ranking.
* two effects: both (some accepted set, declared confusables count) among the causes.
* no gap: anything but the verdict `no_gap` is a false alarm.
* outside the vocabulary: an asserted cause that is not there is a wrong assertion.

`explained` and `partly_explained` assert their causes. A statement is the class at the top of the ranking (the first
effect and those it declares), its probability the sum of theirs, and every further cause that is asserted, with its
own; it is true if an effect of the class is there: the cause, a twin, the clutter (`also_true`), a nominal's error.
`wrongly_sure`: a statement above `SURE` that is not true, whatever the verdict. A learned law names no effect: it is no
statement, and where it comes first the right name does not.
"""

import math
import tomllib
from dataclasses import dataclass, field
from typing import Any

from fpjax.output.json_object import JsonObject

NOMINAL = ("inertia", "coulomb", "viscous")
NOMINAL_MAY_BE_OFF = ("single_off", "wide", "starter")
ASSERTING = ("explained", "partly_explained")
ONE_EFFECT = ("single", "single_off", "wide", "starter", "recorded")
EXACT_NOMINAL = ("single", "recorded")
LARGEST_CLASS = 3
SURE = 0.95
MATTERS = 5.0  # error of a nominal number from which it is expected to be corrected [%]
CORRECTED = (0.25, 2.0)  # what may be left of it: the larger of this share of the error, and this error [%]
Diagnosis = JsonObject
Label = JsonObject


@dataclass
class ParameterScore:
    """One parameter of a cause that was found."""

    effect: str
    name: str
    true: float
    value: float
    relative_error: float
    covered: bool | None
    other_form: bool = False


@dataclass
class NominalScore:
    """One number of the nominal model that was off."""

    name: str
    error_percent: float
    named: bool  # as a cause
    corrected: bool  # in the corrected model


@dataclass
class CaseScore:
    """One case; None where the question is not asked in its set."""

    case: str
    set: str
    group: str
    sensors: str
    system: str
    truth: str
    generator: int
    recording: str
    verdict: str
    asserted: list[str]
    name: bool | None = None
    strict: bool | None = None
    top3: bool | None = None
    right: bool | None = None
    exact: bool | None = None
    both: bool | None = None
    one: bool | None = None
    both_ranked: bool | None = None
    false_alarm: bool | None = None
    wrongly_asserted: bool = False
    wrongly_sure: bool = False
    surest_wrong: float = 0.0
    probability: float | None = None
    statement: bool | None = None
    own: bool | None = None  # the statement names the withheld effect itself, or an exact twin
    ahead: float | None = None  # how far the leading cause is beyond the others, as the diagnosis says it [1]
    sure_statements: int = 0
    sure_wrong: int = 0
    closed: float | None = None
    column: str = "failed"
    parameters: list[ParameterScore] = field(default_factory=list)
    nominal: list[NominalScore] = field(default_factory=list)
    seconds: float | None = None
    warm: bool = True


def number(value: Any) -> float:
    """A number of the diagnosis: plain, or with an interval as {value, low, high}; NaN if none."""
    if isinstance(value, dict):
        value = value.get("value")
    if value is None or isinstance(value, str):
        return math.nan
    return float(value)


def ranking_of(diagnosis: Diagnosis) -> list[JsonObject]:
    """The ranking, most probable first as the tool wrote it."""
    return [entry for entry in diagnosis.get("ranking") or [] if entry.get("effect")]


def declared(entry: JsonObject) -> set[str]:
    """The class that an entry stands for: itself and the effects that it declares indistinguishable."""
    names = {entry["effect"], *(entry.get("indistinguishable_from") or [])}
    return names if len(names) <= LARGEST_CLASS else {entry["effect"]}


def is_learned(name: str) -> bool:
    """Whether a name of the ranking or of the causes is a learned law, and no effect of the vocabulary."""
    return name.startswith("learned")


def single_names(label: Label) -> set[str]:
    """Effects that alone are right: the true one and one-for-one exact twins."""
    return {one[0] for one in label["accepted"] if len(one) == 1}


def nominal_errors(label: Label) -> set[str]:
    """Errors that were put into the nominal model beside the case's effect, as effects."""
    if label["set"] not in NOMINAL_MAY_BE_OFF:
        return set()
    errors = label.get("nominal_error_percent", {})
    found = {f"{name}_error" for name in NOMINAL if abs(errors.get(name, 0.0)) > 0.1}
    # A model regressed on the log may also have a wrong offset and a wrong load.
    return found | ({"constant_torque", "unbalance"} if label["set"] == "starter" else set())


def is_first(entry: JsonObject, causes: set[str], label: Label) -> bool:
    """Whether an entry is the truth or an exact twin; a twin of several causes wants them all."""
    if entry["effect"] in single_names(label):
        return True
    sets = [set(one) for one in label["accepted"] if len(one) > 1]
    return any(entry["effect"] in one and one <= causes for one in sets)


def _covers(names: set[str], classes: list[set[str]]) -> bool:
    """Whether every name can be matched with a cause of its own, itself or a member of the class that it declares.

    A bipartite matching by recursion, for two or three names; names with the fewest possibilities first.
    """
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
            other = effect in label.get("other_form", [])
            result.append(ParameterScore(effect, name, true["value"], value, error, covered, other))
    return result


def nominal_scores(diagnosis: Diagnosis, label: Label) -> list[NominalScore]:
    """Which errors of the nominal were named as causes, which are corrected in the model that the diagnosis gives."""
    if label["set"] not in ("wide", "starter"):
        return []
    try:
        model = tomllib.loads(str(diagnosis.get("model") or ""))
    except tomllib.TOMLDecodeError:
        model = {}
    given = {name: _in_model(model, name) for name in NOMINAL}
    # With these effects the level or the slope is not one number, which could be corrected.
    mixed = {"asymmetric_friction": {"coulomb", "viscous"}, "load_dependent_friction": {"coulomb"}}
    left_out = set().union(*(mixed.get(effect, set()) for effect in label["effects"]))
    result = []
    for name, error in label["nominal_error_percent"].items():
        if abs(error) < MATTERS or name in left_out:
            continue
        left = abs(100 * (given[name] / label["nominal_true"][name] - 1))
        fine = left <= max(CORRECTED[0] * abs(error), CORRECTED[1])
        result.append(NominalScore(name, error, f"{name}_error" in (diagnosis.get("causes") or []), bool(fine)))
    return result


def _in_model(model: JsonObject, name: str) -> float:
    if name == "inertia":
        plant = model.get("plant", {})
        parts = [number(plant.get(key)) for key in ("motor_inertia", "load_inertia")]
        return number(plant["inertia"]) if "inertia" in plant else sum(parts)
    return number(model.get("friction", {}).get(name))


def score_case(diagnosis: Diagnosis | None, label: Label, seconds: float | None = None, warm: bool = True) -> CaseScore:
    """One case; a diagnosis of None is one that failed, and is wrong in every set."""
    failed, kind = diagnosis is None, label["set"]
    diagnosis = diagnosis or {"verdict": "failed", "causes": [], "ranking": []}
    causes_list = [cause for cause in diagnosis.get("causes") or [] if not is_learned(cause)]
    ranking = ranking_of(diagnosis)
    causes, verdict = set(causes_list), str(diagnosis["verdict"])
    score = CaseScore(
        case=label["case"],
        set=kind,
        group=label["group"],
        sensors=label["sensors"],
        system=label["system"],
        truth="+".join(label["effects"]) or (label["outside"] or "none"),
        generator=int(label["truth"]),
        recording=label.get("recording", ""),
        verdict=verdict,
        asserted=causes_list,
        seconds=seconds,
        warm=warm,
    )
    asserts = verdict in ASSERTING
    off = nominal_errors(label)
    exact = asserts and any(set(one) <= causes and causes - set(one) <= off for one in label["accepted"])
    if kind in ONE_EFFECT:
        _score_one(score, ranking, causes if asserts else set(), label, off)
        score.exact = exact
        if score.strict or (score.name and off):
            score.parameters = parameter_scores(diagnosis, label, set(label["effects"]))
    if kind == "pairs":
        _score_pair(score, ranking, asserts, label)
        score.exact = exact
        score.parameters = parameter_scores(diagnosis, label, causes & set(label["effects"]))
    if kind == "none":
        score.false_alarm = verdict != "no_gap"
    if kind not in ("none", "outside"):
        score.closed = closed_share(diagnosis) if not failed else 0.0
    score.nominal = nominal_scores(diagnosis, label)
    ahead = number(diagnosis.get("ahead"))
    score.ahead = ahead if math.isfinite(ahead) else None
    _score_statements(score, [entry for entry in ranking if not is_learned(entry["effect"])], label, off)
    score.column = _column(score, ranking, label)
    return score


def _score_one(score: CaseScore, ranking: list[JsonObject], causes: set[str], label: Label, off: set[str]) -> None:
    leading = [entry for entry in ranking if entry["effect"] not in off - single_names(label)]
    first = leading[0] if leading else {"effect": "nothing"}
    score.strict = bool(ranking) and is_first(ranking[0], causes, label)
    score.name = is_first(first, causes, label) or bool(declared(first) & single_names(label))
    score.right = bool(score.name and causes & declared(first))
    score.top3 = score.name or any(entry["effect"] in single_names(label) for entry in leading[:3])


def _score_pair(score: CaseScore, ranking: list[JsonObject], asserts: bool, label: Label) -> None:
    entries = {entry["effect"]: entry for entry in reversed(ranking)}
    classes = [declared(entries.get(cause, {"effect": cause})) for cause in score.asserted]
    sets = [set(one) for one in label["accepted"]]
    names = {name for one in sets for name in one}
    score.both = asserts and any(_covers(one, classes) for one in sets)
    score.one = any(one & names for one in classes)
    leading = [declared(entry) for entry in ranking[:3]]
    score.both_ranked = any(_covers(one, leading) for one in sets if len(one) <= 3)


def _score_statements(score: CaseScore, ranking: list[JsonObject], label: Label, off: set[str]) -> None:
    """The statement at the top, and whether anything that is stated above `SURE`, or asserted, is not there."""
    if not ranking and not score.asserted:
        return
    true = {name for one in label["accepted"] for name in one} | off | set(label.get("also_true", []))
    if label["set"] in EXACT_NOMINAL:
        # A twin that consists of several causes is right only if all are stated; one of them alone is wrong.
        wholes = [set(one) for one in label["accepted"] if len(one) > 1]
        true -= {n for one in wholes if not one <= set(score.asserted) for n in one} - single_names(label)
    entries = {entry["effect"]: entry for entry in reversed(ranking)}
    groups, causes = [frozenset(declared(ranking[0]))] if ranking else [], []
    if score.verdict in ASSERTING:
        causes = [frozenset(declared(entries.get(cause, {"effect": cause}))) for cause in score.asserted]
        score.wrongly_asserted = any(not group & true for group in causes)
        groups += causes
    stated: dict[frozenset[str], float] = {}
    for group in groups:
        total = sum(number(entries[name].get("probability")) for name in group if name in entries)
        stated[group] = min(max(total, 0.0), 1.0) if math.isfinite(total) else 0.0
    if ranking:
        score.probability, score.statement = stated[groups[0]], bool(groups[0] & true)
        if label["effects"]:
            # of a pair either effect
            names = single_names(label) or {name for one in label["accepted"] for name in one}
            score.own = is_first(ranking[0], set(score.asserted), label) or bool(groups[0] & names)
    if score.verdict in ASSERTING:
        # Of several causes each is stated with its probability to be among the causes.
        for cause, group in zip(score.asserted, causes, strict=True):
            among = number(entries.get(cause, {}).get("cause_probability"))
            stated[group] = max(stated[group], among if math.isfinite(among) else 0.0)
    score.surest_wrong = max((p for group, p in stated.items() if not group & true), default=0.0)
    score.sure_statements = sum(p > SURE for p in stated.values())
    score.sure_wrong = sum(p > SURE and not group & true for group, p in stated.items())
    score.wrongly_sure = score.surest_wrong > SURE


def closed_share(diagnosis: Diagnosis) -> float | None:
    """Share of the gap that is closed, as the diagnosis states it."""
    gap = diagnosis.get("gap") or {}
    before, after, floor = (number(gap.get(k)) for k in ("before", "after", "noise_floor"))
    if not (math.isfinite(before) and math.isfinite(after) and math.isfinite(floor) and before > floor):
        return None
    return (before - after) / (before - floor)


def _column(score: CaseScore, ranking: list[JsonObject], label: Label) -> str:
    """Column of the confusion matrix: the first cause asserted, an exact twin as the truth."""
    if score.verdict not in ASSERTING:
        return score.verdict
    name = score.asserted[0] if score.asserted else "unexplained"
    if len(label["effects"]) == 1 and score.right:
        group = set().union(*(declared(e) for e in ranking if e["effect"] == name), {name})
        if group & {one for names in label["accepted"] for one in names}:
            return label["effects"][0]
    return name
