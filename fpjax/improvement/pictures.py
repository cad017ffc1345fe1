"""The pictures of an improvement: tracking error before and after, machine by machine, and gains in their bounds."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from ..gap.report.theme import AFTER, BEFORE, MUTED, SOFT, report_style
from ..logs.arrays import Values

if TYPE_CHECKING:
    from .answer import Answer

ZOOMED = 2.5  # length of the close-up, in times between two reversals of the reference
POINTS = 1200  # of a line; more than the pixels of its picture show nothing


def draw_overview(found: Answer) -> Figure:
    """One sheet: error over time, a close-up, machine by machine, gains."""
    if not found.runs:
        return draw_gains(found)
    with report_style():
        figure, axes = _new(2, 2, (10.0, 6.0))
        _error(axes[0, 0], found, None)
        _error(axes[0, 1], found, _close_up(found))
        _machines(axes[1, 0], found)
        _gains(axes[1, 1], found)
    return figure


def draw_error(found: Answer, *, narrow: bool = False) -> Figure:
    """The tracking error over the whole reference and about a reversal."""
    with report_style():
        size = (4.4, 5.4) if narrow else (9.6, 3.2)
        figure, axes = _new(2 if narrow else 1, 1 if narrow else 2, size)
        first, second = axes.ravel()
        _error(first, found, None)
        _error(second, found, _close_up(found))
    return figure


def draw_machines(found: Answer, *, narrow: bool = False) -> Figure:
    """Error after over error before in every machine."""
    with report_style():
        figure, axes = _new(1, 1, (4.4, 2.6) if narrow else (9.6, 2.6))
        _machines(axes[0, 0], found)
    return figure


def draw_gains(found: Answer, *, narrow: bool = False) -> Figure:
    """The gains between their bounds, before and after."""
    with report_style():
        height = 1.0 + 0.42 * max(len(found.changes), 1)
        figure, axes = _new(1, 1, (4.4 if narrow else 9.6, height))
        _gains(axes[0, 0], found)
    return figure


def _new(rows: int, columns: int, size: tuple[float, float]) -> tuple[Figure, Values]:
    """A figure in the report's style, which the caller has set."""
    figure = Figure(figsize=size, layout="constrained")
    FigureCanvasAgg(figure)
    return figure, figure.subplots(rows, columns, squeeze=False)


def _unit(found: Answer) -> str:
    return found.before.error.unit


def _error(axes: Axes, found: Answer, span: tuple[float, float] | None) -> None:
    runs = found.runs
    time = runs["time"]
    kept = slice(None) if span is None else slice(*np.searchsorted(time, span))
    word = "new gains" if found.decision == "change" else "best others"
    for name, colour, label in (("before", BEFORE, "gains now"), ("after", AFTER, word)):
        low, middle, high = runs[name][:, kept]
        # lowest, median and highest error of the machines at each sample
        where, low, middle, high = _thin(time[kept], low, middle, high)
        axes.fill_between(where, low, high, color=colour, alpha=0.25, linewidth=0.0)
        axes.plot(where, middle, color=colour, linewidth=1.0, label=label)
    axes.set(xlabel="time [s]", ylabel=f"tracking error [{_unit(found)}]")
    axes.locator_params(axis="x", nbins=6)
    axes.set_title("whole reference" if span is None else "close-up; shaded: 12 machines")
    axes.margins(x=0.0)
    if span is None:
        axes.legend(loc="lower right", bbox_to_anchor=(1.0, 1.0), borderaxespad=0.0, ncols=2)


