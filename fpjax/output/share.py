"""Share: how much of a work is done, where how much is left is known between two bounds only."""

from collections.abc import Mapping


class WorkDone(float):
    """Share of a work that is done [1], at least: a plain number for who asks no more.

    A diagnosis does not know beforehand whether a second and a third cause will be tried, each of which takes as long
    as all before. One number for the time left would be wrong by a factor; two bounds are true.

    Attributes:
        done: work so far, in any unit.
        least: work that is left at least, in the same unit.
        most: work that is left at most.
    """

    done: float
    least: float
    most: float

    def __new__(cls, done: float, least: float, most: float) -> "WorkDone":
        """Of bounds that may be equal; work beyond the most that was expected is no work left."""
        least, most = max(least, 0.0), max(most, least, 0.0)
        whole = done + most
        made = super().__new__(cls, done / whole if whole > 0.0 else 1.0)
        made.done, made.least, made.most = done, least, most
        return made

    @classmethod
    def of(cls, share: float) -> "WorkDone":
        """A `WorkDone` as it is; of a plain number the rest is certain."""
        return share if isinstance(share, cls) else cls(float(share), 1.0 - share, 1.0 - share)


SPREAD = 0.5  # how far other parts of a work may be from the one under way, of it [1]


def part_of(share: float, place: int, count: int) -> float:
    """The share of several works one after the other, of the share of the one under way.

    Args:
        share: of the work under way [1].
        place: works before it.
        count: of all.
    """
    if count == 1 or not isinstance(share, WorkDone):
        return share if count == 1 else (place + share) / count
    # In works as long as this one is expected to be.
    whole, rest = share.done + 0.5 * (share.least + share.most), count - place - 1
    least, most = share.least / whole + (1.0 - SPREAD) * rest, share.most / whole + (1.0 + SPREAD) * rest
    return WorkDone(place + share.done / whole, least, most)


class Outline:
    """Stages of a work that come one after the other, and what each is expected to take.

    Args:
        costs: of each stage in its order, in one unit of work: (at least, expected, at most). At least 0 is a stage
            that may be left out.
        done: work before the first stage, in that unit.
    """

    def __init__(self, costs: Mapping[str, tuple[float, float, float]], done: float = 0.0) -> None:
        self._costs, self._names, self._before = costs, list(costs), done
        self._stage, self._share = "", 0.0

    def __call__(self, stage: str, share: float = 0.0) -> WorkDone:
        """How much is done when a stage begins, or is at a share [1] of itself, which never becomes less.

        A stage that is not in the outline takes no work.
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
        """All is done."""
        self._before += self._expected(self._stage)
        self._stage = ""
        return WorkDone(self._before, 0.0, 0.0)

    def _expected(self, stage: str) -> float:
        return self._costs[stage][1] if stage in self._costs else 0.0
