"""Assemble a `Diagnosis` from the decision on the fits: verdict, numbers with intervals, models, places, warnings."""

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from ...logs.noise import is_derived
from ...model_file import Model
from ...output.stages import StageClock
from ..data.record import Record, in_one_piece
from ..effects.experiments import Experiment, next_experiment
from ..fit.band import unfelt
from ..fit.search import Search
from ..select.decision import Decision, near_models
from ..select.readings import LATE, Reading, material, rounding, sure_readings
from ..select.statement import Verdict
from ..thresholds import THRESHOLDS
from .answer import Answer
from .corrected import corrected_model
from .course import Course
from .curves import Curves
from .findings import Comparison, Ranked
from .fitted_machine import machine_of, with_reading
from .free_replay import free_replay
from .gap_size import rms_of, steps_of, with_readings, withheld
from .intervals import identifiability, read_estimates
from .judge import Read, judge
from .learned import learn
from .posterior import left_open, make_posterior
from .ranking import rank
from .rounded import is_rounded, rounding_of
from .tracking import Side, tracking_error
from .warning_texts import (
    at_bounds,
    beyond_torque,
    details,
    load_error,
    not_answered,
    pushes,
    rounding_left,
    slight_readings,
    slight_rounding,
    undecided_effects,
    where_fitted_alone,
)
from .where import locate


def assemble(
    search: Search, decision: Decision, curves: Curves, model: Model, warnings: Sequence[str], allowed: tuple[str, ...],
    clock: StageClock, contradiction: str = "",
) -> Answer:  # fmt: skip
    """The diagnosis, from the decision on the fits.

    Args:
        search: of the logs.
        decision: on its fits.
        curves: share of the missing torque that a table of each recorded variable accounts for.
        model: the nominal one.
        warnings: about the logs.
        allowed: names of the effects that were tried; () for the whole vocabulary.
        clock: of the stages, called when each one begins.
        contradiction: what of the logs cannot be so (`fpjax.gap.data.checks.Checked.contradictions`); "" for nothing.
    """
    records = search.records
    linear = records[0].linear
    step = unknown_step(search)
    torque = float(np.sqrt(np.mean(np.concatenate([record.torque for record in records]) ** 2)))
    # Errors of the velocity column that the encoder shows by itself, before any model of the machine.
    pieces = [in_one_piece(record) for record in records]
    sure = () if contradiction else sure_readings(pieces, search.setting.inertia)
    sure = tuple(one for one in sure if not allowed or one.effect in allowed)
    read, sure = material(sure), tuple(one for one in sure if one.of_sensor)
    rounded = [rounding(records, step, search.setting.inertia)] if step > 0.0 else []
    slight = [one for one in sure if one not in read and one.effect in LATE]
    known = Read(
        torque, (*read, *slight, *rounded), allowed, bool(contradiction), frozenset(one.effect for one in slight)
    )
    judged = judge(search, decision, known, curves, search.setting.units.name("N m"))
    decision, found, gap, spread = judged.decision, judged.verdict, judged.gap, judged.spread
    before, after, chosen = judged.before, judged.after, judged.decision.chosen.fit
    misread = {one.effect for one in known.readings}
    wrong = tuple(name for name in found.causes if name in misread)
    # Causes of the machine; errors of the reading change no torque, so that the gap after them is the gap after these.
    causes = [name for name in found.causes if name not in wrong]
    # The model to write: the nominal one where nothing of the machine is missing.
    gapless = found.word == "no_gap" or (found.word == "explained" and not causes)
    gap = gap.unchanged() if gapless and wrong else gap
    steps = steps_of(search, decision, causes, found.undecided) if causes else ()
    steps = with_readings(steps, found.causes, wrong, gap)
    seen = {one.effect: read_estimates(one, search.setting.units) for one in known.readings if one.effect in wrong}
    ranking = rank(search, decision, found, gap, steps, seen, allowed, _instead((*read, *slight), allowed))
    written = decision.exact if gapless else chosen
    # The corrected model has whatever is sure of its sensor: to a closed loop it matters more than to the gap.
    read_values = {name: value for one in sure for name, value in one.values.items()}
    machine = with_reading(machine_of(written.candidate), read_values)
    text, missing = corrected_model(model, machine, step)
    # Only where the causes leave something: a learned law, and where the rest of the missing torque lies.
    something_left = found.word in ("partly_explained", "unexplained")
    clock("learned law")
    laws = learn(search, chosen) if something_left else None
    learned_text = ""
    if laws is not None:
        size, spread_of_it = rms_of(withheld(search, laws.fit))
        gap = replace(gap, learned=size, learned_interval=spread_of_it)
        learned_text, _ = corrected_model(model, with_reading(machine_of(laws.fit.candidate), read_values), step)
    clock("closed loop")
    # Over fitted and withheld windows, to notice a gap that the withheld ones do not show.
    everywhere = decision.exact.missing_rms([np.arange(len(record.starts)) for record in records])
    said = [*at_bounds(chosen, search.setting.units), *beyond_torque(gap, torque), *warnings]
    said += [] if gapless else [*pushes(decision, records), *rounding_left(rounding_of(search, chosen)[0], gap)]
    said += not_answered(search.modes, unfelt(search.modes, search.setting.torque_noise), search.setting.units, torque)
    said += [
        *undecided_effects(found.undecided, causes, _in_place(decision, (*causes, *found.undecided))),
        *details(chosen, causes, found.undecided),
        *load_error(decision.nominal.fit if gapless else chosen, search.setting, written=not gapless),
    ]
    for one in rounded:
        said += slight_rounding(step, one.size, search.setting.units) if one.effect not in wrong else []
    said += slight_readings([one for one in sure if one.effect not in wrong], search.setting.units)
    said += [] if gapless else where_fitted_alone(gap, everywhere)
    sides = Side(machine_of(decision.exact.candidate)), Side(machine, step)
    tracking = tracking_error(model, pieces, *sides, said)
    clock("where")
    return Answer(
        verdict=found.word,
        causes=found.causes,
        ranking=ranking.entries,
        gap=gap,
        steps=steps,
        where=locate(records, before),
        next_experiment=experiments(ranking.entries),
        model=text,
        model_missing=missing,
        warnings=tuple(dict.fromkeys([*said, *([missing] if missing else [])])),
        comparisons=_comparisons(search, before, after),
        identifiability=identifiability(search, chosen, spread),
        probability=min(found.probability + _alike(ranking.entries, found), 1.0),
        ahead=found.ahead,
        residual_where=locate(records, after) if something_left else None,
        motion="linear" if linear else "rotary",
        nominal=model.text,
        tracking=tracking,
        free_replay=free_replay(search, decision.exact, chosen),
        contradiction=contradiction if found.word == "unexplained" else "",
        undecided=found.undecided,
        same_as=tuple(twin.sentence() for twin in ranking.twins),
        allowed=allowed,
        learned=() if laws is None else laws.laws,
        learned_model=learned_text,
        dominant_variable=judged.dominant_variable if something_left else None,
        posterior=make_posterior(
            search,
            chosen,
            spread,
            sure,
            step,
            [course.torque for course in after],
            left_open(decision, found.causes, {one.effect: one.cause_probability for one in ranking.entries}),
        ),
    )


