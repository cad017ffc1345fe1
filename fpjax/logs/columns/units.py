"""Units of log columns: the spellings that are understood, and the factor of each to SI."""

import difflib
import math
import re
from typing import NamedTuple

from ...errors import InputError


class Unit(NamedTuple):
    """A unit's quantity and factor to SI.

    Attributes:
        quantity: "angle", "length", "rate", "speed", "torque", "force", "time", "temperature", "count", "count rate",
            or "label" for a unit that replaces N m and is not converted (A, V, PWM).
        factor: factor to SI, or to the label.
        label: unit that a label is kept in ("A" for mA); "" for other quantities.
    """

    quantity: str
    factor: float
    label: str = ""


def is_label(torque: str) -> bool:
    """Whether the unit of a torque is a label (V, A, PWM), which stands for N m or N in all that belongs to it."""
    return torque not in ("N m", "N")


_TURN = 2.0 * math.pi
_DEGREE = math.pi / 180.0
_TABLE: dict[str, dict[str, float]] = {
    "angle": {"rad": 1.0, "mrad": 1e-3, "urad": 1e-6, "deg": _DEGREE, "rev": _TURN, "arcmin": _DEGREE / 60.0,
              "arcsec": _DEGREE / 3600.0},
    "length": {"m": 1.0, "mm": 1e-3, "um": 1e-6, "cm": 1e-2, "inch": 0.0254},
    "rate": {"rad/s": 1.0, "mrad/s": 1e-3, "deg/s": _DEGREE, "rpm": _TURN / 60.0, "rev/s": _TURN,
             "rev/min": _TURN / 60.0, "dps": _DEGREE, "deg/min": _DEGREE / 60.0},
    "speed": {"m/s": 1.0, "mm/s": 1e-3, "um/s": 1e-6, "cm/s": 1e-2, "m/min": 1.0 / 60.0, "mm/min": 1e-3 / 60.0},
    "torque": {"Nm": 1.0, "mNm": 1e-3, "uNm": 1e-6, "kNm": 1e3, "Ncm": 1e-2, "ozin": 0.00706155181422604,
               "lbfin": 0.112984829027617, "lbfft": 1.35581794833140, "kgfcm": 0.0980665},
    "force": {"N": 1.0, "mN": 1e-3, "kN": 1e3, "kgf": 9.80665, "lbf": 4.4482216152605},
    "time": {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9, "min": 60.0},
    "temperature": {"degC": 1.0, "K": 1.0},
    "count": {"counts": 1.0},
    "count rate": {"counts/s": 1.0},
}  # fmt: skip
# Not converted to N m: the model's inertia and friction then have the same label ([units] torque in its file).
# An effective current has a label of its own: its scale in N m is the square root of two times that of a peak value.
_LABELS = {
    "V": ("V", 1.0), "mV": ("V", 1e-3), "A": ("A", 1.0), "mA": ("A", 1e-3), "Arms": ("Arms", 1.0), "PWM": ("PWM", 1.0),
    "%": ("%", 1.0), "‰": ("‰", 1.0),
}  # fmt: skip
UNITS: dict[str, Unit] = {
    **{name: Unit(quantity, factor) for quantity, names in _TABLE.items() for name, factor in names.items()},
    **{name: Unit("label", factor, label) for name, (label, factor) in _LABELS.items()},
}
PER_SECOND = ("1/s", "s-1", "s^-1", "s⁻¹")  # of a speed: rad/s in SI, but some drives count turns
_SPELLINGS = {
    **dict.fromkeys(PER_SECOND, "rad/s"),
    "°": "deg", "°/s": "deg/s", "degree": "deg", "degrees": "deg", "grad": "deg", "radian": "rad", "radians": "rad",
    "µm": "um", "µs": "us", "μm": "um", "μs": "us", "µm/s": "um/s", "newton": "N", "in": "inch", "meter": "m",
    "meters": "m", "metre": "m", "metres": "m",
    "volt": "V", "volts": "V", "amp": "A", "amps": "A", "ampere": "A", "amperes": "A", "percent": "%", "prozent": "%",
    "duty": "PWM", "rps": "rev/s", "1/min": "rpm", "min-1": "rpm", "min^-1": "rpm", "u/min": "rpm", "umin": "rpm",
    "tr/min": "rpm", "r/min": "rpm", "turn": "rev", "turns": "rev", "revolutions": "rev", "revs": "rev", "u": "rev",
    "umdr": "rev", "rotation": "rev", "rotations": "rev", "rot": "rev", "rotations/s": "rev/s", "rot/s": "rev/s",
    "turns/s": "rev/s", "turn/s": "rev/s", "turns/min": "rpm", "revolutions/s": "rev/s",
    "degs": "deg/s", "degrees/s": "deg/s", "rads": "rad/s", "radians/s": "rad/s",
    "sec": "s", "secs": "s", "second": "s", "seconds": "s", "sekunden": "s", "sek": "s", "msec": "ms",
    "millis": "ms", "milliseconds": "ms", "usec": "us", "micros": "us", "microseconds": "us", "nanoseconds": "ns",
    "nsec": "ns", "minutes": "min", "c": "degC", "°c": "degC", "celsius": "degC", "count": "counts", "cnt": "counts",
    "cts": "counts", "ticks": "counts", "tick": "counts", "inc": "counts", "incs": "counts", "inkremente": "counts",
    "ink": "counts", "pulses": "counts", "pulse": "counts", "pls": "counts", "puls": "counts", "impulse": "counts",
    "lsb": "counts", "steps": "counts", "digit": "counts", "digits": "counts",
    "ticks/s": "counts/s", "inc/s": "counts/s", "count/s": "counts/s", "pulses/s": "counts/s",
    "cnt/s": "counts/s", "cts/s": "counts/s", "pulse/s": "counts/s",
    "ink/s": "counts/s", "lbin": "lbfin", "inlb": "lbfin", "inlbf": "lbfin", "lbft": "lbfft", "ftlb": "lbfft",
    "ftlbf": "lbfft", "inoz": "ozin", "kgcm": "kgfcm", "min⁻¹": "rpm", "rad.s-1": "rad/s",
    "aeff": "Arms", "apk": "A", "permille": "‰", "promille": "‰",
}  # fmt: skip
_CASED = ("mn", "mnm", "k", "a", "v", "mv", "ma")  # in another case they are another unit (MN) or a word

