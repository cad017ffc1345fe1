"""NumPy archives (.npz): one array per column, or one structured array."""

import pathlib

import numpy as np

from ...errors import InputError
from .table import RawTable, Request


def read(path: pathlib.Path, request: Request) -> RawTable:
    """The arrays of an .npz file; single numbers and tables are left out.

    Raises:
        InputError: for a file that is not an archive of plain arrays.
    """
    del request
    columns, text = {}, {}
    try:
        with path.open("rb") as stream, np.load(stream, allow_pickle=False) as archive:
            for name in archive.files:
                add_array(columns, text, name, archive[name])
    except Exception as error:  # zipfile, zlib, struct and numpy: whatever a damaged file makes them raise
        raise InputError(
            f"{path.name} is not an archive of plain arrays ({(str(error).splitlines() or ['damaged'])[0][:60]}): "
            f"write it with numpy.savez(path, time=t, torque=u, velocity=w)."
        ) from error
    return RawTable(columns, first_row=0, text=text)


def add_array(columns: dict[str, np.ndarray], text: dict[str, str], name: str, value: object) -> None:
    """Add an array to the columns under its name: a vector as it is, a table by columns, a structured array by fields.

    Args:
        columns: gains the columns of numbers.
        text: gains a sentence for an array that is not numbers.
        name: name of the array in its file.
        value: the array; a table has at most 64 columns, a larger one is left out.
    """
    array = np.asarray(value)
    if array.dtype.names:
        for field in array.dtype.names:
            add_array(columns, text, f"{name}.{field}", array[field])
        return
    if array.dtype.kind not in "biuf":
        text[name] = f"column {name} is not numbers (it holds {array.dtype})"
        return
    array = array.astype(np.float64)
    if array.size > 1 and array.size == max(array.shape):
        columns[name] = array.reshape(-1)
    elif array.ndim == 2 and min(array.shape) > 1:
        # more samples than signals, whichever way the table lies
        tall = array if array.shape[0] >= array.shape[1] else array.T
        if tall.shape[1] <= 64:
            columns.update({f"{name}.{index}": tall[:, index].copy() for index in range(tall.shape[1])})
