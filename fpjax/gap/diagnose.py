# pyright: reportArgumentType=false
"""diagnose: the whole way from a log and a nominal model to a `Diagnosis`."""

import dataclasses
import os
import time
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from ..errors import InputError
from ..signals import Motion
from . import assemble
from .attribute import Fitted, Search
from .confusable import indistinguishable
from .decide import Decision, decide
from .diagnosis import Diagnosis, Estimate, Gap, Ranked, Step
from .effect import Effect, Setting
from .family import Nominal
from .hints import known_torque, position_hints
from .measure import measure_gap, noise_floor, rms, rms_interval
from .probability import shares
from .record import Record, make_record
from .vocabulary import EFFECTS

LISTED = 24  # entries of the ranking


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
    logs, withheld = _logs(log), _logs(holdout)
    if not logs:
        raise InputError("No log was given: pass a path, a Log or a mapping of arrays.")
    model = _model(model)
    if each:
        return tuple(_diagnose([one], withheld, model, effects, progress) for one in logs)
    return _diagnose(logs, withheld, model, effects, progress)


def _diagnose(
    logs: list[Any], withheld: list[Any], model: Any, effects: tuple[Effect, ...], progress: Callable[..., None] | None
) -> Diagnosis:
    began = time.perf_counter()
    seconds: dict[str, float] = {}

    def report(stage: str, share: float) -> None:
        seconds[stage] = round(time.perf_counter() - began, 3)
        if progress is not None:
            progress(stage, share)

    warnings = [sentence for one in logs for sentence in getattr(one, "warnings", ())]
    warnings += _suspicions([*logs, *withheld], model)
    records = [make_record(one, withhold="none" if withheld else "blocks") for one in logs]
    records += [make_record(one, withhold="all") for one in withheld]
    _check_alike(records)
    loop = model.loop
    nominal = Nominal(loop.plant, loop.actuator, loop.sensor)
    setting = make_setting(records, model)
    search = Search(records, nominal, effects, setting, [*logs, *withheld])
    decision = decide(search, report)
    report("intervals and curves", 0.9)
    result = _assemble(search, decision, model, warnings, logs)
    report("done", 1.0)
    return dataclasses.replace(result, seconds=seconds)


def make_setting(records: list[Record], model: Any) -> Setting:
    """Sizes for bounds and starts, from the logs and the nominal model."""
    values = model.nominal
    longest = max(records, key=lambda record: len(record.time))
    torque = max(float(np.max(np.abs(record.torque))) for record in records)
    speed = max(float(np.quantile(np.abs(record.speed), 0.95)) for record in records)
    coulomb, viscous = values.get("coulomb", 0.0), values.get("viscous", 0.0)
    friction = max(coulomb, 0.02 * torque)
    setting = Setting(
        inertia=values["inertia"],
        coulomb=coulomb,
        viscous=viscous,
        friction=friction,
        speed=max(speed, 1e-12),
        torque=torque,
        travel=float(np.ptp(longest.angle)),
        duration=float(longest.time[-1] - longest.time[0]),
        dt=longest.dt,
        nominal={"inertia": values["inertia"], "coulomb": coulomb, "viscous": viscous},
        unknown_origin=longest.position is None and _turns_with_position(model.loop.plant.load),
    )
    return dataclasses.replace(
        setting, hints=position_hints(longest, setting, known_torque(longest, model.loop.plant.load))
    )


def _turns_with_position(load: Any) -> bool:
    """Whether a known load depends on the position."""
    at = [Motion(np.zeros(1), np.full(1, angle), np.zeros(1)) for angle in (0.0, 0.7, 1.9)]
    values = [float(np.asarray(load.readout(motion))[0]) for motion in at]
    return max(values) - min(values) > 0.0


