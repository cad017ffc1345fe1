"""The ranking: every effect with its probability, the gap it leaves, its parameters, and its twins."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import jax.numpy as jnp
import numpy as np

from ...blocks.loads import turns_with_position
from ...blocks.signals import Motion
from ..effects.effect import Effect
from ..effects.estimate import Estimate
from ..effects.twins import LogFacts, Twin, exact_twins
from ..effects.vocabulary import EFFECTS
from ..fit.candidate import NOMINAL, Fit
from ..fit.search import Search
from ..select.decision import Decision
from ..select.simpler import FACTORS
from ..select.statement import Verdict
from ..thresholds import THRESHOLDS
from .confusable import indistinguishable
from .findings import Ranked
from .gap import Gap, Step
from .intervals import covariance, estimates

WITH_INTERVALS = 6  # entries whose intervals are computed: each needs the gradients of all windows

ERRORS: dict[str, Effect] = {e.name: e for e in EFFECTS if e.name.removesuffix("_error") in NOMINAL}


@dataclass(frozen=True)
class Ranking:
    """Every effect tried, and what would do as well as some of the causes.

    Attributes:
        entries: the causes first, then by probability.
        twins: what makes the same log as causes, or fits it alike.
    """

    entries: tuple[Ranked, ...]
    twins: tuple[Twin, ...]


def rank(
    search: Search, decision: Decision, found: Verdict, gap: Gap, steps: Sequence[Step],
    read: Mapping[str, dict[str, Estimate]], allowed: Sequence[str], instead: Mapping[str, tuple[str, ...]],
) -> Ranking:  # fmt: skip
    """Rank every effect.

    Args:
        search: the fits.
        decision: on them.
        found: the verdict.
        gap: on withheld windows.
        steps: the gap after each cause.
        read: parameters of the causes that the velocity column itself shows, by effect.
        allowed: names of the effects that were tried; empty for the whole vocabulary.
        instead: errors that the velocity column does not distinguish from those, by effect.
    """
    chosen, exact = decision.chosen, decision.exact.evidence
    causes = [name for name in found.causes if name not in read]
    effects = {e.name: e for e in chosen.fit.candidate.effects} | ERRORS
    entries: dict[str, Ranked] = {}
    twins: list[Twin] = []
    if causes:
        spread = covariance(search, chosen.fit)
        values = {name: estimates(search, chosen.fit, effects[name], spread) for name in causes}
        twins = [twin for twin in exact_twins(causes, values, log_of(search)) if not told_apart(decision, twin)]
        twins += [twin for twin in factor_twin(decision, causes) if all(twin.instead != one.instead for one in twins)]
        left = {s.added: s.gap_after for s in steps}
        for name in causes:
            same = indistinguishable(decision, name, twins)
            entries[name] = Ranked(name, 0.0, left.get(name, gap.after), values[name], same, chosen.evidence - exact)
    for name, known in read.items():
        entries[name] = Ranked(name, 0.0, gap.after, known, instead.get(name, ()))
        for other in instead.get(name, ()):  # no fit holds it, and its share is not that of nothing
            entries.setdefault(other, Ranked(other, 0.0, gap.after, {}))
    asserted = [name for name in found.causes if name in entries]
    tried = [(w.fit, w.fit.candidate.effects[0], w.evidence) for w in decision.singles]
    # A factor that fits alike beside the other causes, not alone.
    if decision.factor is not None and not all(twin.exact for twin in twins):
        fit = decision.factor.fit
        tried += [(fit, effect, decision.factor.evidence) for effect in fit.candidate.effects if effect.name in FACTORS]
    tried += [(decision.nominal.fit, effect, decision.nominal.evidence) for effect in ERRORS.values()]
    # By probability, so that the intervals are computed for the entries that are read; evidence decides among zeros.
    tried.sort(key=lambda one: (-found.among.get(one[1].name, 0.0), -one[2]))
    for fit, effect, evidence in tried:
        if effect.name in entries or (allowed and effect.name not in allowed):
            continue
        spread = covariance(search, fit) if len(entries) < WITH_INTERVALS else None
        values = estimates(search, fit, effect, spread)
        entries[effect.name] = Ranked(effect.name, 0.0, _left(search, fit), values, (), evidence - exact)
    entries = {
        name: replace(
            entry, probability=found.main.get(name, 0.0), cause_probability=found.among.get(name, 0.0)
        )
        for name, entry in entries.items()
    }  # fmt: skip
    for twin in twins:
        share_alike(entries, twin)
    _both_ways(entries, asserted)
    if found.word == "unexplained":
        # Nothing of the machine is asserted: an error of the reading is then ranked by its probability, not first.
        asserted = []
    rest = [entry for entry in entries.values() if entry.effect not in asserted]
    rest.sort(key=lambda entry: (-entry.probability, -entry.evidence))
    return Ranking((*(entries[name] for name in asserted), *rest), tuple(twins))


def factor_twin(decision: Decision, causes: Sequence[str]) -> list[Twin]:
    """One factor and the wrong numbers among the causes that it makes as well, where these are several.

    Args:
        decision: on the fits.
        causes: that are told.
    """
    numbers = frozenset(name for name in causes if name in ERRORS)
    if decision.factor is None or len(numbers) < 2:
        return []
    factor = next(name for name in decision.factor.structural if name in FACTORS)
    value = decision.factor.fit.candidate.values()[FACTORS[factor]]
    return [Twin(numbers, (factor,), f" ({FACTORS[factor]} {value:.4g})", exact=False)]


def told_apart(decision: Decision, twin: Twin) -> bool:
    """Whether the fits tell two effects apart that are twins by their parameters.

    Wide intervals hold what makes them one (slopes of both directions that may be equal) although one of the two alone
    is far behind the other.

    Args:
        decision: on the fits.
        twin: two sets of causes that make the same log.
    """
    if twin.untried:
        return False
    alone = {w.structural: w for w in decision.singles}
    own, other = alone.get(tuple(twin.causes)), alone.get(twin.instead)
    return own is not None and other is not None and other.worth < (1.0 - THRESHOLDS.clear) * own.worth


def share_alike(entries: dict[str, Ranked], twin: Twin) -> None:
    """Give exact twins equal probabilities, each divided among its causes; changes `entries` in place.

    Not where the other set is larger: several values that happen to be wrong in one proportion are less likely than one
    cause that makes them so, and the simpler statement keeps its probability.

    Args:
        entries: of the ranking, by effect.
        twin: two sets of causes that make the same log.
    """
    sides = (tuple(twin.causes), twin.instead)
    if len(twin.instead) > len(twin.causes) or not {*twin.causes, *twin.instead} <= set(entries):
        return
    whole = sum(entries[name].probability for side in sides for name in side)
    cause = min(sum(entries[name].cause_probability / len(side) for side in sides for name in side), 1.0)
    for side in sides:
        for name in side:
            # Half of the sides' probability to each side, in equal parts to its causes. Being among the causes is not
            # shared out within a side: its causes come together.
            share = 0.5 * whole / len(side)
            entries[name] = replace(entries[name], probability=share, cause_probability=0.5 * cause)


def _both_ways(entries: dict[str, Ranked], asserted: Sequence[str]) -> None:
    """Make `indistinguishable_from` symmetric between causes and others; changes `entries` in place."""
    for name in asserted:
        for other in entries[name].indistinguishable_from:
            if other in entries and other not in asserted:
                same = tuple(dict.fromkeys((*entries[other].indistinguishable_from, name)))
                entries[other] = replace(entries[other], indistinguishable_from=same)


def _left(search: Search, fit: Fit) -> float:
    """Missing torque of a fit on withheld windows, rms [N m]."""
    return fit.missing_rms(search.withheld)


def log_of(search: Search) -> LogFacts:
    """The facts of the log and the nominal model on which exact twins depend."""
    load, actuator = search.nominal.plant.load, search.nominal.actuator
    turning = turns_with_position(load)
    # The load at rest at position zero: a constant torque that the model knows.
    still = Motion(jnp.zeros(1), jnp.zeros(1), jnp.zeros(1))
    known = turning or bool(load.readout(still)[0]) or bool(getattr(actuator, "offset", None))
    # Without a position sensor the travel is that of the integrated readings, with their bias; an axis has no turn.
    short = search.records[0].position is not None and not search.records[0].linear
    travel = float(np.ptp(np.concatenate([record.angle for record in search.records]))) if short else math.inf
    return LogFacts(
        search.records[0].position is not None, known, turning, search.setting.nominal, _unloaded(search, known), travel
    )


def _unloaded(search: Search, known: bool) -> bool:
    """Whether what accelerates the nominal mass is small beside the command, so that friction takes nearly all."""
    inertial = np.concatenate([search.setting.inertia * record.acceleration for record in search.records])
    torque = np.concatenate([record.torque for record in search.records])
    return not known and float(np.sqrt(np.mean(inertial**2))) < THRESHOLDS.unloaded * float(np.sqrt(np.mean(torque**2)))
