"""The one `plot` of the results."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from matplotlib.figure import Figure


class Drawable:
    """A result with a picture: `_figure` draws it, and the docstring of the class says what it shows."""

    def plot(self, path: str | Path | None = None) -> Figure:
        """Draw the result; the docstring of its class says what the picture shows.

        Args:
            path: picture file to write; None to write none.

        Returns:
            The matplotlib figure.

        Raises:
            InputError: where there is nothing to draw, or the file cannot be written.
        """
        from .plotting import saved  # importing matplotlib takes a second, and most results are never drawn

        return saved(self._figure(), path)

    def _figure(self) -> Figure:
        raise NotImplementedError
