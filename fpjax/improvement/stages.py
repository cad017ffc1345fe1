"""Stages: where the time of an improvement goes, and how much of it is left."""

import time
from collections.abc import Callable

from ..output.share import Outline, Share

# What follows the diagnosis, in its unit of work (all effects alone); compiling depends on what the cache holds.
COSTS = {
    "machines": (0.01, 0.03, 0.1),
    "compiling the closed loop": (0.01, 0.4, 0.8),
    "searching": (0.05, 0.15, 0.3),
    "judging on other machines": (0.01, 0.01, 0.02),
    "margins": (0.1, 0.3, 0.4),
    "runs over time": (0.1, 0.3, 0.5),
}


class StageClock:
    """Seconds by stage, and progress."""

    def __init__(self, progress: Callable[[str, float], None] | None) -> None:
        self.seconds: dict[str, float] = {}
        self._progress, self._stage, self._began = progress, "", time.perf_counter()
        self._outline = Outline(COSTS)

    def __call__(self, stage: str, share: float = 0.0) -> None:
        """Begin a stage, or say how far it is [1]."""
        if stage != self._stage:
            self._end()
            self._stage = stage
        least, _, most = (sum(cost[which] for cost in COSTS.values()) for which in range(3))
        if isinstance(share, Share):  # the diagnosis'
            self._outline = Outline(COSTS, share.done)
            told = Share(share.done, share.least + least, share.most + most)
        else:
            told = self._outline(stage, share)
        if self._progress is not None:
            self._progress(stage, told)

    def _end(self) -> None:
        if self._stage:
            name = self._stage.partition(":")[0]
            self.seconds[name] = self.seconds.get(name, 0.0) + time.perf_counter() - self._began
        self._began = time.perf_counter()

    def done(self) -> dict[str, float]:
        """The seconds; the last stage ends."""
        self._end()
        self._stage = ""
        return self.seconds
