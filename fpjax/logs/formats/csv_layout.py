"""Layout of a text table: its separator, its header, a row of units, and the line where the numbers begin."""

import csv
from collections import Counter
from dataclasses import dataclass, field, replace
from datetime import UTC, datetime

from ...errors import InputError
from ..columns.units import find_unit

SEPARATORS: tuple[str | None, ...] = ("\t", ";", "|", ",", None)  # None: any number of spaces


@dataclass(frozen=True)
class Layout:
    """Layout of a text table.

    Attributes:
        separator: between cells; None for spaces.
        names: of the columns; "1", "2", ... where the file gives none.
        units: by name, from a row of units under the header.
        skipped: lines before the first row of numbers.
        decimal_comma: whether numbers are written 1,5.
        trailing: whether every row ends with a separator.
        headless: whether no line names the columns.
        notes: what was assumed, a sentence each.
        ended: whether rows end with ";" where that separates no cells, as those of a matrix in MATLAB.
    """

    separator: str | None
    names: list[str]
    units: dict[str, str] = field(default_factory=dict)
    skipped: int = 0
    decimal_comma: bool = False
    trailing: bool = False
    headless: bool = False
    notes: tuple[str, ...] = ()
    ended: bool = False

    @property
    def first_row(self) -> int:
        """The line number of the first row of numbers."""
        return self.skipped + 1


def number(cell: str, *, comma: bool) -> float | None:
    """The number in a cell, or None. A date or a time of day is given in seconds.

    Args:
        cell: text of the cell.
        comma: whether 1,5 is one and a half (decimal comma) and 1.000,5 has a thousands separator.
    """
    if "_" in cell:  # python reads 1_0 as ten
        return None
    try:
        return float(cell)
    except ValueError:
        if comma and cell.count(",") == 1:
            return number(cell.replace(".", "").replace(",", "."), comma=False)
        if cell.count(":") >= 2:
            return _clock(cell)
        return {"true": 1.0, "false": 0.0}.get(cell.lower())


def _clock(cell: str) -> float | None:
    """Seconds of "2025-11-09T09:27:03.748Z" (since 1970) or "09:27:03.748" (since midnight), or None."""
    text = cell.strip().strip('"').replace(",", ".")
    try:
        if "-" in text or "/" in text:
            moment = datetime.fromisoformat(text.replace("/", "-"))
            return (moment if moment.tzinfo else moment.replace(tzinfo=UTC)).timestamp()
        hours, minutes, seconds = text.split(":")
        return 3600.0 * int(hours) + 60.0 * int(minutes) + float(seconds)
    except ValueError:
        return None


def split(line: str, separator: str | None) -> list[str]:
    """The cells of a line."""
    line = line.rstrip("\r\n")
    if separator is None:
        return line.split()
    if '"' in line:
        try:
            return next(csv.reader([line], delimiter=separator, skipinitialspace=True), [])
        except csv.Error:
            pass
    return line.split(separator)


def find_layout(lines: list[str], name: str) -> Layout:
    """The layout with which the largest share of the first lines is a table of numbers.

    Args:
        lines: the first lines of the file.
        name: of the file, for messages.

    Raises:
        InputError: where no line is a row of numbers.
    """
    filled = [place for place, line in enumerate(lines) if line.strip()]
    if not filled:
        raise InputError(f"{name} holds no rows: record it again, or name another file.")
    ended = sum(_is_ended(lines[place]) for place in filled) > 0.5 * len(filled)
    if ended:
        lines = [without_end(line) for line in lines]
    best: tuple[float, int, str | None, int] | None = None
    # Every separator is tried. Of two that explain the lines equally well the earlier one in SEPARATORS wins: with
    # decimal commas a line "1,5;2,5" has numbers between commas as well.
    for rank, separator in enumerate(SEPARATORS):
        found = _first_numbers(lines, filled, separator)
        if found is not None:
            place, share = found
            if best is None or share > best[0] + 1e-9:
                best = (share, -rank, separator, place)
    if best is None:
        if len(filled) == 1 or any(len(split(lines[filled[-1]], each)) > 1 for each in SEPARATORS[:4]):
            raise InputError(f"{name} has a header and no rows of numbers: record it again, or name another file.")
        raise InputError(f"{name} holds no table of numbers: give columns such as time,torque,velocity.")
    _, _, separator, first = best
    return replace(_with_header(lines, filled, separator, first, name), ended=ended)


def _is_ended(line: str) -> bool:
    return line.rstrip().endswith(";") and line.count(";") == 1


def without_end(line: str) -> str:
    """A line without the ";" that ends it."""
    return line.rstrip().removesuffix(";") if _is_ended(line) else line