def _instead(read: Sequence[Reading], allowed: tuple[str, ...]) -> dict[str, tuple[str, ...]]:
    """By error of the reading, the other error that the log shows it may be instead.

    Named only where the probability of the error is below that of a lead of `close` nats, 1 / (1 + exp(-close)).
    """
    decided = 1.0 / (1.0 + math.exp(-THRESHOLDS.close))
    rivals = [one for one in read if one.rival and one.sure < decided]
    return {one.effect: (one.rival,) for one in rivals if not allowed or one.rival in allowed}


def _in_place(decision: Decision, told: Sequence[str]) -> list[str]:
    """Effects of the models near the chosen one, but for those that it holds itself, the best first; at most
    `largest_class`.
    """
    names = dict.fromkeys(name for w in near_models(decision) for name in w.structural if name not in told)
    return list(names)[: THRESHOLDS.largest_class]


def _alike(ranking: tuple[Ranked, ...], found: Verdict) -> float:
    """Probability of the effects that cannot be distinguished from the causes: the statement names them too."""
    asserted = [entry for entry in ranking if entry.effect in found.causes]
    others = {name for entry in asserted for name in entry.indistinguishable_from} - set(found.causes)
    return sum(found.main.get(name, 0.0) for name in others)


def experiments(ranking: tuple[Ranked, ...]) -> tuple[Experiment, ...]:
    """Experiments that distinguish the leading effects (the first three) from those this log cannot tell them from."""
    return next_experiment((entry.effect, other) for entry in ranking[:3] for other in entry.indistinguishable_from)


def unknown_step(search: Search) -> float:
    """Rounding step of the rate reading [rad/s] if it is most of the reading's noise and not in the model; else 0."""
    steps = [_step(record) for record in search.records]
    known = float(getattr(search.nominal.sensor, "step_size", None) or 0.0)
    return 0.0 if known > 0.0 or min(steps) == 0.0 else max(steps)


def _step(record: Record) -> float:
    """Rounding step of one log's rate reading [rad/s], where it is above its noise; else 0."""
    channel = record.reading
    if record.velocity is None and channel is not None and record.position is not None:
        # Derived from the encoder by the drive: its steps are the encoder's resolution, not an error of a sensor.
        channel = None if is_derived(channel.values, record.position.values) else channel
    return channel.step if channel is not None and is_rounded(channel) else 0.0


def _comparisons(search: Search, before: Sequence[Course], after: Sequence[Course]) -> tuple[Comparison, ...]:
    """The commanded torque beside the torque that each model needs for the measured motion, one entry for each log."""
    found = []
    for which, record in enumerate(search.records):
        window = record.windows_of_samples()
        withheld = np.concatenate([record.withheld, [False]])[window]
        # commanded + missing = what the measured motion needs by that model.
        first, then = (record.torque + courses[which].torque for courses in (before, after))
        found.append(Comparison(record.name, record.time, record.torque, first, then, withheld, window))
    return tuple(found)
