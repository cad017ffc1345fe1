"""Text files in which every signal has a time of its own: traces of TwinCAT Scope and FlexLogger, and of CODESYS.

Side by side (Beckhoff, NI): columns of values, each or several of them behind a column of times, below lines that have
a key above the times and what it says of each signal above the values.
One below the other (CODESYS and what is built on it: Bosch Rexroth's ctrlX, Schneider, WAGO): "0.Variable; name", more
keys, "0.Data;", then lines of "; time; value".
"""

import pathlib
import re
from collections.abc import Iterable

import numpy as np

from ...errors import InputError
from ..columns.names import bracket_unit
from ..columns.units import find_unit
from .cell_numbers import number
from .csv_layout import split
from .join_topics import Topics, joined
from .table import RawTable, Request

_NAME = ("name", "channel name", "channel", "signal", "signal name", "kanal", "kanalname")
_UNIT = ("unit", "einheit", "unit string")
_STEP = re.compile(r"(sample|sampling)[ _]?(time|interval|period)|interval|abtastzeit", re.IGNORECASE)
_CODESYS = re.compile(r"^\s*(?P<number>\d+)\.Variable\s*;\s*(?P<name>.+?)\s*$")
_SEPARATORS = ("\t", ";", ",")
PIECE = 50_000  # [rows] that are Python's numbers at a time


def has_blocks(head: list[str]) -> bool:
    """Whether a file is one of these.

    Args:
        head: its first lines.
    """
    return _header(head) is not None or any(_CODESYS.match(line) for line in head)


def read(path: pathlib.Path, lines: Iterable[str], head: list[str], request: Request) -> RawTable:
    """The signals on the stamps of the one with the torque.

    Args:
        path: of the file.
        lines: all of them.
        head: the first of them.
        request: what the log needs of it.

    Raises:
        InputError: for a file that holds no values.
    """
    header = _header(head)
    recorded, units = _below(lines) if header is None else _beside(lines, *header)
    if not recorded:
        raise InputError(f"{path.name} names signals and holds no values of them: record it again, or export it whole.")
    table = joined(_with_equal_stamps(recorded), request)
    table.units = units
    table.warnings.insert(0, f"{path.name} has a time for each of its {len(recorded)} signals.")
    return table


Recorded = dict[str, tuple[np.ndarray, np.ndarray]]  # by name: stamps, values


def _header(head: list[str]) -> tuple[str, list[str]] | None:
    """(separator, cells) of a line such as "Name;velocity;Name;torque"; None without one."""
    stepped = any(_STEP.match(line.strip()) for line in head)
    found: tuple[str, list[str]] | None = None
    for line in head:
        for separator in _SEPARATORS:
            cells = [part.strip() for part in split(line.rstrip("\r\n").removesuffix(separator), separator)]
            times = [cell for cell in cells if cell == cells[0]]
            # with a single time the line could be the header of any table
            if cells[0].lower() in _NAME and len(times) < len(cells) and (len(times) > 1 or stepped):
                # the widest: the file's own name may stand above in such a line too
                found = max(found or (separator, []), (separator, cells), key=lambda each: len(each[1]))
    return found


def _beside(lines: Iterable[str], separator: str, header: list[str]) -> tuple[Recorded, dict[str, str]]:
    width, units = len(header), {"time": "s"}
    clocks = [place for place, cell in enumerate(header) if cell == header[0]]
    signals = {place: cell for place, cell in enumerate(header) if place not in clocks}
    for place, name in signals.items():
        if name in [each for other, each in signals.items() if other < place] or not name:
            signals[place] = f"{name}#{place}"
    pieces: list[np.ndarray] = []
    rows: list[list[float]] = []
    for line in lines:
        parts = [part.strip() for part in split(line, separator)][:width]
        if not parts:
            continue
        if parts[0].lower() in _UNIT:
            units |= {
                signals[place]: unit
                for place, unit in enumerate(parts)
                if place in signals and find_unit(unit) is not None
            }
        elif _STEP.match(parts[0]):
            units["time"] = bracket_unit(parts[0])[1] or "s"
        elif len(parts) > 1 and any(parts):
            cells = [number(part, comma=True) if part else np.nan for part in parts]
            if any(cells[place] is None for place in clocks if place < len(cells)):
                continue
            # a signal that ended before the others leaves its cells empty, or the rows short
            rows.append([np.nan if cell is None else cell for cell in cells] + [np.nan] * (width - len(cells)))
            if len(rows) == PIECE:
                pieces.append(np.array(rows))
                rows = []
    table = np.concatenate([*pieces, np.array(rows).reshape(len(rows), width)])
    found = {}
    for place, name in signals.items():
        stamps, values = table[:, max(clock for clock in clocks if clock < place)], table[:, place]
        read = np.isfinite(stamps) & np.isfinite(values)
        if read.sum() > 1:
            found[name] = stamps[read], values[read]
    return found, units


def _below(lines: Iterable[str]) -> tuple[Recorded, dict[str, str]]:
    found: dict[str, list[tuple[float, float]]] = {}
    current: list[tuple[float, float]] = []
    for line in lines:
        named = _CODESYS.match(line)
        if named:
            name = named["name"]
            current = found.setdefault(name if name not in found else f"{name}#{named['number']}", [])
        elif line.lstrip().startswith(";"):
            cells = [number(part.strip(), comma=True) for part in line.strip().strip(";").split(";")]
            if len(cells) == 2 and None not in cells:
                current.append((cells[0] or 0.0, cells[1] or 0.0))
    arrays = {name: np.array(rows).reshape(-1, 2) for name, rows in found.items()}
    # milliseconds, which the file does not say
    return {name: (each[:, 0], each[:, 1]) for name, each in arrays.items() if len(each) > 1}, {"time": "ms"}


def _with_equal_stamps(recorded: Recorded) -> Topics:
    """Signals that were recorded at the same times as one topic, so that nothing of them is interpolated."""
    topics: Topics = {}
    for name, (stamps, values) in recorded.items():
        for own, fields in topics.values():
            if own.shape == stamps.shape and np.array_equal(own, stamps):
                fields[name] = values
                break
        else:
            topics[name] = stamps, {name: values}
    return topics
