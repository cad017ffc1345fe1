"""Layout of a text table: its separator, its header, a row of units, and the line where the numbers begin."""

import csv
import re
from collections import Counter
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field, replace

from ...errors import InputError
from ..columns.names import bracket_unit
from ..columns.units import find_unit
from ..mending.clock import SLOW
from .cell_numbers import has_decimal_comma, has_decimal_point, number

NAME_OF = "name of "  # begins the name of a column that only repeats another one's name
_REMARKS = ("comment", "comments", "kommentar", "remark")  # a last column that most rows leave out
_SAMPLING = re.compile(
    r"^\W*(?P<what>(?:(?:sampl|abtast)\w*[ _-]*(?:time|period|interval|step|rate|freq|zeit|takt)[a-z _-]*"
    r"|delta_?[xt]|interval|increment|x_?inc\w*|time[_ ]?step))\s*"
    r"(?P<inner>[\[(][^\])]*[\])])?\s*(?:is|=|:)?\s*(?P<number>[-+]?\d[\d.,]*(?:[eE][-+]?\d+)?)"
    r"\s*(?P<unit>[a-zA-Zµμ/]*)\W*$",
    re.IGNORECASE,
)
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
        period: between two rows [s], where the preamble tells it.
        pointed: places of the columns whose points are decimal ones, though commas are in the others.
        worded: whether the first column holds words; a row that begins with one in another table is a heading.
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
    period: float | None = None
    worded: bool = True
    pointed: frozenset[int] = frozenset()

    @property
    def first_row(self) -> int:
        """The line number of the first row of numbers."""
        return self.skipped + 1


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


# "12:01:02.003 -> ", before every line that Arduino's serial monitor shows
_RECEIVED = re.compile(r"^\s*\d{1,2}:\d{2}:\d{2}(?:[.,]\d+)?\s*->\s?")


def headings_removed(lines: Iterable[str]) -> Iterator[str]:
    """Lines without what recorders put between or before the rows of a table.

    LabVIEW repeats the heading of its measurement files before every segment. Arduino's serial monitor writes before
    each line when it came, which is later than the board's own stamps by what the line waited.
    """
    recorded, segments, heading = False, 0, False
    for place, line in enumerate(lines):
        recorded = line.startswith("LabVIEW Measurement") if place == 0 else recorded
        if not recorded:
            yield _RECEIVED.sub("", line) if "->" in line else line
            continue
        if line.startswith("Channels\t"):
            segments += 1
            heading = segments > 1
        if not heading:
            yield line
        heading = heading and not line.startswith("X_Value")


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
    widths = {bool(parts[-1]): len(parts) for parts in rows if len(parts) > 1 and _numeric(parts) >= 0.5}
    return len(widths) == 2 and widths[True] == widths[False]


def _numeric(parts: list[str]) -> float:
    """Share of a row's filled cells that are numbers."""
    filled = [part for part in parts if part]
    return sum(number(part, comma=True) is not None for part in filled) / max(len(filled), 1)


def _word(part: str) -> bool:
    return bool(part) and number(part, comma=True) is None


def _first_numbers(lines: list[str], filled: list[int], separator: str | None) -> tuple[int, float] | None:
    """(line of the first row of numbers, share of numbers in the rows from there), or None."""
    count = _last_cells_count([lines[place] for place in filled], separator)
    rows = {place: _cells(lines[place], separator, all_of_them=count) for place in filled}
    widths = Counter(len(parts) for place, parts in rows.items() if _numeric(parts) >= 0.5)
    widths.pop(1, None)
    if not widths:
        return None
    width = max(widths, key=lambda each: (widths[each], each))
    table = [place for place in filled if len(rows[place]) == width and _numeric(rows[place]) >= 0.5]
    # A line of a preamble may hold numbers too ("Record Length,4000"), but has words where the table has none.
    worded = [sum(_word(rows[place][at]) for place in table) > 0.5 * len(table) for at in range(width)]
    whole = [
        place
        for place in table
        if not any(_word(part) for part, usual in zip(rows[place], worded, strict=True) if not usual)
    ]
    table = whole if len(whole) > 1 else table
    # and the table begins where two such lines follow each other
    first = next(
        (place for place, after in zip(table, [*table[1:], table[-1]], strict=True) if after - place <= 1), table[0]
    )
    kept = [place for place in filled if place >= first]
    share = sum(_numeric(rows[place]) for place in kept if len(rows[place]) == width) / len(kept)
    return first, share


