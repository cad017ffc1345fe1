"""Numbers for a reader: as many digits as the interval supports, one power of ten a line, typographic units."""

import math
import re

from ..effects.estimate import Estimate as Estimate

_SUPERSCRIPTS = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")
# Units that take the prefixes milli and micro; the others (kg m^2, N m s/rad) are unusual with one.
_PREFIXED = {"s", "m", "m/s", "rad", "rad/s", "N m", "N", "A"}
_NO_BREAK = "\u202f"  # narrow no-break space, between number and unit
_MINUS = "−"


def show_unit(unit: str) -> str:
    """`N m s^2/rad^2` as `N·m·s²/rad²`; a pure number has no unit."""
    text = unit.strip()
    if text in {"", "1", "-"}:
        return ""
    text = re.sub(r"\^(-?\d+)", lambda found: found.group(1).translate(_SUPERSCRIPTS), text)
    return re.sub(r"(?<=[\w²³⁻¹])[ *](?=\w)", "·", text)


def show(value: float, digits: int = 3) -> str:
    """A number with `digits` significant digits; very small and very large ones with a power of ten."""
    if not math.isfinite(value):
        return "not known"
    if value == 0.0:
        return "0"
    return _show(value, _decimals(value, digits), _power(value))


def show_estimate(estimate: Estimate, digits: int = 4) -> tuple[str, tuple[str, str] | None]:
    """The value and the ends of its interval as text, with the digits that the interval supports, without unit.

    The last decimal is that of the second significant digit of the interval's half width. `digits` are the significant
    digits of a value without an interval. The interval is None where it is not known.
    """
    value, low, high = estimate.value, estimate.low, estimate.high
    if not math.isfinite(value):
        return "not known", None
    if not estimate.bounded:
        return show(value, digits), None
    half = 0.5 * (high - low)
    largest = max(abs(value), abs(low), abs(high))
    if largest == 0.0:  # exactly zero: log10 has no value
        return "0", None
    power = _power(largest)
    most = _decimals(largest, max(digits, 6))
    decimals = min(_decimals(half, 2), most) if half > 0.0 else _decimals(largest, digits)
    return _show(value, decimals, power), (_show(low, decimals, power), _show(high, decimals, power))


def scale_for(value: float, unit: str) -> tuple[float, str]:
    """(factor, unit) in which a value of this size reads best: 0.00402 s as 4.02 ms.

    Only units that are usual with a prefix get one; any other keeps its unit and the factor 1.
    """
    if unit not in _PREFIXED or not 0.0 < abs(value) < 0.1:
        return 1.0, unit
    return (1e3, f"m{unit}") if abs(value) >= 1e-3 else (1e6, f"µ{unit}")


def scaled(estimate: Estimate, factor: float, unit: str) -> Estimate:
    """The same estimate in another unit: every number times the factor."""
    return Estimate(factor * estimate.value, factor * estimate.low, factor * estimate.high, unit)


def readable(estimate: Estimate) -> Estimate:
    """The estimate in the unit in which it reads best."""
    return scaled(estimate, *scale_for(estimate.value, estimate.unit))


def show_with_unit(estimate: Estimate, digits: int = 3) -> str:
    """`0.142 rad/s`, in the estimate's own unit."""
    unit = show_unit(estimate.unit)
    return f"{show(estimate.value, digits)}{_NO_BREAK}{unit}" if unit else show(estimate.value, digits)


def show_percent(share: float) -> str:
    """A share between 0 and 1 in per cent; "100 %" and "0 %" only for exactly 1 and 0."""
    if not math.isfinite(share):
        return "not known"
    percent = 100.0 * share
    if 99.5 <= percent < 100.0:
        text = f"{min(percent, 99.9):.1f}"
    elif 0.0 < percent < 0.1:
        text = "< 0.1"
    elif abs(percent) < 0.95 and percent != 0.0:
        text = f"{percent:.1f}"
    else:
        text = f"{percent:.0f}"
    return f"{text.replace('-', _MINUS)}{_NO_BREAK}%"


def _power(value: float) -> int:
    """The power of ten that is written separately: 0 between 1e-3 and 1e6."""
    exponent = math.floor(math.log10(abs(value)))
    return exponent if exponent < -3 or exponent > 5 else 0


def _decimals(value: float, digits: int) -> int:
    """Number of decimals that show `digits` significant digits of the value; negative for large values."""
    # 1e-12: log10(1000) may come out just below 3.
    return digits - 1 - math.floor(math.log10(abs(value)) + 1e-12)


def _show(value: float, decimals: int, power: int) -> str:
    decimals += power
    # Rounded first: a format alone keeps every digit left of the point, 87677 for 90000.
    text = f"{round(value / 10.0**power, decimals) + 0.0:.{max(decimals, 0)}f}".replace("-", _MINUS)
    return text if power == 0 else f"{text}×10{str(power).translate(_SUPERSCRIPTS)}"
