"""Friction numbers of a fit that are further off than a guess: an effect, or other causes, in their place."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from ..fit.candidate import NOMINAL, Fit, Start, nominal_sizes
from ..fit.search import Search
from ..thresholds import THRESHOLDS
from .detectability import resolved
from .shares import absent_friction, lost_of, numbers_of
from .simpler import FACTORS, come_back, plainest
from .starts import beside
from .weighed import Exact, Weighed, settled, weigh, whole_gap

STRIBECK = "stribeck"  # that of most bearings: it stands beside as many causes as are told
LAW_KEEP = (8, 4, 2, 2)  # sets of causes that go on to each stage where a law is tried in the place of a wild number


def plausible(
    search: Search, exact: Exact, chosen: Weighed, singles: Sequence[Weighed]
) -> tuple[Weighed, Sequence[Weighed]]:
    """(what is chosen; what was tried in its place): an effect for a friction number that is further off than a guess.

    Where causes explain the gap no further one is looked for, and a viscous friction of five times the given one may
    then stand for a drag, a Coulomb level for a dead zone: any law of a recorded variable, or a factor on all numbers.
    Friction that the nominal model has none of stands for itself.
    """
    off = wild(search, exact, chosen.fit)
    if not off or len(set(chosen.structural) - {STRIBECK}) >= THRESHOLDS.most_causes:
        return chosen, []
    laws = {e.name for e in search.effects if e.name in FACTORS or (e.follows and not off & set(numbers_of(e)))}
    found = [w for w in singles if set(w.structural) <= laws]
    if chosen.structural:
        starts = beside(search, [chosen], sorted(laws))
        found = weigh(search, exact, search.explore(starts, LAW_KEEP, white=False)) if starts else []
        likeliest = [start for start in starts if found and start.effects == found[0].fit.candidate.effects]
        anew = [again for start in likeliest for again in _stribeck_anew(search, start)]
        found = weigh(search, exact, [*(w.fit for w in found), *search.fitted(anew)]) if anew else found
    options, others = [], far_off(search, exact, chosen.fit)
    for w in found:
        instead = settled(search, exact, w)
        # Beside the effect the number is right, and no other is off in its place: friction that grows with the load
        # does what a Coulomb level does if inertia and viscous friction shrink with it.
        right = not off & instead.fit.candidate.wide and far_off(search, exact, instead.fit) <= others
        if instead.left < chosen.left and right and resolved(search, instead.fit):
            options.append(instead)
    if max((one.evidence for one in options), default=-np.inf) - chosen.evidence <= THRESHOLDS.decisive:
        return chosen, []
    best = plainest([one.fit for one in options])
    return next(one for one in options if one.fit is best), found


def with_right_numbers(search: Search, exact: Exact, chosen: Weighed, tried: Sequence[Weighed]) -> Weighed:
    """Of the models that were tried the likeliest one with no more causes in whose place no two numbers are far off.

    Two friction numbers that are further off than a guess and both come back beside other causes do not do so by
    chance; a Stribeck friction that falls all along the speeds has them off where a drag is missing, and bends better
    after a law of another form. What takes its place may lose as little evidence and torque as one factor may.
    """
    off, others = wild(search, exact, chosen.fit), far_off(search, exact, chosen.fit)
    if len(off) < 2:
        return chosen
    enough = THRESHOLDS.matters * whole_gap(search, exact, chosen.fit) ** 2

    def slight(fit: Fit) -> bool:
        back = exact.left(fit) ** 2 - exact.left(chosen.fit) ** 2
        return back < enough and lost_of(exact.fit, chosen.fit, fit) < THRESHOLDS.factor

    options = []
    for w in tried:
        few = 0 < len(w.structural) <= len(chosen.structural)
        held = {name for effect in w.fit.candidate.effects for name in numbers_of(effect)}
        if not few or off & held or not slight(w.fit) or not resolved(search, w.fit):
            continue
        instead = settled(search, exact, w)
        right = not off & instead.fit.candidate.wide and far_off(search, exact, instead.fit) <= others
        if right and slight(instead.fit) and resolved(search, instead.fit):
            options.append(instead)
    return max(options, key=lambda one: one.evidence, default=chosen)


def mends_numbers(search: Search, exact: Exact, chosen: Fit, best: Fit) -> bool:
    """Whether friction numbers that were further off than a guess all come back, and no other goes off."""
    off = wild(search, exact, chosen)
    return bool(off) and wild(search, exact, best) <= off and come_back(exact.fit, chosen, best, off)


def _stribeck_anew(search: Search, start: Start) -> list[Start]:
    """The same start with its Stribeck friction and its numbers at their beginning; none where it has no such friction.

    A Stribeck curve that falls all along the speeds stands for the Coulomb friction, so that its numbers do not come
    back beside a further law.
    """
    stribeck = [effect for effect in start.effects if effect.name == STRIBECK]
    anew = {*NOMINAL, *(parameter.name for effect in stribeck for parameter in effect.parameters)}
    values = {name: value for name, value in start.values.items() if name not in anew}
    own = [one for effect in stribeck for one in effect.starts(search.setting)]
    return [replace(start, values=values | one, like=None, or_given=False) for one in own]


def wild(search: Search, exact: Exact, fit: Fit) -> set[str]:
    """Friction numbers of a fit that are further off than a guess; not those that the nominal model has none of."""
    return far_off(search, exact, fit) - {"inertia"}


def far_off(search: Search, exact: Exact, fit: Fit) -> set[str]:
    """Nominal numbers of a fit that are further off than a guess; no friction that the nominal model has none of."""
    c, given, sizes = fit.candidate, exact.fit.candidate.values(), nominal_sizes(search.setting)
    off = {n for n in c.wide if abs(c.values()[n] - given[n]) > THRESHOLDS.wild * sizes[n]}
    return off - {name.removesuffix("_error") for name in absent_friction(exact.fit)}
