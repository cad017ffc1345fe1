"""Ranking: every effect with its probability, what it leaves, its parameters, and what it may be mistaken for."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import jax.numpy as jnp

from ..blocks.signals import Motion
from . import assemble
from .attribute import Fitted, Search
from .confusable import indistinguishable
from .decision import Decision
from .diagnosis import Estimate, Gap, Ranked, Step, Verdict
from .posterior import make_posterior
from .record import Record
from .shrink import withheld_rms
from .sizes import turns_with_position
from .twins import Log, Twin, exact_twins

LISTED = 24  # entries of the ranking
WITH_INTERVALS = 6  # entries whose intervals are computed


@dataclass(frozen=True)
class Ranking:
    """What is known of each effect.

    Attributes:
        entries: the causes first, then by probability.
        twins: exact twins of the causes.
        probability: that the verdict is right.
    """

    entries: tuple[Ranked, ...]
    twins: tuple[Twin, ...]
    probability: float


def rank(
    search: Search, decision: Decision, verdict: Verdict, gap: Gap, steps: Sequence[Step], quantised: bool
) -> Ranking:
    """Rank every effect.

    Args:
        search: the fits.
        decision: what they led to.
        verdict: on the causes.
        gap: on withheld data.
        steps: the ladder.
        quantised: the rate reading is rounded to a step that the nominal model does not know.
    """
    chosen = decision.leading
    rivals = (
        [*decision.rivals, *decision.path[1 : len(decision.path) - decision.weak]] if decision.gap else decision.singles
    )
    causes = in_order(chosen.names, steps) if decision.gap else []
    order = [*causes, *(f.names[0] for f in decision.singles)]
    posterior = make_posterior(rivals, decision.explained, decision.gap, quantised, order)
    entries: dict[str, Ranked] = {}
    twins: list[Twin] = []
    if decision.gap:
        spread = assemble.covariance(search, chosen)
        effects = {effect.name: effect for effect in chosen.candidate.effects}
        found = {name: assemble.estimates(search, chosen, effects[name], spread) for name in causes}
        twins = exact_twins(causes, found, log_of(search))
        relative = chosen.evidence - decision.exact.evidence
        left = {step.added: step.gap_after for step in steps}
        for name, values in found.items():
            same = indistinguishable(search, chosen, name, rivals, twins)
            entries[name] = Ranked(name, 0.0, left.get(name, gap.after), values, same, relative)
    if quantised:
        entry = _rounding(search.records[0], gap)
        first = verdict == "unexplained"  # then it is all that is asserted
        entries = {entry.effect: entry, **entries} if first else {**entries, entry.effect: entry}
    asserted = list(entries)
    for fitted in decision.singles[:LISTED]:
        name = fitted.names[0]
        if name not in entries:
            values = _parameters(search, fitted, len(entries) < WITH_INTERVALS)
            relative = fitted.evidence - decision.exact.evidence
            entries[name] = Ranked(name, 0.0, withheld_rms(search, fitted), values, (), relative)
    entries = {
        name: replace(entry, probability=posterior.share(name), cause_probability=posterior.cause(name))
        for name, entry in entries.items()
    }
    same = {name: entries[name].indistinguishable_from for name in asserted}
    right = posterior.statement(asserted, same) if verdict == "explained" else posterior.none()
    for twin in twins:
        share_alike(entries, twin)
    _both_ways(entries, asserted)
    rest = [entry for entry in entries.values() if entry.effect not in asserted]
    rest.sort(key=lambda entry: (-entry.probability, -entry.evidence))
    ranked = (*(entries[name] for name in asserted), *rest)
    return Ranking(ranked, tuple(twins), right)


def in_order(causes: Sequence[str], steps: Sequence[Step]) -> list[str]:
    """The causes as the ladder adds them, the one that takes most first."""
    added = [step.added for step in steps]
    return sorted(causes, key=lambda name: added.index(name) if name in added else len(added))


def share_alike(entries: dict[str, Ranked], twin: Twin) -> None:
    """Two sets of causes with one log hold the same probability, each divided among its causes; in place.

    Unless the other set is larger: values that all happen to be wrong in one proportion are less likely than the one
    cause that makes them so, and the simpler statement keeps its probability.
    """
    sides = (tuple(twin.causes), twin.instead)
    if len(twin.instead) > len(twin.causes) or not {*twin.causes, *twin.instead} <= set(entries):
        return
    whole = sum(entries[name].probability for side in sides for name in side)
    cause = sum(entries[name].cause_probability / len(side) for side in sides for name in side)
    for side in sides:
        for name in side:
            share = 0.5 * whole / len(side)
            entries[name] = replace(entries[name], probability=share, cause_probability=0.5 * cause)


def _both_ways(entries: dict[str, Ranked], asserted: Sequence[str]) -> None:
    """What a cause cannot be told from cannot be told from the cause either; in place."""
    for name in asserted:
        for other in entries[name].indistinguishable_from:
            if other in entries and other not in asserted:
                same = tuple(dict.fromkeys((*entries[other].indistinguishable_from, name)))
                entries[other] = replace(entries[other], indistinguishable_from=same)


def _parameters(search: Search, fitted: Fitted, intervals: bool) -> dict[str, Estimate]:
    effect = fitted.candidate.effects[0]
    if intervals:
        return assemble.estimates(search, fitted, effect)
    values = effect.describe(fitted.candidate.values(), search.setting)
    linear, unknown = search.records[0].linear, float("nan")
    return {
        key: Estimate(value, unknown, unknown, assemble.linear_unit(unit, linear))
        for key, (value, unit) in values.items()
    }


def _rounding(record: Record, gap: Gap) -> Ranked:
    step = record.channel.step
    value = Estimate(step, 0.9999 * step, 1.0001 * step, assemble.signal_unit(record))
    return Ranked("velocity_quantisation", 0.0, gap.after, {"step": value})


def log_of(search: Search) -> Log:
    """What decides about exact twins."""
    load, actuator = search.nominal.plant.load, search.nominal.actuator
    turning = turns_with_position(load)
    still = Motion(jnp.zeros(1), jnp.zeros(1), jnp.zeros(1))
    known = turning or bool(load.readout(still)[0]) or bool(getattr(actuator, "offset", None))
    return Log(search.records[0].position is not None, known, turning, search.setting.nominal)
