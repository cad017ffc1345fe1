"""Keys of servo.toml: their units, their admissible values, and the error messages for wrong ones."""

import difflib
import math
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any, Literal

from ..errors import InputError
from ..logs.columns.units import is_label
from ..output.json_object import JsonObject, TomlTable
from .admissible import check_range

Sign = Literal["any", "positive", "not negative", "share"]
MUST = {
    "positive": "above zero",
    "not negative": "zero or more",
    "share": "between 0 and 1",
    "any": "finite",
}
_MISSING = object()


@dataclass(frozen=True)
class Units:
    """`[units]`: the units of motion and torque, and the kinds of reference and sensor.

    Attributes:
        motion: "rotary" (kg m^2, N m, rad) or "linear" (kg, N, m).
        torque: "N m", "N", or another label such as "V"; inertia and friction are then in units of it.
        reference: the quantity that the controller follows: "velocity", "position" or "none".
        sensors: the quantities that a log of this machine holds: "velocity", "position" or "both".
    """

    motion: str = "rotary"
    torque: str = "N m"
    reference: str = "velocity"
    sensors: str = "velocity"

    def name(self, unit: str) -> str:
        """A rotary SI unit in this machine's units: "N m s/rad" of a linear axis is "N s/m"."""
        if not is_label(self.torque):
            return _LINEAR.get(unit, unit) if self.motion == "linear" else unit
        base = _LABELLED.get(unit, unit).replace("T", self.torque, 1)
        return base.replace("rad", "m") if self.motion == "linear" else base


# Rotary SI units and their linear counterparts; and, for a torque in units of a label such as V, units with T for the
# label (an inertia is torque over acceleration).
_LINEAR = {
    "kg m^2": "kg", "N m": "N", "N m s/rad": "N s/m", "N m/rad": "N/m", "N m s^2/rad^2": "N s^2/m^2",
    "N m/rad^3": "N/m^3", "1/(N m)^2": "1/N^2",
    "rad": "m", "rad/s": "m/s", "rad/s^2": "m/s^2", "s/rad": "s/m", "1/rev": "rad/m", "rad/s/sqrt(s)": "m/s/sqrt(s)",
}  # fmt: skip
_LABELLED = {
    "kg m^2": "T s^2/rad", "N m": "T", "N m s/rad": "T s/rad", "N m/rad": "T/rad", "N m s^2/rad^2": "T s^2/rad^2",
    "N m/rad^3": "T/rad^3", "1/(N m)^2": "1/T^2",
}  # fmt: skip


@dataclass(frozen=True)
class Key:
    """One number of a section.

    Attributes:
        name: as written in the file.
        unit: in rotary SI.
        sign: its admissible range.
        default: the value where the key is not written; without a default the key is required, and a default of None
            means that the feature is absent.
        field: the block's attribute; "" where it has the key's name.
        many: whether the value is a list of numbers.
    """

    name: str
    unit: str
    sign: Sign = "any"
    default: Any = _MISSING
    field: str = ""
    many: bool = False

    @property
    def required(self) -> bool:
        """Whether the file must have it."""
        return self.default is _MISSING

    @property
    def attribute(self) -> str:
        """The block's attribute."""
        return self.field or self.name


def check_keys(section: str, table: TomlTable, known: Iterable[str], also: str = "") -> None:
    """Refuse keys that the section does not have, naming the nearest.

    Args:
        section: name of the section, without brackets.
        table: the section as written.
        known: every admissible key.
        also: a hint for the end of the message.
    """
    known = list(known)
    for key in table:
        if key not in known:
            raise InputError(f"[{section}] {key} is not known: {nearest(key, known)}{also}.")


def nearest(word: str, known: Iterable[str]) -> str:
    """The end of a message about an unknown word: the nearest known word, and all of them."""
    known = list(known)
    near = difflib.get_close_matches(word.lower(), known, n=1, cutoff=0.5)
    hint = f"did you mean {near[0]!r}? " if near else ""
    return f"{hint}{'There' if hint else 'there'} are {', '.join(known)}"


def choose(section: str, key: str, value: Any, known: Iterable[str]) -> str:
    """The value, checked to be one of the known words.

    Raises:
        InputError: naming the nearest.
    """
    known = list(known)
    if not isinstance(value, str):
        raise InputError(f"[{section}] {key} = {value!r} is not a word: write one of {', '.join(known)} in quotes.")
    if value not in known:
        raise InputError(f"[{section}] {key} = {value!r} is not known: {nearest(value, known)}.")
    return value


def read_number(section: str, key: Key, value: Any, units: Units) -> float:
    """The value as a number, checked against the key's range.

    Raises:
        InputError: saying what the number must be, what was written, and what to check.
    """
    unit = units.name(key.unit)
    shown = "" if unit == "1" else f" {unit}"
    # bool first: it is an int in Python, and `kp = true` must not become 1
    if isinstance(value, bool) or not isinstance(value, int | float):
        kind = "text" if isinstance(value, str) else "yes or no" if isinstance(value, bool) else "a list or a table"
        hint = " without quotes" if isinstance(value, str) else ""
        raise InputError(f"[{section}] {key.name} = {str(value)[:40]!r} is {kind}: write a number{hint} [{unit}].")
    try:
        number = float(value)
    except OverflowError:  # TOML integers may have any number of digits
        number = math.inf
    good = (
        math.isfinite(number)
        and {
            "any": True,
            "positive": number > 0.0,
            "not negative": number >= 0.0,
            "share": 0.0 <= number <= 1.0,
        }[key.sign]
    )
    if not good:
        why = "finite" if not math.isfinite(number) else MUST[key.sign]
        check = "its unit" if key.sign == "any" else "its sign and its unit"
        raise InputError(f"[{section}] {key.name} must be {why}, got {number:g}{shown}; check {check} ({unit}).")
    check_range(section, key.name, key.unit, unit, number, divides=key.sign == "positive")
    return number


def read_values(section: str, table: TomlTable, keys: Iterable[Key], units: Units) -> JsonObject:
    """The values of a section's keys by name; the default where a key is not written.

    Raises:
        InputError: for a missing key or an invalid value.
    """
    values: JsonObject = {}
    for key in keys:
        if key.name not in table:
            if key.required:
                raise InputError(missing(section, key, table, units))
            values[key.name] = key.default
        elif key.many:
            values[key.name] = _read_list(section, key, table[key.name], units)
        else:
            values[key.name] = read_number(section, key, table[key.name], units)
    return values


def missing(section: str, key: Key, table: TomlTable, units: Units) -> str:
    """The message for a missing key; it names a similar key that was written instead."""
    near = difflib.get_close_matches(key.name, [name for name in table if name != "type"], n=1, cutoff=0.75)
    unit = units.name(key.unit)
    hint = f" (is {near[0]!r} meant?)" if near else ""
    example = "[...]" if key.many else "..."
    return f"[{section}] {key.name} is missing{hint}: write {key.name} = {example} in {unit}."


def _read_list(section: str, key: Key, value: Any, units: Units) -> tuple[float, ...]:
    if not isinstance(value, list) or not value:
        raise InputError(
            f"[{section}] {key.name} = {str(value)[:40]} is not a list: write {key.name} = [1.0, ...] "
            f"[{units.name(key.unit)}]."
        )
    return tuple(read_number(section, key, item, units) for item in value)
