"""Which column of a file is what: the mapping that the user gives, and the names that speak for themselves."""

import difflib
import re
from collections.abc import Iterable, Mapping
from typing import NamedTuple

from ..errors import InputError
from .units import QUANTITIES, find_unit, parse_unit

CANONICAL = tuple(QUANTITIES)
PRESETS = {
    # Janot, Gautier, Brunot, "Data Set and Reference Models of EMPS", 2019: vir is in volts, 35.15 N/V.
    "emps": "time=t,torque=vir*35.15:N,position=qm:m,reference=qg:m",
}
_BRACKETED = re.compile(r"^\s*(?P<name>[^\[\](]+?)\s*[\[(]\s*(?P<unit>[^\])]+?)\s*[\])]\s*$")


class Source(NamedTuple):
    """Where a canonical column comes from: the file's column, its unit as written, and a further factor."""

    column: str
    unit: str | None = None
    factor: float = 1.0


Columns = str | Mapping[str, str] | None


def parse_columns(columns: Columns) -> dict[str, str]:
    """The user's mapping as {canonical name: "column", "column:unit" or "column*factor:unit"}.

    Args:
        columns: "velocity=gyro_z:deg/s,torque=tau_cmd", a mapping of the same, the name of a preset ("emps") or None.

    Raises:
        InputError: for a part that is not name=column, or a name that is not canonical.
    """
    if columns is None:
        return {}
    if isinstance(columns, str):
        columns = PRESETS.get(columns.strip().lower(), columns)
        pairs = [part.partition("=") for part in columns.split(",") if part.strip()]
        wrong = [name for name, equals, column in pairs if not equals or not column.strip()]
        if wrong:
            raise InputError(
                f"--columns {columns!r} cannot be read at {wrong[0].strip()!r}: write name=column or name=column:unit, "
                f"separated by commas, such as velocity=gyro_z:deg/s,torque=tau_cmd."
            )
        columns = {name.strip(): column.strip() for name, _, column in pairs}
    for name in columns:
        if name not in CANONICAL:
            near = difflib.get_close_matches(name, CANONICAL, n=1)
            raise InputError(
                f"--columns maps {name!r}, which is no column of a log: "
                f"{f'did you mean {near[0]!r}? ' if near else ''}There are {', '.join(CANONICAL)}."
            )
    return {name: str(column) for name, column in columns.items()}


def find_sources(names: Iterable[str], mapping: Mapping[str, str], where: str) -> dict[str, Source]:
    """For each canonical column that is there, the file's column.

    Args:
        names: the file's columns.
        mapping: from `parse_columns`; what it leaves out is looked for under its own name, any case, and with its
            unit in brackets ("velocity [deg/s]").
        where: the file's name, for messages.

    Raises:
        InputError: for a mapped column that the file does not have.
    """
    names = list(names)
    found = {canonical: _mapped(canonical, text, names, where) for canonical, text in mapping.items()}
    taken = {source.column for source in found.values()}
    for name in names:
        if name in taken:
            continue
        bracketed = _BRACKETED.match(name)
        plain = (bracketed["name"] if bracketed else name).strip().lower()
        if plain in CANONICAL and plain not in found:
            found[plain] = Source(name, bracketed["unit"] if bracketed else None)
    return found


def _mapped(canonical: str, text: str, names: list[str], where: str) -> Source:
    if text in names:
        return Source(text)
    head, colon, unit = text.rpartition(":")
    if not colon:
        head, unit = text, ""
    factor = 1.0
    if head not in names and "*" in head:
        head, _, number = head.rpartition("*")
        try:
            factor = float(number)
        except ValueError:
            factor = float("nan")
        if not abs(factor) > 0.0 or abs(factor) == float("inf"):
            raise InputError(
                f"--columns {canonical}={text}: the factor {number!r} is not a number other than zero; "
                f"write for instance {canonical}={head.strip()}*35.15."
            )
    head = head.strip()
    if head not in names:
        near = difflib.get_close_matches(head, names, n=1)
        raise InputError(
            f"{where} has no column {head!r} for {canonical}: "
            f"{f'did you mean {near[0]!r}? ' if near else ''}It has {listed(names)}."
        )
    if colon and not unit.strip():
        raise InputError(f"--columns {canonical}={text} ends with a colon: write the unit after it, or leave both out.")
    return Source(head, unit.strip() or None, factor)


def motion_of(sources: Mapping[str, Source]) -> bool | None:
    """Whether the units given say linear (True) or rotary (False); None where none says either."""
    said = set()
    for canonical, source in sources.items():
        unit = None if source.unit is None else find_unit(source.unit)
        if unit is not None and canonical != "time":
            said |= {True} if unit.quantity in ("length", "speed", "force") else set()
            said |= {False} if unit.quantity in ("angle", "rate", "torque") else set()
    if len(said) == 2:
        units = ", ".join(f"{name} {source.unit}" for name, source in sources.items() if source.unit)
        raise InputError(f"The units mix rotary and linear motion ({units}): give all of them for one kind of axis.")
    return said.pop() if said else None


def scale_of(canonical: str, source: Source, linear: bool | None) -> tuple[float, str]:
    """(factor to SI, "" or the torque label that stands for SI)."""
    if source.unit is None:
        return source.factor, ""
    unit = parse_unit(source.unit, canonical, linear)
    return source.factor * unit.factor, source.unit if unit.quantity == "label" else ""


def missing_sentence(names: list[str], lacking: list[str], where: str) -> str:
    """The sentence for a log that lacks columns, with the names that come nearest."""
    hints = []
    lower = {name.lower(): name for name in names}
    for canonical in lacking:
        for word in canonical.split(" or "):
            near = difflib.get_close_matches(word, lower, n=1, cutoff=0.5) or [
                name for name in lower if name in _ALIASES[word] or name.split(".")[-1] in _ALIASES[word]
            ]
            if near:
                hints.append(f"{word}={lower[near[0]]}")
    fix = f"--columns {','.join(hints)}" if hints else f"--columns {lacking[0].split(' or ')[0]}=NAME:UNIT"
    return (
        f"{where} has no column {' and no column '.join(lacking)}: it has {listed(names)}; "
        f"if one of them is meant, say so with {fix}{' (guessed from the names)' if hints else ''}."
    )


_ALIASES = {
    "time": {"t", "time_s", "timestamp", "stamp", "seconds", "clock", "times"},
    "torque": {"tau", "u", "force", "effort", "current", "voltage", "cmd", "command", "vir", "tau_cmd", "iq"},
    "velocity": {"v", "vel", "w", "omega", "speed", "rate", "gyro", "gyro_z", "dq", "qd"},
    "position": {"p", "pos", "x", "q", "qm", "theta", "angle", "encoder"},
    "reference": {"r", "ref", "setpoint", "target", "qg", "desired"},
}


def listed(names: list[str], most: int = 12) -> str:
    """Names as a readable list, the long ones cut short."""
    shown = ", ".join(name if len(name) <= 40 else f"{name[:37]}..." for name in names[:most])
    return f"{shown} and {len(names) - most} more" if len(names) > most else shown or "no columns at all"
