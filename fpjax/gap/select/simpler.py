"""Simpler: fewer or simpler causes in the place of others, where no torque that matters would be missing for it."""

from collections.abc import Collection, Iterator, Sequence

import numpy as np

from ..effects.effect import Effect
from ..fit.candidate import NOMINAL, SPIKE_RANGE, Candidate, Fit, Start, nominal_sizes
from ..fit.search import Search
from ..thresholds import THRESHOLDS
from .detectability import resolved
from .nominal_errors import wrong_numbers
from .shares import numbers_of, without_effect
from .weighed import CONTAINED, Exact, Weighed, weighed_fit, whole_gap

CONSTANT = "constant_torque"
SIMPLER = {
    "asymmetric_friction": (CONSTANT,),
    "unbalance": (CONSTANT,),
    "cogging": ("unbalance",),
    "backlash": ("compliance",),
}
"""What an effect holds as a special case, or is in a short travel, with fewer parameters."""
GAIN = "torque_gain_error"
SCALE = "velocity_scale_error"
FACTORS = {GAIN: "gain", SCALE: "scale"}
"""One factor, with its parameter, that makes several nominal numbers wrong in proportion."""
POWERS = {"kg m^2": -1, "N m s/rad": -1, "N m s^2/rad^2": -2, "rad/s": 1, "rad": 1, "1/rev": -1}
"""Power of the scale of an angle by which a parameter changes, by its unit; one of another unit does not."""
ONE_FOR_MANY = (*FACTORS, "load_dependent_friction")
"""What one parameter makes of several numbers: a friction that grows with the load is nearly a gain where the motor
hardly ever brakes."""


def simpler(search: Search, exact: Exact, chosen: Weighed) -> Weighed:
    """Fewer or simpler causes in the place of others, where no torque that matters would be missing for it.

    A flexible cause takes some clutter along and so wins by evidence; what it is asked for here is torque.
    """
    by_name = {effect.name: effect for effect in search.effects}
    seen = {_free_in(chosen.fit)}
    while True:
        options = list(_instead(search, chosen.fit, by_name))
        if not options:
            return chosen
        whole = whole_gap(search, exact, chosen.fit)
        fits = iter(search.fitted([start for option in options for start in option]))
        # A detail may be a small share of the evidence: what stands for it must be likelier than nothing in its place.
        tried = [tuple(next(fits) for _ in option) for option in options]
        fits = [fit for fit, *none in tried if resolved(search, fit) and all(fit.evidence > n.evidence for n in none)]
        c = chosen.fit.candidate
        factored = any(set(fit.candidate.structural) > set(c.structural) for fit in fits)
        plain = _beside_given(search, exact, chosen.fit) if factored else exact.fit.evidence
        # Wrong numbers give way to one factor, and beside one at its bound to the numbers again: nothing twice.
        fresh = [fit for fit in fits if _free_in(fit) not in seen]
        near = [fit for fit in fresh if _stands_for(exact, fit, chosen.fit, whole, plain)]
        if not near:
            return chosen
        best = plainest(near)  # none lacks torque that matters
        seen.add(_free_in(best))
        chosen = weighed_fit(search, exact, best, wrong_numbers(best, nominal_sizes(search.setting))[0])


def _free_in(fit: Fit) -> tuple[frozenset[str], frozenset[str]]:
    """Effects of a fit and its nominal numbers that may be wrong: a model, whatever values it has."""
    return frozenset(fit.candidate.structural), frozenset(fit.candidate.wide)


def plainest(fits: Sequence[Fit]) -> Fit:
    """The likeliest of some fits; in the place of a friction by load a factor that is nearly as likely.

    Where the motor hardly ever brakes a friction that grows with the load does what a factor on the torque does, and a
    torque constant that is off is more usual.

    Args:
        fits: at least one.
    """
    best = max(fits, key=lambda fit: fit.evidence)
    by_load = set(ONE_FOR_MANY) - set(FACTORS)
    if not by_load & set(best.candidate.structural):
        return best
    near = [fit for fit in fits if best.evidence - fit.evidence <= THRESHOLDS.decisive]
    factors = [fit for fit in near if set(fit.candidate.structural) & set(FACTORS)]
    return max(factors, key=lambda fit: fit.evidence, default=best)


