"""Commanded torque against what each model needs, on withheld data: the record, the error, and the worst place."""

from __future__ import annotations

import itertools
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from matplotlib.axes import Axes

from ...output.plotting import thin
from .derived_values import gap_scale
from .digits import show_unit
from .names import clip
from .sentences import effort_of, model_names
from .theme import AFTER, BAND, BEFORE, FLOOR, INK, MUTED, PAPER

if TYPE_CHECKING:
    from matplotlib.figure import FigureBase

    from ..answer.answer import Answer
    from ..answer.findings import Comparison


@dataclass(frozen=True)
class Series:
    """The withheld part of one log.

    Attributes:
        label: name of the log.
        time: [s], shape (samples,).
        commanded: torque [N m], shape (samples,).
        before: torque that the nominal model needs [N m], shape (samples,), or None.
        after: torque that the corrected model needs, likewise.
        starts: indices at which a new window or block begins; lines are broken there.
    """

    label: str
    time: np.ndarray
    commanded: np.ndarray
    before: np.ndarray | None
    after: np.ndarray | None
    starts: np.ndarray


def series_of(diagnosis: Answer) -> list[Series]:
    """The withheld part of each log."""
    return [s for s in map(_series, diagnosis.comparisons) if s is not None]


def _series(comparison: Comparison) -> Series | None:
    withheld = np.asarray(comparison.withheld, bool)
    if np.count_nonzero(withheld) < 2:
        return None
    time = np.asarray(comparison.time, float)[withheld]
    parts = [np.asarray(part, float)[withheld] for part in (comparison.torque, comparison.before, comparison.after)]
    known = [part if np.isfinite(part).any() else None for part in parts]
    if known[0] is None:
        return None
    # Lines are broken between windows, each of which has its own start state, and between withheld blocks. One missing
    # sample is not a hole, hence 2.5 steps.
    window = np.asarray(comparison.window)[withheld]
    step = np.median(np.diff(time))
    starts = np.flatnonzero((np.diff(window) != 0) | (np.diff(time) > 2.5 * step)) + 1
    return Series(comparison.name, time, known[0], known[1], known[2], starts)


def has_record(diagnosis: Answer) -> bool:
    """Whether any log has a withheld part with a needed torque."""
    return any(series.before is not None for series in series_of(diagnosis))


def draw_record(figure: FigureBase, diagnosis: Answer, *, narrow: bool) -> None:
    """Draw on a figure or subfigure.

    Args:
        figure: to draw on.
        diagnosis: has at least one series with `before`.
        narrow: panels below one another, for a phone.
    """
    if narrow:
        # A phone: below one another, the enlargement highest.
        signal_axes, error_axes, zoom_axes = figure.subplots(3, 1, gridspec_kw={"height_ratios": [1.0, 1.0, 1.35]})
    else:
        grid = figure.add_gridspec(2, 2, width_ratios=[1.55, 1.0])
        signal_axes = figure.add_subplot(grid[0, 0])
        error_axes = figure.add_subplot(grid[1, 0])
        zoom_axes = figure.add_subplot(grid[:, 1])
    unit = clip(show_unit(diagnosis.gap.unit))
    factor, error_unit = gap_scale(diagnosis)
    shown = [s for s in series_of(diagnosis) if s.before is not None]
    shown_after = not diagnosis.nothing_missing
    names = model_names(diagnosis)
    worst, first, last = worst_place(shown)
    for series, shift in zip(shown, _shifts(shown), strict=True):
        moved = series.time + shift
        _lines(signal_axes, series, moved, INK, series.commanded, "commanded", width=2.4, alpha=0.28)
        _lines(error_axes, series, moved, BEFORE, factor * _error(series, series.before), "")
        if series.before is not None:
            _lines(signal_axes, series, moved, BEFORE, series.before, names[0], width=1.0)
        if series.after is not None and shown_after:
            _lines(signal_axes, series, moved, AFTER, series.after, names[1], width=1.0)
            _lines(error_axes, series, moved, AFTER, factor * _error(series, series.after), "")
        if series is worst:
            for axes in (signal_axes, error_axes):
                axes.axvspan(moved[first], moved[last], color=BAND, linewidth=0, zorder=0)
    if len(shown) == 1:
        _name_holes(signal_axes, shown[0])
    moved_ends = len(shown) > 1 and any(_shifts(shown))
    signal_axes.set_title("Withheld data")
    signal_axes.set_ylabel(f"{effort_of(diagnosis)} [{unit}]")
    signal_axes.tick_params(labelbottom=False)
    error_axes.set_title("Commanded minus needed")
    error_axes.set_ylabel(f"error [{clip(show_unit(error_unit))}]")
    error_axes.set_xlabel("withheld time, logs end to end [s]" if moved_ends else "time [s]")
    error_axes.sharex(signal_axes)
    _zoom(zoom_axes, worst, first, last, ("commanded", *names), with_after=shown_after)
    zoom_axes.set_title("The worst place, enlarged" if shown_after else "An enlarged stretch")
    zoom_axes.set_ylabel(f"{effort_of(diagnosis)} [{unit}]")
    zoom_axes.set_xlabel(f"time in {clip(worst.label)} [s]" if len(shown) > 1 else "time [s]")


