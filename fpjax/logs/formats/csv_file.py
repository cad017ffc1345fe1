"""Text tables: separated by comma, semicolon, tab or spaces; decimal commas, UTF-8 or UTF-16, with or without header.

The file is read in pieces, so that memory holds only the numbers that are needed and never the whole text.
"""

import itertools
import pathlib
import re
from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from ...errors import InputError
from ..mending.clock import TIME_UNITS, check_window, since_1970
from .cell_numbers import has_decimal_point, number, thousands
from .csv_blocks import has_blocks
from .csv_blocks import read as read_blocks
from .csv_layout import NAME_OF, Layout, find_layout, headings_removed, split, without_end
from .table import RawTable, Request

PIECE = 50_000  # [lines]
LARGE = 400 << 20  # [bytes]: of a larger file only the columns are kept that the log needs
HEAD = 400  # [lines] from which the layout is found
NOT_READ = ("null", "none", "n/a", "na", "-", "--", "---", "#n/a", "nan(ind)", "-nan(ind)", "no value")  # cells
# Empty, these are no columns: one without a name, and LabVIEW's times where it writes none.
UNUSED = re.compile(r"X_Value|column \d+")
FEW_ROWS = 20  # fewer rows than this, and more columns: the table lies on its side
MOST_BROKEN = 0.5  # share of the rows: with more, the file is not a table


def read(path: pathlib.Path, request: Request) -> RawTable:
    """The columns of a text file.

    Raises:
        InputError: for a file without a table of numbers, or that is not text.
    """
    encoding = _encoding(path)
    with path.open(encoding=encoding, errors="replace", newline=None) as stream:
        head = list(itertools.islice(headings_removed(stream), HEAD))
        stream.seek(0)
        lines = headings_removed(stream)
        if has_blocks(head):
            return read_blocks(path, lines, head, request)
        layout = find_layout(head, path.name)
        while True:
            try:
                return _read(itertools.islice(lines, layout.skipped, None), path, layout, request)
            except _DecimalPointError as found:  # below the head: its column is read anew
                layout = replace(layout, pointed=layout.pointed | {found.column})
                stream.seek(0)
                lines = headings_removed(stream)


def _encoding(path: pathlib.Path) -> str:
    with path.open("rb") as stream:
        raw = stream.read(1 << 20)
    if raw.startswith((b"\xff\xfe", b"\xfe\xff")):
        return "utf-16"
    zeros = np.frombuffer(raw[:4096], np.uint8) == 0
    if zeros.any():
        # UTF-16 without a byte order mark: ASCII characters have a zero in every second byte
        for place, name in ((1, "utf-16-le"), (0, "utf-16-be")):
            if zeros.size > 1 and zeros[place::2].mean() > 0.9 and zeros[1 - place :: 2].mean() < 0.1:
                return name
        raise InputError(f"{path.name} is not text (it holds zero bytes): is it a binary log with another suffix?")
    try:
        # up to the last line's end: the piece may cut a character of several bytes
        raw[: raw.rfind(b"\n") + 1].decode("utf-8-sig")
    except UnicodeDecodeError:
        return "latin-1"
    return "utf-8-sig"


class _DecimalPointError(Exception):
    """A column has both 1.234, which was read as an integer in groups, and a number with a decimal point."""

    def __init__(self, column: int):
        super().__init__(column)
        self.column = column


@dataclass
class _Gathered:
    """What was read so far."""

    pieces: list[np.ndarray]  # each of shape (rows, columns)
    rows: int = 0
    broken: int = 0  # rows of another width than the header
    first_broken: str = ""
    kept: int = 0  # rows within the part of the time that is wanted
    span: tuple[float, float] = (np.inf, -np.inf)  # first and last time of the file [s]


