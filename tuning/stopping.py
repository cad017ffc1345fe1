"""When a search ends besides its own rules: a target cost, a budget of simulations; and its progress on the way."""

import dataclasses

import numpy as np

from fpjax.output.progress import Stages
from fpjax.output.share import WorkDone

from .lanes import Best


@dataclasses.dataclass
class Stop:
    """Common to all methods.

    Attributes:
        target: a lane is over once its cost is at most this.
        budget: simulations that a lane may use; None for no limit.
        bar: the progress bar, or None.
        expected: iterations that it may take.
    """

    target: float = 0.0
    budget: int | None = None
    bar: Stages | None = None
    expected: int = 1

    def before(self, best: Best, needed: int) -> np.ndarray:
        """Which lanes are over before an iteration that needs so many simulations; their reasons are noted."""
        over = np.zeros(best.costs.shape, bool)
        for lane, cost in enumerate(best.costs):
            if cost <= self.target and self.target > 0.0:
                over[lane], best.reasons[lane] = True, f"reached the target {self.target:g}"
            elif self.budget is not None and best.simulations[lane] + needed > self.budget:
                over[lane], best.reasons[lane] = True, f"used its budget of {self.budget} simulations"
        return over

    def progress(self, best: Best) -> None:
        """Draw the bar."""
        if self.bar is not None:
            done = float(best.iterations.max())
            # Most searches end before their last iteration, and none says when.
            self.bar.stage(f"best {best.costs.min():.4g}", WorkDone(done, 0.0, self.expected - done))
