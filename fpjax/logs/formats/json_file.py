"""JSON: columns, rows, or an object that holds one of these (bam's `entries`); and one object per line."""

import json
import pathlib
from collections.abc import Iterable, Mapping
from typing import Any

import numpy as np

from ...errors import InputError
from ...output.json_object import TomlTable
from .table import RawTable, Request, add_column

LARGEST = 1 << 30  # [bytes]: Python objects take about ten times the memory of their text
DEEPEST = 6  # levels of nesting that are searched for columns


def read(path: pathlib.Path, request: Request) -> RawTable:
    """The columns of a JSON file.

    Raises:
        InputError: for a file that is not JSON, or holds no columns of numbers.
    """
    del request
    if path.stat().st_size > LARGEST:
        raise InputError(f"{path.name} is too large for JSON (over 1 GiB): save it as CSV or Parquet.")
    try:
        content = _parsed(path)
    except (ValueError, RecursionError) as error:
        first = (str(error).splitlines() or ["damaged"])[0][:100]
        raise InputError(f"{path.name} cannot be read as JSON ({first}): save it again.") from error
    columns: dict[str, np.ndarray] = {}
    text: dict[str, str] = {}
    _columns(content, "", columns, text, 0)
    if not columns:
        raise InputError(
            f'{path.name} holds no columns of numbers: write {{"time": [...], "torque": [...], "velocity": [...]}} '
            f"or a list of such rows."
        )
    return RawTable(columns, first_row=0, text=text)


def _parsed(path: pathlib.Path) -> Any:
    with path.open(encoding="utf-8-sig", errors="replace") as stream:
        if path.suffix.lower() in (".jsonl", ".ndjson"):
            return [json.loads(line) for line in stream if line.strip()]
        text = stream.read()
    try:
        return json.loads(text)
    except ValueError:
        # one object per line is often saved as .json too
        lines = [line for line in text.splitlines() if line.strip()]
        if len(lines) > 1 and lines[0].lstrip().startswith("{") and lines[0].rstrip().endswith("}"):
            return [json.loads(line) for line in lines]
        raise


def _columns(value: Any, name: str, columns: dict[str, np.ndarray], text: dict[str, str], depth: int) -> None:
    """Add every list of numbers as a column and every list of objects as a table; names are joined by dots."""
    if depth > DEEPEST:
        return
    if isinstance(value, Mapping):
        inner = list(value.values())
        if len(inner) > 2 and all(str(key).isdigit() for key in value) and not any(isinstance(v, list) for v in inner):
            _columns(inner, name, columns, text, depth + 1)  # pandas writes {column: {row: value}}
            return
        for key, item in value.items():
            # a key that only holds the rows does not become part of the columns' names
            plain = key in ("entries", "data", "rows", "samples", "log", "records")
            _columns(item, name if plain else f"{name}.{key}" if name else str(key), columns, text, depth + 1)
    elif isinstance(value, list) and len(value) > 1:
        if all(isinstance(row, Mapping) for row in value):
            for key, cells in _transposed(value).items():
                _file(f"{name}.{key}" if name else key, cells, columns, text)
        elif all(isinstance(row, list) for row in value) and len({len(row) for row in value}) == 1:
            for index in range(len(value[0])):
                _file(f"{name}.{index}" if name else str(index + 1), [row[index] for row in value], columns, text)
        else:
            _file(name or "1", value, columns, text)


def _transposed(rows: Iterable[TomlTable]) -> dict[str, list[Any]]:
    flat = [dict(_flat(row, "", 0)) for row in rows]
    names = dict.fromkeys(key for row in flat for key in row)
    return {name: [row.get(name) for row in flat] for name in names}


def _flat(value: Any, name: str, depth: int) -> Iterable[tuple[str, Any]]:
    if isinstance(value, Mapping) and depth < DEEPEST:
        for key, item in value.items():
            yield from _flat(item, f"{name}.{key}" if name else str(key), depth + 1)
    elif isinstance(value, list) and depth < DEEPEST and len(value) <= 16:
        for index, item in enumerate(value):
            yield from _flat(item, f"{name}.{index}", depth + 1)
    else:
        yield name, value


def _file(name: str, cells: list[Any], columns: dict[str, np.ndarray], text: dict[str, str]) -> None:
    if any(isinstance(cell, str | list | dict) for cell in cells):
        text[name] = f"column {name} is not an array of numbers"
        return
    try:
        values = np.array([float("nan") if cell is None else float(cell) for cell in cells], dtype=np.float64)
    except (TypeError, ValueError, OverflowError):
        text[name] = f"column {name} is not an array of numbers"
        return
    add_column(columns, text, name, values)
