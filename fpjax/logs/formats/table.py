"""RawTable: the columns of a file as they are, before they get a meaning; and the choice of the reader for a path."""

import importlib
import pathlib
import re
import stat
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from ...errors import InputError
from ..log import NamedArrays


@dataclass
class RawTable:
    """Columns of equal length, float64.

    Attributes:
        columns: by name, each of shape (rows,).
        first_row: the number that a user sees on the first row of data (2 under a CSV header).
        text: columns that are not numbers, with a sentence about the first cell that is not.
        warnings: what the reader left out, a sentence each.
        units: by column name, where the file gives them apart from the names (a row of units).
        headless: whether the file names no columns; they are "1", "2", ... then.
        unread: what it holds that nobody can read but the program that wrote it, and what to do, for the end of a
            sentence that names a missing column ("" for nothing).
        period: between two rows [s], where the file tells it apart from its columns; None where it does not.
    """

    columns: dict[str, np.ndarray]
    first_row: int = 1
    text: dict[str, str] = field(default_factory=dict)
    warnings: list[str] = field(default_factory=list)
    units: dict[str, str] = field(default_factory=dict)
    headless: bool = False
    unread: str = ""
    period: float | None = None


@dataclass(frozen=True)
class Request:
    """What the log needs of a file, so that a reader can skip the rest.

    Attributes:
        mapped: the user's mapping, text for each canonical column.
        wanted: function of the file's names and units that gives (name of the time column or "", its factor to
            seconds, names of all columns that the log needs); None to read every column.
        start: earliest time kept [s], in the log's own time.
        stop: latest time kept [s].
    """

    mapped: dict[str, str] = field(default_factory=dict)
    wanted: Callable[[list[str], dict[str, str]], tuple[str, float, list[str]]] | None = None
    start: float = -np.inf
    stop: float = np.inf

    @property
    def cuts(self) -> bool:
        """Whether only a part of the time is wanted."""
        return bool(np.isfinite(self.start) or np.isfinite(self.stop))


READERS = {
    ".csv": "csv_file", ".txt": "csv_file", ".tsv": "csv_file", ".dat": "csv_file", ".asc": "csv_file",
    ".log": "csv_file", ".lvm": "csv_file", ".npz": "numpy_file", ".mat": "matlab_file", ".json": "json_file",
    ".jsonl": "json_file", ".ndjson": "json_file", ".wpilog": "wpilog_file", ".parquet": "parquet_file",
    ".pq": "parquet_file", ".mcap": "mcap_file", ".db3": "rosbag_file",
}  # fmt: skip


_NUMBER = re.compile(r"[-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?|[nN]a[nN]")


def read_table(path: pathlib.Path, request: Request) -> RawTable:
    """A file's columns, by the reader of its suffix.

    Args:
        path: the file.
        request: what the log needs of it.

    Raises:
        InputError: for a file that does not exist, cannot be read, or has an unknown format.
    """
    check_regular(path)
    module = READERS.get(path.suffix.lower())
    if module is None:
        kinds = ", ".join(sorted(READERS))
        if path.suffix == ".toml":
            raise InputError(f"{path.name} is a model, not a log: give a log here, and the model with --model.")
        # data loggers invent suffixes (.t, .out, .res, none): a file with rows of numbers is read as text
        if not _rows_of_numbers(path):
            raise InputError(f"{path.name} has an unknown format ({path.suffix or 'no suffix'}): use {kinds}.")
        module = "csv_file"
    if module == "csv_file" and _is_json(path):
        module = "json_file"
    # by name, so that a format's library is imported only where that format is read
    reader: Callable[..., RawTable] = importlib.import_module(f"fpjax.logs.formats.{module}").read
    try:
        if path.stat().st_size == 0:
            raise InputError(f"{path.name} is empty: record it again, or name another file.")
        return reader(path, request)
    except OSError as error:
        raise InputError(f"{path} cannot be read ({error.strerror or error}): check its permissions.") from error
    except MemoryError as error:
        raise InputError(f"{path.name} does not fit into memory: read a part of it with --from and --to.") from error


