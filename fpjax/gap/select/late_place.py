"""Late place: where between command and reading a time is lost, decided beside all that is chosen."""

from collections.abc import Sequence

from ..fit.candidate import Start, nominal_sizes
from ..fit.search import Search
from ..thresholds import THRESHOLDS
from .detectability import resolved
from .nominal_errors import wrong_numbers
from .shares import without_effect
from .weighed import Exact, Weighed, settled, weighed_fit

PLACES = ("actuator_lag", "actuator_delay", "velocity_lag", "velocity_delay")
"""Effects of one parameter each, the time that is lost."""


def late_elsewhere(search: Search, exact: Exact, chosen: Weighed) -> tuple[Weighed, Sequence[Weighed]]:
    """(the chosen model with a lost time in another place, if that is surely the likelier; those that were tried).

    A torque that comes late and a reading that does differ at reversals alone, by some samples: there a Stribeck
    friction that is not in the model yet says more. What was chosen before the details stood beside it is asked again.

    Args:
        search: of the logs.
        exact: what models are weighed against.
        chosen: the model.
    """
    c = chosen.fit.candidate
    late = [effect for effect in c.effects if effect.name in PLACES]
    if len(late) != 1:
        return chosen, []
    (own,) = late
    rest = tuple(effect for effect in c.effects if effect is not own)
    values, time = without_effect(c.values(), own, rest), c.values()[own.parameters[0].name]
    others = [effect for effect in search.effects if effect.name in PLACES and effect is not own]
    starts = [
        Start((*rest, other), tuple(c.wide), values | {other.parameters[0].name: time}, c)
        for other in others
        if not c.values().get(other.parameters[0].name)  # one that the nominal model has too is another number
    ]
    fits = [fit for fit in search.fitted(starts) if resolved(search, fit)] if starts else []
    sizes = nominal_sizes(search.setting)
    found = [weighed_fit(search, exact, fit, wrong_numbers(fit, sizes)[0]) for fit in fits]
    best = max(found, key=lambda one: one.evidence, default=chosen)
    if best.evidence - chosen.evidence <= THRESHOLDS.decisive:
        return chosen, found
    return settled(search, exact, best), [chosen, *(one for one in found if one is not best)]
