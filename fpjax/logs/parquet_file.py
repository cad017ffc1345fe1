"""Parquet, by pyarrow of the `logs` extra."""

import pathlib
from collections.abc import Mapping

from ..errors import InputError
from .table import Table, from_arrays, need


def read(path: pathlib.Path, wanted: Mapping[str, str]) -> Table:
    """The columns of a Parquet file.

    Raises:
        InputError: without the extra, or for a file that is no Parquet.
    """
    del wanted
    parquet = need("pyarrow.parquet", path)
    try:
        content = parquet.read_table(str(path))
        arrays = {name: content[name].to_numpy() for name in dict.fromkeys(content.column_names)}
    except Exception as error:  # pyarrow: its own family of errors, and OSError for a damaged file
        raise InputError(
            f"{path.name} is no Parquet file that can be read ({str(error).splitlines()[0][:120]}): export it again."
        ) from error
    return from_arrays(arrays)