def _with_header(lines: list[str], filled: list[int], separator: str | None, first: int, name: str) -> Layout:
    count = _last_cells_count([lines[place] for place in filled], separator)
    width = len(_cells(lines[first], separator, all_of_them=count))
    above = [place for place in filled if place < first]
    units: list[str] = []
    header: list[str] | None = None
    # from the first row of numbers upwards: an optional row of units, then the header, or these two the other way round
    for place in reversed(above[-3:]):
        parts = _cells(_uncommented(lines[place]), separator, all_of_them=True)
        if len(parts) == width and _numeric(parts) > 0.5:
            continue  # a row of the table in which a word stands
        parts = _heading_cells(lines[place], separator, width)
        if parts is None:
            break
        if not units and _are_units(parts) and place != above[0]:
            units = [part.strip("[]()") for part in parts]
            continue
        header = parts
        before = filled[filled.index(place) - 1] if place != above[0] else None
        if not units and before is not None and all(bracket_unit(part)[1] is None for part in parts):
            units = _units_above(_heading_cells(lines[before], separator, width))
        break
    body = [lines[place] for place in filled if place >= first]
    cells = [_cells(line, separator, all_of_them=count) for line in body]
    comma = has_decimal_comma((cell for row in cells for cell in row), separator)
    columns = enumerate(zip(*(row for row in cells if len(row) == width), strict=True)) if comma else ()
    pointed = frozenset(place for place, column in columns if any(map(has_decimal_point, column)))
    trailing = all(line.rstrip("\r\n").endswith(separator) for line in body) if separator else False
    notes: list[str] = []
    period, labelled = _of_preamble([_cells(lines[place], separator) for place in above], width)
    if header is None:
        header = _named_beside(cells, width)
    names = [str(index + 1) for index in range(width)] if header is None else _unique(header, name, notes)
    units = units or labelled
    return Layout(
        separator, names, {key: unit for key, unit in zip(names, units, strict=False) if unit}, first, comma, trailing,
        header is None, tuple(notes), period=period, worded=_word(cells[0][0]), pointed=pointed,
    )  # fmt: skip


def _uncommented(line: str) -> str:
    return line.strip().lstrip("#%").strip()


def _heading_cells(line: str, separator: str | None, width: int) -> list[str] | None:
    """The cells of a row of names or of units, one for each column; None where it is of another width."""
    line = _uncommented(line)
    parts = _cells(line, separator, all_of_them=True)
    parts = [part.strip('"').strip() for part in (parts if len(parts) == width else _cells(line, separator))]
    if len(parts) > width and len(named := [part for part in parts if part]) == width:
        parts = named  # two separators between the names, one between the numbers
    if len(parts) == width + 1 and parts[-1].lower() in _REMARKS:
        parts = parts[:-1]
    if len(parts) != width and separator is None:
        parts = [part.strip() for part in line.split(",")]
    return parts if len(parts) == width else None


def _units_above(parts: list[str] | None) -> list[str]:
    """The units of a row above the names; none where one of its filled cells is no unit: a title, or other names."""
    if parts is None or not _are_units(parts):
        return []
    units = [part.strip("[]()") for part in parts]
    return units if all(not unit.strip("-# ") or find_unit(unit) is not None for unit in units) else []


def _of_preamble(rows: list[list[str]], width: int) -> tuple[float | None, list[str]]:
    """(period between two rows [s], None where no line tells it; units by column from a line that begins with one)."""
    period, units = None, []
    for row in rows:
        period = sampling_period(row) if period is None else period
        if len(row) in (width, width + 1) and re.search(r"unit|einheit", row[0], re.IGNORECASE):
            units = ["", *(part if find_unit(part) is not None else "" for part in row[1:width])]
    return period, units


def sampling_period(row: list[str]) -> float | None:
    """Period [s] that a line of a preamble tells: "Sampling time interval(ms);0.667", "Sample rate: 1000 Hz"; or None.

    Args:
        row: the line's cells.
    """
    # the unit stands in brackets behind the words, or behind the number
    found = _SAMPLING.match(" ".join(row[:2])) or _SAMPLING.match(" ".join(row))
    if found is None:
        return None
    unit = (found["inner"] or found["unit"] or "").strip("[]()")
    if rate := re.search(r"rate|freq", found["what"], re.IGNORECASE):
        size = {"": 1.0, "hz": 1.0, "khz": 1e3, "s/s": 1.0}.get(unit.lower())
    else:
        scale = find_unit(unit) if unit else None
        size = scale.factor if scale is not None and scale.quantity == "time" else None if unit else 1.0
    # 1,000 is a thousand or one: no servo's log has a period as long as that of the wrong reading.
    values = [number(found["number"], comma=comma) for comma in (False, True)]
    periods = [1.0 / (size * v) if rate else size * v for v in values if v is not None and v > 0.0 and size is not None]
    likely = [period for period in periods if period < SLOW]
    return likely[0] if likely else periods[0] if periods and unit else None


def _named_beside(rows: list[list[str]], width: int) -> list[str] | None:
    """Names of columns whose name stands before the number in every row, as in LinuxCNC's halscope; None without."""
    whole = [row for row in rows if len(row) == width]
    if width < 4 or width % 2 or not all(_word(part) for part in whole[0][::2]):
        return None
    if any(row[::2] != whole[0][::2] for row in whole):
        return None
    return [each for word in whole[0][::2] for each in (NAME_OF + word, word)]


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