def _read(stream: Iterator[str], path: pathlib.Path, layout: Layout, request: Request) -> RawTable:
    warnings = list(layout.notes)
    names = layout.names
    chosen = list(range(len(names)))
    time, factor = "", 1.0
    if request.wanted is not None and (request.cuts or path.stat().st_size > LARGE):
        time, factor, needed = request.wanted(names, layout.units)
        if path.stat().st_size > LARGE:
            chosen = [names.index(name) for name in dict.fromkeys(needed)] or chosen
            if len(chosen) < len(names):
                warnings.append(f"{path.name} is large: of its {len(names)} columns, {len(chosen)} were read.")
    cells = _Cells(layout, chosen)
    found = _Gathered([])
    row = layout.first_row
    for lines in _pieces(stream):
        values = cells.numbers(lines, row, found)
        row += len(lines)
        found.rows += len(values)
        if request.cuts and time:
            stamps = values[:, chosen.index(names.index(time))] * factor
            stamps = stamps * TIME_UNITS.get(since_1970(stamps), 1.0)
            values = values[(stamps >= request.start) & (stamps <= request.stop)]
            found.kept += len(values)
            if (read := stamps[np.isfinite(stamps)]).size:
                found.span = min(found.span[0], read.min()), max(found.span[1], read.max())
        if values.size:
            found.pieces.append(values)
    if found.rows == 0:
        raise InputError(f"{path.name} has a header and no rows: record it again, or name another file.")
    if request.cuts and time and found.kept < found.rows:
        check_window(found.kept, found.span, path.name)
    if layout.headless and found.rows < FEW_ROWS < len(names):
        raise InputError(
            f"{path.name} has {len(names)} cells a line and {found.rows} line{'s' * (found.rows > 1)} of them: a log "
            f"has a line for each sample; write it the other way round."
        )
    if found.broken:
        total = found.rows + found.broken
        if found.broken > MOST_BROKEN * total:
            raise InputError(
                f"{path.name} is not a table: {found.first_broken}, and so do {found.broken} of {total} rows."
            )
        warnings.append(f"{path.name}: {found.broken} of {total} rows were dropped ({found.first_broken}).")
    cells.check_points(found.rows)
    warnings += cells.about_points(path.name)
    columns: dict[str, np.ndarray] = {}
    text: dict[str, str] = {}
    for place, index in enumerate(chosen):
        name, example = names[index], cells.text.get(index)
        if example is not None and cells.words[index] > 0.5 * found.rows:
            if not name.startswith(NAME_OF):
                text[name] = f"column {name} holds {example}, which is not a number"
            continue
        if example is not None and cells.words[index]:
            warnings.append(f"{path.name}: {cells.words[index]} cells of column {name} are not numbers ({example}).")
        column = np.concatenate([piece[:, place] for piece in found.pieces]) if found.pieces else np.zeros(0)
        if not UNUSED.fullmatch(name) or not column.size or not np.isnan(column).all():
            columns[name] = column
    return RawTable(columns, layout.first_row, text, warnings, layout.units, layout.headless, period=layout.period)


def _pieces(stream: Iterator[str]) -> Iterator[list[str]]:
    while lines := list(itertools.islice(stream, PIECE)):
        yield lines


