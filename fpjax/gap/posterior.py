"""Posterior: from the probabilities of sets of causes to those of the causes.

What competes are sets of causes: each effect alone, and every pair or triple that was tried. `probability.shares` says
how probable each set is. A cause's own probability is the sum over the sets that hold it; of a pair both may be
certain, so these need not sum to one. The ranking's probabilities must: there an effect has the probability that it is
the main cause, so a set's goes to the most important of its causes. A pair that is sure has 1 and 0 in the ranking, and
1 and 1 as `cause_probability`.
"""

import itertools
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from .attribute import Fitted
from .probability import shares

ROUNDING = frozenset({"velocity_quantisation"})
QUANTISED = 0.98  # probability that a rounded reading is a cause: the step itself is seen
BESIDE_ROUNDING = 0.5  # of the probability of an effect where rounding explains all that is seen


@dataclass(frozen=True)
class Posterior:
    """Probabilities of sets of causes; what is missing to one is none of these.

    Attributes:
        sets: (names, probability), the most probable first; each set once.
        order: effects, the most important first.
    """

    sets: tuple[tuple[frozenset[str], float], ...]
    order: tuple[str, ...] = ()

    def share(self, effect: str) -> float:
        """What the ranking gives an effect: that it is the main cause."""
        return sum(share for names, share in self.sets if self._main(names) == effect)

    def _main(self, names: frozenset[str]) -> str:
        known = [name for name in self.order if name in names]
        return known[0] if known else min(names)

    def cause(self, effect: str) -> float:
        """That an effect is among the causes."""
        return sum(share for names, share in self.sets if effect in names)

    def none(self) -> float:
        """That no effect tried is a cause, but rounding that is seen."""
        return max(1.0 - sum(share for names, share in self.sets if names != ROUNDING), 0.0)

    def statement(self, causes: Sequence[str], same: Mapping[str, Sequence[str]]) -> float:
        """That the causes are exactly these, each itself or one that it cannot be told from.

        Args:
            causes: as asserted.
            same: by cause, what it cannot be told from.
        """
        classes = [{cause, *same.get(cause, ())} for cause in causes]

        def states(names: frozenset[str]) -> bool:
            orders = itertools.permutations(classes) if len(names) == len(classes) else ()
            return any(all(n in one for n, one in zip(sorted(names), order, strict=True)) for order in orders)

        return sum(share for names, share in self.sets if states(names))


def make_posterior(
    rivals: Sequence[Fitted], explained: bool, gap: bool, quantised: bool, order: Sequence[str] = ()
) -> Posterior:
    """Probabilities of the sets that were tried.

    Args:
        rivals: fits, the chosen one among them; of several of one set the best counts.
        explained: the chosen one leaves nothing but noise.
        gap: something beside rounding was found.
        quantised: the rate reading is rounded, which is then a cause beside each set.
        order: effects, the most important first.
    """
    best: dict[frozenset[str], float] = {}
    for fitted in rivals:
        names = frozenset(fitted.names)
        best[names] = max(best.get(names, -np.inf), fitted.evidence)
    odds = shares(np.array(list(best.values())), explained, gap)
    found = list(zip(best, odds.tolist(), strict=True))
    if quantised and gap:
        found = [(names | ROUNDING, share) for names, share in found]
    elif quantised:
        found = [(names, BESIDE_ROUNDING * share) for names, share in found]
    if quantised:
        # Alone, or beside what no effect tried explains.
        found.append((ROUNDING, max(QUANTISED - float(np.sum(odds)), 0.0) if gap else QUANTISED))
    return Posterior(tuple(sorted(found, key=lambda pair: -pair[1])), tuple(order))
