"""MATLAB files: v7 and older by scipy, v7.3 (HDF5) by pymatreader of the `logs` extra."""

import pathlib
import warnings
from collections.abc import Mapping
from typing import Any

import numpy as np

from ...errors import InputError
from .numpy_file import add_array
from .table import RawTable, Request, need

REFERENCE = 0xDD000000  # begins a reference to an object


def read(path: pathlib.Path, request: Request) -> RawTable:
    """The vectors of a .mat file; structs are flattened with dots ("log.velocity"), single numbers are left out.

    Raises:
        InputError: for a file that is not a .mat file, or a v7.3 one without the extra.
    """
    del request
    from scipy import io

    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            content: Any = io.loadmat(path, squeeze_me=True, simplify_cells=True)
    except NotImplementedError:  # raised by scipy for v7.3 files
        content = _read_hdf(path)
    except Exception as error:  # scipy raises whatever its parser trips over on a damaged file
        raise InputError(f"{path.name} cannot be read as a .mat file ({_first_line(error)}): save it again.") from error
    columns: dict[str, np.ndarray] = {}
    text: dict[str, str] = {}
    objects: dict[str, str] = {}
    _flatten(columns, text, objects, "", content)
    return RawTable(columns, first_row=1, text=text, unread=_unread(objects))


def _read_hdf(path: pathlib.Path) -> Any:
    reader = need("pymatreader", path)
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            return reader.read_mat(str(path))
    except Exception as error:  # h5py and pymatreader: whatever a damaged file makes them raise
        raise InputError(
            f"{path.name} cannot be read as a v7.3 .mat file ({_first_line(error)}): save it again with -v7."
        ) from error


def _flatten(
    columns: dict[str, np.ndarray], text: dict[str, str], objects: dict[str, str], prefix: str, value: Any
) -> None:
    if class_name := _class_of(value):
        objects[prefix] = class_name
    elif isinstance(value, Mapping):
        if recorded := _recorded(value):
            value = recorded
        for name, inner in value.items():
            if not str(name).startswith(("__", "#")):  # "#subsystem#" of v7.3 holds the insides of the objects
                _flatten(columns, text, objects, f"{prefix}.{name}" if prefix else str(name), inner)
    else:
        try:
            add_array(columns, text, prefix, value)
        except (ValueError, TypeError):
            text[prefix] = f"column {prefix} is not an array of numbers"


def _class_of(value: Any) -> str:
    """Class of an object of MATLAB (timeseries, timetable, Dataset); "" for any other value."""
    from scipy.io.matlab import MatlabOpaque

    # what pymatreader gives for one: nothing, or the words of a reference into v7.3's "#subsystem#"
    if value is None or (getattr(value, "dtype", None) == np.uint32 and np.ravel(value)[:1].tolist() == [REFERENCE]):
        return "object"
    if not isinstance(value, MatlabOpaque):
        return ""
    # Its fields are the type system, the class and a reference; older versions of scipy have its name before them, and
    # the class in bytes.
    kind = value[list(value.dtype.names or ())[-2]].item()
    return kind.decode() if isinstance(kind, bytes) else str(kind)


def _unread(objects: Mapping[str, str]) -> str:
    """How an engineer gets the objects of a file out of MATLAB, for the end of a sentence; "" for none."""
    if not objects:
        return ""
    # Older versions of scipy do not tell the name.
    called = [f"{kind} {name!r}" if name != "None" else f"a {kind}" for name, kind in list(objects.items())[:4]]
    called += [f"{len(objects) - 4} more"] if len(objects) > 4 else []
    return (
        f"it holds objects that only MATLAB can read ({', '.join(called)}): save their numbers there, of a timeseries "
        "with time = x.Time; torque = x.Data; and so on, then save('log.mat', 'time', 'torque', 'velocity')"
    )


def _recorded(struct: Mapping[str, Any]) -> dict[str, Any] | None:
    """The signals of a recording of Simulink or dSPACE, by their labels; None for any other struct.

    Simulink's "structure with time" has `time` and `signals`, each with `values` and `label`; ControlDesk's file has
    `X` (the time) and `Y`, each with `Data` and `Name`.
    """
    for clock, signals, values, label in (("time", "signals", "values", "label"), ("X", "Y", "Data", "Name")):
        if not {clock, signals} <= set(struct):
            continue
        several = [struct[signals]] if isinstance(struct[signals], Mapping) else list(np.atleast_1d(struct[signals]))
        if not several or not all(isinstance(each, Mapping) and values in each for each in several):
            continue
        found = {"time": struct[clock].get(values) if isinstance(struct[clock], Mapping) else struct[clock]}
        for index, each in enumerate(several):
            name = each.get(label)
            found[name if isinstance(name, str) and name and name not in found else f"{signals}.{index}"] = each[values]
        return found
    return None


def _first_line(error: BaseException) -> str:
    return (str(error).splitlines() or [type(error).__name__])[0][:120]
