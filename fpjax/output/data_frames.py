"""Results as data frames, where pandas is installed."""

from typing import Any

import numpy as np

from ..errors import InputError
from .json_object import TomlTable


def to_frame(columns: TomlTable, index: Any = None, index_name: str = "time") -> Any:
    """A `pandas.DataFrame` of columns of one length.

    Args:
        columns: by name, each of shape (rows,).
        index: of shape (rows,); None for the row numbers.
        index_name: name of the index.

    Raises:
        InputError: where pandas is not installed.
    """
    try:
        import pandas
    except ImportError:
        raise InputError(
            "to_dataframe needs pandas, which is not installed: pip install pandas (or fpjax[frames])."
        ) from None
    rows = None if index is None else pandas.Index(np.asarray(index), name=index_name)
    return pandas.DataFrame({name: np.asarray(values) for name, values in columns.items()}, index=rows)
