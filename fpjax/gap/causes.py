"""Causes: one more, one less, a simpler one in place of another."""

from collections.abc import Iterable

import numpy as np

from .attribute import Fitted, Search
from .decision import Decision
from .effect import Effect
from .judging import DECISIVE, MATERIAL, WHITE, channel_energy, judge, noise_share, weigh
from .measure import sure_gain

REMOVES = 0.5  # a further cause must remove this share of the energy that is left above the noise
BARELY = 0.1  # of the noise's energy that a cause must close beyond a simpler one that it contains
SIMPLER = {
    "asymmetric_friction": (
        ("coulomb_error",),
        ("viscous_error",),
        ("constant_torque",),
        ("viscous_error", "constant_torque"),
    ),
    "backlash": (("compliance",),),
}  # what a cause holds as a special case, with fewer parameters
WEAK = 0.02  # of the withheld energy that is left: a further cause that removes less is not worth a name
MORE = (14, 10, 5, 2)
FEW = (8, 6, 4, 2)  # sets of causes that go on after the screening and after each stage
IMPOSSIBLE = ({"presliding", "compliance"}, {"presliding", "backlash"}, {"compliance", "backlash"})


def one_more(search: Search, decision: Decision, screen: list[np.ndarray]) -> bool:
    """Add the best further cause, then try to replace what was there; False if none is worth it."""
    base = decision.chosen
    bases = [base]
    if len(base.names) == 1 and not search.imposed:
        # What leads alone may be no more than flexible: the best rigid effects are bases as well.
        rigid = [f for f in decision.singles if f.candidate.family.key[0] == "rigid" and f.names != base.names]
        bases += rigid[:2]
    options = [option for one in bases for option in _additions(search, one)]
    found = search.best_of(options, screen, FEW if len(bases) == 1 else MORE)
    if not found:
        return False
    weigh(search, [*found, base, decision.exact, decision.null, *decision.singles])
    best = max(found, key=lambda f: f.evidence)
    everything = list(found)
    # Backward: with the new cause in, is what came first still the right companion?
    if len(bases) > 1 and channel_energy(search, best) > WHITE * noise_share(search, best):
        newcomer = [f for f in decision.singles if f.names == (best.candidate.effects[-1].name,)]
        if newcomer:
            others = search.best_of(_replacements(search, best, newcomer[0]), screen, FEW)
            weigh(search, [*others, *found, base, decision.exact, decision.null, *decision.singles])
            swapped = max(others, key=lambda f: f.evidence)
            everything += others
            if swapped.evidence > best.evidence + 2.0 and set(swapped.names) != set(best.names):
                best = swapped
    before = decision.structure * decision.floor
    floor = noise_share(search, best)
    after = channel_energy(search, best)
    removed = (before - after) / max(before - floor, 1e-12)
    if best.evidence - base.evidence < DECISIVE or removed < REMOVES:
        return _weak_step(search, decision, found)
    if np.sum(best.withheld) > np.sum(base.withheld):
        return False
    added = set(base.names) <= set(best.names)
    decision.path = [*decision.path, best] if added else _path_to(decision, best)
    decision.rivals = sorted([*everything, *decision.singles], key=lambda f: -f.evidence)
    judge(search, decision, best)
    return True


def one_less(search: Search, decision: Decision) -> bool:
    """Take out a cause that the others do without, once they are fitted from where all of them stand."""
    chosen = decision.chosen
    fewer = []
    for effect in chosen.candidate.effects:
        others = tuple(other for other in chosen.candidate.effects if other is not effect)
        fewer.append(search.candidate(others, _values_without(search, chosen, effect, others)))
    search.fit(fewer, search.train, 12)
    for c in fewer:
        if search.has_play(c) and not search.imposed:
            search.polish(c)
    found = search.finish(fewer)
    weigh(search, [*found, *decision.rivals, chosen, decision.exact, decision.null, *decision.singles])
    best = max(found, key=lambda f: f.evidence)
    needed = channel_energy(search, best) - channel_energy(search, chosen) > MATERIAL * decision.floor
    if needed and chosen.evidence - best.evidence > DECISIVE:
        return False
    if len(best.names) == 1:
        decision.singles = [best, *(f for f in decision.singles if f.names != best.names)]
        decision.rivals = decision.singles
        decision.path = [decision.exact, best]
    else:
        decision.path = _path_to(decision, best)
        decision.rivals = [best, *(f for f in decision.rivals if set(f.names) != set(best.names))]
    return True