class _Cells:
    """Lines to numbers: by numpy's parser where every cell is a number (ten times faster), else cell by cell."""

    def __init__(self, layout: Layout, chosen: list[int]):
        self.layout, self.chosen = layout, chosen
        self.words = dict.fromkeys(chosen, 0)  # by column: number of cells that are not numbers
        self.text: dict[int, str] = {}  # by column: the first such cell, for the message
        self.known_text: set[int] = set()  # columns that are text throughout: not parsed again
        self.grouped: dict[int, int] = {}  # by column: number of cells such as 1.234, in a file of decimal commas
        self.pointed = set(layout.pointed)  # columns with a decimal point there

    def numbers(self, lines: list[str], row: int, found: _Gathered) -> np.ndarray:
        """The cells, shape (rows, columns), NaN where they are not numbers; rows of another width are dropped."""
        if self.layout.ended:
            lines = [without_end(line) for line in lines]
        plain = [line for line in lines if line.strip()]
        if not plain:
            return np.zeros((0, len(self.chosen)))
        read = [index for index in self.chosen if index not in self.known_text]
        fast = self._fast(plain, read)
        if fast is None:
            return self._careful(lines, row, found)
        if len(read) == len(self.chosen):
            return fast
        values = np.full((len(fast), len(self.chosen)), np.nan)
        values[:, [self.chosen.index(index) for index in read]] = fast
        for index in self.known_text:
            self.words[index] += len(fast)
        return values

    def _fast(self, lines: list[str], columns: list[int]) -> np.ndarray | None:
        layout = self.layout
        every = len(columns) == len(layout.names)
        if layout.decimal_comma and layout.separator == ",":
            return None
        if layout.decimal_comma and any("." in line for line in lines):
            return None  # each cell tells whether its points are between thousands
        if layout.decimal_comma:
            lines = [line.replace(",", ".") for line in lines]
        if layout.trailing:
            lines = [line.rstrip("\r\n").removesuffix(layout.separator or " ") for line in lines]
        try:
            values = np.loadtxt(
                lines, delimiter=layout.separator, ndmin=2, dtype=np.float64, comments=None, quotechar='"',
                usecols=None if every else columns,
            )  # fmt: skip
        except (ValueError, OverflowError):
            return None
        return values if values.shape == (len(lines), len(columns)) else None

    def _careful(self, lines: list[str], row: int, found: _Gathered) -> np.ndarray:
        width, rows = len(self.layout.names), []
        words_before = dict(self.words)
        for place, line in enumerate(lines):
            if not line.strip() or line.lstrip().startswith(("#", "%")):
                continue
            parts = split(line, self.layout.separator)
            if len(parts) == width + 1 and not parts[-1].strip():
                parts = parts[:-1]
            if len(parts) != width or (not self.layout.worded and self._heading(parts)):
                found.broken += 1
                cells = "1 cell" if len(parts) == 1 else f"{len(parts)} cells"
                what = f"{cells} where the header has {width}" if len(parts) != width else "words and no number"
                found.first_broken = found.first_broken or f"row {row + place} has {what}"
                continue
            rows.append([self._cell(index, parts[index].strip(), row + place) for index in self.chosen])
        for index in self.chosen:
            if rows and self.words[index] - words_before[index] == len(rows):
                self.known_text.add(index)
        return np.array(rows, dtype=np.float64).reshape(len(rows), len(self.chosen))

    def _heading(self, parts: list[str]) -> bool:
        """Whether the cells of a row are words, as where another run's header follows."""
        filled = [part.strip() for part in parts if part.strip() and part.strip().lower() not in NOT_READ]
        return bool(filled) and all(number(part, comma=self.layout.decimal_comma) is None for part in filled)

    def _cell(self, index: int, cell: str, row: int) -> float:
        if not cell or cell.lower() in NOT_READ:
            return float("nan")
        value = number(cell, comma=self.layout.decimal_comma)
        if self.layout.decimal_comma:
            value = self._in_groups(index, cell, value)
        if value is None:
            self.words[index] += 1
            self.text.setdefault(index, f"{cell[:30]!r} in row {row}")
            return float("nan")
        return value

    def _in_groups(self, index: int, cell: str, value: float | None) -> float | None:
        """The value of a cell in a file of decimal commas, where 1.234 is an integer unless points are decimal ones."""
        whole = thousands(cell)
        if whole is not None:
            self.grouped[index] = self.grouped.get(index, 0) + 1
        elif has_decimal_point(cell):
            self.pointed.add(index)
        if index in self.grouped and index in self.pointed and index not in self.layout.pointed:
            raise _DecimalPointError(index)
        return value if whole is None or index in self.pointed else whole

    def check_points(self, rows: int) -> None:
        """A column with a point in every cell has three decimals, rather than no number below 1000.

        Args:
            rows: that were read.

        Raises:
            _DecimalPointError: for a column that was read as integers in groups.
        """
        for index, count in self.grouped.items():
            if count == rows and index not in self.layout.pointed:
                raise _DecimalPointError(index)

    def about_points(self, name: str) -> list[str]:
        """A sentence for each column of a file of decimal commas in which points may be either."""
        found = []
        for index in self.grouped:
            column = f"{name}: commas are its decimals, and column {self.layout.names[index]}"
            if index in self.pointed:
                found.append(
                    f"{column} has decimal points: it mixes both, and 1.234 was read as a decimal there. If it is "
                    f"1234, say so with NAME*1000 in --columns."
                )
        return found
