"""Stages: where the time goes."""

import time
from collections.abc import Callable


class StageClock:
    """Seconds by stage; calling it begins a stage, which ends when the next one begins.

    Attributes:
        seconds: spent by stage [s], in the order in which they first began.
    """

    def __init__(self, progress: Callable[[str, float], None] | None = None) -> None:
        self.seconds: dict[str, float] = {}
        self._progress = progress
        self._stage: str | None = None
        self._began = 0.0

    def __call__(self, stage: str, share: float) -> None:
        """Begin a stage; `share` of the whole is done [1]."""
        self.end()
        self._stage, self._began = stage, time.perf_counter()
        if self._progress is not None:
            self._progress(stage, share)

    def end(self) -> None:
        """End the stage; a stage that was there before is added to."""
        if self._stage is not None:
            spent = time.perf_counter() - self._began
            self.seconds[self._stage] = self.seconds.get(self._stage, 0.0) + spent
        self._stage = None

    def done(self) -> None:
        """The last stage ends, and progress is told that all is done."""
        self.end()
        if self._progress is not None:
            self._progress("done", 1.0)
