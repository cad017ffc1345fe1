"""The picture of a sweep: contours over two axes, or a line over one, with the paths that methods took."""

import dataclasses
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from matplotlib import rc_context
from matplotlib.axes import Axes
from matplotlib.colors import BoundaryNorm
from matplotlib.figure import Figure
from matplotlib.text import Text

from fpjax.errors import InputError
from fpjax.output.plotting import BLACK, BLUE, GREY, SERIES, STYLE, new_figure, saved

from .sweep_axis import Axis, Paths

APART = 30.0  # least distance between two labels of contours [pixels]
LEVELS = 24  # borders of the colours
MOST_POINTS = 400  # drawn along an axis, about the pixels there are; a denser grid is thinned for the picture


@dataclasses.dataclass(frozen=True)
class Slice:
    """The part of a sweep that is shown: its first two axes (or its only one), any further one at its best value.

    Attributes:
        axes: that are shown.
        values: of each shown axis, thinned.
        cost: shape (rows, columns) or (points,), thinned; infinite where a run diverged.
        title: objective, references, and the values of the axes that are not shown.
        gains: of the least cost, by parameter name.
        least: that cost [1].
        thinned: "2 x 3" where every second row and every third column is shown; "" where all are.
    """

    axes: tuple[Axis, ...]
    values: tuple[np.ndarray, ...]
    cost: np.ndarray
    title: str
    gains: dict[str, float]
    least: float
    thinned: str


