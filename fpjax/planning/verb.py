"""plan: from a model, and a diagnosis that could not decide, to the run to record next."""

from __future__ import annotations

import dataclasses
import math
import numbers
import os
import time
from collections.abc import Callable
from typing import Any

import jax.numpy as jnp
import numpy as np

from ..errors import InputError
from ..gap import diagnose
from ..gap.answer.provenance import refuse_other_log, refuse_other_machine
from ..gap.data.checks import refuse_contradicted
from ..gap.diagnosis import Diagnosis
from ..logs import Log, read_log
from ..model_file import Model
from ..model_file.as_model import needed_model
from ..output.json_object import JsonObject, TomlTable
from ..output.stages import StageClock
from ..simulation.precision import double_precision
from ..simulation.scan import astype
from ..simulation.seeds import checked_seed
from .answer import MATERIAL, NEEDED, Separation, Visible
from .design import Designed, design
from .explain import beside, kinds_of_samples, not_visible, separations, where_from
from .limits import Limits, make_limits
from .machines import Shop, detectable, make_shop, reported
from .measurement_model import MeasurementModel, make_measurement_model
from .plain_references import NAMES
from .result import Plan
from .rivals import hidden_by_twin, level_of, machines_of, read_diagnosis, rivals_of, settled_of, twins_of, unlikely
from .trajectory import make_course
from .trial import ExpectedRun, Trial, effects_trial, rivals_trial

SECONDS = 20.0  # [s] processor time of the search after compiling, so that the whole plan takes about a minute
RISE = 0.02  # [s] shortest useful time between knots: faster changes of speed are not followed by a usual loop
TOO_FAST = 3.0  # a simulated speed of this many times the speed limit means that the loop is unstable

Progress = Callable[[str, float], None]


def plan(
    model: Model | str | os.PathLike[str],
    *,
    log: Log | str | os.PathLike[str] | None = None,
    diagnosis: Diagnosis | TomlTable | str | os.PathLike[str] | None = None,
    speed: float | None = None,
    acceleration: float | None = None,
    torque: float | None = None,
    travel: float | None = None,
    duration: float | None = None,
    missing: float | None = None,
    velocity_noise: float | None = None,
    position_noise: float | None = None,
    seconds: float = SECONDS,
    seed: int = 0,
    progress: Progress | None = None,
) -> Plan:
    """Plan the run to record next.

    From a model alone: a reference that makes every effect of the vocabulary visible, with as much evidence as possible
    for the least visible one. With a diagnosis that could not decide between causes: the reference that separates these
    rivals best; where they are improbable even together, again one that makes every effect visible. With a log, the log
    is diagnosed first. Where the controller is known the closed loop is simulated; else a stiff loop is used in its
    place, and the motion itself is planned. Computed in double precision. After an
    interrupt the best run so far is returned, and `Plan.ended` says so.

    Args:
        model: the nominal model, or the path or text of a servo.toml.
        log: a log of an earlier run; it is diagnosed, and its extent gives the default limits.
        diagnosis: of that log, if there is one already: a `Diagnosis`, the folder of `fpjax diagnose`, or the
            dictionary of its diagnosis.json.
        speed: largest speed [rad/s].
        acceleration: largest acceleration [rad/s^2].
        torque: largest commanded torque [N m].
        travel: largest distance between both ends of the motion [rad].
        duration: length of the run [s].
        missing: level of the missing torque that every model is assumed to have [N m]; None for the gap after the
            diagnosis, or 2 % of the friction.
        velocity_noise: noise standard deviation of a rate reading [rad/s]; None for the log's or the model's.
        position_noise: noise standard deviation of a position reading [rad]; None for the log's or the model's.
        seconds: processor time of the search, after compiling [s].
        seed: of the random motions among the starts.
        progress: called with (name of the stage, share done [1]).

    Returns:
        A `Plan`: it prints its sentences, plots itself and writes plan.json, reference.csv and plan.png.

    Raises:
        InputError: for limits that contradict each other, a machine that cannot move within them, a diagnosis without
            rivals, or a loop that is unstable.
    """
    known = needed_model(model, "plan")
    given = {
        "speed": speed, "acceleration": acceleration, "torque": torque, "travel": travel, "duration": duration,
        "missing": missing, "velocity_noise": velocity_noise, "position_noise": position_noise, "seconds": seconds,
    }  # fmt: skip
    for name, value in given.items():
        if value is not None and not isinstance(value, numbers.Real):
            raise InputError(f"{name} must be a number, got {type(value).__name__} {value!r}.")
    if not 0.0 < seconds < float("inf"):
        raise InputError(f"seconds must be above zero, got {seconds:g} s; {SECONDS:g} s is usual.")
    for name, value in (("missing", missing), ("velocity_noise", velocity_noise), ("position_noise", position_noise)):
        if value is not None and not 0.0 < value < float("inf"):
            raise InputError(f"{name} must be a number above zero, got {value:g}.")
    checked_seed(seed)
    clock, notes = StageClock(progress, now=time.process_time), list[str]()
    clock("reading", 0.0)
    record = log if isinstance(log, Log) or log is None else read_log(log, linear=known.linear)
    if record is not None and diagnosis is None:
        clock("diagnosing the log", 0.02)
        refuse_contradicted(record, known, "No run is planned from this log")
        diagnosis = diagnose(record, known, progress=lambda stage, share: clock(stage, 0.02 + 0.38 * share))
        notes.append(f"the log: {diagnosis.sentence()}")
    told = None if diagnosis is None else read_diagnosis(diagnosis)
    if told is not None and isinstance(made := told.get("provenance"), dict):
        refuse_other_machine(made, known, "The diagnosis")
        if record is not None:
            refuse_other_log(made, record, "The diagnosis")
    with double_precision():
        known = dataclasses.replace(known, loop=astype(known.loop, jnp.float64))
        clock("limits", 0.4 if record is not None else 0.02)
        given = {
            "speed": speed, "acceleration": acceleration, "torque": torque, "travel": travel, "duration": duration,
        }  # fmt: skip
        limits = make_limits(known, record, given, notes)
        level = missing if missing is not None or told is None else level_of(told)
        noise = {"velocity": velocity_noise, "position": position_noise}
        measurement = make_measurement_model(known, limits, record, level, noise, notes)
        course = make_course(limits, known.dt, RISE)
        shop = make_shop(known, limits, _largest_torque(known, limits), measurement.samples * measurement.dt)
        if not known.controller_known:
            notes.append(
                "[controller] is unknown: the motion itself is planned, and simulated with a velocity loop and the "
                "inverse dynamics as feed-forward in place of the drive's loop."
            )
        clock("machines", 0.05)
        if told is not None and (why := unlikely(rivals_of(told))):
            notes.append(why)
            told = None
        trial, twins, wanted = _trial(shop, measurement, course, told)
        plain = {name: trial.followed(course.within(speed)) for name, speed in zip(NAMES, course.usual.T, strict=True)}
        found = design(trial, wanted, seconds=seconds, seed=seed, progress=clock, usual=plain)
        clock("writing it down", 1.0)
        if found is None:
            raise InputError(_unstable(known))
        return _plan(known, limits, trial, twins, wanted, found, notes, clock)


