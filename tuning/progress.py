"""A progress bar with an ETA on stderr, for what takes over a second; nothing where stderr is not a terminal."""

import sys
import time


class Progress:
    """One line that is rewritten.

    Attributes:
        title: what is under way.
    """

    def __init__(self, title: str):
        self.title = title
        self._begin = self._shown = time.monotonic()
        self._first = 0.0
        self._drawn = False
        self._terminal = sys.stderr.isatty()

    def begin_at(self, share: float) -> None:
        """So much, from 0 to 1, was done before: the ETA counts only what is done now."""
        self._first = share

    def show(self, share: float, note: str = "") -> None:
        """Draw, at most five times a second, how much is done from 0 to 1."""
        now = time.monotonic()
        spent = now - self._begin
        if not self._terminal or spent < 1.0 or now - self._shown < 0.2:
            return
        self._shown, self._drawn = now, True
        done = share - self._first
        left = f"{spent * (1.0 - share) / done:.0f} s left" if done > 0.0 else "..."
        filled = round(24 * min(1.0, max(0.0, share)))
        line = f"{self.title} [{'#' * filled}{'.' * (24 - filled)}] {100 * share:3.0f} %  {left}  {note}"
        print(f"\r{line:<100.100}", end="", file=sys.stderr, flush=True)

    def end(self) -> None:
        """Clear the line."""
        if self._drawn:
            print("\r" + " " * 100 + "\r", end="", file=sys.stderr, flush=True)
