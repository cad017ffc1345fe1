"""Stages: where the time goes, and how much of it is left."""

import time
from collections.abc import Callable

from ...output.share import Outline

# What a stage takes, in units of all effects alone: a tenth, the half and nine tenths of 118 withheld logs stay below
# (80 of them with a second round of causes together, 41 with a third, which come only where fewer do not suffice).
COSTS = {
    "looking": (0.26, 0.35, 0.48),
    "effects alone": (1.0, 1.0, 1.0),
    "effects together (2)": (0.0, 1.3, 1.8),
    "effects together (3)": (0.0, 0.8, 1.1),
    "simpler causes": (0.0, 0.08, 0.2),
    "what each cause takes": (0.02, 0.12, 0.3),
    "intervals and curves": (0.02, 0.05, 0.1),
    "learned law": (0.0, 0.01, 0.02),
    "where": (0.0, 0.0, 0.01),
    "closed loop": (0.0, 0.01, 0.05),
}


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
        self._outline = Outline(COSTS)

    def __call__(self, stage: str, share: float = 0.0) -> None:
        """Begin a stage, or go on with it: `share` of the stage is done [1]."""
        self.end()
        self._stage, self._began = stage, time.perf_counter()
        told = self._outline(stage, share)
        if self._progress is not None:
            self._progress(stage, told)

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
            self._progress("done", self._outline.end())
