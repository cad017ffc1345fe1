"""The picture of a sweep: contours over two axes, or a line over one."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from matplotlib import rc_context
from matplotlib.axes import Axes
from matplotlib.colors import BoundaryNorm
from matplotlib.figure import Figure

from fpjax.output.plotting import BLACK, BLUE, GREY, STYLE, new_figure, save

from .axis import Axis

LEVELS = 24
MOST_POINTS = 400  # drawn along an axis; a denser grid is thinned for the picture


def draw(named: Sequence[Axis], cost: np.ndarray, title: str, path: Path | None = None) -> Figure:
    """Draw, and save where a path is given.

    Args:
        named: axes of the grid.
        cost: at its points, shape (*counts); past two axes the others stay at their best values.
        title: of the picture.
        path: of its file; None to write none.
    """
    with rc_context(STYLE):
        figure = _draw(named, np.asarray(cost, dtype=float), title)
        if path is not None:
            save(figure, path)
    return figure


def _draw(named: Sequence[Axis], cost: np.ndarray, title: str) -> Figure:
    figure, panels = new_figure(size=(6.6, 4.6))
    axes = panels[0, 0]
    best = np.unravel_index(int(np.argmin(cost)), cost.shape)
    least = float(cost[best])
    gains = {axis.name: float(axis.values[i]) for axis, i in zip(named, best, strict=True)}
    others = ""
    if len(named) > 2:
        cost = cost[(slice(None), slice(None), *best[2:])]
        others = ", ".join(f"{axis.name} = {gains[axis.name]:.4g}" for axis in named[2:])
    axes.set_title(title + (f"  ({others})" if others else ""))
    first = named[0]
    if len(named) == 1:
        axes.plot(first.values, np.where(np.isfinite(cost), cost, np.nan), color=BLUE)
        axes.plot(gains[first.name], least, "o", color=BLACK, label=f"least: {least:.4g} at {gains[first.name]:.5g}")
        axes.set(xlabel=first.name, ylabel="cost", xscale=first.scale)
        if least > 0.0:
            axes.set_yscale("log")
    else:
        second = named[1]
        _contours(figure, axes, first, second, cost)
        label = f"least: {least:.4g} at ({gains[second.name]:.5g}, {gains[first.name]:.5g})"
        axes.plot(
            gains[second.name], gains[first.name], "o", color="white", markeredgecolor=BLACK, label=label, zorder=5
        )
        axes.set(xlabel=second.name, ylabel=first.name, xscale=second.scale, yscale=first.scale)
        axes.grid(False)
    axes.legend(loc="upper left", bbox_to_anchor=(0.0, -0.14), borderaxespad=0.0, frameon=False)
    return figure


def _labelled(levels: np.ndarray) -> np.ndarray:
    """Logarithms of the round costs (1, 2, 5 of each decade; whole decades where they are many) within the levels."""
    low, high = levels[0], levels[-1 - levels.size // 12]  # the cliff before divergence would stack the lines
    parts = (1.0,) if high - low > 3.0 else (1.0, 2.0, 5.0)
    decades = np.arange(np.floor(low), np.ceil(high) + 1.0)
    found = np.array(sorted(decade + np.log10(part) for decade in decades for part in parts))
    inside = found[(found > low) & (found < high)]
    return inside if inside.size else levels[levels.size // 2 : levels.size // 2 + 1]


def _contours(figure: Figure, axes: Axes, first: Axis, second: Axis, cost: np.ndarray) -> None:
    rows, columns = max(1, cost.shape[0] // MOST_POINTS), max(1, cost.shape[1] // MOST_POINTS)
    down, across, shown = first.values[::rows], second.values[::columns], cost[::rows, ::columns]
    finite = np.isfinite(shown)
    if not finite.any() or min(shown.shape) < 2:
        axes.text(0.5, 0.5, "nothing to draw: every run diverged", transform=axes.transAxes, ha="center")
        return
    positive = shown[finite & (shown > 0.0)]
    grid = np.ma.masked_invalid(np.where(finite, shown, np.nan))
    if positive.size and positive.min() < positive.max():
        grid = np.ma.log10(np.ma.maximum(grid, positive.min()))
    # The far end of a landscape would take all the levels: they follow the quantiles, where the points are.
    levels = np.unique(np.quantile(grid.compressed(), np.linspace(0.0, 1.0, LEVELS)))
    if levels.size < 2:
        levels = np.array([levels[0] - 0.5, levels[0] + 0.5])
    # Every level gets the same share of the colours: those of a linear scale were all one purple.
    filled = axes.contourf(across, down, grid, levels=levels, cmap="viridis_r", norm=BoundaryNorm(levels, 256))
    lines = axes.contour(
        across, down, grid, levels=_labelled(levels), colors="white", linewidths=0.7, linestyles="solid"
    )
    axes.clabel(lines, fontsize=8, fmt=lambda level: f"{float(f'{10**level:.2g}'):g}")
    bar = figure.colorbar(filled, ax=axes, label="cost, equal shares of the grid (diverged: grey)")
    bar.set_ticks(levels[:: max(1, levels.size // 6)].tolist())
    bar.set_ticklabels([f"{10**level:.3g}" for level in levels[:: max(1, levels.size // 6)]])
    axes.set_facecolor(GREY)