def _cells(line: str, separator: str | None, *, all_of_them: bool = False) -> list[str]:
    """The cells of a line; an empty last one is dropped, since it comes from a separator at the end of the line."""
    parts = [part.strip() for part in split(line, separator)]
    return parts[:-1] if len(parts) > 1 and not parts[-1] and not all_of_them else parts


def _last_cells_count(lines: list[str], separator: str | None) -> bool:
    """Whether an empty last cell is a missing value: other rows of as many cells have a number there."""
    if separator is None:
        return False
    rows = [[part.strip() for part in split(line, separator)] for line in lines]
    widths = {bool(parts[-1]): len(parts) for parts in rows if len(parts) > 1 and _numeric(parts, separator) >= 0.5}
    return len(widths) == 2 and widths[True] == widths[False]


def _numeric(parts: list[str], separator: str | None) -> float:
    """Share of a row's filled cells that are numbers."""
    filled = [part for part in parts if part]
    return sum(number(part, comma=separator != ",") is not None for part in filled) / max(len(filled), 1)


def _first_numbers(lines: list[str], filled: list[int], separator: str | None) -> tuple[int, float] | None:
    """(line of the first row of numbers, share of numbers in the rows from there), or None."""
    count = _last_cells_count([lines[place] for place in filled], separator)
    rows = {place: _cells(lines[place], separator, all_of_them=count) for place in filled}
    widths = Counter(len(parts) for place, parts in rows.items() if _numeric(parts, separator) >= 0.5)
    widths.pop(1, None)
    if not widths:
        return None
    width = max(widths, key=lambda each: (widths[each], each))
    table = [place for place in filled if len(rows[place]) == width and _numeric(rows[place], separator) >= 0.5]
    # a line of a preamble may hold numbers too: the table begins where two such lines follow each other
    first = next(
        (place for place, after in zip(table, [*table[1:], table[-1]], strict=True) if after - place <= 1), table[0]
    )
    kept = [place for place in filled if place >= first]
    share = sum(_numeric(rows[place], separator) for place in kept if len(rows[place]) == width) / len(kept)
    return first, share


def _with_header(lines: list[str], filled: list[int], separator: str | None, first: int, name: str) -> Layout:
    count = _last_cells_count([lines[place] for place in filled], separator)
    width = len(_cells(lines[first], separator, all_of_them=count))
    above = [place for place in filled if place < first]
    units: list[str] = []
    header: list[str] | None = None
    # from the first row of numbers upwards: an optional row of units, then the header
    for place in reversed(above[-3:]):
        line = lines[place].strip()
        parts = [part.strip().strip('"').strip() for part in _cells(line.lstrip("#%").strip(), separator)]
        if len(parts) > width and len(named := [part for part in parts if part]) == width:
            parts = named  # two separators between the names, one between the numbers
        if len(parts) != width and separator is None:
            parts = [part.strip() for part in line.lstrip("#%").strip().split(",")]
        if len(parts) != width:
            break
        if not units and _are_units(parts) and place != above[0]:
            units = [part.strip("[]()") for part in parts]
            continue
        header = parts
        break
    body = [lines[place] for place in filled if place >= first]
    comma = separator != "," and any("," in line for line in body)
    trailing = all(line.rstrip("\r\n").endswith(separator) for line in body) if separator else False
    notes: list[str] = []
    names = [str(index + 1) for index in range(width)] if header is None else _unique(header, name, notes)
    return Layout(
        separator, names, {key: unit for key, unit in zip(names, units, strict=False) if unit}, first, comma, trailing,
        header is None, tuple(notes),
    )  # fmt: skip


def _are_units(parts: list[str]) -> bool:
    if all(part[:1] + part[-1:] == "[]" for part in parts):  # "[#],[V],[turns]": brackets alone make names of none
        return any(find_unit(part.strip("[]")) is not None for part in parts)
    known = [part for part in parts if part.strip("[]()-") and find_unit(part.strip("[]()")) is not None]
    return len(known) >= 2 and all(
        part in known or not part.strip("[]()- ") or part.lower() == "none" for part in parts
    )


def _unique(header: list[str], name: str, notes: list[str]) -> list[str]:
    """The header with repeated names made unique by a number ("x", "x#2")."""
    names: list[str] = []
    seen: Counter[str] = Counter()
    for index, word in enumerate(header):
        word = word or f"column {index + 1}"
        seen[word] += 1
        names.append(word if seen[word] == 1 else f"{word}#{seen[word]}")
    twice = [word for word, count in seen.items() if count > 1]
    if twice:
        notes.append(
            f"{name} names column {twice[0]!r} {seen[twice[0]]} times: the later ones are {twice[0]}#2 and so on."
        )
    return names
