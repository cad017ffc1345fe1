"""Scores: the share of the possible improvement that was reached, and whether promises hold."""

import math
from collections.abc import Callable, Sequence

import numpy as np

from fpjax.output.json_object import JsonObject

# Goals: median share of the possible improvement; relative increase of the error that counts as worse; share of
# promised 90 % intervals that hold the truth.
WON, WORSE, INTERVALS = 0.9, 0.02, (0.85, 0.95)
# Relative improvement that the best gains in the truth must bring for the machine to count: below it a share is noise.
NOTHING = 0.02

Row = JsonObject


def share_won(row: Row) -> float | None:
    """(a - b) / (a - c) [1], errors with the gains of the nominal model (a), of `improve` (b), best in the truth (c).

    None where there was nothing to win, or c was not searched.
    """
    nominal, ours, best = row["error_nominal"], row["error_improve"], row["error_truth"]
    if best is None:
        return None
    if not math.isfinite(nominal):
        return 1.0 if math.isfinite(ours) else 0.0
    if nominal - best <= NOTHING * nominal:
        return None
    return (nominal - ours) / (nominal - best) if math.isfinite(ours) else -math.inf


def worse(row: Row) -> bool:
    """Whether the gains of `improve` are worse than the nominal model's by more than 2 %."""
    return row["error_improve"] > (1.0 + WORSE) * row["error_nominal"]


def within_limits(row: Row) -> bool | None:
    """Whether the nominal model's gains keep, in the truth, the limits of the torque that `improve` keeps; None where
    that was not measured.

    The nominal model knows no missing friction, so its gains may ask for a larger or rougher torque than they were
    allowed, and follow better for it.
    """
    allowed = row.get("of_allowed", {}).get("nominal")
    return None if not allowed else max(allowed.values()) <= 1.0 + WORSE


def told_so(row: Row) -> bool | None:
    """Whether `improve` said that the nominal model's gains follow better, and what speaks against them; None where it
    did not judge them.
    """
    told = row.get("told")
    return None if told is None else bool(told["objection"]) and (told["ratio"]["value"] or math.inf) < 1.0


def held(row: Row) -> bool | None:
    """Whether the truth lies within the predicted interval; None where there is none."""
    low, high = row["promised"]
    return None if low is None else bool(low <= row["error_improve"] <= high)


def table(rows: Sequence[Row], group: Callable[[Row], str]) -> list[Row]:
    """One row for each group: machines, median share won, number worse, intervals that hold, changes proposed."""
    found = []
    for name in sorted({group(row) for row in rows}):
        some = [row for row in rows if group(row) == name]
        won = [share for row in some if (share := share_won(row)) is not None]
        promises = [kept for row in some if (kept := held(row)) is not None]
        found.append(
            {
                "group": name,
                "machines": len(some),
                "something to win": len(won),
                "won, median": float(np.median(won)) if won else None,
                "won, least": float(np.min(won)) if won else None,
                "worse by over 2 %": sum(worse(row) for row in some),
                "promises": len(promises),
                "intervals held": float(np.mean(promises)) if promises else None,
                "changes": sum(row["decision"] == "change" for row in some),
            }
        )
    return found


def goals(rows: Sequence[Row]) -> list[tuple[str, str, str, str]]:
    """(goal, wanted, found, met or not) over all machines."""
    (all_of,) = table(rows, lambda row: "all")
    unexplained = [row for row in rows if row["verdict"] == "unexplained"]
    lost = sum(row["error_improve"] > (1.0 + WORSE) * row["error_now"] for row in unexplained)
    fair = [row for row in rows if within_limits(row)]
    against = sum(worse(row) for row in fair)
    silent = [row for row in rows if worse(row) and not told_so(row)]
    # Of a log that it does not explain `improve` expects an error, and says that it does not promise it.
    won, low, high = all_of["won, median"], *INTERVALS
    promised = _share_held([row for row in rows if row["verdict"] != "unexplained"])

    def met(value: bool | None) -> str:
        return "not measured" if value is None else "met" if value else "not met"

    return [
        ("share of what is possible, median", f"{WON:.0%}", _percent(won), met(None if won is None else won >= WON)),
        ("worse than the nominal gains by over 2 %", "none", f"{all_of['worse by over 2 %']} of {len(rows)}",
         met(all_of["worse by over 2 %"] == 0)),
        ("of these, against gains that keep improve's limits of torque", "none",
         f"{against} of {len(fair)}", met(against == 0 if fair else None)),
        ("of these, and improve did not say what speaks against them", "none",
         f"{len(silent)} of {len(rows)}", met(not silent)),
        ("truth within the promised 90 % interval", f"{low:.0%} to {high:.0%}", _percent(promised),
         met(None if promised is None else low <= promised <= high)),
        ("... within what is expected of unexplained logs, not promised", "told",
         _percent(_share_held(unexplained)), "no goal"),
        ("unexplained logs worse than with the gains that ran", "none",
         f"{lost} of {len(unexplained)}", met(lost == 0 if unexplained else None)),
    ]  # fmt: skip


def _share_held(rows: Sequence[Row]) -> float | None:
    found = [kept for row in rows if (kept := held(row)) is not None]
    return float(np.mean(found)) if found else None


def _percent(value: float | None) -> str:
    return "none" if value is None else f"{value:.0%}"
