"""Stopping rules common to all methods, a target cost and a budget of simulations; and the progress bar."""

import dataclasses

import numpy as np

from fpjax.errors import InputError
from fpjax.output.progress import Stages
from fpjax.output.work_done import WorkDone

from .lanes import Best


@dataclasses.dataclass
class Stop:
    """Stopping rules and progress of a search, common to all methods.

    Attributes:
        target: a lane ends once its cost is at most this [1]; 0 for no target.
        budget: simulations that each lane may use; None for no limit.
        bar: the progress bar, or None.
        expected: largest number of iterations.
    """

    target: float = 0.0
    budget: int | None = None
    bar: Stages | None = None
    expected: int = 1

    def before(self, best: Best, needed: int) -> np.ndarray:
        """Which lanes end before an iteration of `needed` simulations, shape (lanes,); the reasons go into `best`.

        Raises:
            InputError: for a budget that ends before the first iteration: nothing would be known of the start.
        """
        over = np.zeros(best.costs.shape, bool)
        for lane, cost in enumerate(best.costs):
            if cost <= self.target and self.target > 0.0:
                over[lane], best.reasons[lane] = True, f"reached the target {self.target:g}"
            elif self.budget is not None and best.simulations[lane] + needed > self.budget:
                if best.iterations[lane] == 0:
                    raise InputError(
                        f"max_simulations = {self.budget} ends before the first iteration, which needs "
                        f"{best.simulations[lane] + needed} simulations of each start: give at least as many, or None "
                        f"(no --max-simulations) for no limit."
                    )
                over[lane], best.reasons[lane] = True, f"used its budget of {self.budget} simulations"
        return over

    def progress(self, best: Best) -> None:
        """Draw the bar."""
        if self.bar is not None:
            done = float(best.iterations.max())
            # A search may end at any iteration: what is left is between 0 and the rest.
            self.bar.stage(f"best {best.costs.min():.4g}", WorkDone(done, 0.0, self.expected - done))
