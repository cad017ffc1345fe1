"""Inputs: logs and model are read and checked before anything is fitted."""

import dataclasses
import math
import os
from collections.abc import Sequence

import numpy as np

from ...blocks.plants import TwoMass
from ...blocks.plants.transmission import Transmission
from ...errors import InputError
from ...logs import Log, LogSource, read_log
from ...logs.checks.suspicions import Numbers, suspicions
from ...logs.dynamics.nominal import fit_rigid, speed_of
from ...logs.mending.resample import at_period
from ...model_file import Model, ModelSource, load_model
from ..thresholds import THRESHOLDS
from .record import LEAST
from .setting import turns_with_position

SAME_PERIOD = 1e-3  # relative difference of control periods that counts as none
SIMILAR_PERIOD = 0.1  # likewise, up to which logs are resampled onto the period of the first
OTHER_PERIOD = 4.0  # likewise, ratio above which they are not put together: most of the faster one would be lost
CONTRADICTIONS = {"unit", "sign", "swapped", "inconsistent", "machine"}  # kinds of suspicions that no effect explains
MOST_ROWS = 400_000  # samples that checks read, from the middle of the log: numerical derivatives take time


def read_logs(logs: LogSource | Sequence[LogSource] | None) -> list[list[Log]]:
    """For each log (a `Log`, a path or a mapping of arrays) its longest stretch and the further ones that tell more."""
    if logs is None:
        return []
    several = isinstance(logs, Sequence) and not isinstance(logs, str | os.PathLike)
    every: Sequence[LogSource] = logs if several else [logs]  # pyright: ignore[reportAssignmentType]
    read = [one if isinstance(one, Log) else read_log(one) for one in every]
    return [[one, *_that_tell_more(one)] for one in read]


def _that_tell_more(log: Log) -> list[Log]:
    """Further stretches of a log that could be diagnosed by themselves and look like it.

    One in which the machine rests is left out, or whose columns contradict each other where the log's own do not. So
    are those without a position: how far the machine went in the pause is not known, and what depends on the position
    would stand at another place there.
    """
    parts = [part for part in log.further if part.position is not None and part.samples >= LEAST]
    if not parts:
        return []
    wrong = _wrong_kinds(log)
    return [part for part in parts if _moves(part) and _wrong_kinds(part) <= wrong]


def _wrong_kinds(log: Log) -> set[str]:
    found = suspicions(log, None)
    return {one.kind for one in found if one.severity == "stop" or one.kind in CONTRADICTIONS | {"still"}}


def _moves(log: Log) -> bool:
    try:
        _check_drive(log, "")
    except InputError:
        return False
    return True


def on_one_clock(logs: Sequence[Log]) -> list[Log]:
    """The logs at one period: that of the first, from which drives of one kind differ by some per cent.

    Of runs that were recorded at different rates it is the longest: none is told more often than it was recorded. Those
    that differ by far are left as they are, and refused when they are put together.
    """
    if not logs:
        return []
    periods = [log.dt for log in logs]
    if max(periods) > OTHER_PERIOD * min(periods):
        return list(logs)
    period = max(periods) if max(periods) > (1.0 + SIMILAR_PERIOD) * min(periods) else periods[0]
    return [at_period(log, period) if abs(log.dt / period - 1.0) > SAME_PERIOD else log for log in logs]


def read_model(model: ModelSource) -> Model:
    """A `Model`, or the path or text of one."""
    return model if isinstance(model, Model) else load_model(model)


def look_at(logs: Sequence[Log], model: Model) -> list[str]:
    """Warnings about the logs.

    Raises:
        InputError: for a log that cannot be diagnosed.
    """
    found = [one for log in logs for one in suspicions(log, _numbers(model))]
    for one in found:
        if one.severity == "stop":
            raise InputError(one.sentence)
    for log in logs:
        _check_drive(log, "m/s" if model.linear else "rad/s")
    late = [
        f"{log.name} has a period of {log.dt:g} s and the model [simulation] dt = {model.dt:g} s: the corrected model "
        f"keeps the model's; write dt = {log.dt:g} there to simulate the loop as it ran."
        for log in logs
        if abs(log.dt / model.dt - 1.0) > SAME_PERIOD
    ]
    return [*(one.sentence for one in found), *late]