def _largest_torque(model: Model, limits: Limits) -> float:
    """Largest torque of the run [N m]: the limit, or the torque for the largest acceleration at the top speed."""
    nominal = model.nominal
    needed = nominal["inertia"] * limits.acceleration + nominal["coulomb"] + nominal["viscous"] * limits.speed
    return float(min(limits.torque, needed + abs(nominal["offset"])))


def _trial(
    shop: Shop, measurement: MeasurementModel, course: Any, told: JsonObject | None
) -> tuple[Trial, dict[frozenset[str], str], np.ndarray]:
    """(the trial, by effect or pair why no run can show or separate it, the weight of every comparison)."""
    if told is None:
        variants = [detectable(shop, effect) for effect in shop.effects()]
        hidden = {v.name: hidden_by_twin(shop, v) for v in variants}
        trial = effects_trial(shop, measurement, course, variants)
        wanted = np.array([0.0 if hidden[v.name] else 1.0 for v in variants])
        return trial, {frozenset((name,)): why for name, why in hidden.items() if why}, wanted
    variants = machines_of(shop, rivals_of(told), settled_of(told))
    if len(variants) < 2:
        raise InputError(
            "The diagnosis has no rivals that are possible with these sensors: leave out --diagnosis for a run "
            "that makes all effects visible."
        )
    twins = twins_of(shop, variants)
    trial = rivals_trial(shop, measurement, course, variants)
    names = [v.name for v in variants]
    wanted = np.array([0.0 if frozenset((names[c.log], names[c.model])) in twins else 1.0 for c in trial.comparisons])
    if not wanted.any():
        pair = " and ".join(name.replace("_", " ") for name in names)
        why = " ".join(dict.fromkeys(twins.values()))
        raise InputError(
            f"The rivals {pair} are exact twins, inseparable by any run with these sensors ({why.rstrip('.')}): record "
            f"{beside((names[0], names[1]))} instead."
        )
    return trial, twins, wanted


def _unstable(model: Model) -> str:
    if model.controller_known:
        return (
            "The closed loop diverges on every motion that was tried: check it with fpjax simulate --margins, use "
            'smaller gains or a smaller [simulation] dt, or write [controller] type = "unknown" to plan the motion.'
        )
    return (
        "The machine leaves the range of finite numbers on every motion that was tried: check [plant] and [friction]."
    )