def _is_json(path: pathlib.Path) -> bool:
    """Whether the first lines of a file are objects of JSON: a log of rows is often saved as .txt.

    A single one may stand above a table.
    """
    try:
        with path.open("rb") as stream:
            lines = stream.read(1 << 16).lstrip(b"\xef\xbb\xbf \t\r\n").split(b"\n")
    except OSError:
        return False
    first = [line.strip() for line in lines if line.strip()][:2]
    return bool(first) and all(line.startswith(b'{"') and line.endswith(b"}") for line in first)


def _rows_of_numbers(path: pathlib.Path) -> bool:
    """Whether the last 20 lines of the first 64 KiB of a file are rows of at least two numbers."""
    try:
        with path.open("rb") as stream:
            lines = stream.read(1 << 16).decode("utf-8-sig").splitlines()[:-1]
    except (OSError, UnicodeDecodeError):
        return False
    rows = [re.split(r"[,;\s]+", line.strip(" \t,;")) for line in lines[-20:]]
    return len(rows) == 20 and all(len(row) > 1 and all(_NUMBER.fullmatch(cell) for cell in row) for row in rows)


def check_regular(path: pathlib.Path) -> None:
    """Check that a path is a regular file: reading a pipe or a device might never end.

    Raises:
        InputError: where the path does not exist, is a folder, a pipe or a device.
    """
    try:
        kind = path.stat().st_mode
    except FileNotFoundError as error:
        near = _neighbours(path)
        raise InputError(f"{path} does not exist: {near}") from error
    except (OSError, ValueError) as error:  # a name too long, a zero byte in it, a loop of links
        raise InputError(
            f"{str(path)[:80]!r} cannot be read ({getattr(error, 'strerror', None) or error}): check the path."
        ) from error
    if stat.S_ISDIR(kind):
        raise InputError(f"{path} is a folder, not a log: name the file in it.")
    if not stat.S_ISREG(kind):
        raise InputError(f"{path} is a pipe or a device, not a file: save the log to a file first.")


def need(module: str, path: pathlib.Path) -> Any:
    """Import an optional module of the `logs` extra.

    Args:
        module: its name.
        path: file that needs it, for the message.

    Raises:
        InputError: where it is not installed, with the command that installs it.
    """
    try:
        return importlib.import_module(module)
    except ImportError as error:
        raise InputError(
            f'{path.name} needs {module.split(".")[0]}, which is not installed: run  pip install "fpjax[logs]"  '
            f"(or export the log as CSV)."
        ) from error


def from_arrays(data: NamedArrays) -> RawTable:
    """Columns of a DataFrame (pandas, with a named index; polars), a pyarrow table or a mapping of arrays.

    Raises:
        InputError: for an object of another kind.
    """
    names = getattr(data, "column_names", None) or list(getattr(data, "keys", tuple)()) or None
    if names is None or not hasattr(data, "__getitem__"):
        raise InputError(
            f"A log cannot be made of {type(data).__name__}: give a path, a DataFrame (of a run: its to_dataframe()), "
            f'or a dict of arrays such as {{"time": t, "torque": u, "velocity": w}}.'
        )
    columns, text = {}, {}
    index: Any = getattr(data, "index", None)
    if (named := getattr(index, "name", None)) is not None and named not in names:
        add_column(columns, text, str(named), np.asarray(index))
    for name in names:
        try:
            values = np.asarray(data[name])
        except (TypeError, ValueError):
            text[str(name)] = f"column {name} is not an array of numbers"
            continue
        add_column(columns, text, str(name), values)
    return RawTable(columns, first_row=0, text=text)


def add_column(columns: dict[str, np.ndarray], text: dict[str, str], name: str, values: np.ndarray) -> None:
    """Add one column under its name, as numbers or as text; dates become seconds since 1970."""
    if values.dtype.kind in "Mm":
        values = values.astype(f"{values.dtype.kind}8[ns]").astype(np.int64) * 1e-9
    try:
        if values.dtype.kind == "c":
            raise TypeError
        columns[name] = np.asarray(values, dtype=np.float64).reshape(-1)
    except (TypeError, ValueError, OverflowError):
        text[name] = f"column {name} is not numbers (it holds {values.dtype})"


def _neighbours(path: pathlib.Path) -> str:
    import difflib

    folder = path.parent
    if not folder.is_dir():
        return f"the folder {folder} does not exist either."
    names = [entry.name for entry in folder.iterdir() if entry.suffix.lower() in READERS]
    near = difflib.get_close_matches(path.name, names, n=1)
    return f"did you mean {near[0]!r}?" if near else "check the path."
