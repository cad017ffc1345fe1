"""Diagnosis: the answer for the user, which prints, plots and reports itself."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ..output.drawable import Drawable
from .answer.answer import Answer
from .answer.ranking_frame import ranking_frame
from .answer.summary import summary, verdict_line

if TYPE_CHECKING:
    from matplotlib.figure import Figure


@dataclass(frozen=True, repr=False, eq=False)
class Diagnosis(Drawable, Answer):
    """Where the simulation is wrong, which effect causes it, how far the gap shrinks.

    Its fields are those of `Answer`. `plot` draws one page: the verdict, measured against simulated,
    where, and how far the gap shrinks.
    """

    @classmethod
    def of(cls, answer: Answer, **changes: Any) -> Diagnosis:
        """The diagnosis with the fields of an answer.

        Args:
            answer: the data of the diagnosis.
            changes: fields with another value, by name.
        """
        return cls(**{each.name: getattr(answer, each.name) for each in dataclasses.fields(answer)} | changes)

    def _figure(self) -> Figure:
        from .report import draw_overview  # importing matplotlib takes a second

        return draw_overview(self)

    def to_dataframe(self) -> Any:
        """The ranking as a `pandas.DataFrame`, the effect as its index: a row for each parameter of each effect tried.

        Columns: cause (whether it is asserted), probability, cause_probability, gap_after; parameter, value, low,
        high (90 % interval), unit.

        Raises:
            InputError: where pandas is not installed.
        """
        return ranking_frame(self)

    def report(self, path: str | Path) -> Path:
        """Write `report.html` and every picture as PNG.

        Args:
            path: the folder, created if needed.

        Returns:
            The path of `report.html`.
        """
        from .report import write_report  # imports matplotlib too

        return write_report(self, path)

    def __str__(self) -> str:
        return summary(self)

    __repr__ = __str__

    def sentence(self) -> str:
        """The verdict in one sentence."""
        return verdict_line(self)