def _assemble(search: Search, decision: Decision, model: Any, warnings: list[str], logs: list[Any]) -> Diagnosis:
    records = search.records
    quantised = _quantised(records[0], model)
    causes = list(decision.chosen.names) if decision.gap else []
    if not decision.explained and not _asserted(decision):
        causes = []
    if quantised:
        causes.append("velocity_quantisation")
    verdict = ("explained" if decision.explained else "unexplained") if decision.gap or quantised else "no_gap"
    compared = assemble.comparisons(search, decision)
    gap, steps = _gap(search, decision, compared)
    if quantised:
        steps = (*steps, Step("velocity_quantisation", gap.after, gap.after_interval))
    ranking = _ranking(search, decision, gap, quantised, records[0])
    corrected = assemble.machine_of(decision.chosen.candidate)
    text = _corrected(model, corrected, records[0].channel.step if quantised else 0.0, warnings)
    spread = assemble.covariance(search, decision.chosen)
    return Diagnosis(
        verdict=verdict,
        causes=tuple(causes),
        ranking=ranking,
        gap=gap,
        steps=steps,
        where=_where(logs[0], search, decision.exact, warnings),
        next_experiment=_experiments(ranking, records[0]),
        model=text,
        warnings=tuple(dict.fromkeys(warnings)),
        comparisons=compared,
        identifiability=assemble.identifiability(search, decision.chosen, spread),
        probability=ranking[0].probability if ranking else 0.0,
        residual_where=_where(logs[0], search, decision.chosen, warnings) if verdict == "unexplained" else None,
        motion="linear" if records[0].linear else "rotary",
        nominal=model.text,
    )


def _asserted(decision: Decision) -> bool:
    """Whether causes may be named although structure is left: only if they close most of the gap."""
    return False


def _quantised(record: Record, model: Any) -> bool:
    """Whether the rate reading is rounded to a step that the nominal model does not know and that is most of its
    noise.
    """
    channel = record.velocity
    known = getattr(model.loop.sensor, "step_size", 0.0)
    return channel is not None and channel.step > 0 and float(known) == 0.0 and channel.step > 1.5 * channel.noise


def _gap(search: Search, decision: Decision, compared: tuple[Any, ...]) -> tuple[Gap, tuple[Step, ...]]:
    before, after, measured = [], [], []
    for c in compared:
        keep = c.withheld & np.isfinite(c.before) & np.isfinite(c.after)
        before.append((c.before - c.measured)[keep])
        after.append((c.after - c.measured)[keep])
        measured.append(c.after - c.measured)
    first = compared[0]
    floor = noise_floor(first.measured, measured[0], search.records[0].reference)
    if decision.structure < 1.05:
        # Nothing but noise is left: then what is left is the best estimate of the floor.
        level = min(rms(np.concatenate(after)), rms(np.concatenate(before)))
        floor = dataclasses.replace(floor, value=level, interval=rms_interval(np.concatenate(after)))
    gap = measure_gap(np.concatenate(before), np.concatenate(after), floor, signal=first.signal, unit=first.unit)
    steps = []
    for previous, fitted in zip(decision.path[:-1], decision.path[1:], strict=True):
        left = []
        for which, c in enumerate(compared):
            trace = assemble.residual_trace(search, fitted, which)
            left.append(trace[c.withheld & np.isfinite(trace)])
        added = next((n for n in fitted.names if n not in previous.names), fitted.names[-1])
        values = np.concatenate(left)
        steps.append(Step(added, rms(values), rms_interval(values)))
    return gap, tuple(steps)


def _withheld_rms(search: Search, fitted: Fitted) -> float:
    found = []
    for which in range(len(search.records)):
        _, withheld = assemble.window_of(search, which)
        trace = assemble.residual_trace(search, fitted, which)
        found.append(trace[withheld & np.isfinite(trace)])
    return rms(np.concatenate(found))


