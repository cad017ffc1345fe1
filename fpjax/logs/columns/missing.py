"""Missing: what is said of columns that a file lacks, with the nearest names that it has."""

import difflib
import re

MOST_COMPARED = 400  # names that a misspelt one is compared with
LIKE_A_WORD = 0.58  # difflib's ratio: "tork" is near enough to "torque"


def missing_sentence(names: list[str], lacking: list[str], where: str) -> str:
    """The error sentence for a log that lacks columns, with the nearest names in the file."""
    hints = []
    lower = {name.lower(): name for name in names[:MOST_COMPARED]}
    for canonical in lacking:
        for word in canonical.split(" or "):
            # word by word: of the whole name, "pi_time" would have enough letters in common with "position"
            likeness = {
                name: max(
                    (difflib.SequenceMatcher(None, word, p).ratio() for p in re.split(r"[^a-z]+", name) if len(p) > 2),
                    default=0.0,
                )
                for name in lower
            }
            near = max(likeness, key=lambda name: likeness[name], default="")
            if near and likeness[near] >= LIKE_A_WORD and f"={lower[near]}" not in "".join(hints):
                hints.append(f"{word}={lower[near]}")
    fix = f"--columns {','.join(hints)}" if hints else f"--columns {lacking[0].split(' or ')[0]}=NAME:UNIT"
    # a log with one row per period may have no stamps at all
    rate = "; if it has no stamps, give its rows per second with --rate" if "time" in lacking else ""
    return (
        f"{where} has no column {' and no column '.join(lacking)}: it has {listed(names)}; "
        f"if one of them is meant, say so with {fix}{' (guessed from the names)' if hints else ''}{rate}."
    )


def listed(names: list[str], most: int = 12) -> str:
    """Names as a readable list for a message: at most `most` of them, long ones shortened."""
    shown = ", ".join(name if len(name) <= 40 else f"{name[:37]}..." for name in names[:most])
    return f"{shown} and {len(names) - most} more" if len(names) > most else shown or "no columns at all"
