"""The picture of how far the gap shrinks: a bar for each cause, solid what is left, pale what the cause removes."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from .derived_values import gap_scale, shown_gap, step_gap, twins_of
from .digits import show, show_percent, show_unit
from .names import clip, effect_title
from .sentences import effort_of, learned_name, step_remark
from .theme import AFTER, BEFORE, FLOOR, INK, MUTED, PAPER, SOFT

if TYPE_CHECKING:
    from matplotlib.figure import FigureBase

    from ..answer.answer import Answer
    from ..effects.estimate import Estimate


def rows_of(diagnosis: Answer) -> list[tuple[str, Estimate]]:
    """Names and gaps from top to bottom: the nominal model, each added cause, or the best attempt."""
    rows = [("Nominal model", diagnosis.gap.estimate("before"))]
    for step in diagnosis.steps:
        # A twin closes the gap as well: the row must not claim more than the ranking.
        twin = " (or twin)" if twins_of(diagnosis, step.added) else ""
        detail = step_remark(diagnosis, step.added)
        rows.append((f"+ {effect_title(step.added, diagnosis.motion)}{twin}{detail}", step_gap(diagnosis, step)))
    if not diagnosis.steps and not diagnosis.nothing_missing and diagnosis.gap.estimate("after").known:
        rows.append(("Corrected model" if diagnosis.causes else "Best attempt", diagnosis.gap.estimate("after")))
    if diagnosis.learned:
        name = learned_name(diagnosis)
        rows.append((f"+ {name[:1].upper() + name[1:]}", diagnosis.gap.estimate("learned")))
    return [(name, gap) for name, gap in rows if gap.known]


def draw_gap(figure: FigureBase, diagnosis: Answer, *, narrow: bool) -> None:
    """Draw on a figure or subfigure.

    Args:
        figure: to draw on.
        diagnosis: has a gap before.
        narrow: names above the bars instead of beside them, for a phone.
    """
    axes = figure.subplots()
    rows = [(clip(name, 36), shown_gap(diagnosis, gap)) for name, gap in rows_of(diagnosis)]
    floor = shown_gap(diagnosis, diagnosis.gap.estimate("noise_floor"))
    largest = max(max(gap.value, gap.high if gap.bounded else 0.0) for _, gap in rows)
    previous = None
    for i, (name, gap) in enumerate(rows):
        at = -i
        if previous is not None and previous > gap.value:
            axes.barh(
                at, previous - gap.value, left=gap.value, height=0.5, color=SOFT, alpha=0.45, linewidth=0, zorder=2
            )
        axes.barh(at, gap.value, height=0.5, color=BEFORE if i == 0 else AFTER, linewidth=0, zorder=3)
        if gap.bounded:
            low, high = max(gap.low, 0.0), gap.high
            # A light rim, without which the dark line of the interval cannot be seen on the bar.
            axes.plot([low, high], [at, at], color=PAPER, linewidth=3.4, solid_capstyle="butt", zorder=4)
            axes.plot([low, high], [at, at], color=INK, linewidth=1.4, solid_capstyle="butt", zorder=5)
        # The number stands right of everything that is drawn in its row.
        reach = max(gap.value, gap.high if gap.bounded else 0.0, previous or 0.0)
        axes.annotate(
            show(gap.value),
            (reach, at),
            xytext=(7, 0),
            textcoords="offset points",
            va="center",
            fontweight="bold",
            zorder=6,
        )
        if narrow:
            # On a light background: the line of the noise floor would run through the name.
            paper = {"facecolor": PAPER, "linewidth": 0, "pad": 1.0}
            axes.annotate(
                name, (0.0, at + 0.29), xytext=(6, 2), textcoords="offset points", va="bottom", bbox=paper, zorder=6
            )
        previous = gap.value
    if floor.known:
        axes.axvline(floor.value, color=FLOOR, linewidth=1.4, linestyle=(0, (4, 2)), zorder=5.5)
        axes.annotate(
            f"noise floor {show(floor.value)}",
            (floor.value, 1.0),
            xycoords=("data", "axes fraction"),
            xytext=(4, -2),
            textcoords="offset points",
            va="top",
            color=MUTED,
        )
    axes.set_ylim(-len(rows) + 0.45, 0.95 if not narrow else 1.15)
    # Room for the number right of the longest bar.
    axes.set_xlim(0.0, 1.16 * max(largest, floor.value if floor.known else 0.0))
    axes.set_yticks([] if narrow else [-i for i in range(len(rows))], [] if narrow else [name for name, _ in rows])
    axes.tick_params(axis="y", length=0, labelcolor=INK, labelsize=9.0)
    axes.spines["left"].set_visible(False)
    axes.grid(visible=True, axis="x")
    axes.grid(visible=False, axis="y")
    axes.set_xlabel(
        f"missing {effort_of(diagnosis)}, rms on withheld data [{clip(show_unit(gap_scale(diagnosis)[1]))}]"
    )


def draw_ranking(figure: FigureBase, diagnosis: Answer) -> None:
    """Draw the probabilities of the first five effects to be a cause, on a figure or subfigure.

    Args:
        figure: to draw on.
        diagnosis: has a ranking.
    """
    axes = figure.subplots()
    shown = [c for c in diagnosis.ranking if math.isfinite(c.probability)][:5]
    rows = [-i for i in range(len(shown))]
    # The larger of the two probabilities, as in the table: the second cause of a pair may be certain.
    shares = [max(c.probability, c.cause_probability) for c in shown]
    twins = set().union(*(twins_of(diagnosis, cause) for cause in diagnosis.causes))
    colours = [AFTER if c.effect in diagnosis.causes or c.effect in twins else SOFT for c in shown]
    bars = axes.barh(rows, shares, height=0.5, color=colours, linewidth=0)
    for bar, candidate in zip(bars, shown, strict=True):
        # Twins of a cause are drawn in its colour, half transparent.
        bar.set_alpha(0.5 if candidate.effect in twins - set(diagnosis.causes) else 1.0)
    for row, share in zip(rows, shares, strict=True):
        axes.annotate(show_percent(share), (share, row), xytext=(5, 0), textcoords="offset points", va="center")
    axes.set_yticks(rows, [clip(effect_title(c.effect, diagnosis.motion)) for c in shown])
    axes.tick_params(axis="y", length=0, labelcolor=INK, labelsize=8.5)
    axes.set_xlim(0.0, 1.2)  # room for the number right of a bar of 100 %
    axes.set_xticks([])
    axes.set_title("Probability of being a cause")
    axes.spines["bottom"].set_visible(False)
    axes.grid(visible=False)
