"""Progress on stderr by stages, for work of over a second; nothing is shown where stderr is not a terminal."""

import contextlib
import sys
import threading
import time
from collections.abc import Iterator

from .work_done import WorkDone

FIRST_SHOWN, REDRAWN = 1.0, 0.25  # [s] after which progress is first shown, and redrawn
LEAST_DONE = 0.02  # share of the whole before which the pace is not known well enough for a time left
ALIKE = 1.25  # bounds of the time left with a smaller ratio are shown as one number
FAR = 0.25  # a lower bound below this share of the upper one is not shown

_start_up = 0.0  # [s] start-up time of this process, see `starting`


@contextlib.contextmanager
def starting() -> Iterator[None]:
    """Measure the block as the start-up of a command (imports), as a yardstick for the speed of this computer."""
    global _start_up
    begin = time.monotonic()
    yield
    _start_up = time.monotonic() - begin


def drawing(ratio: float) -> float:
    """Expected time to draw pictures [s], before anything was drawn.

    Args:
        ratio: its processor time relative to the start-up, which was measured in this process, under the same load.
    """
    return ratio * _start_up


class Pace:
    """The time left, from reports of work done.

    The work of the stages is known only roughly, relative to one another. The pace of the present stage predicts its
    own rest best, the pace of everything so far the stages after it. The difference of both paces gives the bounds.
    """

    def __init__(self) -> None:
        self._reports: list[tuple[float, float]] = []  # (when, work done by then), both ascending

    def report(self, now: float, share: WorkDone) -> None:
        """Note that so much work is done at a time [s]; reports of more work, from before a restart, are dropped."""
        while self._reports and self._reports[-1][1] > share.done:
            self._reports.pop()
        self._reports.append((now, share.done))

    def left(self, share: WorkDone) -> tuple[float, float] | None:
        """(least, most) time left at the last report [s]; None where nothing was done since the first."""
        # The pace since the first report, and the pace over the later half of the work.
        first, (now, done) = self._reports[0], self._reports[-1]
        if done <= first[1]:
            return None
        half = [one for one in self._reports if one[1] <= 0.5 * (first[1] + done)][-1]
        paces = [(now - when) / (done - before) for when, before in (first, half)]
        return min(paces) * share.least, max(paces) * share.most


class Stages:
    """One line with the present stage and the time, redrawn by a thread of its own while the main thread works.

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
            after: an ended `Stages` of the same work, whose time and pace are continued.
            tail: time of what follows the last stage, for instance drawing [s].
            what: what the time left is for, where more work follows.
        """
        self.title, self.total, self.tail, self.what = title, total, tail, what
        self._name, self._share, self._count, self._drawn = "", None, 0, False
        self._begin = time.monotonic()
        self._before = 0.0
        self._pace = Pace()
        self._left: tuple[float, float, float] | None = None  # time of the last report, least and most left then [s]
        self._compiling = False  # whether compilation came before the first share: its time does not count
        self._begun = False  # whether a share was reported
        if after is not None:
            self._begin, self._before, self._begun = after._begin, after._before, after._begun
            self._pace, self._compiling = after._pace, after._compiling
        self._stop = threading.Event()
        self._thread: threading.Thread | None = None
        if sys.stderr.isatty():
            self._thread = threading.Thread(target=self._redraw, daemon=True)
            self._thread.start()

    def stage(self, name: str, share: float | None = None) -> None:
        """Report the present stage, and the share of the whole that is done, where it is known [1]."""
        if name != self._name:
            self._count += 1
        self._name, self._share = name, share
        if share is None:
            self._compiling |= not self._begun and name.startswith("compiling")
            return
        told, now = WorkDone.of(share), time.monotonic()
        if not self._begun and not self._compiling and float(told) > self._before:
            # Time before the first reported share counts as work, unless it was compilation, which does not come again.
            self._pace.report(self._begin, WorkDone(told.done * self._before / float(told), 0.0, 0.0))
        self._begun = True
        self._pace.report(now, told)
        left = self._pace.left(told)
        self._left = None if left is None else (now, *left)

    def begin_at(self, share: float) -> None:
        """This share of the whole was done by an earlier run: the time left is estimated from the rest only [1]."""
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
            since = self._begin + spent - self._left[0]  # between two reports the time left counts down
            left = told_left(*(max(each - since, 0.0) + self.tail for each in self._left[1:]))
            left = f", {left}{f' of {self.what}' if self.what else ''}"
        return f"{self.title}{which}: {self._name}  {spent:.0f} s{left}"[:110]


def told_left(least: float, most: float) -> str:
    """The time left in words [s]: one number where both bounds are nearly the same, else both."""
    if most <= ALIKE * least or most < 2.0:
        return f"about {0.5 * (least + most):.0f} s left"
    return f"at most {most:.0f} s left" if least < FAR * most else f"{least:.0f} to {most:.0f} s left"
