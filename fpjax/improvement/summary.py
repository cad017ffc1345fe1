"""An improvement as lines of text."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from .answer import Answer

WORDS = {
    "change": "Change these gains.",
    "keep": "Keep your gains.",
    "cannot_promise": "No prediction is possible.",
    "unstable": "The likeliest model is unstable.",
}

UNPROMISED = {"change": "expected", "keep": "expected", "cannot_promise": "possible"}


def summary(found: Answer) -> str:
    """The decision, what changes, and what is predicted before and after."""
    lines = [headline(found), ""]
    if found.changes:
        header = ("gain", "before", "after", "bounds")
        rows = [(c.gain, f"{c.before:.5g}", f"{c.after:.5g}", f"{c.low:.4g} to {c.high:.4g}") for c in found.changes]
        lines += [*_table([header, *rows]), ""]
    if found.decision != "unstable":  # of which every number would be infinite
        name = "predicted, 90 % interval" if found.promised else f"{UNPROMISED[found.decision]}, not promised"
        if found.decision == "change":
            lines += _table([(name, "before", "after"), *predicted(found)])
        else:
            lines += _table([(name, "with your gains"), *(row[:2] for row in predicted(found))])
    if found.measured is not None:
        lines += ["", f"  measured in the log with the gains before: {found.measured:.4g} {found.before.error.unit}"]
    lines += [f"  note: {note}" for note in found.notes]
    return "\n".join(lines)


def headline(found: Answer) -> str:
    """The decision in one sentence or two."""
    word = WORDS[found.decision]
    return found.reason if found.reason.startswith(word.rstrip(".")) else f"{word} {found.reason}"


def predicted(found: Answer) -> list[tuple[str, str, str]]:
    """(quantity, before, after), as text."""
    after = dict(found.after.rows())
    return [(name, str(value), str(after[name]) if name in after else "") for name, value in found.before.rows()]


def _table(rows: list[tuple[str, ...]]) -> list[str]:
    width = [max(len(row[i]) for row in rows) for i in range(len(rows[0]))]
    lines = ["  " + "  ".join(cell.ljust(width[i]) for i, cell in enumerate(row)).rstrip() for row in rows]
    return [lines[0], "  " + "  ".join("-" * each for each in width), *lines[1:]]
