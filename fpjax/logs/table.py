"""Table: a file's columns as they stand, before anyone says what they mean; and which reader a path wants."""

import importlib
import pathlib
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from ..errors import InputError


@dataclass
class Table:
    """Columns of equal length, float64.

    Attributes:
        columns: by name, each of shape (rows,).
        first_row: the number that a user sees on the first row of data (2 under a CSV header).
        text: columns that are not numbers, with a sentence about the first cell that is not.
        warnings: what the reader had to let go, a sentence each.
        time_known: a "time" column was made by the reader from the file's own stamps.
    """

    columns: dict[str, np.ndarray]
    first_row: int = 1
    text: dict[str, str] = field(default_factory=dict)
    warnings: list[str] = field(default_factory=list)
    time_known: bool = False


READERS = {
    ".csv": "csv_file", ".txt": "csv_file", ".tsv": "csv_file", ".dat": "csv_file",
    ".npz": "numpy_file", ".mat": "matlab_file",
    ".parquet": "parquet_file", ".pq": "parquet_file", ".mcap": "mcap_file",
}  # fmt: skip


def read_table(path: pathlib.Path, wanted: Mapping[str, str]) -> Table:
    """A file's columns, by the reader of its suffix.

    Args:
        path: the file.
        wanted: the user's mapping (an MCAP reader needs to know which topics).

    Raises:
        InputError: for a file that is not there, cannot be read, or is of a kind that nobody reads.
    """
    if not path.exists():
        near = _neighbours(path)
        raise InputError(f"{path} does not exist: {near or 'check the path'}.")
    if path.is_dir():
        raise InputError(f"{path} is a folder, not a log: name the file in it.")
    module = READERS.get(path.suffix.lower())
    if module is None:
        kinds = ", ".join(sorted(READERS))
        if path.suffix == ".toml":
            raise InputError(f"{path.name} is a model, not a log: give a log here, and the model with --model.")
        raise InputError(f"{path.name} is of a kind that is not read ({path.suffix or 'no suffix'}): use {kinds}.")
    reader: Callable[..., Table] = importlib.import_module(f"fpjax.logs.{module}").read
    try:
        if path.stat().st_size == 0:
            raise InputError(f"{path.name} is empty: record it again, or name another file.")
        return reader(path, wanted)
    except OSError as error:
        raise InputError(f"{path} cannot be read ({error.strerror or error}): check its rights.") from error


def need(module: str, path: pathlib.Path) -> Any:
    """An optional module of the `logs` extra.

    Raises:
        InputError: with the command that installs it.
    """
    try:
        return importlib.import_module(module)
    except ImportError as error:
        raise InputError(
            f'{path.name} needs {module.split(".")[0]}, which is not installed: run  pip install "fpjax[logs]"  '
            f"(or export the log as CSV)."
        ) from error


def from_arrays(data: Any) -> Table:
    """Columns of a DataFrame (pandas, polars), a pyarrow table or a mapping of arrays.

    Raises:
        InputError: for anything else, or for columns of different lengths.
    """
    names = getattr(data, "column_names", None) or (list(data.keys()) if hasattr(data, "keys") else None)
    if names is None or not hasattr(data, "__getitem__"):
        raise InputError(
            f"A log cannot be made of {type(data).__name__}: give a path, a DataFrame, or a dict of arrays such as "
            f'{{"time": t, "torque": u, "velocity": w}}.'
        )
    columns, text = {}, {}
    for name in names:
        try:
            values = np.asarray(data[name])
        except (TypeError, ValueError):
            text[str(name)] = f"column {name} is not an array of numbers"
            continue
        if values.dtype.kind in "Mm":
            values = values.astype(f"{values.dtype.kind}8[ns]").astype(np.int64) * 1e-9
        try:
            columns[str(name)] = np.asarray(values, dtype=np.float64).reshape(-1)
        except (TypeError, ValueError):
            text[str(name)] = f"column {name} is not numbers (it holds {values.dtype})"
    return Table(columns, first_row=0, text=text)


def _neighbours(path: pathlib.Path) -> str:
    import difflib

    folder = path.parent
    if not folder.is_dir():
        return f"the folder {folder} does not exist either"
    names = [entry.name for entry in folder.iterdir() if entry.suffix.lower() in READERS]
    near = difflib.get_close_matches(path.name, names, n=1)
    return f"did you mean {near[0]!r}" if near else ""
