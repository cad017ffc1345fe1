"""Progress with an ETA on stderr, silent where stderr is not a terminal but for a line a minute."""

import sys
import time


class Progress:
    """One line that is rewritten; without a terminal, a whole line every 60 s."""

    def __init__(self, stage: str):
        self.stage = stage
        self.start = self.shown = time.perf_counter()
        self.terminal = sys.stderr.isatty()

    def share(self, share: float, note: str = "") -> None:
        """How much of the stage is done, 0 ... 1."""
        now = time.perf_counter()
        if now - self.shown < (0.2 if self.terminal else 60.0):
            return
        self.shown = now
        spent = now - self.start
        left = spent * (1 - share) / share if share > 0 else float("nan")
        line = f"{self.stage}: {100 * share:5.1f} %  {spent:5.0f} s spent, {left:5.0f} s left  {note}"
        print(
            f"\r{line:<100}" if self.terminal else line, end="" if self.terminal else "\n", file=sys.stderr, flush=True
        )

    def end(self, note: str) -> None:
        """The stage is over."""
        spent = time.perf_counter() - self.start
        line = f"{self.stage}: {note} in {spent:.1f} s"
        print(f"\r{line:<100}" if self.terminal else line, file=sys.stderr, flush=True)
