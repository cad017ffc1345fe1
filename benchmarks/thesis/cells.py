"""Printed cells, the numbers obtained for them, and the verdicts computed from both."""

import dataclasses
import math
from collections.abc import Mapping, Sequence

REPRODUCED = "reproduced"
SOLVER_SPECIFIC = "solver-specific"
NOT_REPRODUCED = "not reproduced"
VERDICTS = (REPRODUCED, SOLVER_SPECIFIC, NOT_REPRODUCED)

# A check by another solver or step may differ from the printed number by twice the tolerance: once for the rounding of
# print (most digits are truncated, not rounded), once for the solver.
CHECK_TOLERANCE = 2.0


@dataclasses.dataclass(frozen=True)
class Printed:
    """A number that the thesis prints.

    Attributes:
        cell: its name, as "2.3/g2/alpha=10/velocity".
        text: as printed.
        tolerance: largest relative difference that counts as the same [1].
        absolute: largest difference that counts as the same, in the cell's unit.
        below: whether print gives an upper bound ("under 30 %").
    """

    cell: str
    text: str
    tolerance: float = 0.005
    absolute: float = 0.0
    below: bool = False

    @property
    def value(self) -> float:
        """The printed number."""
        return float(self.text)

    def matches(self, obtained: float, slack: float = 1.0) -> bool:
        """Whether `obtained` is the printed number: within the tolerance, or the same digits when rounded or truncated.

        Args:
            obtained: in the cell's unit.
            slack: what the tolerance is multiplied by [1].
        """
        if not math.isfinite(obtained):
            return False
        if self.below:
            return obtained < self.value
        if abs(obtained - self.value) <= max(slack * self.tolerance * abs(self.value), slack * self.absolute):
            return True
        return self._same_digits(obtained)

    def _same_digits(self, obtained: float) -> bool:
        text = self.text.lower()
        if "e" in text:
            mantissa, exponent = text.split("e")
            return dataclasses.replace(self, text=mantissa)._same_digits(obtained / 10.0 ** int(exponent))
        decimals = len(text.partition(".")[2])
        if decimals == 0:  # a whole number has too few digits to compare
            return False
        scaled, target = obtained * 10.0**decimals, round(self.value * 10.0**decimals)
        return target in (round(scaled), math.trunc(scaled + 1e-9))


@dataclasses.dataclass(frozen=True)
class Cell:
    """A printed cell with what was obtained.

    Attributes:
        printed: what the thesis prints.
        obtained: with the thesis' solver and step.
        checks: the same with other solvers and steps, by their names.
        reason: why it is not reproduced, or only by this solver; empty where it is reproduced.
    """

    printed: Printed
    obtained: float
    checks: Mapping[str, float]
    reason: str = ""

    @property
    def relative_error(self) -> float:
        """(obtained - printed) / printed [1]."""
        return (self.obtained - self.printed.value) / self.printed.value

    @property
    def verdict(self) -> str:
        """One of `VERDICTS`."""
        if not self.printed.matches(self.obtained):
            return NOT_REPRODUCED
        if all(self.printed.matches(value, CHECK_TOLERANCE) for value in self.checks.values()):
            return REPRODUCED
        return SOLVER_SPECIFIC

    def row(self) -> dict[str, object]:
        """The cell as `thesis.json` holds it."""
        return {
            "cell": self.printed.cell,
            "printed": self.printed.value,
            "obtained": self.obtained,
            "relative_error": self.relative_error,
            "verdict": self.verdict,
        }

    def details(self) -> dict[str, object]:
        """The cell as `thesis_details.json` holds it."""
        return self.row() | {
            "as_printed": self.printed.text,
            "tolerance": self.printed.tolerance,
            "checks": dict(self.checks),
            "reason": self.reason,
        }


def judge(
    printed: Sequence[Printed],
    obtained: Mapping[str, float],
    checks: Mapping[str, Mapping[str, float]],
    reasons: Mapping[str, str],
) -> list[Cell]:
    """Cells from what was printed and obtained.

    Args:
        printed: what the thesis prints.
        obtained: by cell, with the thesis' solver and step.
        checks: by setting, then by cell; a cell may be missing from it.
        reasons: why a cell misses, by cell or by the beginning of its name (the longest counts).
    """
    cells = []
    for one in printed:
        found = {name: values[one.cell] for name, values in checks.items() if one.cell in values}
        cell = Cell(one, obtained[one.cell], found)
        cells.append(dataclasses.replace(cell, reason=_reason(cell, reasons)))
    return cells


def _reason(cell: Cell, reasons: Mapping[str, str]) -> str:
    if cell.verdict == REPRODUCED:
        return ""
    name = cell.printed.cell
    known = max((key for key in reasons if name.startswith(key)), key=len, default="")
    parts = [reasons[known]] if known else []
    if cell.verdict == SOLVER_SPECIFIC:
        moved = ", ".join(f"{value:.4g} with {setting}" for setting, value in cell.checks.items())
        parts.insert(0, moved)
    return "; ".join(parts)
