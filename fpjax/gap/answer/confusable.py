"""Confusable: effects that a log cannot tell apart, exactly or by its data."""

from collections.abc import Sequence

from ..effects.twins import Twin
from ..select.decision import Decision, Weighed
from ..select.thresholds import THRESHOLDS

LARGEST_CLASS = 3  # names; a class of everything says nothing


def indistinguishable(decision: Decision, effect: str, twins: Sequence[Twin]) -> tuple[str, ...]:
    """Effects that could stand in one place of the causes as well.

    First the effect that is its exact twin; then those that are worth nearly as much in its place; last, where there
    is room, several effects that together are its exact twin.

    Args:
        decision: of the fits.
        effect: which of the chosen model's causes is asked about.
        twins: of the chosen model's causes.

    Returns:
        At most two names, the closest first.
    """
    sets = [twin.instead for twin in twins if effect in twin.causes]
    found = [instead[0] for instead in sets if len(instead) == 1][: LARGEST_CLASS - 1]
    for rival, other in _in_place(decision.chosen, effect, decision.rivals):
        if len(found) >= LARGEST_CLASS - 1 or rival.behind(decision.chosen) >= THRESHOLDS.close:
            break
        if other not in found:
            found.append(other)
    for instead in sets:
        new = [name for name in instead if name not in found]
        if len(instead) > 1 and len(found) + len(new) < LARGEST_CLASS:
            found += new
    return tuple(found)


def _in_place(chosen: Weighed, effect: str, rivals: Sequence[Weighed]) -> list[tuple[Weighed, str]]:
    """Rivals that differ from the chosen model in one effect, with that effect's name, the most likely first."""
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