# Quantities that each canonical column may be given in: (rotary axis, linear axis).
QUANTITIES: dict[str, tuple[tuple[str, ...], tuple[str, ...]]] = {
    "time": (("time",), ("time",)),
    "torque": (("torque", "label", "count"), ("force", "label", "count")),
    "velocity": (("rate", "count rate"), ("speed", "count rate")),
    "position": (("angle", "count"), ("length", "count")),
    "reference": (("rate", "angle", "count", "count rate"), ("speed", "length", "count", "count rate")),
    "torque_measured": (("torque", "label", "count"), ("force", "label", "count")),
    "temperature": (("temperature",), ("temperature",)),
}
# unit at the end of a name: "torque_Nm", "velocity_deg_s"
_SUFFIXES = {
    "nm": "Nm", "mnm": "mNm", "ncm": "Ncm", "n": "N", "a": "A", "ma": "mA", "v": "V", "mv": "mV", "pwm": "PWM",
    "s": "s", "ms": "ms", "us": "us", "ns": "ns", "sec": "s", "secs": "s", "seconds": "s", "millis": "ms",
    "rad": "rad", "mrad": "mrad", "deg": "deg", "degrees": "deg", "rev": "rev", "turns": "rev", "counts": "counts",
    "ticks": "counts", "m": "m", "mm": "mm", "um": "um", "rad_s": "rad/s", "rads": "rad/s", "radps": "rad/s",
    "rad_per_s": "rad/s", "rad_per_sec": "rad/s", "deg_s": "deg/s", "degps": "deg/s", "deg_per_s": "deg/s",
    "dps": "deg/s", "rpm": "rpm", "rps": "rev/s", "rev_s": "rev/s", "turns_s": "rev/s", "m_s": "m/s", "mps": "m/s",
    "mm_s": "mm/s", "c": "degC", "degc": "degC", "radians": "rad", "rotations": "rev", "rotations_per_sec": "rev/s",
    "amps": "A", "arms": "Arms", "volts": "V", "percent": "%", "pct": "%", "permille": "‰", "deg_sec": "deg/s",
    "rad_sec": "rad/s", "deg_per_sec": "deg/s", "inc": "counts", "cts": "counts", "pulses": "counts",
}  # fmt: skip

