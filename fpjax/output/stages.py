"""StageClock: the time by stage of a long piece of work, and its progress."""

import time
from collections.abc import Callable

from .work_done import Outline, StageCosts, WorkDone


class StageClock:
    """Measures the time by stage. Calling it begins a stage, which ends when another one begins.

    Attributes:
        seconds: time by stage [s], in the order in which they first began. "diagnose: looking" and "diagnose: where"
            are parts of the stage "diagnose".
    """

    def __init__(
        self,
        progress: Callable[[str, float], None] | None = None,
        costs: StageCosts | None = None,
        *,
        now: Callable[[], float] = time.perf_counter,
    ) -> None:
        """Begin.

        Args:
            progress: called with (name of the stage, share of the whole that is done [1]).
            costs: of the stages; the shares reported are then shares of the stage. None where they are shares of the
                whole.
            now: the clock [s]; `time.process_time` for processor time.
        """
        self.seconds: dict[str, float] = {}
        self._progress, self._costs, self._now = progress, costs, now
        self._outline = None if costs is None else Outline(costs)
        self._stage: str | None = None
        self._began = 0.0

    def __call__(self, stage: str, share: float = 0.0) -> None:
        """Begin a stage, or go on with it.

        Args:
            stage: its name.
            share: share that is done [1]; or the `WorkDone` of a work that is itself a stage and comes before all
                stages that have costs.
        """
        self.end()
        self._stage, self._began = stage.partition(":")[0], self._now()
        self.seconds.setdefault(self._stage, 0.0)
        told = self._whole(stage, share)
        if self._progress is not None:
            self._progress(stage, told)

    def end(self) -> None:
        """End the stage; the times of a stage that comes several times are added."""
        if self._stage is not None:
            self.seconds[self._stage] += self._now() - self._began
        self._stage = None

    def done(self) -> None:
        """End the last stage and report that all is done."""
        self.end()
        if self._progress is not None:
            self._progress("done", 1.0 if self._outline is None else self._outline.end())

    def _whole(self, stage: str, share: float) -> float:
        if self._outline is None or self._costs is None:
            return share
        if not isinstance(share, WorkDone):
            return self._outline(stage, share)
        self._outline = Outline(self._costs, share.done)
        least, _, most = (sum(cost[which] for cost in self._costs.values()) for which in range(3))
        return WorkDone(share.done, share.least + least, share.most + most)
