"""Ranking: every effect with its probability, what it leaves, its parameters, and what it may be mistaken for."""

import dataclasses
from typing import Any

import numpy as np

from . import assemble
from .attribute import Search
from .confusable import indistinguishable
from .decide import Decision
from .diagnosis import Estimate, Gap, Ranked
from .probability import shares
from .record import Record
from .shrink import withheld_rms

LISTED = 24  # entries of the ranking


def rank(search: Search, decision: Decision, gap: Gap, quantised: bool, record: Record) -> tuple[Ranked, ...]:
    """The causes first, then every effect alone by its evidence."""
    chosen = decision.leading
    entries: dict[str, Ranked] = {}
    rivals = [f for f in decision.rivals if len(f.names) == len(chosen.names)] if decision.gap else decision.singles
    leads = rivals if len(chosen.names) <= 1 else [chosen]
    odds = shares(np.array([f.evidence for f in leads]), decision.explained, decision.gap)
    probability: dict[str, float] = {}
    for fitted, share in zip(leads, odds, strict=True):
        probability[fitted.names[0]] = probability.get(fitted.names[0], 0.0) + float(share)
    rest = max(1.0 - sum(probability.values()), 0.0)
    spread = assemble.covariance(search, chosen) if decision.gap else None
    for position, effect in enumerate(chosen.candidate.effects if decision.gap else ()):
        same = indistinguishable(chosen, position, decision.rivals, decision, search)
        share = probability.get(effect.name, 0.5 * rest)
        found = assemble.estimates(search, chosen, effect, spread)
        alone = len(chosen.names) == 1 and not decision.weak
        after = gap.after if alone else withheld_rms(search, decision.path[1])
        entries[effect.name] = Ranked(effect.name, share, after, found, same, chosen.evidence - decision.exact.evidence)
    if quantised:
        step = record.channel.step
        lead = not decision.gap
        top = 0.98 if lead else 0.5 * rest
        if lead:
            probability = {name: value * 0.5 for name, value in probability.items()}
        value = Estimate(step, 0.9999 * step, 1.0001 * step, assemble.signal_unit(record))
        entry = Ranked("velocity_quantisation", top, gap.after, {"step": value}, (), 0.0)
        entries = {entry.effect: entry, **entries} if lead else {**entries, entry.effect: entry}
    for fitted in decision.singles[:LISTED]:
        name = fitted.names[0]
        if name in entries:
            continue
        found = {}
        if len(entries) < 6:
            found = assemble.estimates(search, fitted, fitted.candidate.effects[0])
        else:
            values = fitted.candidate.effects[0].describe(fitted.candidate.values(), search.setting)
            found = {key: Estimate(value, value, value, unit) for key, (value, unit) in values.items()}
        share = min(probability.get(name, 0.0), max(1.0 - sum(e.probability for e in entries.values()), 0.0))
        relative = fitted.evidence - decision.exact.evidence
        entries[name] = Ranked(name, share, withheld_rms(search, fitted), found, (), relative)
    named = list(entries.values())
    for twin in named[0].indistinguishable_from:
        if twin in entries and twin not in chosen.names:
            same = tuple(dict.fromkeys((named[0].effect, *entries[twin].indistinguishable_from)))
            share = 0.5 * (named[0].probability + entries[twin].probability)
            entries[twin] = dataclasses.replace(entries[twin], indistinguishable_from=same, probability=share)
            entries[named[0].effect] = dataclasses.replace(entries[named[0].effect], probability=share)
    return tuple(entries.values())


def quantised_reading(record: Record, model: Any) -> bool:
    """Whether the rate reading is rounded to a step that the nominal model does not know and that is most of its
    noise.
    """
    channel = record.velocity
    known = getattr(model.loop.sensor, "step_size", 0.0)
    return channel is not None and channel.step > 0 and float(known) == 0.0 and channel.step > 1.5 * channel.noise
