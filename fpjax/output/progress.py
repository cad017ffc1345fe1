"""Progress on stderr by stages, for what takes over a second; nothing where stderr is not a terminal."""

import sys
import threading
import time

FIRST_SHOWN, REDRAWN = 1.0, 0.25  # s


class Stages:
    """One line that names the stage, with the time spent, redrawn while the work holds the main thread.

    Attributes:
        title: the command.
        total: number of stages; 0 where unknown.
    """

    def __init__(self, title: str, total: int = 0, after: "Stages | None" = None) -> None:
        """Begin.

        Args:
            title: the command.
            total: number of stages; 0 where unknown.
            after: of the same work, ended: time and pace go on from there.
        """
        self.title, self.total = title, total
        self._name, self._share, self._count, self._drawn = "", None, 0, False
        self._begin = time.monotonic()
        self._before = 0.0
        self._first: tuple[float, float] | None = None  # when the first share was told, and what it was
        self._left: tuple[float, float] | None = None  # when the last one was, and the seconds that were left then
        self._compiling = False  # the time before the first share says nothing of the pace
        if after is not None:
            self._begin, self._before = after._begin, after._before
            self._first, self._compiling = after._first, after._compiling
        self._stop = threading.Event()
        self._thread: threading.Thread | None = None
        if sys.stderr.isatty():
            self._thread = threading.Thread(target=self._redraw, daemon=True)
            self._thread.start()

    def stage(self, name: str, share: float | None = None) -> None:
        """Say what is under way; `share` of the whole that is done, where that is known [1]."""
        if name != self._name:
            self._count += 1
        self._name, self._share = name, share
        if share is None:
            self._compiling |= self._first is None and name.startswith("compiling")
            return
        now = time.monotonic()
        if self._first is None or share < self._first[1]:
            self._first = (now, share)
        # What came before the first share was compiling, which does not come again: the pace counts from there.
        since, begun = self._first
        self._left = (now, (now - since) * (1.0 - share) / (share - begun)) if share > begun else None

    def begin_at(self, share: float) -> None:
        """So much of the whole was done before: the time left is reckoned from what is done now [1]."""
        self._before = share

    def end(self) -> None:
        """Clear the line."""
        self._stop.set()
        if self._thread is not None:
            self._thread.join()
        if self._drawn:
            print("\r\033[K", end="", file=sys.stderr, flush=True)

    def __enter__(self) -> "Stages":
        return self

    def __exit__(self, *_: object) -> None:
        self.end()

    def _redraw(self) -> None:
        while not self._stop.wait(REDRAWN):
            spent = time.monotonic() - self._begin
            if spent < FIRST_SHOWN or not self._name:
                continue
            self._drawn = True
            print(f"\r\033[K{self._line(spent)}", end="", file=sys.stderr, flush=True)

    def _line(self, spent: float) -> str:
        which = f" {self._count}/{self.total}" if self.total else ""
        left = ""
        if self._share and self._share - self._before > 0.02:
            seconds = None if self._compiling else spent * (1.0 - self._share) / (self._share - self._before)
            if self._left is not None:  # between two reports it counts down
                seconds = max(self._left[1] - (self._begin + spent - self._left[0]), 0.0)
            left = "" if seconds is None else f", about {seconds:.0f} s left"
        return f"{self.title}{which}: {self._name}  {spent:.0f} s{left}"[:110]
