"""Progress on stderr by stages, for what takes over a second; nothing where stderr is not a terminal."""

import contextlib
import sys
import threading
import time
from collections.abc import Iterator

from .share import WorkDone

FIRST_SHOWN, REDRAWN = 1.0, 0.25  # s
LEAST_DONE = 0.02  # of the whole: before it nothing is known of the pace
ALIKE = 1.25  # of two bounds of the time left: closer ones are told as one number
FAR = 0.25  # a lower bound below this share of the upper one is not told

_start_up = 0.0  # [s], what starting took in this process


@contextlib.contextmanager
def starting() -> Iterator[None]:
    """What runs within is the start of a command: importing, which every computer does at its own pace."""
    global _start_up
    begin = time.monotonic()
    yield
    _start_up = time.monotonic() - begin


def drawing(ratio: float) -> float:
    """What drawing will take [s], before anything was drawn.

    Args:
        ratio: of its processor time to that of the start, which was measured in this process, under this load.
    """
    return ratio * _start_up


class Pace:
    """Seconds that are left, from when work was reported done.

    What a stage takes is expected in proportion to others: its own pace says better what its rest takes, the pace of
    all before what the stages after it take. Where the two differ, the bounds of the time left are as far apart.
    """

    def __init__(self) -> None:
        self._reports: list[tuple[float, float]] = []  # (when, work done by then), both ascending

    def report(self, now: float, share: WorkDone) -> None:
        """So much is done [s]; work that is less than before begins anew."""
        while self._reports and self._reports[-1][1] > share.done:
            self._reports.pop()
        self._reports.append((now, share.done))

    def left(self, share: WorkDone) -> tuple[float, float] | None:
        """(least, most) that is left at the last report [s]; None where nothing was done since the first."""
        first, (now, done) = self._reports[0], self._reports[-1]
        if done <= first[1]:
            return None
        half = [one for one in self._reports if one[1] <= 0.5 * (first[1] + done)][-1]
        paces = [(now - when) / (done - before) for when, before in (first, half)]
        return min(paces) * share.least, max(paces) * share.most


class Stages:
    """One line that names the stage, with the time spent, redrawn while the work holds the main thread.

    Attributes:
        title: the command.
        total: number of stages; 0 where unknown.
    """

    def __init__(
        self, title: str, total: int = 0, after: "Stages | None" = None, *, tail: float = 0.0, what: str = ""
    ) -> None:
        """Begin.

        Args:
            title: the command.
            total: number of stages; 0 where unknown.
            after: of the same work, ended: time and pace go on from there.
            tail: what follows when all is done, drawing for instance [s].
            what: the time left is of, where more follows.
        """
        self.title, self.total, self.tail, self.what = title, total, tail, what
        self._name, self._share, self._count, self._drawn = "", None, 0, False
        self._begin = time.monotonic()
        self._before = 0.0
        self._pace = Pace()
        self._left: tuple[float, float, float] | None = None  # when the last share was told, least and most left [s]
        self._compiling = False  # the time before the first share says nothing of the pace
        self._begun = False  # whether a share was told
        if after is not None:
            self._begin, self._before, self._begun = after._begin, after._before, after._begun
            self._pace, self._compiling = after._pace, after._compiling
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
            self._compiling |= not self._begun and name.startswith("compiling")
            return
        told, now = WorkDone.of(share), time.monotonic()
        if not self._begun and not self._compiling and float(told) > self._before:
            # What came before the first share counts, unless it was compiling, which does not come again.
            self._pace.report(self._begin, WorkDone(told.done * self._before / float(told), 0.0, 0.0))
        self._begun = True
        self._pace.report(now, told)
        left = self._pace.left(told)
        self._left = None if left is None else (now, *left)

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
        if self._left is not None and self._share is not None and self._share - self._before > LEAST_DONE:
            since = self._begin + spent - self._left[0]  # between two reports it counts down
            left = told_left(*(max(each - since, 0.0) + self.tail for each in self._left[1:]))
            left = f", {left}{f' of {self.what}' if self.what else ''}"
        return f"{self.title}{which}: {self._name}  {spent:.0f} s{left}"[:110]


def told_left(least: float, most: float) -> str:
    """The time left in words [s]: one number only where both bounds come to nearly the same."""
    if most <= ALIKE * least or most < 2.0:
        return f"about {0.5 * (least + most):.0f} s left"
    return f"at most {most:.0f} s left" if least < FAR * most else f"{least:.0f} to {most:.0f} s left"
