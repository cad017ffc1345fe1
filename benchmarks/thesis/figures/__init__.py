"""The thesis' figures: 2.4-2.16, 3.2-3.12, 4.2-4.13."""

from collections.abc import Callable
from pathlib import Path

from matplotlib.figure import Figure

from fpjax.output import plotting


def all_figures() -> dict[str, Callable[[], Figure]]:
    """The function that draws each figure, by the stem of its file."""
    from . import diagrams, estimates, loops, searches, two_mass

    return diagrams.FIGURES | loops.FIGURES | two_mass.FIGURES | estimates.FIGURES | searches.FIGURES


def draw_all(
    out: Path, progress: Callable[[float, str], object] | None = None, names: tuple[str, ...] = ()
) -> list[Path]:
    """Draw every figure as a PNG.

    Args:
        out: folder.
        progress: called with the share done and what is next.
        names: stems; none for all.

    Raises:
        InputError: where one cannot be written.
    """
    figures = {stem: draw for stem, draw in sorted(all_figures().items()) if not names or stem in names}
    written = []
    for index, (stem, draw) in enumerate(figures.items()):
        if progress is not None:
            progress(index / len(figures), stem)
        with plotting.style():
            figure = draw()
        written.append(plotting.save(figure, out / f"{stem}.png"))
    return written