def slice_of(named: Sequence[Axis], cost: np.ndarray, title: str) -> Slice:
    """The `Slice` of a sweep.

    Args:
        named: axes of the grid.
        cost: at its points, shape (*counts).
        title: objective and references.
    """
    cost = np.asarray(cost, dtype=float)
    # Of the whole grid, before it is thinned: the marked minimum is one that was swept.
    best = np.unravel_index(int(np.argmin(cost)), cost.shape)
    least = float(cost[best])
    gains = {axis.name: float(axis.values[place]) for axis, place in zip(named, best, strict=True)}
    if len(named) > 2:
        cost = cost[(slice(None), slice(None), *best[2:])]
        title += f"  ({', '.join(f'{axis.name} = {gains[axis.name]:.4g}' for axis in named[2:])})"
    axes = tuple(named[:2])
    # Rounded up, so that at most MOST_POINTS remain.
    every = [-(-count // MOST_POINTS) for count in cost.shape]
    thin = tuple(slice(None, None, step) for step in every)
    values = tuple(axis.values[step] for axis, step in zip(axes, thin, strict=True))
    thinned = " x ".join(map(str, every)) if max(every) > 1 else ""
    return Slice(axes, values, cost[thin], title, gains, least, thinned)


def checked_paths(named: Sequence[Axis], paths: Paths) -> Paths:
    """The paths, each with every shown axis.

    Args:
        named: axes of the grid.
        paths: by the method's name.

    Raises:
        InputError: for a path without a parameter that was swept, or with unequal lengths.
    """
    for method, path in paths.items():
        lengths = set()
        for axis in named[:2]:
            if axis.name not in path:
                raise InputError(
                    f"The path of {method} holds {', '.join(path) or 'nothing'}, not {axis.name}: give the `path` of a "
                    f"tuning of the parameters that were swept."
                )
            lengths.add(len(path[axis.name]))
        if len(lengths) > 1:
            raise InputError(f"The path of {method} has {sorted(lengths)} values: every parameter needs as many.")
    return paths


def draw(shown: Slice, path: Path | None, paths: Paths) -> Figure:
    """Draw, and save where a path is given.

    Args:
        shown: of the sweep.
        path: of the picture's file; None to write none.
        paths: as `checked_paths` gives them.
    """
    with rc_context(STYLE):
        return saved(_draw(shown, paths), path)


def _draw(shown: Slice, paths: Paths) -> Figure:
    figure, panels = new_figure(size=(6.6, 4.6 + 0.18 * len(paths)))
    axes, least, gains = panels[0, 0], shown.least, shown.gains
    axes.set_title(shown.title)
    first = shown.axes[0]
    if len(shown.axes) == 1:
        axes.plot(shown.values[0], np.where(np.isfinite(shown.cost), shown.cost, np.nan), color=BLUE)
        axes.plot(gains[first.name], least, "o", color=BLACK, label=f"least: {least:.4g} at {gains[first.name]:.5g}")
        axes.set(xlabel=first.name, ylabel="cost", xscale=first.scale)
        if least > 0.0:
            axes.set_yscale("log")
    else:
        second = shown.axes[1]
        # The scales come before the contours: their labels are placed in screen coordinates.
        axes.set(xlabel=second.name, ylabel=first.name, xscale=second.scale, yscale=first.scale)
        _contours(figure, axes, shown)
        limits = axes.get_xlim(), axes.get_ylim()
        for color, (method, points) in zip(SERIES[1:], paths.items(), strict=False):
            _path(axes, points[second.name], points[first.name], color, method)
        axes.set(xlim=limits[0], ylim=limits[1])  # a path that leaves the grid does not stretch it
        label = f"least: {least:.4g} at ({gains[second.name]:.5g}, {gains[first.name]:.5g})"
        axes.plot(
            gains[second.name], gains[first.name], "o", color="white", markeredgecolor=BLACK, label=label, zorder=5
        )
        axes.grid(False)
    axes.legend(loc="upper left", bbox_to_anchor=(0.0, -0.14), borderaxespad=0.0, frameon=False)
    return figure


def _path(axes: Axes, across: Sequence[float], up: Sequence[float], color: str, method: str) -> None:
    """The path of a search: a line with a white edge, an open circle at its start, a square at its end."""
    axes.plot(across, up, color="white", linewidth=3.4, solid_joinstyle="round", zorder=3)
    axes.plot(across, up, color=color, linewidth=1.5, marker=".", markersize=4, label=method, zorder=3.5)
    axes.plot(across[:1], up[:1], "o", color="white", markeredgecolor=color, markersize=6, zorder=4)
    axes.plot(across[-1:], up[-1:], "s", color=color, markeredgecolor="white", markersize=7, zorder=4)


def colour_levels(cost: np.ndarray) -> np.ndarray:
    """Borders of the colours, shape (levels,): quantiles of the cost, or of its logarithm where all costs are positive.

    Evenly spaced levels would nearly all lie between the few points just before divergence, whose costs are orders of
    magnitude larger; with quantiles every colour has the same share of the points.
    """
    finite = cost[np.isfinite(cost)]
    if not finite.size:
        return np.array([0.0, 1.0])
    if finite.min() > 0.0:
        finite = np.log10(finite)
    levels = np.unique(np.quantile(finite, np.linspace(0.0, 1.0, LEVELS)))
    return levels if levels.size > 1 else np.array([levels[0] - 0.5, levels[0] + 0.5])


def colour_marks(cost: np.ndarray, levels: np.ndarray) -> list[tuple[int, str]]:
    """(index of a level, its cost in words) for the colour bar: about seven, for the picture and the page alike.

    Args:
        cost: of the grid; shape does not matter.
        levels: from `colour_levels`.
    """
    logarithmic = np.nanmin(np.where(np.isfinite(cost), cost, np.nan)) > 0.0
    places = range(0, levels.size, max(1, levels.size // 6))
    return [(place, f"{10.0 ** levels[place] if logarithmic else levels[place]:.3g}") for place in places]


def _labelled(levels: np.ndarray) -> np.ndarray:
    """Logarithms of the round costs (1, 2, 5 of each decade; whole decades beyond three) within the levels."""
    # The top twelfth of the points is left out: just before divergence the cost rises so steeply that lines overlap.
    low, high = levels[0], levels[-1 - levels.size // 12]
    parts = (1.0,) if high - low > 3.0 else (1.0, 2.0, 5.0)
    decades = np.arange(np.floor(low), np.ceil(high) + 1.0)
    found = np.array(sorted(decade + np.log10(part) for decade in decades for part in parts))
    inside = found[(found > low) & (found < high)]
    return inside if inside.size else levels[levels.size // 2 : levels.size // 2 + 1]


def _spread(axes: Axes, labels: Sequence[Text]) -> None:
    """Remove labels that overlap an earlier one, as they do where the cost rises steeply and the lines are close."""
    kept: list[np.ndarray] = []
    for label in labels:
        place = axes.transData.transform(label.get_position())
        if any(np.hypot(*(place - other)) < APART for other in kept):
            label.remove()
        else:
            kept.append(place)


def _contours(figure: Figure, axes: Axes, shown: Slice) -> None:
    down, across = shown.values
    finite = np.isfinite(shown.cost)
    if not finite.any() or min(shown.cost.shape) < 2:
        why = "every run diverged" if not finite.any() else "an axis has one value"
        axes.text(0.5, 0.5, f"nothing to draw: {why}", transform=axes.transAxes, ha="center")
        return
    grid = np.ma.masked_invalid(np.where(finite, shown.cost, np.nan))
    logarithmic = float(grid.min()) > 0.0
    if logarithmic:
        grid = np.ma.log10(grid)
    levels = colour_levels(shown.cost)
    # BoundaryNorm gives every level the same share of the colour map; with a linear norm nearly all had one colour.
    filled = axes.contourf(across, down, grid, levels=levels, cmap="viridis_r", norm=BoundaryNorm(levels, 256))
    marked = _labelled(levels) if logarithmic else levels[:: max(1, levels.size // 6)]
    lines = axes.contour(across, down, grid, levels=marked, colors="white", linewidths=0.7, linestyles="solid")

    def cost_of(level: float) -> float:
        return 10.0**level if logarithmic else level

    _spread(axes, axes.clabel(lines, fontsize=8, fmt=lambda level: f"{float(f'{cost_of(level):.2g}'):g}"))
    bar = figure.colorbar(filled, ax=axes, label="cost, equal shares of the grid (diverged: grey)")
    marks = colour_marks(shown.cost, levels)
    bar.set_ticks([levels[place] for place, _ in marks])
    bar.set_ticklabels([word for _, word in marks])
    axes.set_facecolor(GREY)
