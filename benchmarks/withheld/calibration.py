"""Calibration: stated probabilities against the share that was true, in bins and by verdict and lead."""

import itertools
import statistics

from fpjax.output.json_object import JsonObject

from .goals import KINDS
from .score import CaseScore

BINS = (0.0, 0.2, 0.4, 0.6, 0.8, 0.9, 0.95, 1.0)
VERDICTS = ("explained", "partly_explained", "unexplained", "no_gap")
# Bands of `ahead`: share of the evidence over the nominal model that is lost without the leading cause [1].
LEADS = {"clear": (0.4, float("inf")), "between": (0.1, 0.4), "contested": (-float("inf"), 0.1), "not said": None}


def laplace(count: int, of: int) -> float:
    """(k + 1) / (n + 2): the probability that k of n supports, never 0 or 1.

    Laplace's rule of succession, the posterior mean under a uniform prior.
    """
    return (count + 1) / (of + 2)


def calibration(scores: list[CaseScore]) -> list[JsonObject]:
    """Stated probability against the share that was true, in bins; empty bins are left out.

    `right`: an effect of the stated class is truly there (the cause, a twin, clutter, a nominal's error); `named`: it
    is the withheld effect itself, of the cases that have one.
    """
    rows = []
    stated = [(s.probability, s) for s in scores if s.probability is not None and s.statement is not None]
    for low, high in itertools.pairwise(BINS):
        inside = [(p, s) for p, s in stated if low <= p < high or (high == 1.0 and p == 1.0)]
        if not inside:
            continue
        named = [s.own for _, s in inside if s.own is not None]
        there = sum(bool(s.statement) for _, s in inside)
        rows.append(
            {
                "from": low,
                "to": high,
                "stated": statistics.fmean(p for p, _ in inside),
                "right": there / len(inside),
                "count": len(inside),
                "there": there,
                "supported": laplace(there, len(inside)),
                "named": sum(named),
                "named_of": len(named),
            }
        )
    return rows


def lead_of(score: CaseScore) -> str:
    """The band of `LEADS` of a case."""
    if score.ahead is None:
        return "not said"
    return next(word for word, band in LEADS.items() if band and band[0] <= score.ahead < band[1])


def by_verdict(scores: list[CaseScore]) -> list[JsonObject]:
    """Counts of the leading statements by verdict, lead and kind of sensors; rows without a case are left out.

    A log without a gap has no leading cause that could be right: `no_gap` counts whether there was none.
    """
    rows = []
    for verdict, lead, kind in itertools.product(VERDICTS, LEADS, ("all", *dict.fromkeys(KINDS.values()))):
        alike = [s for s in scores if s.verdict == verdict and kind in ("all", KINDS[s.sensors])]
        inside = [s for s in alike if verdict == "no_gap" or lead_of(s) == lead]
        if verdict == "no_gap":
            if lead != "not said":
                continue
            values = {"named": [], "there": [s.set == "none" for s in inside]}
        else:
            values = {
                "named": [s.own for s in inside if s.own is not None],
                "there": [s.statement for s in inside if s.statement is not None],
            }
        if not inside:
            continue
        row: JsonObject = {"verdict": verdict, "lead": "" if verdict == "no_gap" else lead, "sensors": kind}
        for name, found in values.items():
            row |= {name: sum(found), f"{name}_of": len(found), f"{name}_supported": laplace(sum(found), len(found))}
        stated = [s.probability for s in inside if s.probability is not None and verdict != "no_gap"]
        row["stated"] = statistics.fmean(stated) if stated else None
        rows.append(row)
    return rows


def print_by_verdict(rows: list[JsonObject]) -> None:
    """Print the counts, with (k + 1) / (n + 2) in brackets."""
    print(
        f"\nstatements by verdict and lead, (k + 1) / (n + 2) in brackets\n{'verdict':18}{'lead':12}{'logs':18}"
        f"{'mean stated':>12}{'the withheld effect itself':>30}{'truly there':>22}"
    )
    for row in rows:
        stated = "-" if row["stated"] is None else f"{row['stated']:.2f}"
        named, there = (
            f"{row[name]} of {row[f'{name}_of']} ({row[f'{name}_supported']:.2f})" if row[f"{name}_of"] else "-"
            for name in ("named", "there")
        )
        print(f"{row['verdict']:18}{row['lead']:12}{row['sensors']:18}{stated:>12}{named:>30}{there:>22}")


def print_curves(curves: dict[str, list[JsonObject]]) -> None:
    """Print the curves with their counts."""
    for name, rows in curves.items():
        if rows:
            print(
                f"\ncalibration, {name}\n{'stated':>14}{'mean':>8}{'cases':>7}{'truly there':>16}"
                f"{'(k+1)/(n+2)':>13}{'itself':>14}"
            )
        for row in rows:
            print(
                f"{row['from']:6.2f} .. {row['to']:4.2f}{row['stated']:8.2f}{row['count']:7d}"
                f"{row['there']:>7} = {100 * row['right']:4.0f} %{row['supported']:13.2f}"
                f"{row['named']:>8} of {row['named_of']}"
            )