# a letter behind one of these is an index, not a unit: theta_m is the motor's angle, tau_a the actual torque
_SYMBOLS = {"theta", "phi", "omega", "alpha", "tau", "q", "dq", "qd", "w", "v", "p", "u", "i", "t", "angle"}


# "0.1 rpm", "0.1 %": a drive counts in steps of its last digit; but 1/min is no multiple of anything
_MULTIPLE = re.compile(r"^(?P<number>\d*[.,]?\d+(?:e-?\d+)?)\s*(?P<unit>[^\d\s/^*.,].*)$", re.IGNORECASE)


def find_unit(text: str) -> Unit | None:
    """The unit that `text` spells ("deg/s", "N m", "N*m", "oz-in", "U/min", "0.1 %", "V (Voltage)"), or None."""
    bare = re.sub(r"\s*\([^)]*\)$", "", text.strip())
    effective = re.sub(r"\s*\((rms|eff)\)$", r" \1", text.strip(), flags=re.IGNORECASE)  # another size, not a remark
    found, text = _spelt(effective) or _spelt(bare), bare
    if found is None and (multiple := _MULTIPLE.match(text)) and (whole := _spelt(multiple["unit"])):
        number = float(multiple["number"].replace(",", "."))
        found = whole._replace(factor=number * whole.factor) if number > 0.0 else None
    return found


def _spelt(text: str) -> Unit | None:
    plain = re.sub(r"[\s*·.⋅]", "", _SPELLINGS.get(text, text))
    plain = re.sub(r"/(?:sec|second|sek)s?$", "/s", re.sub(r"/minutes?$", "/min", plain, flags=re.I), flags=re.I)
    plain = _SPELLINGS.get(plain, plain)
    if plain in UNITS:
        return UNITS[plain]
    # any case is accepted ("RPM", "Deg/S"), but not where case decides: mN is a millinewton, MN would be a meganewton
    lower = plain.lower()
    if lower in _CASED and lower not in _SPELLINGS:
        return None
    found = UNITS.get(_SPELLINGS.get(lower, "")) or _LOWER.get(lower)
    return _spelt(plain.replace("-", "")) if found is None and "-" in plain else found


_LOWER = {name.lower(): unit for name, unit in UNITS.items() if name.lower() not in _CASED}


def suffix_unit(name: str) -> tuple[str, str] | None:
    """(name without its unit, unit) of a name that ends with a unit: ("torque", "Nm") of "torque_nm"; None without."""
    parts = name.split("_")
    if parts[-1] in ("m", "a", "n", "c") and "_".join(parts[:-1]) in _SYMBOLS:
        return None
    for size in (3, 2, 1):
        if len(parts) > size and (unit := _SUFFIXES.get("_".join(parts[-size:]))):
            return "_".join(parts[:-size]), unit
    return None


def parse_unit(text: str, column: str, linear: bool | None) -> Unit:
    """The unit that `text` spells, checked to be one that the canonical column can have.

    Args:
        text: as the user wrote it.
        column: "time", "torque", "velocity", "position", "reference", "torque_measured" or "temperature".
        linear: whether the axis is linear; None where that is not known yet.

    Raises:
        InputError: for a unit that is not known, or is of another quantity.
    """
    unit = find_unit(text)
    fitting = allowed_units(column, linear)
    if unit is None:
        near = difflib.get_close_matches(text[:40], fitting, n=1)
        hint = f"did you mean {near[0]!r}? " if near else ""
        raise InputError(
            f"Unit {text[:40]!r} of column {column} is not known: {hint}{column} takes {', '.join(fitting)}; give "
            f"one of them with --columns {column}=NAME:UNIT."
        )
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
    """Names of the units that a canonical column may have.

    Args:
        column: as in `parse_unit`.
        linear: whether the axis is linear; None for the units of both kinds of axis.
    """
    rotary, straight = QUANTITIES[column]
    quantities = tuple(dict.fromkeys(rotary + straight)) if linear is None else straight if linear else rotary
    return [name for name, unit in UNITS.items() if unit.quantity in quantities]