def simpler(search: Search, decision: Decision) -> None:
    """Put what is simpler in the place of a cause that contains it, where the data want no more."""
    chosen = decision.chosen
    by_name = {effect.name: effect for effect in search.effects}
    options = []
    for effect in chosen.candidate.effects:
        for names in SIMPLER.get(effect.name, ()):
            if not set(names) <= set(by_name) or set(names) & set(chosen.names):
                continue
            instead = tuple(by_name[name] for name in names)
            start = _values_without(search, chosen, effect, instead)
            parts = [instead if other is effect else (other,) for other in chosen.candidate.effects]
            options.append(search.candidate([other for part in parts for other in part], start))
    if not options:
        return
    search.fit(options, search.train, 12)
    sets = [set(c.names) for c in options]
    found = [*search.finish(options), *(f for f in decision.rivals if set(f.names) in sets)]
    weigh(search, [*found, *decision.rivals, chosen, decision.exact, decision.null, *decision.singles])
    best = max(found, key=lambda f: f.evidence)
    lost = channel_energy(search, best) - channel_energy(search, chosen)
    if best.evidence > chosen.evidence or lost < BARELY * decision.floor:
        decision.path = _path_to(decision, best)
        decision.rivals = [best, *decision.rivals]


def _path_to(decision: Decision, best: Fitted) -> list[Fitted]:
    """The ladder to a model: the rungs that are parts of it, or the best of its causes alone."""
    rungs = [f for f in decision.path[1:-1] if set(f.names) < set(best.names)]
    if not rungs and len(best.names) > 1:
        rungs = [f for f in decision.singles if f.names[0] in best.names][:1]
    return [decision.exact, *rungs, best]


def _values_without(search: Search, fitted: Fitted, effect: Effect, kept: Iterable[Effect]) -> dict[str, float]:
    """A model's values with an effect taken out, but for parameters that it shares with effects that are kept."""
    neutral = fitted.candidate.family.neutral_values(search.setting)
    shared = {p.name for other in kept for p in other.parameters}
    return fitted.candidate.values() | {p.name: neutral[p.name] for p in effect.parameters if p.name not in shared}


def _weak_step(search: Search, decision: Decision, found: list[Fitted]) -> bool:
    """Go on with the best cause beside those that are there if withheld data are sure of it, and say that it is weak.

    Only where motion is imposed: there a step costs little, and real logs ask for it.
    """
    base = decision.chosen
    if not search.imposed:
        return False

    def sure(f: Fitted) -> bool:
        removed = 1.0 - np.sum(f.withheld) / np.sum(base.withheld)
        more = f.evidence - base.evidence >= DECISIVE and removed >= WEAK
        return more and sure_gain(base.withheld, f.withheld)

    beside = [f for f in found if set(base.names) < set(f.names) and sure(f)]
    if not beside:
        return False
    best = max(beside, key=lambda f: f.evidence)
    decision.weak += 1
    decision.path.append(best)
    judge(search, decision, best)
    return True


def _replacements(search: Search, best: Fitted, newcomer: Fitted) -> list[tuple[tuple[Effect, ...], dict[str, float]]]:
    """Every companion of the newcomer, from the pair's fit with what came first taken out again; timing from its
    timing.
    """
    replaced = best.candidate.effects[0]
    values = _values_without(search, best, replaced, newcomer.candidate.effects)
    options = _additions(search, newcomer, values)
    times = [best.candidate.values()[p.name] for p in replaced.parameters if p.unit == "s"]
    for effect in search.effects:
        own = [p for p in effect.parameters if p.unit == "s"]
        if times and len(own) == len(effect.parameters) == 1 and effect.name not in newcomer.names:
            options.append(((*newcomer.candidate.effects, effect), values | {own[0].name: times[0]}))
    return options


def _additions(
    search: Search, base: Fitted, values: dict[str, float] | None = None
) -> list[tuple[tuple[Effect, ...], dict[str, float]]]:
    """Every effect beside those of the base, from its own starts and the base's fit."""
    values = base.candidate.values() if values is None else values
    options = []
    for effect in search.effects:
        names = {*base.names, effect.name}
        if effect.name in base.names or any(pair <= names for pair in IMPOSSIBLE):
            continue
        held = {p.name for p in effect.parameters}
        if held <= {p.name for e in base.candidate.effects for p in e.parameters}:
            continue  # a part of what is there already
        for start in effect.starts(search.setting):
            options.append(((*base.candidate.effects, effect), values | start))
    return options