def contradictions(logs: Sequence[Log], model: Model, *, rate: bool = True) -> list[str]:
    """What of the logs cannot be so, in the light of their other columns or of the model: a unit, a sign, a column.

    No effect of the vocabulary is as large, and whatever is fitted to such a log bends after it.

    Args:
        logs: fitted and withheld.
        model: the nominal one.
        rate: whether a velocity column is fitted beside a position; the unit and the sign of one that is not do no
            harm, if it is that column and not the position that has the wrong one.
    """
    # A rigid machine of all the mass is no measure of a model of two: above the anti-resonance one of them moves alone.
    numbers = None if isinstance(model.loop.plant, TwoMass | Transmission) else _numbers(model)
    found = []
    for log in logs:
        seen = [one for one in suspicions(log, numbers) if one.kind in CONTRADICTIONS]
        if seen and not rate and log.position is not None and seen[0].kind in ("unit", "sign"):
            alone = suspicions(dataclasses.replace(log, velocity=None), numbers)
            left = [one for one in alone if one.kind in CONTRADICTIONS]
            seen = left if left or numbers is None or not _position_is_wrong(log, numbers.inertia) else seen
        found += [one.sentence for one in seen]
    return found


def refuse_contradicted(log: Log, model: Model, undone: str) -> None:
    """Refuse a log before it is diagnosed, if whatever is fitted to it has a contradiction.

    Args:
        log: that is to be diagnosed.
        model: the nominal one.
        undone: what is not done with it, the beginning of the sentence.

    Raises:
        InputError: for such a log.
    """
    found = contradictions([log], model, rate=log.position is None)
    if found:
        raise InputError(f"{undone} until this is settled: {found[0]}")


def _position_is_wrong(log: Log, inertia: float) -> bool:
    """Whether the velocity column moves as the model's inertia does, and the position's rate does not."""
    if log.velocity is None or log.position is None:
        return False
    part = _middle(log)
    alone = (
        fit_rigid(log.torque[part], velocity, position, log.dt, gravity=not log.linear)
        for velocity, position in ((log.velocity[part], None), (None, log.position[part]))
    )
    by_velocity, by_position = (
        abs(math.log(one.inertia / inertia)) if one is not None and one.inertia > 0.0 else math.inf for one in alone
    )
    return by_velocity < by_position


def _numbers(model: Model) -> Numbers | None:
    """What a log's torque and motion are compared with, as the log has them; None where they cannot be compared.

    The check is a regression on acceleration, direction and speed. A load that turns with the position would look like
    an inertia to it.
    """
    if turns_with_position(model.loop.plant.load):
        return None
    scales = (getattr(model.loop.actuator, "gain", None), getattr(model.loop.sensor, "scale", None))
    gain, scale = (1.0 if one is None else float(one) for one in scales)
    inertia, coulomb, viscous = (model.nominal.get(name, 0.0) for name in ("inertia", "coulomb", "viscous"))
    return Numbers(inertia / (gain * scale), coulomb / gain, viscous / (gain * scale))


def _middle(log: Log) -> slice:
    first = max(0, (log.samples - MOST_ROWS) // 2)
    return slice(first, first + MOST_ROWS)


def _check_drive(log: Log, unit: str) -> None:
    """Refuse a log without torque, or with one speed throughout.

    Raises:
        InputError: for such a log.
    """
    if not np.any(log.torque):
        raise InputError(
            f"{log.name}: its torque is zero throughout, and the torque is what a diagnosis simulates from: was the "
            "right column mapped?"
        )
    part = _middle(log)
    columns = (None if column is None else column[part] for column in (log.velocity, log.position))
    speed = speed_of(dataclasses.replace(log, **dict(zip(("velocity", "position"), columns, strict=True))))
    size, spread = float(np.sqrt(np.mean(speed**2))), float(np.std(speed))
    if spread < THRESHOLDS.uniform * size:
        mean, within = float(np.mean(speed)), 100.0 * spread / size
        raise InputError(
            f"{log.name}: its speed stays at {mean:.4g} {unit} (within {within:.2g} %), at which friction, load and "
            "inertia look alike: record a run with reversals and several speeds."
        )


def about_noise(logs: Sequence[Log], floor: float, unit: str) -> list[str]:
    """A warning where the sensors' noise hides even a missing torque as large as the command; else [].

    Args:
        logs: fitted and withheld.
        floor: missing torque that noise alone would give, in `unit`.
        unit: of the torque.
    """
    size = float(np.sqrt(np.mean(np.concatenate([np.square(log.torque) for log in logs]))))
    if not floor > size:
        return []
    return [
        f"The sensors' noise hides any missing torque below {floor:.3g} {unit}, and the commanded torque is {size:.3g} "
        f"{unit} rms: this log cannot show a gap, so finding none proves nothing; move faster, or use a better sensor."
    ]
