"""Shared numbers: nominal numbers that are wrong in every model that does nearly as well as the chosen one.

Where several effects do as well as each other, none is sure; a number that each of them stands beside is.
"""

from ..thresholds import THRESHOLDS, Thresholds
from .decision import Decision
from .nominal_errors import wrong_numbers
from .statement import is_number
from .weighed import Weighed


def shared_numbers(
    decision: Decision, told: tuple[str, ...], sizes: dict[str, float], t: Thresholds = THRESHOLDS
) -> tuple[str, ...]:
    """Of the chosen model's causes, the wrong numbers that no model near it does without, the largest first.

    Near are those of `near_models`, and that of the numbers alone. One does without a number where
    that is right beside its effects, ends at a bound, or keeps less than `persists` of how far it is off.

    Args:
        decision: on the fits.
        told: causes of the chosen model, the largest first.
        sizes: of the nominal numbers (`fpjax.gap.fit.candidate.nominal_sizes`).
        t: thresholds.
    """
    near = [decision.nominal, *near_models(decision, t)]
    return tuple(name for name in told if is_number(name) and all(_keeps(w, name, decision, sizes, t) for w in near))


def near_models(decision: Decision, t: Thresholds = THRESHOLDS) -> list[Weighed]:
    """Models that lack less of the chosen one's worth than what makes a cause sure, the most worth first.

    Args:
        decision: on the fits.
        t: thresholds.
    """
    enough = (1.0 - t.clear) * decision.chosen.worth
    tried = (decision.nominal, *decision.singles, *decision.rivals)
    return sorted((w for w in tried if w.worth > max(enough, 0.0)), key=lambda w: -w.worth)


def _keeps(w: Weighed, name: str, decision: Decision, sizes: dict[str, float], t: Thresholds) -> bool:
    """Whether a number is wrong in a model as it is in the chosen one."""
    number, c = name.removesuffix("_error"), w.fit.candidate
    if number not in c.wide or number not in wrong_numbers(w.fit, sizes)[1] or number in c.at_bound():
        return False
    given = decision.exact.candidate.values()[number]
    own, chosen = (one.values()[number] - given for one in (c, decision.chosen.fit.candidate))
    return own * chosen > 0.0 and abs(own) >= t.persists * abs(chosen)