def _ranking(search: Search, decision: Decision, gap: Gap, quantised: bool, record: Record) -> tuple[Ranked, ...]:
    chosen = decision.chosen
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
        after = gap.after if len(chosen.names) == 1 else _withheld_rms(search, decision.path[1])
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
        entries[name] = Ranked(name, share, _withheld_rms(search, fitted), found, (), relative)
    named = list(entries.values())
    for twin in named[0].indistinguishable_from:
        if twin in entries and twin not in chosen.names:
            same = tuple(dict.fromkeys((named[0].effect, *entries[twin].indistinguishable_from)))
            share = 0.5 * (named[0].probability + entries[twin].probability)
            entries[twin] = dataclasses.replace(entries[twin], indistinguishable_from=same, probability=share)
            entries[named[0].effect] = dataclasses.replace(entries[named[0].effect], probability=share)
    return tuple(entries.values())


def _where(log: Any, search: Search, fitted: Fitted, warnings: list[str]) -> Any:
    from .diagnosis import Where
    from .locate import locate
    from .machine import nominal_machine
    from .rigid import rigid_body

    try:
        if fitted.names:
            body = rigid_body(_full(assemble.machine_of(fitted.candidate)))
        else:
            nominal = search.nominal
            body = rigid_body(nominal_machine(nominal.plant, nominal.actuator, nominal.sensor))
        return locate(log, body)
    except Exception as error:
        warnings.append(f"The map of where the gap lies could not be drawn ({type(error).__name__}: {error}).")
        return Where()


def _full(machine: Any) -> Any:
    from .machine import nominal_machine

    full = nominal_machine(machine.plant, machine.actuator, machine.sensor)
    return full


def _experiments(ranking: tuple[Ranked, ...], record: Record) -> tuple[Any, ...]:
    try:
        from .experiment import next_experiment
    except ImportError:
        return ()
    pairs = [(entry.effect, other) for entry in ranking[:3] for other in entry.indistinguishable_from]
    unique = [pair for i, pair in enumerate(pairs) if set(pair) not in [set(p) for p in pairs[:i]]]
    return tuple(next_experiment(unique))


def _corrected(model: Any, machine: Any, step: float, warnings: list[str]) -> str:
    from ..model_file import dump_model, simplified

    sensor = machine.sensor if step == 0 else dataclasses.replace(machine.sensor, step_size=step)
    loop = dataclasses.replace(model.loop, plant=machine.plant, actuator=machine.actuator, sensor=sensor)
    try:
        return dump_model(simplified(model, loop))
    except InputError as error:
        warnings.append(f"The corrected model has no words in servo.toml: {error}")
        return ""


def _suspicions(logs: list[Any], model: Any) -> list[str]:
    from .machine import nominal_machine
    from .rigid import rigid_body
    from .suspicion import check

    body = rigid_body(nominal_machine(model.loop.plant, model.loop.actuator, model.loop.sensor))
    return [sentence for one in logs for sentence in check(one, body)]


def _check_alike(records: list[Record]) -> None:
    first = records[0]
    for record in records[1:]:
        if (record.velocity is None) != (first.velocity is None) or (record.position is None) != (
            first.position is None
        ):
            raise InputError(
                f"{record.name} and {first.name} do not have the same columns: give both velocity, or "
                f"position, or both."
            )
        if abs(record.dt / first.dt - 1.0) > 1e-3:
            raise InputError(
                f"{record.name} has a period of {record.dt:g} s and {first.name} of {first.dt:g} s: logs of "
                f"one machine "
                "need one period; diagnose them apart with --each."
            )


def _logs(logs: Any) -> list[Any]:
    from ..logs import read_log

    if logs is None:
        return []
    several = isinstance(logs, Sequence) and not isinstance(logs, (str, os.PathLike))
    return [
        one if hasattr(one, "torque") and hasattr(one, "dt") else read_log(one) for one in (logs if several else [logs])
    ]


def _model(model: Any) -> Any:
    from ..model_file import load_model

    return model if hasattr(model, "loop") else load_model(model)
