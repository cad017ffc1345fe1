"""The pictures of a report, each in a wide layout and in one for a phone, and the one-page overview."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from textwrap import fill
from typing import TYPE_CHECKING, Any

from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure, FigureBase

from .gap_picture import draw_gap, draw_ranking, rows_of
from .learned_picture import draw_learned, laws_of
from .record_picture import draw_record, has_record
from .sentences import confidence_sentence, verdict_sentence, verdict_title, where_sentence
from .theme import MUTED, report_style
from .where_picture import (
    axes_with_places,
    draw_residual,
    draw_rest,
    draw_where,
    has_regimes,
    has_where,
    residual_axes,
)

if TYPE_CHECKING:
    from ..answer.answer import Answer

_WIDE, _NARROW = 11.2, 4.3  # widths [inch]; the page shows them at about 96 and 84 pixels per inch


@dataclass(frozen=True)
class Picture:
    """One picture.

    Attributes:
        name: stem of its file.
        description: what it shows, in a sentence.
        wide: for paper and a desktop.
        narrow: for a phone.
    """

    name: str
    description: str
    wide: Figure
    narrow: Figure


def draw_pictures(diagnosis: Answer) -> list[Picture]:
    """Every picture that the diagnosis has the data for: `record`, `where`, `residual`, `left`, `learned`,
    `shrink`.

    Args:
        diagnosis: from `fpjax.gap.diagnose`.
    """
    found = []
    if has_record(diagnosis):
        # Heights [inch] of the wide and of the narrow layout.
        found.append(_picture("record", _record_description(), draw_record, diagnosis, 4.6, 7.4))
    if has_where(diagnosis):
        found.append(
            _where_picture("where", where_sentence(diagnosis) or "Shares of the gap's energy.", draw_where, diagnosis)
        )
    if diagnosis.residual_where is not None:
        # The same picture, of what the causes leave.
        rest = replace(diagnosis, where=diagnosis.residual_where)
        if has_where(rest):
            found.append(_where_picture("left", "Where the rest of the gap lies.", draw_rest, rest))
    panels = len(residual_axes(diagnosis))
    if panels:
        description = "What the nominal model cannot account for, against " + ", ".join(residual_axes(diagnosis)) + "."
        found.append(_picture("residual", description, draw_residual, diagnosis, 2.9, 2.1 * panels + 0.3))
    if laws := laws_of(diagnosis):
        description = (
            "Learned laws: " + ", ".join(f"of {law.of}, {law.share:.0%} of what is left" for law in laws) + "."
        )
        found.append(_picture("learned", description, draw_learned, diagnosis, 3.0, 2.5 * len(laws) + 0.3))
    rows = len(rows_of(diagnosis))
    if rows:
        description = "The gap: " + ", ".join(f"{name} {gap.value:.3g}" for name, gap in rows_of(diagnosis)) + "."
        found.append(_picture("shrink", description, draw_gap, diagnosis, 0.95 + 0.52 * rows, 1.0 + 0.72 * rows))
    return found


def draw_overview(diagnosis: Answer) -> Figure:
    """One page: the verdict, commanded against needed, where the gap lies and how far it shrinks.

    Args:
        diagnosis: from `fpjax.gap.diagnose`.
    """
    parts: list[tuple[float, Callable[..., None]]] = []
    if has_record(diagnosis):
        parts.append((4.6, draw_record))
    if has_where(diagnosis):
        parts.append((4.6 if len(axes_with_places(diagnosis)) > 1 else 2.4, draw_where))
    if rows_of(diagnosis):
        parts.append(
            (max(0.95 + 0.52 * len(rows_of(diagnosis)), 1.9 if diagnosis.ranking else 0.0), _draw_gap_and_ranking)
        )
    with report_style():
        figure = _figure(_WIDE, 1.0 + sum(height for height, _ in parts))
        # Head and at least one part: `subfigures` returns an array, not a single subfigure.
        parts = parts or [(0.1, _draw_nothing)]
        bands: Any = figure.subfigures(
            len(parts) + 1, 1, height_ratios=[1.0, *(height for height, _ in parts)], hspace=0.02
        )
        head = bands[0]
        # In shares of the head's width and height.
        head.text(0.012, 0.72, verdict_title(diagnosis), fontsize=17, fontweight="bold", va="center")
        # Wrapped here: matplotlib's own wrapping reads a dollar sign in a name as mathematics.
        head.text(0.012, 0.5, fill(verdict_sentence(diagnosis), 122), fontsize=10, va="top")
        head.text(0.988, 0.72, confidence_sentence(diagnosis), fontsize=10, color=MUTED, va="center", ha="right")
        for band, (_, draw) in zip(bands[1:], parts, strict=True):
            draw(band, diagnosis, narrow=False)
    return figure


def _where_picture(name: str, description: str, draw: Callable[..., None], diagnosis: Answer) -> Picture:
    panels = len(axes_with_places(diagnosis)) + has_regimes(diagnosis)
    rows = 1 if panels < 3 else 2
    return _picture(name, description, draw, diagnosis, 2.3 * rows + 0.2, 2.0 * panels + 0.2)


def _draw_nothing(figure: FigureBase, diagnosis: Answer, *, narrow: bool) -> None:
    del figure, diagnosis, narrow


def _draw_gap_and_ranking(figure: FigureBase, diagnosis: Answer, *, narrow: bool) -> None:
    if not diagnosis.ranking:
        draw_gap(figure, diagnosis, narrow=narrow)
        return
    halves: Any = figure.subfigures(1, 2, width_ratios=[1.9, 1.0])
    draw_gap(halves[0], diagnosis, narrow=narrow)
    draw_ranking(halves[1], diagnosis)


def _record_description() -> str:
    return (
        "The commanded torque and what each model needs on withheld data, the difference, and the worst place enlarged."
    )


def _picture(
    name: str, description: str, draw: Callable[..., None], diagnosis: Answer, high: float, high_narrow: float
) -> Picture:
    return Picture(
        name,
        description,
        _drawn(draw, diagnosis, _WIDE, high, narrow=False),
        _drawn(draw, diagnosis, _NARROW, high_narrow, narrow=True),
    )


def _drawn(draw: Callable[..., None], diagnosis: Answer, width: float, height: float, *, narrow: bool) -> Figure:
    with report_style():
        figure = _figure(width, height)
        draw(figure, diagnosis, narrow=narrow)
        # Laid out once; the layout engine would run again for the SVG and the PNG.
        layout = figure.get_layout_engine()
        assert layout is not None
        layout.execute(figure)
        figure.set_layout_engine("none")
    return figure


def _figure(width: float, height: float) -> Figure:
    figure = Figure(figsize=(width, height), layout="constrained")
    FigureCanvasAgg(figure)
    return figure