def worst_place(shown: list[Series]) -> tuple[Series, int, int]:
    """(series, first sample, last sample) of the stretch with the largest mean square error of the nominal model."""
    best, found = -1.0, (shown[0], 0, len(shown[0].time) - 1)
    for series in shown:
        squares = np.nan_to_num(np.square(_error(series, series.before)))
        for start, stop in _blocks(series):
            # Half of the block, 300 to 500 samples if it has them: single samples can be seen in the enlargement.
            length = max(min(stop - start, 500, max(stop - start, 600) // 2), 2)
            # Moving mean over `length` samples, never across a hole.
            sums = np.convolve(squares[start:stop], np.ones(length) / length, mode="valid")
            at = int(np.argmax(sums))
            if sums[at] > best:
                best, found = float(sums[at]), (series, start + at, start + at + length - 1)
    return found


def _zoom(axes: Axes, series: Series, first: int, last: int, names: tuple[str, str, str], *, with_after: bool) -> None:
    part = slice(first, last + 1)
    time = series.time[part]
    starts = series.starts[(series.starts > first) & (series.starts <= last)] - first
    # The part as a series of its own, whose windows start where those of the whole do.
    near = Series(series.label, time, series.commanded[part], series.before, series.after, starts)
    _lines(axes, near, time, INK, series.commanded[part], names[0], width=3.2, alpha=0.28)
    if series.before is not None:
        _lines(axes, near, time, BEFORE, series.before[part], names[1], width=1.5, style=(0, (5, 1.6)))
    if series.after is not None and with_after:
        _lines(axes, near, time, AFTER, series.after[part], names[2], width=1.5)
    axes.legend(loc="best", handlelength=2.2)
    axes.margins(x=0.0)
    for start in starts:
        axes.axvline(float(time[start]), color=FLOOR, linewidth=0.6, linestyle=(0, (1, 2)))
    if starts.size:
        axes.annotate(
            "a new window starts",
            (time[starts[0]], 0.0),
            xycoords=("data", "axes fraction"),
            xytext=(4, 5),
            textcoords="offset points",
            fontsize=7.5,
            color=MUTED,
            bbox={"facecolor": PAPER, "alpha": 0.85, "linewidth": 0, "pad": 1.0},
        )


def _lines(
    axes: Axes,
    series: Series,
    time: np.ndarray,
    colour: str,
    values: np.ndarray,
    label: str,
    *,
    width: float = 1.0,
    alpha: float = 1.0,
    style: Any = "-",
) -> None:
    """Draw one line, broken where a window or a block ends, and thinned to what can be seen."""
    pieces_time, pieces = [], []
    # About two points for each pixel of the panel, over all pieces; `thin` keeps the extremes of what it leaves out.
    budget = max(2400 // (len(series.starts) + 1), 6)
    for start, stop in _windows(series):
        part = np.isfinite(values[start:stop])
        if not part.any():
            continue
        short_time, short = thin(time[start:stop][part], values[start:stop][part], points=budget)
        pieces_time += [short_time, short_time[-1:]]
        pieces += [short, np.array([np.nan])]
    if pieces:
        # Several logs have one entry in the legend: a label that begins with _ is left out.
        known = axes.get_legend_handles_labels()[1]
        axes.plot(
            np.concatenate(pieces_time),
            np.concatenate(pieces),
            color=colour,
            linewidth=width,
            alpha=alpha,
            linestyle=style,
            solid_capstyle="round",
            label=f"_{label}" if label in known or not label else label,
        )


def _error(series: Series, simulated: np.ndarray | None) -> np.ndarray:
    return np.full(len(series.time), np.nan) if simulated is None else series.commanded - simulated


def _windows(series: Series) -> list[tuple[int, int]]:
    ends = [0, *map(int, series.starts), len(series.time)]
    return [(a, b) for a, b in itertools.pairwise(ends) if b - a >= 2]


def _blocks(series: Series) -> list[tuple[int, int]]:
    """(first, stop) of stretches without a hole in time; adjacent windows are one block."""
    step = np.median(np.diff(series.time))
    holes = np.flatnonzero(np.diff(series.time) > 2.5 * step) + 1
    ends = [0, *map(int, holes), len(series.time)]
    return [(a, b) for a, b in itertools.pairwise(ends) if b - a >= 2]


def _name_holes(axes: Axes, series: Series) -> None:
    """Label wide holes in the withheld time as fitted: they could be taken for lost data."""
    blocks = _blocks(series)
    whole = series.time[-1] - series.time[0]
    for (_, stop), (start, _) in itertools.pairwise(blocks):
        low, high = series.time[stop - 1], series.time[start]
        if high - low > 0.12 * whole:
            spot = (0.5 * (low + high), 0.5)
            axes.annotate(
                "fitted", spot, xycoords=("data", "axes fraction"), ha="center", va="center", fontsize=8, color=MUTED
            )


def _shifts(shown: list[Series]) -> list[float]:
    """Shift of each log's time [s] so that no two overlap; zeros where they do not."""
    spans = sorted((s.time[0], s.time[-1]) for s in shown)
    if all(a[1] < b[0] for a, b in itertools.pairwise(spans)):
        return [0.0] * len(shown)
    shifts, at = [], 0.0
    for series in shown:
        shifts.append(at - float(series.time[0]))
        at += 1.04 * float(series.time[-1] - series.time[0])
    return shifts
