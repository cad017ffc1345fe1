# pyright: reportArgumentType=false
"""diagnose: the whole way from a log and a nominal model to a `Diagnosis`."""

import dataclasses
import datetime
from collections.abc import Callable
from typing import Any

from ..errors import InputError
from . import assemble
from .attribute import Search
from .corrected import corrected_model
from .decide import decide
from .decision import Decision
from .diagnosis import Diagnosis, Experiment, Ranked, Step
from .effect import Effect
from .experiment import next_experiment
from .family import Nominal, double_precision
from .inputs import check_alike, look_at, read_logs, read_model
from .judging import quantised_reading
from .left import left_sentence
from .places import places
from .provenance import provenance
from .ranking import in_order, rank
from .record import make_record, window_seconds, with_common_noise
from .shrink import gap_and_steps
from .sizes import make_setting
from .stages import StageClock
from .tracking import Side, tracking_error
from .vocabulary import EFFECTS, on_rate_sensor


def diagnose(
    log: Any,
    model: Any,
    *,
    holdout: Any = (),
    each: bool = False,
    effects: tuple[Effect, ...] = EFFECTS,
    progress: Callable[..., None] | None = None,
) -> Any:
    """Where the simulation is wrong, which effect causes it, how far the gap shrinks.

    Args:
        log: a `fpjax.logs.Log`, a path, a mapping of arrays, or several of them (runs of one machine).
        model: the nominal model: a `fpjax.model_file.Model`, or the path or text of a servo.toml.
        holdout: further logs that are scored and never fitted.
        each: take the logs as separate machines.
        effects: the vocabulary; append your own `Effect` to `fpjax.gap.EFFECTS`.
        progress: called with (name of the stage, share done [1]).

    Returns:
        A `Diagnosis`; a tuple of them, one a log, with `each`.

    Raises:
        InputError: for logs or a model that cannot be diagnosed, in one sentence.
    """
    allowed = allowed_effects(effects)
    clock = StageClock(progress)
    clock("reading", 0.0)
    logs, withheld = read_logs(log), read_logs(holdout)
    if not logs:
        raise InputError("No log was given: pass a path, a Log or a mapping of arrays.")
    model = read_model(model)
    found = []
    for group in [[one] for one in logs] if each else [logs]:
        found.append(_diagnose(group, withheld, model, effects, allowed, clock))
        clock = StageClock(progress)
    return tuple(found) if each else found[0]


def _diagnose(
    logs: list[Any], withheld: list[Any], model: Any, effects: tuple[Effect, ...], allowed: tuple[str, ...],
    clock: StageClock,
) -> Diagnosis:  # fmt: skip
    started = datetime.datetime.now(datetime.UTC)
    clock("looking", 0.01)
    if model.units.motion == "linear":
        logs, withheld = ([dataclasses.replace(one, linear=True) for one in some] for some in (logs, withheld))
    everything = [*logs, *withheld]
    warnings = [sentence for one in logs for sentence in getattr(one, "warnings", ())]
    warnings += look_at(everything, model)
    search = make_search(logs, withheld, model, effects)
    decision = decide(search, clock)
    clock("intervals and curves", 0.9)
    with double_precision():
        found = _assemble(search, decision, model, warnings, everything, clock)
    made = provenance(everything, search.records, model, allowed, started)
    clock.done()
    return dataclasses.replace(found, seconds=clock.seconds, allowed=allowed, provenance=made)


def make_search(logs: list[Any], withheld: list[Any], model: Any, effects: tuple[Effect, ...]) -> Search:
    """Everything that is fitted on one machine's logs, before anything is.

    Args:
        logs: fitted, in blocks where nothing else is withheld.
        withheld: scored only.
        model: the nominal model.
        effects: the vocabulary.

    Raises:
        InputError: for logs that are too short, or do not go together.
    """
    everything = [*logs, *withheld]
    window = window_seconds(everything)
    records = [make_record(one, withhold="none" if withheld else "blocks", window=window) for one in logs]
    records += [make_record(one, withhold="all", window=window) for one in withheld]
    check_alike(records)
    records = with_common_noise(records)
    if records[0].velocity is None:
        effects = tuple(effect for effect in effects if not on_rate_sensor(effect))
    nominal = Nominal(model.loop.plant, model.loop.actuator, model.loop.sensor)
    return Search(records, nominal, effects, make_setting(records, model), everything)


def allowed_effects(effects: tuple[Effect, ...]) -> tuple[str, ...]:
    """Names of the effects where they are not the whole vocabulary; () where they are, an effect of one's own or not.

    Raises:
        InputError: for no effects at all.
    """
    names = tuple(effect.name for effect in effects)
    if not names:
        raise InputError("effects is empty: give at least one effect, or leave it out to try the whole vocabulary.")
    return () if {effect.name for effect in EFFECTS} <= set(names) else names


def _assemble(
    search: Search, decision: Decision, model: Any, warnings: list[str], logs: list[Any], clock: StageClock
) -> Diagnosis:
    records = search.records
    quantised = quantised_reading(search)
    step = records[0].channel.step if quantised else 0.0
    verdict = ("explained" if decision.explained else "unexplained") if decision.gap or quantised else "no_gap"
    compared = assemble.comparisons(search, decision)
    gap, steps = gap_and_steps(search, decision, compared)
    causes = in_order(decision.leading.names, steps) if decision.gap else []
    if not decision.explained and not _asserted(decision):
        causes = []
    if quantised:
        causes.append("velocity_quantisation")
        steps = (*steps, Step("velocity_quantisation", gap.after, gap.after_interval))
    ranking = rank(search, decision, verdict, gap, steps, quantised)
    corrected = assemble.machine_of(decision.chosen.candidate)
    text, missing = corrected_model(model, corrected, step)
    spread = assemble.covariance(search, decision.chosen)
    if verdict == "unexplained" and decision.gap:
        warnings += filter(None, [left_sentence(search, decision, gap)])
    clock("where", 0.94)
    where = places(logs[0], decision.exact, warnings)
    left = places(logs[0], decision.chosen, warnings) if verdict == "unexplained" else None
    clock("closed loop", 0.97)
    sides = Side(assemble.machine_of(decision.exact.candidate)), Side(corrected, step)
    tracking = tracking_error(model, records, *sides, warnings)
    return Diagnosis(
        verdict=verdict,
        causes=tuple(causes),
        ranking=ranking.entries,
        gap=gap,
        steps=steps,
        where=where,
        next_experiment=experiments(ranking.entries),
        model=text,
        model_missing=missing,
        warnings=tuple(dict.fromkeys([*warnings, *([missing] if missing else [])])),
        comparisons=compared,
        identifiability=assemble.identifiability(search, decision.chosen, spread),
        probability=ranking.probability,
        residual_where=left,
        motion="linear" if records[0].linear else "rotary",
        nominal=model.text,
        tracking=tracking,
        same_as=tuple(twin.sentence() for twin in ranking.twins),
    )


def experiments(ranking: tuple[Ranked, ...]) -> tuple[Experiment, ...]:
    """For the effects that this log cannot tell apart."""
    return next_experiment((entry.effect, other) for entry in ranking[:3] for other in entry.indistinguishable_from)


def _asserted(decision: Decision) -> bool:
    """Whether causes may be named although structure is left: only if they close most of the gap."""
    return False
