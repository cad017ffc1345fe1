"""Names of result folders made from the names of a user's files: each within its parent folder, and no two the same."""

import collections
import re
import unicodedata
from collections.abc import Sequence

LONGEST = 80  # characters; file systems allow 255 bytes, and in UTF-8 a letter may take four
# Names that Windows reserves for devices, whatever the suffix.
_DEVICES = {"con", "prn", "aux", "nul", *(f"{port}{n}" for port in ("com", "lpt") for n in range(1, 10))}
_KEPT = re.compile(r"[^\w .+=@()\-]+")


def folder_names(files: Sequence[str]) -> list[str]:
    """A folder name for each file: its name without folders and suffix, with characters that every system allows.

    Names that would be the same, also those that differ only in upper and lower case, are numbered: run-1, run-2.

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
    """The name as one part of a path: not empty, not hidden, not "..", not the name of a device."""
    last = re.split(r"[/\\]", unicodedata.normalize("NFC", file))[-1]
    stem = last.rpartition(".")[0] or last
    stem = _KEPT.sub("_", stem)[:LONGEST].strip(" .")
    return f"log_{stem}" if not stem or stem.partition(".")[0].casefold() in _DEVICES else stem