def alike_factor(search: Search, exact: Exact, chosen: Weighed) -> Weighed | None:
    """The chosen model with one factor that would do as well as its wrong numbers; None for none.

    But for what is left of these: beside such a factor they end further from the given ones than numbers that are right
    by themselves. They are guesses that are near to one factor by chance, or it is a factor on a machine whose laws are
    of another form: one is told, and the other beside it.

    Args:
        search: of the logs.
        exact: what models are weighed against.
        chosen: in which no factor stands for them.
    """
    c, by_name = chosen.fit.candidate, {effect.name: effect for effect in search.effects}
    values, given = c.values(), exact.fit.candidate.values()
    ways = {values[number] > given[number] for number in c.wide}
    factors = [by_name[name] for name in FACTORS if name in by_name]
    if len(c.wide) < 2 or len(ways) > 1 or set(c.structural) & set(ONE_FOR_MANY) or not factors:
        return None
    best = max(search.fitted([_by_one_factor(c, factor) for factor in factors]), key=lambda one: one.evidence)
    if not resolved(search, best) or not best.evidence > chosen.evidence - THRESHOLDS.close:
        return None
    whole, plain = whole_gap(search, exact, chosen.fit), _beside_given(search, exact, chosen.fit)
    if not _stands_for(exact, best, chosen.fit, whole, plain, unlike=np.inf):
        return None
    return weighed_fit(search, exact, best, best.evidence)


def _beside_given(search: Search, exact: Exact, fit: Fit) -> float:
    """Evidence of a fit's effects beside the numbers as they were given."""
    return search.refit(fit, ()).evidence if fit.candidate.wide and fit.candidate.effects else exact.fit.evidence


def _stands_for(
    exact: Exact, fit: Fit, chosen: Fit, whole: float, plain: float, unlike: float = THRESHOLDS.unlike
) -> bool:
    """Whether a simpler fit may take the place of the chosen one: no torque that matters is missing, little is lost.

    Args:
        exact: what models are weighed against.
        fit: the simpler one.
        chosen: the one in whose place it would stand.
        whole: what counts as all of the gap [N m].
        plain: evidence of the chosen effects beside the numbers as they were given, where a factor may stand for these.
        unlike: `Thresholds.unlike`, or infinity where the numbers beside a factor may be off [nats].
    """
    ahead = fit.evidence - chosen.evidence > THRESHOLDS.decisive
    slight = exact.left(fit) ** 2 - exact.left(chosen) ** 2 < THRESHOLDS.matters * whole**2
    before, after = chosen.candidate, fit.candidate
    if set(after.structural) > set(before.structural):
        if _puts_off(exact.fit, fit, chosen):
            return False
        if after.strain > unlike:
            return False
        # One factor. One number is no more than it is: then it must be the likelier.
        doubtful = len(before.wide) == 1 and not _stands_beside_sides(exact.fit, fit, chosen)
        # Of what the numbers bring: beside a cause that brings thousands of nats a hundredth of all is no small loss.
        return slight and _lost(fit, chosen, plain) < THRESHOLDS.factor and (ahead or not doubtful)
    # A model that is less likely than one that it contains has not found its best: less torque left is chance.
    contained = any(a in before.structural and b in after.structural for a, b in CONTAINED.items())
    return (contained and ahead) or (slight and _lost(fit, chosen, exact.fit.evidence) < THRESHOLDS.simpler)


def come_back(given: Fit, before: Fit, after: Fit, numbers: Collection[str]) -> bool:
    """Whether numbers that one fit has off come back to the given ones in another, at least a good part of the way.

    Args:
        given: the nominal model as given.
        before: a fit.
        after: another one.
        numbers: names.
    """
    old, first, then = (fit.candidate.values() for fit in (given, before, after))
    return all(abs(then[n] - old[n]) <= THRESHOLDS.comes_back * abs(first[n] - old[n]) for n in numbers)


