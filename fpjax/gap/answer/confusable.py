"""Effects that a log cannot distinguish: exact twins, and rivals of nearly the same evidence."""

from collections.abc import Sequence

from ..effects.twins import Twin
from ..select.decision import Decision
from ..select.weighed import Weighed
from ..thresholds import THRESHOLDS


def indistinguishable(decision: Decision, effect: str, twins: Sequence[Twin]) -> tuple[str, ...]:
    """Effects that could replace one of the causes.

    First a single effect that is its exact twin, and wrong numbers that make up for it; then effects in whose place the
    model has nearly the same worth (within `close` nats); last, if the class has room, several effects that together
    are an exact twin.

    Args:
        decision: of the fits.
        effect: one of the causes of the chosen model.
        twins: of the chosen model's causes.

    Returns:
        At most two names, the closest first.
    """
    # Each a tuple of effects that together give the same log.
    sets = [twin.instead for twin in twins if effect in twin.causes]
    found = [instead[0] for instead in sets if len(instead) == 1]
    found = [*found, *(name for name in decision.alike.get(effect, ()) if name not in found)]
    found = found[: THRESHOLDS.largest_class - 1]
    for rival, other in _in_place(decision.chosen, effect, decision.rivals):
        if len(found) >= THRESHOLDS.largest_class - 1 or rival.behind(decision.chosen) >= THRESHOLDS.close:
            break
        if other not in found:
            found.append(other)
    for instead in sets:
        new = [name for name in instead if name not in found]
        if len(instead) > 1 and len(found) + len(new) < THRESHOLDS.largest_class:
            found += new
    return tuple(found)


def _in_place(chosen: Weighed, effect: str, rivals: Sequence[Weighed]) -> list[tuple[Weighed, str]]:
    """Rivals that have another effect in place of `effect`, with the name of that one, the most likely first."""
    others = set(chosen.structural) - {effect}
    near = [
        (rival, next(iter(set(rival.structural) - others)))
        for rival in rivals
        if effect in chosen.structural
        and len(rival.structural) == len(chosen.structural)
        and others <= set(rival.structural)
        and effect not in rival.structural
    ]
    return sorted(near, key=lambda pair: -pair[0].worth)
