"""Numbers, dates and times of day in the cells of a text table, with the decimal signs of either habit."""

import re
from collections.abc import Iterable
from datetime import UTC, datetime

# 1,234.5 and 1'234'567: in groups of three, of which the first begins with no zero
_GROUPED = re.compile(r"[-+]?[1-9]\d{0,2}(?:[,'\u2019]\d{3})+(?:\.\d*)?(?:[eE][-+]?\d+)?")

# 1.234.567, as German programs write integers
_POINTS = re.compile(r"[-+]?[1-9]\d{0,2}(?:\.\d{3})+")


def thousands(cell: str) -> float | None:
    """The whole number in a cell whose points stand between groups of three digits (1.234), or None."""
    return float(cell.replace(".", "")) if _POINTS.fullmatch(cell) else None


def has_decimal_point(cell: str) -> bool:
    """Whether a cell of a file of decimal commas is a number with a decimal point, or one of more than three digits.

    In a column of the latter (1234) a 1.234 is no integer in groups either.
    """
    if thousands(cell) is not None or not re.fullmatch(r"[-+]?(?:\d*\.\d*|\d{4,})(?:[eE][-+]?\d+)?", cell):
        return False
    return any(map(str.isdigit, cell))


def number(cell: str, *, comma: bool) -> float | None:
    """The number in a cell, or None. A date or a time of day is given in seconds.

    Args:
        cell: text of the cell.
        comma: whether 1,5 is one and a half (decimal comma) and 1.000,5 has a thousands separator.
    """
    if "_" in cell:  # python reads 1_0 as ten
        return None
    try:
        return float(cell)
    except ValueError:
        if cell.count(":") >= 2:
            return _clock(cell)
        # the later one of comma and point is the decimal one
        if comma and cell.count(",") == 1 and cell.rfind(".") < cell.find(","):
            return number(cell.replace(".", "").replace(",", "."), comma=False)
        if _GROUPED.fullmatch(cell):
            return float(re.sub("[,'\u2019]", "", cell))
        # 12 345,6: a space or a narrow one between digits
        joined = re.sub(r"(?<=\d)[ \u00a0\u202f](?=\d{3}(?!\d))", "", cell)
        if joined != cell:
            return number(joined, comma=comma)
        return {"true": 1.0, "false": 0.0}.get(cell.lower())


def has_decimal_comma(cells: Iterable[str], separator: str | None) -> bool:
    """Whether the commas within cells are decimal ones.

    They are where one does not stand in groups of three ("1,5", "0,345"), and not where a point or a second group
    follows ("1,234.5", "1,234,567"). A file of nothing but "12,345" is of where commas separate no cells.

    Args:
        cells: of the rows of numbers.
        separator: of the cells; quoted ones may hold it.
    """
    numbers = [cell.strip() for cell in cells if ":" not in cell]  # a time of day may have either
    commas = [cell for cell in numbers if "," in cell and number(cell, comma=True) is not None]
    if not all(_GROUPED.fullmatch(cell) for cell in commas):
        return True
    plain = all(cell.count(",") == 1 and "." not in cell for cell in commas)
    return bool(commas) and plain and separator != ","


# 28.11.2026 23:59:57.000, 11/28/2026 11:59:57 PM, 23:59:57:000
_MOMENT = re.compile(
    r"(?:(?P<day>\d{1,2})\.(?P<month>\d{1,2})\.(?P<year>\d{4})[.,]? +"
    r"|(?P<us_month>\d{1,2})/(?P<us_day>\d{1,2})/(?P<us_year>\d{4})[.,]? +(?=.*[ap]m$))?"
    r"(?P<hour>\d{1,2}):(?P<minute>\d{2}):(?P<second>\d{2})(?P<rest>\.\d+|:\d{3})?(?: ?(?P<half>[ap])m)?",
    re.IGNORECASE,
)


def _clock(cell: str) -> float | None:
    """Seconds of "2025-11-09T09:27:03.748Z" (since 1970) or "09:27:03.748" (since midnight), or None.

    Dates may also be German ones (day.month.year) or those of a clock of 12 hours (month/day/year and AM or PM).
    """
    text = re.sub("[\u00a0\u202f]", " ", cell.strip().strip('"').replace(",", "."))
    try:
        if found := _MOMENT.fullmatch(text):
            return _seconds(found)
        if "-" in text or "/" in text:
            moment = datetime.fromisoformat(text.replace("/", "-"))
            return (moment if moment.tzinfo else moment.replace(tzinfo=UTC)).timestamp()
        hours, minutes, seconds = text.split(":")
        return 3600.0 * int(hours) + 60.0 * int(minutes) + float(seconds)
    except ValueError:
        return None


def _seconds(found: re.Match[str]) -> float:
    """Seconds of a match of `_MOMENT`, since 1970 where it has a date.

    Raises:
        ValueError: for a date or an hour that there is not.
    """
    hour, rest = int(found["hour"]), (found["rest"] or ".0").replace(":", ".")
    if found["half"]:
        if not 1 <= hour <= 12:
            raise ValueError(f"{hour} is no hour of a clock of 12")
        hour = hour % 12 + (12 if found["half"].lower() == "p" else 0)
    seconds = 3600.0 * hour + 60.0 * int(found["minute"]) + float(found["second"] + rest)
    date = [found["year"] or found["us_year"], found["month"] or found["us_month"], found["day"] or found["us_day"]]
    if date[0] is None:
        return seconds
    year, month, day = map(int, date)
    return datetime(year, month, day, tzinfo=UTC).timestamp() + seconds
