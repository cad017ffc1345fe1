"""Pictures of where the gap lies: its energy by time, velocity, position, frequency and regime; the missing torque."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import PolyCollection
from matplotlib.ticker import MaxNLocator, PercentFormatter

from .derived_values import AXES, bins, places
from .digits import show_percent, show_unit
from .names import clip, motion_units, regime_name
from .theme import AFTER, BEFORE, INK, MUTED, SOFT

if TYPE_CHECKING:
    from matplotlib.figure import FigureBase

    from ..answer.answer import Answer
    from ..answer.findings import Share


HIGHEST = 3.0  # expected share over the largest one up to which the picture makes room for it
LEAST = 8  # values in a bin: fewer have no 10 % quantile


def axes_with_places(diagnosis: Answer) -> list[str]:
    """The axes on which any bin holds a share of the gap."""
    found = []
    for axis in AXES:
        shown = (*bins(diagnosis.where, axis), *places(diagnosis.where, axis))
        # Where nothing is above the noise all bins are zero.
        if any(place.share > 0.0 for place in shown):
            found.append(axis)
    return found


def has_regimes(diagnosis: Answer) -> bool:
    """Whether any regime holds a share of the gap."""
    return any(share > 0.0 for share in diagnosis.where.regime.values())


def has_where(diagnosis: Answer) -> bool:
    """Whether there is anything to draw."""
    return bool(axes_with_places(diagnosis)) or has_regimes(diagnosis)


def draw_where(figure: FigureBase, diagnosis: Answer, *, narrow: bool) -> None:
    """Draw the maps of the nominal model's gap on a figure or subfigure: what stands out in colour, the rest in grey.

    Args:
        figure: to draw on.
        diagnosis: has a map or a regime.
        narrow: panels below one another, for a phone.
    """
    _draw_maps(figure, diagnosis, narrow, BEFORE, "share of the gap")


def draw_rest(figure: FigureBase, diagnosis: Answer, *, narrow: bool) -> None:
    """As `draw_where`, in the colour of the corrected model: `diagnosis.where` holds what the causes leave."""
    _draw_maps(figure, diagnosis, narrow, AFTER, "share of the rest")


def _draw_maps(figure: FigureBase, diagnosis: Answer, narrow: bool, colour: str, label: str) -> None:
    panels = axes_with_places(diagnosis)
    units = motion_units(diagnosis.motion)
    names = [*(["regime"] if has_regimes(diagnosis) else []), *panels]
    spots = _stacked(figure, names, label) if narrow else _side_by_side(figure, names, label)
    for axis in panels:
        every, standing_out = bins(diagnosis.where, axis), places(diagnosis.where, axis)
        _bars(spots[axis], every, standing_out, colour, with_even=axis != "frequency")
        spots[axis].set_title(f"By {axis}")
        spots[axis].set_xlabel(f"{axis} [{show_unit(units[axis])}]")
        if axis == "frequency":
            _frequency_scale(spots[axis], bins(diagnosis.where, axis) or places(diagnosis.where, axis))
        else:
            _few_ticks(spots[axis])
    for axis in panels:
        if spots[axis].get_legend_handles_labels()[1]:
            spots[axis].legend(loc="upper right", handlelength=1.8)
            break
    if has_regimes(diagnosis):
        _regimes(spots["regime"], diagnosis, colour)
        spots["regime"].set_title("By regime")


def _stacked(figure: FigureBase, names: list[str], label: str) -> dict[str, Axes]:
    # A subfigure each: the long names of the regimes do not shrink the other panels.
    bands = np.atleast_1d(figure.subfigures(len(names), 1))
    drawn = [band.subplots() for band in bands]
    for axes, name in zip(drawn, names, strict=True):
        if name != "regime":
            axes.set_ylabel(label)
    return dict(zip(names, drawn, strict=True))


def _side_by_side(figure: FigureBase, names: list[str], label: str) -> dict[str, Axes]:
    """Time and regime above, the other axes below."""
    rows = [[n for n in ("time", "regime") if n in names], [n for n in names if n not in ("time", "regime")]]
    rows = [row for row in rows if row]
    # A subfigure for each row: long labels of one row do not shrink the panels of the other.
    bands = np.atleast_1d(figure.subfigures(len(rows), 1))
    spots: dict[str, Axes] = {}
    for band, row in zip(bands, rows, strict=True):
        ratios = [1.9, 1.0] if row == ["time", "regime"] else [1.0] * len(row)
        drawn = band.subplots(1, len(row), squeeze=False, gridspec_kw={"width_ratios": ratios})[0]
        if row != ["regime"]:
            drawn[0].set_ylabel(label)
        spots |= dict(zip(row, drawn, strict=True))
    return spots


def _bars(
    axes: Axes, every: tuple[Share, ...], standing_out: tuple[Share, ...], colour: str, *, with_even: bool
) -> None:
    # Diagnoses made without maps have only the places that stand out.
    shown = every or standing_out
    out = [not every or any(_overlap(place, other) > 0.5 for other in standing_out) for place in shown]
    # One collection: single bars are laid out and drawn one by one, which took a sixth of a report's time.
    corners = [
        [(place.start, 0.0), (place.start, place.share), (place.stop, place.share), (place.stop, 0.0)]
        for place in shown
    ]
    colours = [colour if stands_out else SOFT for stands_out in out]
    axes.add_collection(PolyCollection(corners, facecolors=colours, linewidths=0, zorder=2))
    axes.autoscale_view()
    if with_even and every and any(p.expected > 0.0 for p in every):
        edges = [p.start for p in every] + [every[-1].stop]
        axes.stairs(
            [p.expected for p in every],
            edges,
            baseline=None,
            color=MUTED,
            linewidth=0.9,
            linestyle=(0, (3, 2)),
            label="if spread evenly",
        )
    largest = max(p.share for p in every or standing_out)
    even = max((p.expected for p in every), default=0.0) if with_even else 0.0
    # The dashed line stays in the picture, unless a machine that mostly rests made the bars too small to read.
    top = 1.18 * max(largest, even if even < HIGHEST * largest else 0.0) or 1.0
    axes.set_ylim(0.0, top)
    # Not 2.5: the labels have no decimals and would show 2 and 5 for 2.5 and 5.
    axes.yaxis.set_major_locator(MaxNLocator(4, steps=[1, 2, 5, 10]))
    axes.yaxis.set_major_formatter(PercentFormatter(1.0, decimals=0 if top > 0.04 else 1, symbol="\u202f%"))
    axes.margins(x=0.01)


def _overlap(place: Share, other: Share) -> float:
    """The share of `place` that lies within `other`."""
    width = place.stop - place.start
    return (min(place.stop, other.stop) - max(place.start, other.start)) / width if width > 0.0 else 0.0


def _frequency_scale(axes: Axes, every: tuple[Share, ...]) -> None:
    positive = [p for p in every if p.start > 0.0]
    if len(positive) > 2 and positive[-1].stop > 20.0 * positive[0].start:
        axes.set_xscale("log")
        # A first bin that begins at zero has no place on a logarithmic axis: it gets half a decade.
        first = positive[0].start if every[0].start > 0.0 else every[0].stop / 3.0
        axes.set_xlim(first, positive[-1].stop)
        axes.xaxis.set_major_formatter(lambda value, _: f"{value:g}")


def _few_ticks(axes: Axes) -> None:
    """Five intervals at most: in one of three panels in a row, numbers of three decimals overlap from six on."""
    axes.xaxis.set_major_locator(MaxNLocator(5))


def _regimes(axes: Axes, diagnosis: Answer, colour: str) -> None:
    names = [r for r, share in diagnosis.where.regime.items() if math.isfinite(share)]
    shares = [diagnosis.where.regime[name] for name in names]
    largest = max(shares, default=0.0)
    rows = np.arange(len(names))[::-1]
    stands_out = not diagnosis.nothing_missing
    colours = [colour if s == largest and stands_out else SOFT for s in shares]
    axes.barh(rows, shares, height=0.62, color=colours, linewidth=0, zorder=2)
    for row, share in zip(rows, shares, strict=True):
        axes.annotate(
            show_percent(share), (share, row), xytext=(4, 0), textcoords="offset points", va="center", color=INK
        )
    axes.set_yticks(rows, [clip(regime_name(name, diagnosis.motion)) for name in names])
    axes.tick_params(axis="y", length=0, labelcolor=INK, labelsize=8.5)
    axes.spines["bottom"].set_visible(False)
    axes.set_xlim(0.0, 1.25 * largest or 1.0)
    axes.set_xticks([])
    axes.grid(visible=False)


def residual_axes(diagnosis: Answer) -> list[str]:
    """The axes against which the residual can be drawn."""
    if diagnosis.where.residual is None or diagnosis.nothing_missing:
        return []
    samples = len(diagnosis.where.residual)
    return [
        axis
        for axis in ("velocity", "position", "time")
        if (values := diagnosis.where.axes.get(axis)) is not None
        and len(values) == samples
        and np.isfinite(values).any()
        and np.ptp(values[np.isfinite(values)]) > 0.0
    ]


def draw_residual(figure: FigureBase, diagnosis: Answer, *, narrow: bool) -> None:
    """Draw the missing torque of the nominal model against the motion: median and middle 80 % of each bin.

    The sign is that of commanded minus needed, as in the record: the torque that the model does not account for.

    Args:
        figure: to draw on.
        diagnosis: has a residual.
        narrow: panels below one another, for a phone.
    """
    panels = residual_axes(diagnosis)
    drawn = figure.subplots(*((len(panels), 1) if narrow else (1, len(panels))), squeeze=False, sharey=True).ravel()
    units = motion_units(diagnosis.motion)
    # The course is the torque to be added to the command; plotted is commanded minus needed, its negative.
    residual = -np.asarray(diagnosis.where.residual, float)
    left = diagnosis.residual_where if diagnosis.causes else None
    for axes, axis in zip(drawn, panels, strict=True):
        centres, low, middle, high = binned(np.asarray(diagnosis.where.axes[axis], float), residual)
        axes.axhline(0.0, color=MUTED, linewidth=0.8)
        axes.fill_between(centres, low, high, color=BEFORE, alpha=0.18, linewidth=0, label="middle 80 %")
        axes.plot(centres, middle, color=BEFORE, linewidth=1.6, label="median")
        if left is not None and left.residual is not None and axis in left.axes:
            centres, _, middle, _ = binned(np.asarray(left.axes[axis], float), -np.asarray(left.residual, float))
            axes.plot(centres, middle, color=AFTER, linewidth=1.6, label="median with the causes in")
        axes.set_title(f"Against {axis}")
        axes.set_xlabel(f"{axis} [{show_unit(units[axis])}]")
        axes.margins(x=0.01)
        _few_ticks(axes)
    for axes in drawn if narrow else drawn[:1]:
        axes.set_ylabel(f"commanded minus needed [{clip(show_unit(diagnosis.gap.unit))}]")
    drawn[0].legend(loc="best")


def binned(axis: np.ndarray, values: np.ndarray, bins: int = 60) -> tuple[np.ndarray, ...]:
    """(centres, 10 %, 50 %, 90 % quantiles) of the values in equal bins of an axis; bins of fewer than 8 left out.

    Args:
        axis: of the bins, shape (samples,).
        values: shape (samples,).
        bins: their number, of a short log fewer.
    """
    known = np.isfinite(axis) & np.isfinite(values)
    axis, values = axis[known], values[known]
    # Twice as many values as a bin needs, on average: the motion does not spread them evenly.
    bins = max(min(bins, len(axis) // (2 * LEAST)), 1)
    # The outermost half per cent on each side would stretch the axis for a handful of samples.
    first, last = np.quantile(axis, [0.005, 0.995])
    edges = np.linspace(first, last, bins + 1)
    index = np.digitize(axis, edges) - 1
    quantiles = np.full((3, bins), np.nan)
    for i in range(bins):
        inside = values[index == i]
        if inside.size >= LEAST:
            quantiles[:, i] = np.quantile(inside, [0.1, 0.5, 0.9])
    centres = 0.5 * (edges[1:] + edges[:-1])
    keep = np.isfinite(quantiles[1])
    return centres[keep], quantiles[0, keep], quantiles[1, keep], quantiles[2, keep]