def _plan(
    model: Model, limits: Limits, trial: Trial, twins: dict[frozenset[str], str], wanted: np.ndarray, found: Designed,
    notes: list[str], clock: StageClock,
) -> Plan:  # fmt: skip
    seen, course = found.seen, trial.course
    if not float(seen.speed) < TOO_FAST * limits.speed:
        raise InputError(_unstable(model))
    if trial.beyond(seen):
        notes.append(
            f"the simulated machine needs up to {float(seen.torque):.4g} {model.units.name('N m')}, above the limit: "
            "the drive will clip the torque there."
        )
    elif found.share < 1.0:
        notes.append(
            f"the motion was scaled to {found.share:.2f} of its size, so that the simulated torque keeps its limit."
        )
    if found.ended == "interrupted":
        notes.append(f"interrupted after {found.evaluations} motions: the best of them is kept.")
    motion = {name: np.asarray(values) for name, values in course.motion(found.shape, found.share)._asdict().items()}
    position = model.units.reference == "position"
    nats = np.asarray(seen.nats, float)
    live = (wanted > 0.0) & ~found.unseen
    live = live if live.any() else wanted > 0.0
    visible, separated = tuple[Visible, ...](), tuple[Separation, ...]()
    aim = "effects" if len(trial.simulated) == 1 else "rivals"
    if aim == "effects":
        visible = _visible(trial, found, twins)
    else:
        kinds = kinds_of_samples(trial.measurement, motion["speed"], motion["acceleration"], model.units.name("rad/s"))
        wheres = [where_from(trial.measurement, kinds, left) for left in np.asarray(seen.left)]
        names = [v.name for v in trial.models]
        separated = separations(names, trial.comparisons, nats, wheres, twins)
    clock.done()
    return Plan(
        aim=aim,
        time=course.time,
        reference=motion["position" if position else "speed"],
        motion=motion,
        torque=np.asarray(seen.readings.torque[0]),
        limits=limits,
        visible=visible,
        separations=separated,
        rivals=tuple(v.name for v in trial.simulated) if aim == "rivals" else (),
        missing=trial.measurement.missing,
        noise={
            name: size
            for name, size, there in zip(
                ("velocity", "position"), (trial.measurement.rate_noise, trial.measurement.angle_noise),
                trial.measurement.channels,
                strict=True,
            )
            if there
        },
        position=position,
        linear=model.linear,
        torque_unit=model.units.name("N m"),
        model="the model" if model.path is None else model.path.name,
        evaluations=found.evaluations,
        usual={
            name: (_decided(trial, one, wanted, twins, found.alike), float(np.min(np.asarray(one.nats)[live])))
            for name, one in found.usual.items()
        },
        gained=(float(np.min(np.asarray(found.first.nats)[live])), float(np.min(nats[live]))),
        ended=found.ended,
        notes=tuple(notes),
        seconds=clock.seconds,
    )  # fmt: skip


def _visible(trial: Trial, found: Designed, twins: dict[frozenset[str], str]) -> tuple[Visible, ...]:
    seen, listed = found.seen, list[Visible]()
    for place, variant in enumerate(trial.models):
        values = {name: (one.value, one.unit) for name, one in reported(variant, trial.shop).items()}
        nats, share = float(seen.nats[place]), float(seen.share[place])
        why = twins.get(frozenset((variant.name,)), "")
        if why:
            listed.append(Visible(variant.name, values, float("nan"), twin=why))
            continue
        material = trial.material[place]
        nearest, between = _nearest(trial, seen, place, found.alike)
        unseen = not_visible(
            nats, share if material else None, nowhere=bool(found.unseen[place]), nearest=nearest, apart=between
        )
        listed.append(
            Visible(
                variant.name, values, nats, share if material else float("nan"), unseen=unseen, nearest=nearest,
                apart=between,
            )
        )  # fmt: skip
    return tuple(sorted(listed, key=lambda one: (bool(one.twin), bool(one.unseen), one.nats)))


def _nearest(trial: Trial, seen: ExpectedRun, place: int, alike: np.ndarray) -> tuple[str, float]:
    """(the effect that is hardest to tell from one, the evidence between them [nats]); ("", NaN) without one."""
    assert seen.apart is not None
    between = np.where(alike[place], np.inf, np.asarray(seen.apart[place], float))
    nearest = int(np.argmin(between))
    return (trial.models[nearest].name, float(between[nearest])) if np.isfinite(between[nearest]) else ("", math.nan)


def _decided(
    trial: Trial, seen: ExpectedRun, wanted: np.ndarray, twins: dict[frozenset[str], str], alike: np.ndarray
) -> int:
    """Effects that a run shows, or pairs of rivals that it separates."""
    nats, share = np.asarray(seen.nats), np.asarray(seen.share)
    if len(trial.simulated) > 1:
        names = [v.name for v in trial.models]
        pairs = separations(names, trial.comparisons, nats, [""] * len(nats), twins)
        return sum(one.separated for one in pairs)
    enough = ~np.asarray(trial.material) | (share >= MATERIAL)
    between = [_nearest(trial, seen, place, alike)[1] for place in range(len(nats))]
    return int(np.sum((wanted > 0.0) & (nats >= NEEDED) & enough & ~(np.asarray(between) < NEEDED)))


__all__ = ["NEEDED", "plan"]
