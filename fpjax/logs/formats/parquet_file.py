"""Parquet files, with pyarrow of the `logs` extra; of a large file only the needed columns are read."""

import pathlib

import numpy as np

from ...errors import InputError
from .table import RawTable, Request, add_column, need

LARGE = 50_000_000  # [numbers]: 400 MB in memory


def read(path: pathlib.Path, request: Request) -> RawTable:
    """The columns of a Parquet file.

    Raises:
        InputError: without the extra, or for a file that is not Parquet.
    """
    parquet = need("pyarrow.parquet", path)
    columns: dict[str, np.ndarray] = {}
    text: dict[str, str] = {}
    warnings: list[str] = []
    try:
        file = parquet.ParquetFile(str(path))
        names = list(dict.fromkeys(file.schema_arrow.names))
        chosen = names
        if request.wanted is not None and len(names) * file.metadata.num_rows > LARGE:
            chosen = list(dict.fromkeys(request.wanted(names, {})[2])) or names
            warnings.append(f"{path.name} is large: of its {len(names)} columns, {len(chosen)} were read.")
        for name in chosen:  # one by one: a table of all would be in memory twice
            add_column(columns, text, name, np.asarray(file.read(columns=[name])[name].to_numpy()))
    except InputError:
        raise
    except Exception as error:  # pyarrow: its own family of errors, and OSError for a damaged file
        first = (str(error).splitlines() or [type(error).__name__])[0][:120]
        raise InputError(f"{path.name} cannot be read as a Parquet file ({first}): export it again.") from error
    return RawTable(columns, first_row=1, text=text, warnings=warnings)
