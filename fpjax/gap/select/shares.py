"""Shares: what each cause of a model takes of the missing torque."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

from ..effects.effect import Effect
from ..fit.candidate import NOMINAL, Fit, Start
from ..fit.search import Search
from ..thresholds import THRESHOLDS
from .weighed import Exact, whole_gap

Alike = dict[str, tuple[str, ...]]  # by cause, those that would do as well in its place


@dataclass(frozen=True)
class Shares:
    """What each cause of a model is worth.

    Attributes:
        energy: what would come back of the nominal model's missing energy without it [1], the largest first.
        evidence: what would be lost without it alone, of the evidence that the model has over the nominal one [1]: the
            smaller of two shares (`lost_of`).
        alike: causes that would do as well in its place.
    """

    energy: dict[str, float]
    evidence: dict[str, float] = field(default_factory=dict)
    alike: Alike = field(default_factory=dict)


def shares_of(search: Search, exact: Exact, fit: Fit, known: Sequence[Fit]) -> Shares:
    """What would come back of the missing energy without each cause of a model, and what evidence would be lost.

    What is left without a cause is that of the most likely fit without it: from where the whole stands, from the
    numbers as they were given, or as it was found before. A friction by direction takes what no friction equal in both
    directions does: without it the numbers that it holds stay free.

    Args:
        search: of the logs.
        exact: what models are weighed against.
        fit: of the model whose causes they are.
        known: fits found before.
    """
    # Energies, not rms values: of causes that act at different times or frequencies they add up.
    whole, now = whole_gap(search, exact, fit) ** 2, exact.left(fit) ** 2
    c = fit.candidate
    numbers = [f"{number}_error" for number in NOMINAL if number in c.wide]
    if not whole > 0.0:
        nothing = dict.fromkeys((*c.structural, *numbers), 0.0)
        return Shares(nothing, nothing)
    singly = [(name,) for name in (*c.structural, *numbers)]
    without = _fits_without(search, fit, singly, known)
    shares = {name: min(max(exact.left(without[(name,)]) ** 2 - now, 0.0) / whole, 1.0) for (name,) in singly}
    lost = {name: lost_of(exact.fit, fit, without[(name,)]) for (name,) in singly}
    alike: Alike = {}
    for some in (numbers, [*c.structural, *numbers]):
        details = [name for name in some if shares[name] <= THRESHOLDS.matters]
        if len(details) > 1:
            found, others = _one_by_one(search, exact, fit, details, known)
            shares, alike = shares | found, alike | others
    return Shares(dict(sorted(shares.items(), key=lambda item: -item[1])), lost, alike)


def lost_of(given: Fit, fit: Fit, without: Fit) -> float:
    """Share of the evidence over the nominal model that is lost without a cause [1].

    Of all of it, or of that in modes that hold more torque than noise (`Fit.undrowned`), whichever share is smaller:
    what follows the noise of the readings or of a measured torque is no cause by that.

    Args:
        given: the nominal model as given.
        fit: of all causes.
        without: of all but one.
    """
    both = ((fit.evidence - one.evidence, fit.undrowned - one.undrowned) for one in (given, without))
    return min(max(lost, 0.0) / brings if brings > 0.0 else 0.0 for brings, lost in zip(*both, strict=True))


def _one_by_one(
    search: Search, exact: Exact, fit: Fit, details: Sequence[str], known: Sequence[Fit]
) -> tuple[dict[str, float], Alike]:
    """Shares of causes of which one makes up for the other, so that none alone would bring much back.

    Where Coulomb and viscous friction are both missing, either does; so does a Coulomb level for a weight that hangs on
    a winch. Without both much comes back: they are taken on again one by one, the one that takes most first, while
    without the rest too much is left; with each, those that would have done as well.
    """
    whole, now = whole_gap(search, exact, fit) ** 2, exact.left(fit) ** 2
    matters = THRESHOLDS.matters * whole
    out, found, alike = tuple(details), {}, {}
    left = exact.left(_fits_without(search, fit, [out], known)[out]) ** 2
    while len(out) > 1 and left - now > matters:
        fewer = {name: tuple(other for other in out if other != name) for name in out}
        fits = _fits_without(search, fit, list(fewer.values()), known)
        after = {name: exact.left(fits[rest]) ** 2 for name, rest in fewer.items()}
        near = [
            name for name in sorted(out, key=lambda one: after[one]) if after[name] <= min(after.values()) + matters
        ]
        # Of those that do as well, friction that the nominal model has none of comes before what would vary it; else an
        # effect stands in the model because its evidence is beyond that of the numbers.
        absent, effects = absent_friction(exact.fit), fit.candidate.structural
        name = next(iter([*(n for n in near if n in absent), *(n for n in near if n in effects)]), near[0])
        if left - after[name] <= matters:
            break  # they only add up
        found[name] = max(left - after[name], 0.0) / whole
        alike[name] = tuple(other for other in near if other != name)
        out, left = fewer[name], after[name]
    # What is needed beside it does not stand in its place.
    return found, {name: tuple(n for n in others if n not in found) for name, others in alike.items()}


def _fits_without(
    search: Search, fit: Fit, sets: Sequence[tuple[str, ...]], known: Sequence[Fit]
) -> dict[tuple[str, ...], Fit]:
    """The most likely fit without each of some sets of causes."""
    c = fit.candidate
    starts: list[Start] = []
    for names in sets:
        rest = tuple(effect for effect in c.effects if effect.name not in names)
        values = c.values()
        for effect in c.effects:
            if effect.name in names:
                values = without_effect(values, effect, rest)
        numbers = {name.removesuffix("_error") for name in names} & c.wide
        values = {name: value for name, value in values.items() if name not in numbers}
        given = {name: value for name, value in values.items() if name not in NOMINAL}
        freed = {number for e in c.effects if e.name in names for number in numbers_of(e)} - numbers
        wide = tuple(number for number in NOMINAL if number in (c.wide - numbers) | freed)
        starts += [Start(rest, wide, values, c), Start(rest, wide, given, c)]
    best: dict[tuple[str, ...], Fit] = {}
    for names, start, without in zip([n for n in sets for _ in range(2)], starts, search.fitted(starts), strict=True):
        same = [
            k for k in known
            if set(k.candidate.effects) == set(start.effects) and k.candidate.wide <= set(start.wide)
        ]  # fmt: skip
        best[names] = max((without, *same, *([best[names]] if names in best else [])), key=lambda one: one.evidence)
    return best


def absent_friction(given: Fit) -> frozenset[str]:
    """Errors of the friction numbers that the nominal model has none of, as every machine has.

    Args:
        given: the nominal model as given.
    """
    values = given.candidate.values()
    return frozenset(f"{number}_error" for number in ("coulomb", "viscous") if values.get(number) == 0.0)


def numbers_of(effect: Effect) -> tuple[str, ...]:
    """The nominal numbers that an effect holds, as a friction by direction does.

    Args:
        effect: of the vocabulary or the user's own.
    """
    return tuple(p.name for p in effect.parameters if p.name in NOMINAL)


def without_effect(values: Mapping[str, float], effect: Effect, rest: Sequence[Effect]) -> dict[str, float]:
    """Values without the parameters that an effect alone has; the nominal numbers are the machine's.

    Args:
        values: by name.
        effect: that is left out.
        rest: effects that stay.
    """
    shared = {*NOMINAL, *(p.name for other in rest for p in other.parameters)}
    gone = {p.name for p in effect.parameters} - shared
    return {name: value for name, value in values.items() if name not in gone}
