"""Starts: which sets of causes are tried, and where their fits begin."""

from collections.abc import Sequence

from ..effects.effect import Effect
from ..fit.candidate import NOMINAL, Start
from ..fit.search import Search
from ..thresholds import THRESHOLDS
from .simpler import FACTORS, GAIN
from .weighed import Weighed

# Pairs that one machine cannot hold: bristles and a transmission are two structures of the plant, and a backlash brings
# its own spring.
IMPOSSIBLE = ({"presliding", "compliance"}, {"presliding", "backlash"}, {"compliance", "backlash"})


def alone(search: Search) -> list[Start]:
    """Every effect alone, from its own starts, beside the nominal numbers as given and as they are best without it."""
    base, starts = search.base, [Start((), NOMINAL, {})]
    if base.family.key[0] == "transmission":  # an effect goes on from there too (`fpjax.gap.fit.screen.from_bases`)
        starts.append(Start((), NOMINAL, base.values(), base))
    for effect in search.effects:
        if effect.name.removesuffix("_error") in NOMINAL:
            continue  # every fit asks for them
        for values in effect.starts(search.setting):
            for wide in nominal_for(effect):
                own = {k: v for k, v in values.items() if k not in NOMINAL}
                kept = base.values() if wide else {k: v for k, v in base.values().items() if k not in NOMINAL}
                starts.append(Start((effect,), wide, values if wide else own))
                if not values.keys() & set(NOMINAL):  # else it has numbers of its own, beside which it was found
                    starts.append(Start((effect,), wide, kept | own, base))
    return starts


def beside(search: Search, bases: Sequence[Weighed], likely: Sequence[str]) -> list[Start]:
    """Every likely effect beside those of the bases, from its own starts and the base's fit.

    Without the effect the base's numbers make up for it, and may lie in another valley: an actuator's lag alone lowers
    the viscous friction by as much as a dead zone beside it asks for.
    """
    starts = []
    for base in bases:
        values, setting = base.fit.candidate.values(), search.setting_beside(base.fit.candidate)
        held = {p.name for e in base.fit.candidate.effects for p in e.parameters}
        for effect in search.effects:
            names = {*base.structural, effect.name}
            if effect.name in base.structural or effect.name.removesuffix("_error") in NOMINAL:
                continue
            if effect.name not in likely:
                continue
            if any(pair <= names for pair in IMPOSSIBLE) or {p.name for p in effect.parameters} <= held:
                continue
            for found in effect.starts(setting):
                start = {k: v for k, v in found.items() if k not in NOMINAL}
                for wide in nominal_for(*base.fit.candidate.effects, effect):
                    # A twin of the nominal numbers starts from the numbers as they were given.
                    kept = values if wide else {k: v for k, v in values.items() if k not in NOMINAL}
                    effects = (*base.fit.candidate.effects, effect)
                    own = found if wide else start  # numbers of a start were found beside this base
                    starts.append(Start(effects, wide, kept | own, base.fit.candidate, or_given=bool(wide)))
    return starts


def nominal_for(*effects: Effect) -> list[tuple[str, ...]]:
    """Which nominal numbers are free beside effects: all; none beside a factor that is a twin of all of them together.

    A factor on the rate alone leaves the Coulomb friction as it is, so that the numbers may be free beside it too. All
    three beside one on the torque are one number too many: it only scales what else of the nominal model is known, an
    offset or a weight, against them.
    """
    names = {effect.name for effect in effects}
    if GAIN in names:
        return [()]
    return [NOMINAL, ()] if names & set(FACTORS) else [NOMINAL]


def bases_of(singles: Sequence[Weighed]) -> list[Weighed]:
    """Effects beside which others are tried: the likeliest, and as many again where they are worth as much.

    With numbers that are guesses, a factor or a friction by direction does what a constant torque does, and beside the
    one that came third by a nat the second cause may be right.
    """
    first, more = list(singles[: THRESHOLDS.bases]), singles[THRESHOLDS.bases : 2 * THRESHOLDS.bases]
    if not first or not first[-1].gain > THRESHOLDS.decisive:
        return first
    return first + [w for w in more if w.behind(first[-1]) < THRESHOLDS.sure]


def bases_beside(chosen: Weighed, rivals: Sequence[Weighed]) -> list[Weighed]:
    """The chosen causes, and the best others that are nearly worth as much or else likelier: a further one may decide.

    What leaves less torque may be the more flexible of the two (a friction by direction for a constant torque), and
    beside it what is missing is not seen.
    """
    known = frozenset(chosen.structural)
    near = [
        w
        for w in rivals
        if w.structural
        and frozenset(w.structural) != known
        and (w.behind(chosen) < THRESHOLDS.contested * chosen.gain or w.evidence > chosen.evidence)
    ]
    return [chosen, *near][: THRESHOLDS.bases]
