"""Improvement: the predicted effect of other gains, for a user: printed, plotted, reported."""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ..output.data_frames import to_frame
from ..output.drawable import Drawable
from .answer import Answer, Range
from .summary import summary

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_UNKNOWN = Range(math.nan, math.nan, math.nan, "")


@dataclass(frozen=True, repr=False, eq=False)
class Improvement(Drawable, Answer):
    """The predicted effect of other gains, and whether they are proposed.

    Its fields are those of `Answer`. `plot` draws the tracking error before and after, the machines one by one, and the
    gains.
    """

    def __str__(self) -> str:
        return summary(self)

    __repr__ = __str__

    def _figure(self) -> Figure:
        from .pictures import draw_overview  # importing matplotlib takes a second

        return draw_overview(self)

    def to_dataframe(self) -> Any:
        """The predictions as a `pandas.DataFrame`, with the quantity as its index.

        Columns: unit, and of each of before, after and found (where something was searched) its value, low and high
        (90 % interval): before, before_low, before_high, after, ... A quantity that a side lacks is NaN.

        Raises:
            InputError: where pandas is not installed.
        """
        sides = {name: dict(side.rows()) for name in ("before", "after", "found") if (side := getattr(self, name))}
        units = {quantity: value.unit for rows in sides.values() for quantity, value in rows.items()}
        columns: dict[str, list[Any]] = {"unit": list(units.values())}
        for name, rows in sides.items():
            found = [rows.get(quantity, _UNKNOWN) for quantity in units]
            columns |= {
                name: [each.value for each in found],
                f"{name}_low": [each.low for each in found],
                f"{name}_high": [each.high for each in found],
            }
        return to_frame(columns, list(units), "quantity")

    def report(self, path: str | Path) -> Path:
        """Write `improve.html`, one self-contained page, and the pictures as PNG.

        Args:
            path: the folder; created if missing.

        Returns:
            The path of the page.
        """
        from .page import write_page  # likewise

        return write_page(self, Path(path))
