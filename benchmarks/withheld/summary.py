"""Figures of groups of scored cases, of the rows of the goals' table, and of all cases together."""

import statistics
from collections.abc import Iterable

from fpjax.output.json_object import JsonObject

from .calibration import by_verdict, calibration
from .goals import KINDS, goals_table
from .score import ASSERTING, ONE_EFFECT, SURE, CaseScore, ParameterScore


def share(values: Iterable[bool | None]) -> float | None:
    """Share of the values that is true, None left out [1]."""
    asked = [value for value in values if value is not None]
    return sum(asked) / len(asked) if asked else None


def brier(scores: list[CaseScore]) -> float | None:
    """Mean squared difference of the stated probability and what was true."""
    terms = [
        (s.probability - float(s.statement)) ** 2
        for s in scores
        if s.probability is not None and s.statement is not None
    ]
    return statistics.fmean(terms) if terms else None


def parameters(scores: Iterable[ParameterScore]) -> JsonObject:
    """Median and 90th percentile of the relative error, coverage of the 90 % intervals."""
    scores = list(scores)
    errors = sorted(s.relative_error for s in scores)
    same, other = [s for s in scores if not s.other_form], [s for s in scores if s.other_form]
    return {
        "count": len(scores),
        "median_error": statistics.median(errors) if errors else None,
        "p90_error": errors[min(len(errors) - 1, int(0.9 * len(errors)))] if errors else None,
        "coverage": share(s.covered for s in scores),
        "coverage_same_law": share(s.covered for s in same),
        "count_same_law": len(same),
        "coverage_other_form": share(s.covered for s in other),
        "count_other_form": len(other),
    }


def times(scores: list[CaseScore]) -> JsonObject:
    """Processor seconds a log, warm calls only, with the first calls of a process apart."""
    warm = [s.seconds for s in scores if s.seconds is not None and s.warm]
    cold = [s.seconds for s in scores if s.seconds is not None and not s.warm]
    return {
        "median": statistics.median(warm) if warm else None,
        "worst": max(warm) if warm else None,
        "count": len(warm),
        "first_calls": cold,
    }


def summary_of(scores: list[CaseScore]) -> JsonObject:
    """Every figure of a group of cases; None where its sets do not ask."""
    closed = [s.closed for s in scores if s.closed is not None]
    nominal = [n for s in scores for n in s.nominal]
    return {
        "cases": len(scores),
        "name": share(s.name for s in scores),
        "right": share(s.right for s in scores),
        "strict": share(s.strict for s in scores),
        "top3": share(s.top3 for s in scores),
        "exact_causes": share(s.exact for s in scores),
        "both": share(s.both for s in scores),
        "at_least_one": share(s.one for s in scores),
        "both_in_first_three": share(s.both_ranked for s in scores),
        "false_alarms": share(s.false_alarm for s in scores),
        "wrongly_asserted": share(s.wrongly_asserted for s in scores),
        "wrongly_sure": share(s.wrongly_sure for s in scores),
        "wrongly_sure_count": sum(s.wrongly_sure for s in scores),
        "verdicts": {verdict: sum(s.verdict == verdict for s in scores) for verdict in VERDICTS},
        "nominal_named": share(n.named for n in nominal),
        "nominal_corrected": share(n.corrected for n in nominal),
        "nominal_count": len(nominal),
        "brier": brier(scores),
        "statements": sum(s.probability is not None for s in scores),
        "sure_statements": sum(s.sure_statements for s in scores),
        "gap_closed": statistics.median(closed) if closed else None,
        "parameters": parameters(p for s in scores for p in s.parameters),
        "time": times(scores),
        "failed": sum(s.verdict == "failed" for s in scores),
    }


VERDICTS = (*ASSERTING, "unexplained", "no_gap", "failed")


def summarise(scores: list[CaseScore]) -> JsonObject:
    """The content of `withheld.json`, but for provenance."""
    # In a pair the two main-cause probabilities share at most 1: they are not calibrated as those of single effects.
    judged = [s for s in scores if s.set != "pairs"]
    effects = sorted({s.truth for s in scores if s.set in ONE_EFFECT})
    kinds = dict.fromkeys(KINDS.values())
    by_kind = {kind: [s for s in judged if KINDS[s.sensors] == kind] for kind in kinds}
    curves = {"all": calibration(judged)}
    curves |= {kind: calibration(some) for kind, some in by_kind.items() if some}
    ways = dict.fromkeys(s.recording for s in scores if s.recording)
    return {
        "goals": goals_table(scores),
        "statements": by_verdict(judged),
        "recordings": {way: summary_of([s for s in scores if s.recording == way]) for way in ways},
        "groups": {
            name: summary_of([s for s in scores if s.group == name]) for name in dict.fromkeys(s.group for s in scores)
        },
        "all": summary_of(scores),
        "systems": {
            name: summary_of([s for s in scores if s.system == name])
            for name in dict.fromkeys(s.system for s in scores)
        },
        "effects": {
            name: summary_of([s for s in scores if s.set in ONE_EFFECT and s.truth == name]) for name in effects
        },
        "brier": brier(judged),
        "calibration": curves,
        "sure": {"limit": SURE, "statements": sum(s.sure_statements for s in scores),
                 "wrong": sum(s.sure_wrong for s in scores), "wrong_cases": sum(s.wrongly_sure for s in scores)},
        "parameters": parameters(p for s in scores for p in s.parameters),
        "time": times(scores),
        "confusion": confusion([s for s in scores if s.set != "pairs"]),
        "misses": misses(scores),
    }  # fmt: skip


def confusion(scores: list[CaseScore]) -> dict[str, dict[str, int]]:
    """How often each truth was answered by what."""
    table: dict[str, dict[str, int]] = {}
    for score in scores:
        truth = {"none": "no gap", "outside": "outside"}.get(score.set, score.truth)
        row = table.setdefault(truth, {})
        row[score.column] = row.get(score.column, 0) + 1
    return table


def misses(scores: list[CaseScore]) -> list[JsonObject]:
    """Every case that counts against a goal, one line each."""
    result = []
    for s in scores:
        good = s.name if s.set in ONE_EFFECT else s.both if s.set == "pairs" else True
        if s.false_alarm or s.wrongly_sure or s.verdict == "failed":
            good = False
        if not good:
            result.append(
                {
                    "case": s.case,
                    "group": s.group,
                    "system": s.system,
                    "truth": s.truth,
                    "verdict": s.verdict,
                    "causes": s.asserted,
                    "answered": s.column,
                    "right_name": s.name,
                    "wrongly_sure": s.wrongly_sure,
                    "probability": s.probability,
                }
            )
    return result
