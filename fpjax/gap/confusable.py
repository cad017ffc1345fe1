"""Confusable: effects that a log cannot tell apart, exactly or by its data."""

from .attribute import Fitted, Search
from .signature import canonical_correlation
from .twins import Twin

CLOSE = 4.0  # log evidence [1] within which the data do not decide between effects whose signatures are alike
TOSS = 1.0  # and within which they decide nothing, whatever the signatures
ALIKE = 0.95  # canonical correlation of two signatures from which on they are alike
LARGEST_CLASS = 3  # names; a class of everything says nothing


def indistinguishable(
    search: Search, fitted: Fitted, effect: str, rivals: list[Fitted], twins: list[Twin]
) -> tuple[str, ...]:
    """Effects that could stand in one place of the causes as well.

    First the effect that is its exact twin. Then those whose evidence in its place is nearly as good and whose
    signature in this log is alike: evidence alone can be close by luck, and signatures alone can be alike where the
    data still decide. Last, where there is room, several effects that together are its exact twin.

    Args:
        search: the fits.
        fitted: the chosen model.
        effect: which of its causes is asked about.
        rivals: models that were tried.
        twins: of the chosen model's causes.

    Returns:
        At most two names, the closest first.
    """
    sets = [twin.instead for twin in twins if effect in twin.causes]
    found = [instead[0] for instead in sets if len(instead) == 1][: LARGEST_CLASS - 1]
    others = set(fitted.names) - {effect}
    for rival, other in sorted(_in_place(fitted, others, rivals), key=lambda pair: -pair[0].evidence):
        distance = fitted.evidence - rival.evidence
        if len(found) >= LARGEST_CLASS - 1 or distance >= CLOSE:
            break
        if other in found:
            continue
        if distance < TOSS or canonical_correlation(search, fitted, effect, rival, other) > ALIKE:
            found.append(other)
    for instead in sets:
        new = [name for name in instead if name not in found]
        if len(instead) > 1 and len(found) + len(new) < LARGEST_CLASS:
            found += new
    return tuple(found)


def _in_place(fitted: Fitted, others: set[str], rivals: list[Fitted]) -> list[tuple[Fitted, str]]:
    """Rivals that differ in one cause, with that cause's name."""
    size = len(fitted.names)
    near = [r for r in rivals if len(r.names) == size and others <= set(r.names) and set(r.names) != set(fitted.names)]
    return [(rival, next(iter(set(rival.names) - others))) for rival in near]