def _puts_off(given: Fit, fit: Fit, chosen: Fit) -> bool:
    """Whether one factor takes a nominal number that an effect holds further from the given one.

    An effect that holds nominal numbers, as a friction by direction does, has levels of its own that no prior binds:
    they follow any factor for nothing. The inertia would come back and both means be off instead.
    """
    held = {n for effect in chosen.candidate.effects for n in numbers_of(effect)}
    old, first, then = (one.candidate.values() for one in (given, chosen, fit))
    return any(abs(then[n] - old[n]) > max(abs(first[n] - old[n]), SPIKE_RANGE * abs(old[n])) for n in held)


def _stands_beside_sides(given: Fit, fit: Fit, chosen: Fit) -> bool:
    """Whether one factor brings back a wrong inertia and both means of the friction by direction beside it.

    Beside a torque that is off by a factor all three are off by the same share; by chance they hardly are. The inertia
    and the Coulomb level are right then; of the viscous friction, which a log tells less well, a good part of
    the way is enough.
    """
    held = {n for effect in chosen.candidate.effects for n in numbers_of(effect)}
    old, then = given.candidate.values(), fit.candidate.values()
    return (
        held >= {"coulomb", "viscous"}
        and come_back(given, chosen, fit, held | chosen.candidate.wide)
        and all(abs(then[n] - old[n]) <= SPIKE_RANGE * old[n] for n in ("inertia", "coulomb"))
    )


def _lost(fit: Fit, chosen: Fit, without: float) -> float:
    """Share [1] of the evidence that a chosen fit has over `without`, which another fit lacks."""
    return (chosen.evidence - fit.evidence) / max(chosen.evidence - without, 1e-300)


def _as_read(c: Candidate) -> dict[str, float]:
    """Values of the machine that a right rate sensor shows as a candidate's sensor with a scale shows its own.

    Where the rate alone is measured, an angle counts in the readings' unit: an inertia and a damping go down with the
    scale, a speed of friction goes up, and a torque repeats after another angle.
    """
    values = c.values()
    scale, own = values["scale"], [p for p in c.family.parameters if p.name not in ("scale", "bias")]
    return {p.name: values[p.name] * scale ** POWERS[p.unit] for p in own if p.unit in POWERS}


def _instead(search: Search, fit: Fit, by_name: dict[str, Effect]) -> Iterator[tuple[Start, ...]]:
    """Starts of what may stand for causes of a fit; behind one for an effect, that of the fit without the effect.

    Args:
        search: of the logs.
        fit: of the chosen causes.
        by_name: the vocabulary.
    """
    c, rate_alone = fit.candidate, all(record.position is None for record in search.records)
    # With a known load that turns in the nominal model an unbalance is its error.
    turning_load = bool(search.setting.turning_load)
    for effect in c.effects:
        rest = tuple(e for e in c.effects if e is not effect)
        values = without_effect(c.values(), effect, rest)
        for name in SIMPLER.get(effect.name, ()):
            if name in by_name and name not in c.structural:
                # What the simpler one does not hold of friction may still be wrong in the nominal numbers.
                wide = tuple(c.wide | set(() if GAIN in c.structural else numbers_of(effect)))
                simple = Start((*rest, by_name[name]), wide, values)
                yield simple, Start(rest, wide, values)
        if effect.name == SCALE and rate_alone and (c.wide or set(c.at_bound()) & set(NOMINAL)):
            # With numbers wrong beside it a factor on the reading makes nothing simpler: they alone do what it does.
            yield (Start(rest, tuple(c.wide | {"inertia", "viscous"}), values | _as_read(c)),)
        if effect.name == "unbalance" and turning_load and c.wide and GAIN in by_name and GAIN not in c.structural:
            # A factor on the torque makes the known load and the numbers wrong in proportion.
            given = {k: v for k, v in values.items() if k not in NOMINAL}
            yield Start((*rest, by_name[GAIN]), (), given), Start(rest, tuple(c.wide), values)
    for name in ONE_FOR_MANY:
        if c.wide and name in by_name and name not in c.structural:
            yield (_by_one_factor(c, by_name[name]),)


def _by_one_factor(c: Candidate, factor: Effect) -> Start:
    """The start of one factor in the place of all wrong numbers of a candidate."""
    return Start((*c.effects, factor), (), {k: v for k, v in c.values().items() if k not in NOMINAL})
