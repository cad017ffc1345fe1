"""CSV with a header: any of , ; tab as the separator, decimal commas under ;, one clear sentence for what is broken."""

import csv
import io
import pathlib
from collections.abc import Mapping

import numpy as np

from ..errors import InputError
from .table import Table


def read(path: pathlib.Path, wanted: Mapping[str, str]) -> Table:
    """The columns of a CSV file.

    Raises:
        InputError: for a file without a header, with broken rows, or that is no text.
    """
    del wanted
    raw = path.read_bytes()
    if b"\x00" in raw[:4096]:
        raise InputError(f"{path.name} is not text (it holds zero bytes): is it a binary log with another suffix?")
    try:
        text = raw.decode("utf-8-sig")
    except UnicodeDecodeError:
        text = raw.decode("latin-1")
    lines = text.splitlines()
    skipped = 0
    while skipped < len(lines) and (not lines[skipped].strip() or _is_comment(lines, skipped)):
        skipped += 1
    if skipped == len(lines):
        raise InputError(f"{path.name} holds no rows: record it again, or name another file.")
    separator = _separator(lines[skipped])
    header = [name.strip().strip('"').strip() for name in lines[skipped].lstrip("#% ").split(separator)]
    if header and header[-1] == "":  # a trailing separator
        header = header[:-1]
    if all(_number(name) is not None for name in header):
        raise InputError(
            f"{path.name} has no header: its first row is numbers; put a first line with the columns' names, "
            f"such as time,torque,velocity."
        )
    twice = sorted({name for name in header if header.count(name) > 1})
    if twice:
        raise InputError(f"{path.name} names column {twice[0]!r} twice: rename one of them.")
    body = "\n".join(lines[skipped + 1 :])
    if not body.strip():
        raise InputError(f"{path.name} has a header and no rows: record it again, or name another file.")
    first_row = skipped + 2
    fast = _fast(body, separator, len(header))
    if fast is not None:
        return Table(dict(zip(header, fast.T.copy(), strict=True)), first_row)
    return _careful(path, body, separator, header, first_row)


def _is_comment(lines: list[str], index: int) -> bool:
    """A line of # that is not itself the header (the header may start with #)."""
    line = lines[index].strip()
    if not line.startswith(("#", "%")):
        return False
    follows = next((other.strip() for other in lines[index + 1 :] if other.strip()), "")
    if follows.startswith(("#", "%")):
        return True
    separator = _separator(line)
    is_header = bool(follows) and line.count(separator) == follows.count(separator) and separator in line
    return not (is_header and all(_number(cell) is not None for cell in follows.split(separator)))


def _separator(line: str) -> str:
    counts = {separator: line.count(separator) for separator in (";", "\t", ",")}
    best = max(counts, key=lambda separator: counts[separator])
    return best if counts[best] else ","


def _number(cell: str) -> float | None:
    try:
        return float(cell)
    except ValueError:
        return None


def _fast(body: str, separator: str, width: int) -> np.ndarray | None:
    """numpy's own parser, for a file in which every cell is a number."""
    try:
        values = np.loadtxt(io.StringIO(body), delimiter=separator, ndmin=2, dtype=np.float64, comments=None)
    except ValueError:
        return None
    return values if values.shape[1] == width else None


def _careful(path: pathlib.Path, body: str, separator: str, header: list[str], first_row: int) -> Table:
    """Cell by cell: empty cells are NaN, columns of text are set aside, a last row cut short is dropped."""
    width, warnings = len(header), []
    try:
        rows = list(csv.reader(io.StringIO(body), delimiter=separator, skipinitialspace=True))
    except csv.Error as error:
        raise InputError(f"{path.name} is not readable as CSV ({error}): export it again.") from error
    numbered = [(first_row + index, row) for index, row in enumerate(rows) if any(cell.strip() for cell in row)]
    cells: list[list[str]] = []
    for place, (number, row) in enumerate(numbered):
        if len(row) == width + 1 and row[-1].strip() == "":
            row = row[:-1]
        if len(row) != width:
            if place == len(numbered) - 1 and len(row) < width and place > 0:
                warnings.append(
                    f"{path.name}: the last row is cut short ({len(row)} of {width} cells) and was dropped."
                )
                break
            raise InputError(
                f"{path.name}: row {number} has {len(row)} cells where the header has {width}: repair or drop that row."
            )
        cells.append(row)
    columns, text = {}, {}
    for index, name in enumerate(header):
        values = np.full(len(cells), np.nan)
        for place, row in enumerate(cells):
            cell = row[index].strip()
            number = _number(cell.replace(",", ".") if separator == ";" else cell) if cell else float("nan")
            if number is None:
                text[name] = f"column {name} holds {cell[:30]!r} in row {numbered[place][0]}, which is no number"
                break
            values[place] = number
        else:
            columns[name] = values
    return Table(columns, first_row, text, warnings)
