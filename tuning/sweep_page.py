"""The page of a sweep: one HTML file without external resources, with cost and parameters under the pointer."""

import html
import importlib.resources
import json
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib import colormaps
from matplotlib.colors import to_hex

from fpjax.output.json_object import JsonObject
from fpjax.output.plotting import SERIES
from fpjax.output.runfile import plain, write_whole

from .sweep_axis import Paths
from .sweep_plot import Slice, colour_levels, colour_marks

DIGITS = 5  # significant digits of a cost on the page, for a smaller file


def write_page(shown: Slice, path: Path, paths: Paths) -> Path:
    """Write the page.

    Args:
        shown: of the sweep.
        path: of its file.
        paths: as `sweep_plot.checked_paths` gives them.

    Raises:
        InputError: where it cannot be written.
    """
    template = importlib.resources.files("tuning").joinpath("sweep_page.html").read_text(encoding="utf-8")
    # A name that holds "</script>" would end the script: "<" is written as its JSON escape.
    content = json.dumps(plain(_content(shown, paths)), allow_nan=False).replace("<", "\\u003c")
    page = template.replace("@TITLE@", html.escape(shown.title)).replace("@DATA@", content)
    write_whole(path, page)
    return path


def _content(shown: Slice, paths: Paths) -> JsonObject:
    """What the script of the page draws, as JSON takes it."""
    grid = shown.cost
    levels = colour_levels(grid)
    colours = colormaps["viridis_r"](np.linspace(0.0, 1.0, max(len(levels) - 1, 1)))
    best = np.unravel_index(int(np.argmin(np.where(np.isfinite(grid), grid, np.inf))), grid.shape)
    diverged = int(np.count_nonzero(~np.isfinite(grid)))
    notes = ["Move the pointer, or the arrow keys, over the grid: the nearest swept point is read."]
    if shown.thinned:
        notes.append(f"Thinned by {shown.thinned}: sweep.npz holds every point.")
    if diverged and grid.ndim == 2:
        notes.append("Grey: the run diverged.")
    named = [axis.name for axis in shown.axes]
    drawn = [
        {"name": name, "colour": color, "points": list(zip(*(path[each] for each in named), strict=True))}
        for color, (name, path) in zip(SERIES[1:], paths.items(), strict=False)
        if len(named) == 2
    ]
    return {
        "axes": [
            {"name": axis.name, "scale": axis.scale, "values": [float(f"{value:.7g}") for value in values]}
            for axis, values in zip(shown.axes, shown.values, strict=True)
        ],
        "cost": _rounded(grid),
        "levels": [float(level) for level in levels],
        "marks": colour_marks(grid, levels) if np.isfinite(grid).any() else [],
        "colours": [to_hex(colour) for colour in colours],
        "best": [int(best[0]), int(best[1])] if grid.ndim == 2 else [0, int(best[0])],
        "paths": drawn,
        "note": " ".join(notes),
    }


def _rounded(grid: np.ndarray) -> Any:
    """Nested lists of costs rounded to `DIGITS`; None where a run diverged: JSON has no infinity."""
    if grid.ndim > 1:
        return [_rounded(row) for row in grid]
    return [float(f"{value:.{DIGITS}g}") if np.isfinite(value) else None for value in grid]
