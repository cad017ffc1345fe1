"""The common style of all pictures, with a palette that colour-blind readers can distinguish, and saving of figures.

matplotlib is imported where something is drawn: it takes half a second, and most importers of this module draw nothing.
"""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import AbstractContextManager
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from ..errors import InputError
from .runfile import whole_file

if TYPE_CHECKING:
    from matplotlib.figure import Figure

# Okabe and Ito, "Color universal design" (2008): distinct for people with the common colour vision deficiencies.
BLACK, ORANGE, SKY, GREEN, YELLOW, BLUE, RED, PURPLE = (
    "#000000",
    "#E69F00",
    "#56B4E9",
    "#009E73",
    "#F0E442",
    "#0072B2",
    "#D55E00",
    "#CC79A7",
)
GREY = "#6F6F6F"

# Colours with a fixed meaning, the same in every picture.
REFERENCE = GREY
TRUTH = BLACK
UNCOMPENSATED = RED
COMPENSATED = BLUE
SERIES = (BLUE, RED, GREEN, PURPLE, ORANGE, SKY, BLACK)  # for lines without a fixed meaning, in this order

STYLE: Any = {
    "figure.dpi": 100,
    "savefig.dpi": 130,
    "figure.facecolor": "white",
    "figure.constrained_layout.use": True,
    "font.family": "DejaVu Sans",
    "font.size": 9.5,
    "axes.titlesize": 10,
    "axes.titlelocation": "left",
    "axes.labelsize": 9.5,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.edgecolor": "#4D4D4D",
    "axes.linewidth": 0.8,
    "axes.grid": True,
    "axes.axisbelow": True,
    "axes.formatter.use_mathtext": True,
    "grid.color": "#E4E4E4",
    "grid.linewidth": 0.7,
    "lines.linewidth": 1.3,
    "xtick.labelsize": 8.5,
    "ytick.labelsize": 8.5,
    "xtick.color": "#4D4D4D",
    "ytick.color": "#4D4D4D",
    "legend.fontsize": 8.5,
    "legend.frameon": True,
    "legend.framealpha": 0.9,
    "legend.edgecolor": "none",
    "legend.borderpad": 0.3,
    "legend.handlelength": 1.6,
    "agg.path.chunksize": 20000,
}


def style() -> AbstractContextManager[None]:
    """The common style for everything drawn within the block: matplotlib styles an object when it is made."""
    from matplotlib import rc_context

    return rc_context(STYLE)


def new_figure(
    rows: int = 1,
    columns: int = 1,
    *,
    size: tuple[float, float] | None = None,
    share_x: bool | Literal["all", "row", "col"] = False,
    share_y: bool | Literal["all", "row", "col"] = False,
    title: str = "",
    height_ratios: Sequence[float] | None = None,
) -> tuple[Figure, np.ndarray]:
    """A figure in the common style, apart from pyplot's global state; draw on it inside `with style():`.

    Args:
        rows: panels from top to bottom.
        columns: panels from left to right.
        size: (width, height) [inch]; None for one that suits the panels.
        share_x: one horizontal axis for all panels, or for each "row" or "col".
        share_y: one vertical axis for all panels, or for each "row" or "col".
        title: above all panels.
        height_ratios: relative heights of the rows [1].

    Returns:
        (figure, axes of shape (rows, columns)).
    """
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    if size is None:
        size = (6.6 if columns == 1 else 4.4 * columns, 3.4 if rows == 1 else 2.4 * rows)
    with style():
        figure = Figure(figsize=size, layout="constrained")
        # without pyplot: no window system is touched, nothing is kept alive in a global list of figures, threads may
        # draw at once
        FigureCanvasAgg(figure)
        axes = figure.subplots(
            rows,
            columns,
            sharex=share_x,
            sharey=share_y,
            squeeze=False,
            gridspec_kw={"height_ratios": list(height_ratios)} if height_ratios else None,
        )
        if title:
            figure.suptitle(title, fontsize=11, fontweight="bold", x=0.01, ha="left")
    return figure, axes


def save(figure: Figure, path: str | Path) -> Path:
    """Write a figure, atomically; the folder is created if missing.

    Args:
        figure: from `new_figure`.
        path: file to write; its ending (.png, .svg, .pdf) is the format.

    Returns:
        The path.

    Raises:
        InputError: where it cannot be written.
    """
    path = Path(path)
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise InputError(
            f"The picture {path} cannot be written ({error.strerror}): give a folder that can be written with --out."
        ) from error
    with whole_file(path) as file, style():
        figure.savefig(file, format=path.suffix.lstrip(".") or "png")
    return path


def saved(figure: Figure, path: str | Path | None) -> Figure:
    """The figure, after writing it where a path is given; every `plot` of a result ends with this.

    Args:
        figure: drawn.
        path: file to write; None to write none.

    Raises:
        InputError: where it cannot be written.
    """
    if path is not None:
        save(figure, path)
    return figure


def thin(time: Any, *signals: Any, points: int = 4000) -> tuple[np.ndarray, ...]:
    """Signals with fewer points for fast drawing; the lowest and the highest sample of every bin are kept.

    Args:
        time: [s], shape (samples,).
        signals: shape (samples,) each.
        points: about how many to keep.

    Returns:
        (time, *signals), each of shape (kept,); unchanged where they are short.
    """
    arrays = [np.asarray(array) for array in (time, *signals)]
    samples = len(arrays[0])
    # Samples of a bin: each bin keeps up to two samples of each signal. Bins under three samples would save nothing.
    width = -(-samples * 2 * max(len(signals), 1) // max(points, 1))
    if width < 3:
        return tuple(arrays)
    # the first and the last sample are always kept, so that the time axis does not shrink
    starts = np.arange(0, samples, width)
    kept = [np.array([0, samples - 1])]
    for array in arrays[1:]:
        whole = np.pad(array, (0, starts.size * width - samples), mode="edge").reshape(starts.size, width)
        kept += [starts + whole.argmin(axis=1), starts + whole.argmax(axis=1)]
    index = np.unique(np.minimum(np.concatenate(kept), samples - 1))
    return tuple(array[index] for array in arrays)
