"""Units of log columns: what a user may write, and the factor to SI."""

import difflib
import math
from typing import NamedTuple

from ..errors import InputError


class Unit(NamedTuple):
    """A unit's quantity ("angle", "length", "rate", "speed", "torque", "force", "time", "label") and factor to SI."""

    quantity: str
    factor: float


_TURN = 2.0 * math.pi
_DEGREE = math.pi / 180.0
_TABLE: dict[str, dict[str, float]] = {
    "angle": {"rad": 1.0, "mrad": 1e-3, "urad": 1e-6, "deg": _DEGREE, "rev": _TURN, "arcmin": _DEGREE / 60.0,
              "arcsec": _DEGREE / 3600.0},
    "length": {"m": 1.0, "mm": 1e-3, "um": 1e-6, "cm": 1e-2, "inch": 0.0254},
    "rate": {"rad/s": 1.0, "mrad/s": 1e-3, "deg/s": _DEGREE, "rpm": _TURN / 60.0, "rev/s": _TURN,
             "rev/min": _TURN / 60.0, "dps": _DEGREE},
    "speed": {"m/s": 1.0, "mm/s": 1e-3, "um/s": 1e-6, "cm/s": 1e-2, "m/min": 1.0 / 60.0, "mm/min": 1e-3 / 60.0},
    "torque": {"Nm": 1.0, "mNm": 1e-3, "uNm": 1e-6, "kNm": 1e3, "Ncm": 1e-2, "ozin": 0.00706155181422604,
               "lbfin": 0.112984829027617, "lbfft": 1.35581794833140},
    "force": {"N": 1.0, "mN": 1e-3, "kN": 1e3, "kgf": 9.80665, "lbf": 4.4482216152605},
    "time": {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9, "min": 60.0},
    # Not converted: the model's inertia and friction then carry the same label ([units] torque).
    "label": {"V": 1.0, "A": 1.0, "PWM": 1.0, "%": 1.0, "counts": 1.0},
}  # fmt: skip
UNITS: dict[str, Unit] = {
    name: Unit(quantity, factor) for quantity, names in _TABLE.items() for name, factor in names.items()
}
_SPELLINGS = {"°": "deg", "°/s": "deg/s", "degree": "deg", "degrees": "deg", "radian": "rad", "radians": "rad",
              "µm": "um", "µs": "us", "newton": "N", "volt": "V", "percent": "%", "rps": "rev/s", "1/min": "rpm",
              "in": "inch", "µm/s": "um/s", "degs": "deg/s", "rads": "rad/s", "sec": "s", "seconds": "s"}  # fmt: skip

# Which quantities a column may be given in: rotary, linear.
QUANTITIES: dict[str, tuple[tuple[str, ...], tuple[str, ...]]] = {
    "time": (("time",), ("time",)),
    "torque": (("torque", "label"), ("force", "label")),
    "velocity": (("rate",), ("speed",)),
    "position": (("angle",), ("length",)),
    "reference": (("rate", "angle"), ("speed", "length")),
}


def find_unit(text: str) -> Unit | None:
    """The unit written as `text` ("deg/s", "N m", "N*m", "mm"), or None."""
    text = text.strip()
    plain = _SPELLINGS.get(text, text).replace(" ", "").replace("*", "").replace("·", "").replace(".", "")
    plain = _SPELLINGS.get(plain, plain)
    if plain in UNITS:
        return UNITS[plain]
    lower = {name.lower(): unit for name, unit in UNITS.items() if name.lower() not in ("mn", "mnm")}
    return lower.get(plain.lower()) if plain.lower() not in ("mn", "mnm") else None


def parse_unit(text: str, column: str, linear: bool | None) -> Unit:
    """The unit of a canonical column.

    Args:
        text: as the user wrote it.
        column: "time", "torque", "velocity", "position" or "reference".
        linear: whether the axis is linear; None where nobody has said yet.

    Raises:
        InputError: for a unit that is not known, or is of another quantity.
    """
    unit = find_unit(text)
    fitting = allowed_units(column, linear)
    if unit is None:
        near = difflib.get_close_matches(text, fitting, n=1)
        hint = f"did you mean {near[0]!r}? " if near else ""
        raise InputError(f"Unit {text!r} of column {column} is not known: {hint}{column} takes {', '.join(fitting)}.")
    rotary, straight = QUANTITIES[column]
    allowed = rotary + straight if linear is None else straight if linear else rotary
    if unit.quantity not in allowed:
        axis = "" if linear is None else " of a linear axis" if linear else " of a rotary axis"
        other = linear is not None and unit.quantity in (rotary if linear else straight)
        word = "rotary" if linear else "linear"
        hint = f'; for a {word} axis set [units] motion = "{word}" in the model' if other else ""
        raise InputError(
            f"Unit {text!r} is a {unit.quantity}, which column {column}{axis} cannot be: "
            f"give one of {', '.join(fitting)}{hint}."
        )
    return unit


def allowed_units(column: str, linear: bool | None) -> list[str]:
    """Names of the units that a canonical column may be given in."""
    rotary, straight = QUANTITIES[column]
    quantities = tuple(dict.fromkeys(rotary + straight)) if linear is None else straight if linear else rotary
    return [name for quantity in quantities for name in _TABLE[quantity]]
