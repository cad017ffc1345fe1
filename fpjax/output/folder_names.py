"""Names of folders for results that are named after a user's files: none leaves its parent, and no two are the same."""

import collections
import re
import unicodedata
from collections.abc import Sequence

LONGEST = 80  # characters: file systems allow 255 bytes, and a letter may take four
_DEVICES = {"con", "prn", "aux", "nul", *(f"{port}{n}" for port in ("com", "lpt") for n in range(1, 10))}
_KEPT = re.compile(r"[^\w .+=@()\-]+")


def folder_names(files: Sequence[str]) -> list[str]:
    """A folder's name for each file: its own name without folders and suffix, as far as every system takes it.

    Those that would be the same, also where letters differ by case only, are numbered: run-1, run-2.

    Args:
        files: names or paths.
    """
    stems = [_plain(file) for file in files]
    often = collections.Counter(stem.casefold() for stem in stems)
    found: list[str] = []
    taken: set[str] = set()
    for stem in stems:
        number = 1 if often[stem.casefold()] > 1 else 0
        name = f"{stem}-{number}" if number else stem
        while name.casefold() in taken:
            number += 1
            name = f"{stem}-{number}"
        taken.add(name.casefold())
        found.append(name)
    return found


def _plain(file: str) -> str:
    """One part of a path that is neither empty, nor hidden, nor "..", nor a device's name."""
    last = re.split(r"[/\\]", unicodedata.normalize("NFC", file))[-1]
    stem = last.rpartition(".")[0] or last
    stem = _KEPT.sub("_", stem)[:LONGEST].strip(" .")
    return f"log_{stem}" if not stem or stem.partition(".")[0].casefold() in _DEVICES else stem
