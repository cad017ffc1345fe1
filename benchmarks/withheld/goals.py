"""The goals' table: every row with its counts, the goal beside it, and whether it is met."""

import statistics
from collections.abc import Iterable
from dataclasses import asdict, dataclass
from typing import Any

from fpjax.output.json_object import JsonObject

from .score import ONE_EFFECT, SURE, CaseScore

KINDS = {"rate": "rate sensor", "both": "rate sensor", "encoder": "encoder only", "derived": "derived velocity"}
FORTIETH = 1 / 40  # half of what statements above 0.95 may miss by their own word


@dataclass(frozen=True)
class Row:
    """One row.

    Attributes:
        name: the question and the logs.
        count: number of cases in which it holds; None for a row of times.
        of: number of cases in which it was asked.
        found: the share [1], or the time [s]; None where no case was asked.
        goal: in words.
        met: None where no case was asked.
    """

    name: str
    count: int | None
    of: int
    found: float | None
    goal: str
    met: bool | None


def goals_table(scores: list[CaseScore]) -> list[JsonObject]:
    """The rows, in the order of the goals that were set for the diagnosis."""

    def some(generator: int | None, sets: Iterable[str], kind: str | None = None) -> list[CaseScore]:
        wanted = set(sets)
        found = [s for s in scores if s.set in wanted and generator in (None, s.generator)]
        return [s for s in found if kind in (None, KINDS[s.sensors])]

    second = "second generator, one effect"
    rows = [at_least(f"{second}, rate sensor: right first", names(some(2, ["single"], "rate sensor")), 0.97)]
    for kind in ("encoder only", "derived velocity"):
        chosen = some(2, ["single"], kind)
        rows.append(at_least(f"{second}, {kind}: right first", names(chosen), 0.95))
        rows.append(at_most(f"{second}, {kind}: wrongly sure", [s.wrongly_sure for s in chosen], 0.0))
    rows.append(at_least(f"{second}, up to 3 % off: right first", names(some(2, ["single_off"])), 0.97))
    rows.append(at_least(f"{second}, as drives record: right first", names(some(2, ["recorded"])), 0.95))
    pairs = some(2, ["pairs"])
    rows.append(at_least("second generator, pairs: both", [s.both for s in pairs], 0.85))
    rows.append(at_least("second generator, pairs: at least one", [s.one for s in pairs], 0.98))
    rows.append(at_most("no gap: false alarms", [s.false_alarm for s in some(None, ["none"])], 0.0))
    outside = some(None, ["outside"])
    rows.append(at_most("outside the vocabulary: wrongly sure", [s.wrongly_sure for s in outside], FORTIETH))
    found = [p for s in scores for p in s.parameters]
    own = [p.covered for p in found if not p.other_form]
    rows.append(within("90 % intervals that hold the truth, own law", own, 0.85, 0.95))
    other = [p.covered for p in found if p.other_form]
    rows.append(at_least("90 % intervals that hold the truth, another form", other, 0.7))
    for set_, words in (("wide", "nominal 10 to 30 % off"), ("starter", "nominal as inspect wrote it")):
        chosen = some(None, [set_])
        rows.append(at_least(f"{words}: right first", names(chosen), 0.95))
        numbers = [n.corrected for s in chosen for n in s.nominal]
        rows.append(at_least(f"{words}: nominal's errors corrected", numbers, 0.95))
    for set_, words, goal in (("single", "singles", 0.99), ("single_off", "3 % off", 0.99)):
        chosen = [s for s in some(1, [set_]) if KINDS[s.sensors] == "rate sensor"]
        rows.append(at_least(f"first generator, {words}: right first", names(chosen), goal))
    rows.append(at_least("first generator, pairs: both", [s.both for s in some(1, ["pairs"])], 0.94))
    encoder = some(1, ["single"], "encoder only")
    rows.append(at_least("first generator, encoder only: right first", names(encoder), 0.97))
    statements = [True] * sum(s.sure_wrong for s in scores)
    statements += [False] * sum(s.sure_statements - s.sure_wrong for s in scores)
    rows.append(at_most(f"statements above {SURE:g} that are wrong", statements, FORTIETH))
    warm = [s.seconds for s in scores if s.seconds is not None and s.warm]
    cold = [s.seconds for s in scores if s.seconds is not None and not s.warm]
    rows.append(seconds("processor seconds a log, median", warm, statistics.median, 6.0))
    rows.append(seconds("processor seconds a log, worst", warm, max, 25.0))
    rows.append(seconds("processor seconds, first log of each kind of sensors, worst", cold, max, 15.0))
    return [asdict(row) for row in rows]


def names(scores: Iterable[CaseScore]) -> list[bool | None]:
    """Whether the right name comes first, of the cases of one effect."""
    return [s.name for s in scores if s.set in ONE_EFFECT]


def _counted(values: Iterable[bool | None]) -> tuple[int, int, float | None]:
    asked = [value for value in values if value is not None]
    return sum(asked), len(asked), sum(asked) / len(asked) if asked else None


def at_least(name: str, values: Iterable[bool | None], goal: float) -> Row:
    """A row whose share is to be large."""
    count, of, share = _counted(values)
    return Row(name, count, of, share, f"{100 * goal:g} %", None if share is None else share >= goal)


def at_most(name: str, values: Iterable[bool | None], goal: float) -> Row:
    """A row whose share is to be small."""
    count, of, share = _counted(values)
    words = "none" if goal == 0 else f"1 in {1 / goal:.0f} at most"
    return Row(name, count, of, share, words, None if share is None else share <= goal)


def within(name: str, values: Iterable[bool | None], low: float, high: float) -> Row:
    """A row whose share is to be in a band."""
    count, of, share = _counted(values)
    words = f"{50 * (low + high):g} +- {50 * (high - low):g} %"
    return Row(name, count, of, share, words, None if share is None else low <= share <= high)


def seconds(name: str, values: list[float], what: Any, goal: float) -> Row:
    """A row of processor times [s]."""
    found = float(what(values)) if values else None
    return Row(name, None, len(values), found, f"{goal:g} s", None if found is None else found <= goal)


def print_goals(rows: list[JsonObject]) -> None:
    """Print the table: counts first."""
    print(f"\n{'':62}{'found':>20}{'':>9}   {'goal':18}")
    for row in rows:
        if row["count"] is None:
            counted = "-" if row["found"] is None else f"{row['found']:.3g} s of {row['of']}"
            percent = ""
        else:
            counted = f"{row['count']} of {row['of']}" if row["of"] else "-"
            percent = "" if row["found"] is None else f"{100 * row['found']:.1f} %"
        met = {True: "met", False: "MISSED", None: "not asked"}[row["met"]]
        print(f"{row['name']:62}{counted:>20}{percent:>9}   {row['goal']:18}{met}")