def _machines(axes: Axes, found: Answer) -> None:
    assert found.ratios is not None
    ratios = np.sort(100.0 * found.ratios[np.isfinite(found.ratios)])
    rank = np.arange(1, len(ratios) + 1)
    axes.axvline(100.0, color=MUTED, linewidth=1.0, linestyle="--")
    axes.scatter(ratios, rank, s=14, color=np.where(ratios < 100.0, AFTER, BEFORE), zorder=3)
    axes.set(xlabel="error with the new gains, % of the error now", ylabel="machines")
    count = len(found.ratios)
    axes.set_title(f"machine by machine: better in {round(found.wins * count)} of {count}")
    # the axis reaches past 100 %, so that the line of "no change" is always in the picture
    axes.set_xlim(left=0.0, right=max(110.0, 1.05 * float(ratios.max(initial=100.0))))


def _gains(axes: Axes, found: Answer) -> None:
    for place, change in enumerate(reversed(found.changes)):
        logarithmic = change.low > 0.0 and change.high > 3.0 * change.low

        # place of a value between the bounds, 0 to 1; logarithmic where the bounds are more than a factor of 3 apart
        def at(value: float, change=change, logarithmic=logarithmic) -> float:
            if logarithmic:
                return float(np.log(max(value, change.low) / change.low) / np.log(change.high / change.low))
            return (value - change.low) / (change.high - change.low)

        axes.plot([0.0, 1.0], [place, place], color=SOFT, linewidth=3.0, solid_capstyle="round")
        axes.plot([at(change.before), at(change.after)], [place, place], color=AFTER, linewidth=1.5)
        axes.scatter([at(change.before)], [place], s=30, color=BEFORE, zorder=3)
        axes.scatter([at(change.after)], [place], s=30, color=AFTER, zorder=4)
        # Beside the dots, by points: by shares of the axis, a narrow picture would set one on the other.
        for end, bound, side in ((0.0, change.low, -1), (1.0, change.high, 1)):
            axes.annotate(
                f"{bound:.3g}",
                (end, place),
                xytext=(7 * side, 0),
                textcoords="offset points",
                ha="right" if side < 0 else "left",
                va="center",
                color=MUTED,
                fontsize=8,
            )
    axes.set_yticks(range(len(found.changes)), [change.gain for change in reversed(found.changes)])
    axes.set(xlim=(-0.2, 1.15), ylim=(-0.6, max(len(found.changes), 1) - 0.4))
    axes.set_xticks([])
    axes.tick_params(length=0)
    axes.grid(visible=False)
    for side in ("left", "bottom", "top", "right"):
        axes.spines[side].set_visible(False)
    # A longer title is cut on a phone; the caption tells the rest.
    axes.set_title("gains: now (orange), new (blue)")


def _close_up(found: Answer) -> tuple[float, float]:
    """(begin, end) [s] of a stretch around the largest error with the present gains."""
    time, reference = found.runs["time"], found.runs["reference"]
    moving = reference if found.signal == "velocity" else np.gradient(reference, time)
    # reversals of the motion: zero crossings of the velocity, of the reference's slope in a position loop
    turns = time[1:][np.diff(np.sign(moving)) != 0]
    error = np.abs(found.runs["before"][1])
    # the transient from the start state is not typical of the machine's work
    settled = time > 0.1 * time[-1]
    worst = float(time[settled][np.argmax(error[settled])]) if settled.any() else float(time[len(time) // 2])
    apart = float(np.median(np.diff(turns))) if len(turns) > 1 else 0.2 * float(time[-1])
    half = 0.5 * min(max(ZOOMED * apart, 0.2), float(time[-1]))
    middle = min(max(worst, half), float(time[-1]) - half)
    return middle - half, middle + half


def _thin(time: Values, low: Values, middle: Values, high: Values) -> tuple[Values, ...]:
    """The band with fewer points: of each block of samples the smallest low, the middle sample and the largest high."""
    step = max(1, len(time) // POINTS)
    count = len(time) // step
    if step == 1 or count < 2:
        return time, low, middle, high
    cut = count * step
    blocks = [values[:cut].reshape(count, step) for values in (low, middle, high)]
    return time[:cut:step], blocks[0].min(axis=1), blocks[1][:, step // 2], blocks[2].max(axis=1)
