"""Every picture of a report, in a wide layout and in one for a phone, and the one-page overview."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from textwrap import fill
from typing import Any

from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from ..diagnosis import Diagnosis
from .contents import Contents, read
from .record_picture import draw_record, has_record
from .shrink_picture import draw_ranking, draw_shrink, rows_of
from .text import confidence_sentence, verdict_sentence, verdict_title, where_sentence
from .theme import MUTED, report_style
from .where_picture import axes_with_places, draw_residual, draw_where, has_regimes, has_where, residual_axes

_WIDE, _NARROW = 11.2, 4.3  # inch; the page shows them at about 96 and 84 pixels per inch


@dataclass(frozen=True)
class Picture:
    """One picture.

    Attributes:
        name: its file's stem.
        description: what it shows, in a sentence.
        wide: for paper and a desktop.
        narrow: for a phone.
    """

    name: str
    description: str
    wide: Figure
    narrow: Figure


def draw_pictures(diagnosis: Diagnosis) -> list[Picture]:
    """Every picture that the diagnosis has the data for: `record`, `where`, `residual`, `shrink`.

    Args:
        diagnosis: what `fpjax.gap.diagnose` found.
    """
    return pictures_of(read(diagnosis))


def draw_overview(diagnosis: Diagnosis) -> Figure:
    """One page: the verdict, measured against simulated, where the gap lies and how far it shrinks.

    Args:
        diagnosis: what `fpjax.gap.diagnose` found.
    """
    return overview_of(read(diagnosis))


def pictures_of(contents: Contents) -> list[Picture]:
    """As `draw_pictures`, of what was read."""
    found = []
    if has_record(contents):
        found.append(_picture("record", _record_description(contents), draw_record, contents, 4.6, 7.4))
    if has_where(contents):
        found.append(_where_picture("where", where_sentence(contents) or "Shares of the gap's energy.", contents))
    if contents.left is not None and contents.verdict == "unexplained":
        left = contents.left
        rest = replace(contents, where=left.where, maps=left.maps, regimes=left.regimes)
        if has_where(rest):
            found.append(_where_picture("left", "Where what is left of the gap lies.", rest))
    panels = len(residual_axes(contents))
    if panels:
        description = "What the nominal model cannot account for, against " + ", ".join(residual_axes(contents)) + "."
        found.append(_picture("residual", description, draw_residual, contents, 2.9, 2.1 * panels + 0.3))
    rows = len(rows_of(contents))
    if rows:
        description = "The gap: " + ", ".join(f"{name} {gap.value:.3g}" for name, gap in rows_of(contents)) + "."
        found.append(_picture("shrink", description, draw_shrink, contents, 0.95 + 0.52 * rows, 1.0 + 0.72 * rows))
    return found


def overview_of(contents: Contents) -> Figure:
    """As `draw_overview`, of what was read."""
    parts: list[tuple[float, Callable[..., None]]] = []
    if has_record(contents):
        parts.append((4.6, draw_record))
    if has_where(contents):
        parts.append((4.6 if len(axes_with_places(contents)) > 1 else 2.4, draw_where))
    if rows_of(contents):
        parts.append(
            (max(0.95 + 0.52 * len(rows_of(contents)), 1.9 if contents.ranking else 0.0), _draw_shrink_and_ranking)
        )
    with report_style():
        figure = _figure(_WIDE, 1.0 + sum(height for height, _ in parts))
        # at least one part and the head: an array of subfigures, never a single one
        parts = parts or [(0.1, _draw_nothing)]
        bands: Any = figure.subfigures(
            len(parts) + 1, 1, height_ratios=[1.0, *(height for height, _ in parts)], hspace=0.02
        )
        head = bands[0]
        head.text(0.012, 0.72, verdict_title(contents), fontsize=17, fontweight="bold", va="center")
        # wrapped here: matplotlib's own wrapping reads a dollar sign in a name as mathematics
        head.text(0.012, 0.5, fill(verdict_sentence(contents), 122), fontsize=10, va="top")
        head.text(0.988, 0.72, confidence_sentence(contents), fontsize=10, color=MUTED, va="center", ha="right")
        for band, (_, draw) in zip(bands[1:], parts, strict=True):
            draw(band, contents, narrow=False)
    return figure


def _where_picture(name: str, description: str, contents: Contents) -> Picture:
    panels = len(axes_with_places(contents)) + has_regimes(contents)
    rows = 1 if panels < 3 else 2
    return _picture(name, description, draw_where, contents, 2.3 * rows + 0.2, 2.0 * panels + 0.2)


def _draw_nothing(figure: Any, contents: Contents, *, narrow: bool) -> None:
    del figure, contents, narrow


def _draw_shrink_and_ranking(figure: Any, contents: Contents, *, narrow: bool) -> None:
    if not contents.ranking:
        draw_shrink(figure, contents, narrow=narrow)
        return
    left, right = figure.subfigures(1, 2, width_ratios=[1.9, 1.0])
    draw_shrink(left, contents, narrow=narrow)
    draw_ranking(right, contents)


def _record_description(contents: Contents) -> str:
    return f"Measured and simulated {contents.signal} on withheld data, the error, and the worst place enlarged."


def _picture(
    name: str, description: str, draw: Callable[..., None], contents: Contents, high: float, high_narrow: float
) -> Picture:
    return Picture(
        name,
        description,
        _drawn(draw, contents, _WIDE, high, narrow=False),
        _drawn(draw, contents, _NARROW, high_narrow, narrow=True),
    )


def _drawn(draw: Callable[..., None], contents: Contents, width: float, height: float, *, narrow: bool) -> Figure:
    with report_style():
        figure = _figure(width, height)
        draw(figure, contents, narrow=narrow)
        # laid out once, not again for every file that is written from it
        figure.draw_without_rendering()
        figure.set_layout_engine("none")
    return figure


def _figure(width: float, height: float) -> Figure:
    figure = Figure(figsize=(width, height), layout="constrained")
    FigureCanvasAgg(figure)
    return figure
