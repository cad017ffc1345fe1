"""The share of work that is done, where the work left is only known between two bounds."""

from collections.abc import Mapping

StageCosts = Mapping[str, tuple[float, float, float]]
"""(Least, expected, most) work of each stage, in order and in one unit; least = 0 for a stage that may be left out."""


class WorkDone(float):
    """The least share of work that is done [1], a plain number for readers that need no more, with bounds.

    A diagnosis does not know beforehand whether it will try a second and a third cause, each of which takes as long as
    everything before. A single number for the time left would be wrong by a factor, so there are two bounds.

    Attributes:
        done: work so far, in any unit.
        least: the least work that may be left, in the same unit.
        most: the most work that may be left, in the same unit.
    """

    done: float
    least: float
    most: float

    def __new__(cls, done: float, least: float, most: float) -> "WorkDone":
        """From both bounds, which may be equal; negative bounds (more was done than expected) count as zero."""
        least, most = max(least, 0.0), max(most, least, 0.0)
        whole = done + most
        made = super().__new__(cls, done / whole if whole > 0.0 else 1.0)
        made.done, made.least, made.most = done, least, most
        return made

    @classmethod
    def of(cls, share: float) -> "WorkDone":
        """A `WorkDone` unchanged; a plain share with the certain rest 1 - share."""
        return share if isinstance(share, cls) else cls(float(share), 1.0 - share, 1.0 - share)


SPREAD = 0.5  # how much the other parts of a work may differ from the present one, relative to it [1]


def part_of(share: float, place: int, count: int) -> float:
    """The share of several works that is done, from the share of the present one.

    Args:
        share: of the present work [1].
        place: number of works before it.
        count: number of all works.
    """
    if count == 1 or not isinstance(share, WorkDone):
        return share if count == 1 else (place + share) / count
    # The unit of work is the expected length of the present one.
    whole, rest = share.done + 0.5 * (share.least + share.most), count - place - 1
    least, most = share.least / whole + (1.0 - SPREAD) * rest, share.most / whole + (1.0 + SPREAD) * rest
    return WorkDone(place + share.done / whole, least, most)


class Outline:
    """The consecutive stages of a work and their expected costs.

    Args:
        costs: of the stages.
        done: work before the first stage, in that unit.
    """

    def __init__(self, costs: StageCosts, done: float = 0.0) -> None:
        self._costs, self._names, self._before = costs, list(costs), done
        self._stage, self._share = "", 0.0

    def __call__(self, stage: str, share: float = 0.0) -> WorkDone:
        """The work done when a stage begins, or has reached a share [1] of itself; a smaller share is ignored.

        A stage that is not in the outline counts as no work.
        """
        if stage != self._stage:
            self._before += self._expected(self._stage)
            self._stage, self._share = stage, 0.0
        self._share = max(self._share, min(share, 1.0))
        own = self._expected(stage)
        left = (1.0 - self._share) * own
        later = self._names[self._names.index(stage) + 1 :] if stage in self._costs else self._names
        least, _, most = (sum(self._costs[name][which] for name in later) for which in range(3))
        return WorkDone(self._before + own - left, left + least, left + most)

    def end(self) -> WorkDone:
        """The work done at the end of the last stage, with nothing left."""
        self._before += self._expected(self._stage)
        self._stage = ""
        return WorkDone(self._before, 0.0, 0.0)

    def _expected(self, stage: str) -> float:
        return self._costs[stage][1] if stage in self._costs else 0.0
