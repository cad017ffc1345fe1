"""Checks: what of logs is wrong in itself, or in the light of the model, before anything is fitted."""

import dataclasses
import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ...blocks.loads import turns_with_position
from ...blocks.plants import TwoMass
from ...blocks.plants.transmission import Transmission
from ...errors import InputError
from ...logs import Log
from ...logs.arrays import Values
from ...logs.checks.agreement import TOGETHER, one_unit, travelled
from ...logs.checks.suspicion import Suspicion
from ...logs.checks.suspicions import Numbers, suspicions
from ...logs.columns.units import is_label
from ...logs.dynamics.nominal import fit_rigid, speed_of
from ...logs.mending.clock import SLOW, TIME_UNITS, USUAL
from ...model_file import Model
from ..thresholds import THRESHOLDS

SAME_PERIOD = 1e-3  # relative difference of control periods that counts as none
# kinds of suspicions that no effect explains
CONTRADICTIONS = {"time", "unit", "sign", "swapped", "inconsistent", "machine"}
MOST_ROWS = 400_000  # samples that checks read, from the middle of the log: numerical derivatives take time


@dataclass(frozen=True)
class Checked:
    """What is noticed of some logs in the light of the nominal model.

    Attributes:
        model: the nominal one.
        noticed: each log, fitted or withheld, with its suspicions.
    """

    model: Model
    noticed: tuple[tuple[Log, tuple[Suspicion, ...]], ...]

    def warnings(self) -> list[str]:
        """A sentence for each suspicion, and for each log at another period than the model's."""
        late = [
            f"{log.name} has a period of {log.dt:g} s and the model [simulation] dt = {self.model.dt:g} s: the "
            f"corrected model keeps the model's; write dt = {log.dt:g} there to simulate the loop as it ran."
            for log, found in self.noticed
            if abs(log.dt / self.model.dt - 1.0) > SAME_PERIOD and not any(one.kind == "time" for one in found)
        ]
        return [*(one.sentence for _, found in self.noticed for one in found), *late]

    def contradictions(self, *, rate: bool = True) -> list[str]:
        """What of the logs cannot be so, in the light of their other columns or of the model: a unit, a sign, a column.

        No effect of the vocabulary is as large, and whatever is fitted to such a log bends after it.

        Args:
            rate: whether a velocity column is fitted beside a position; the unit and the sign of one that is not do no
                harm, if it is that column and not the position that has the wrong one.
        """
        said = []
        for log, found in self.noticed:
            seen = [one for one in found if one.kind in CONTRADICTIONS]
            if seen and not rate and log.position is not None and seen[0].kind in ("unit", "sign"):
                numbers = _numbers(self.model)
                alone = suspicions(dataclasses.replace(log, velocity=None), numbers)
                left = [one for one in alone if one.kind in CONTRADICTIONS]
                if left and (left[0].kind, seen[0].kind) == ("sign", "sign"):
                    left = seen  # which tells, by the velocity, that it is the position's and not the torque's
                seen = left if left or numbers is None or not _position_is_wrong(log, numbers.inertia) else seen
            said += [one.sentence for one in seen]
        return said


def check(logs: Sequence[Log], model: Model) -> Checked:
    """Look at logs before anything is fitted.

    Raises:
        InputError: for a log that cannot be diagnosed.
    """
    numbers = _numbers(model)
    checked = Checked(model, tuple((log, tuple(_looked_at(log, model, numbers))) for log in logs))
    for _, found in checked.noticed:
        for one in found:
            if one.severity == "stop":
                raise InputError(one.sentence)
    _check_drive(logs, "m/s" if model.linear else "rad/s")
    return checked


def refuse_contradicted(log: Log, model: Model, undone: str) -> None:
    """Refuse a log before it is diagnosed, if whatever is fitted to it has a contradiction.

    Args:
        log: that is to be diagnosed.
        model: the nominal one.
        undone: what is not done with it, the beginning of the sentence.

    Raises:
        InputError: for such a log, or one that cannot be diagnosed.
    """
    found = check([log], model).contradictions(rate=log.position is None)
    if found:
        raise InputError(f"{undone} until this is settled: {found[0]}")


def refuse_reference(log: Log, undone: str) -> None:
    """Refuse a log whose reference has another unit or sign than the motion that follows it.

    Args:
        log: whose reference is to be followed.
        undone: as of `refuse_contradicted`.

    Raises:
        InputError: for such a log.
    """
    for one in suspicions(log, None):
        if one.kind == "reference":
            raise InputError(f"{undone} until this is settled: {one.sentence}")


def wrong_kinds(log: Log) -> set[str]:
    """Kinds of what is wrong in a log by itself, without a model: contradictions, and what stops a diagnosis."""
    found = suspicions(log, None)
    return {one.kind for one in found if one.severity == "stop" or one.kind in CONTRADICTIONS | {"still"}}


def _looked_at(log: Log, model: Model, numbers: Numbers | None) -> list[Suspicion]:
    """The suspicions about a log; a wrong unit of its time explains a column or a model that seems wrong."""
    found = suspicions(log, numbers)
    if is_label(model.units.torque) and model.units.torque != log.torque_unit:
        found = [one for one in found if one.kind != "counts"]  # the model says what its whole numbers are
    time = _unit_of_time(log, model)
    if not time or any(one.severity == "stop" for one in found):
        return found
    return [*time, *(one for one in found if one.kind not in CONTRADICTIONS | {"clock", "compensated", "nominal"})]


def _unit_of_time(log: Log, model: Model) -> list[Suspicion]:
    """Rows that are a thousand, a million, ... times further apart than the model's period, or nearer together.

    A velocity beside a position has a clock in them: where it agrees, the model's period is the wrong one.
    Besides, the log must be too slow or too fast for a drive: a scope's log of a sampled loop may be a thousand times
    as fast as its period, and the step of a model that is not sampled is a solver's.
    """
    ratio = log.dt / model.dt
    unit = next((name for name, size in TIME_UNITS.items() if abs(ratio * size - 1.0) < SAME_PERIOD), "")
    if not unit and not any(abs(ratio / size - 1.0) < SAME_PERIOD for size in TIME_UNITS.values()):
        return []
    unusual = log.dt > SLOW if unit else log.dt < USUAL[0]
    if not unusual or _clock_agrees(log):
        return []
    times = f"{ratio:.0f} times" if unit else f"1/{1.0 / ratio:.0f} of"
    read = f"{unit} and was read in s" if unit else "a longer unit than the one it was read in"
    return [
        Suspicion(
            f"{log.name}: its rows are {log.dt:.4g} s apart, {times} the model's [simulation] dt = {model.dt:g} s, so "
            f"its time is in {read}: give its unit, as in --columns time=NAME:{unit or 's'}.",
            "warn",
            "time",
        )
    ]


def _clock_agrees(log: Log) -> bool:
    """Whether the velocity is the position's rate on the log's clock."""
    if log.velocity is None or log.position is None:
        return False
    part = _middle(log)
    ratio, together = travelled(log.velocity[part], log.position[part], log.dt)
    return together > TOGETHER and one_unit(ratio)


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
    an inertia to it, and a rigid machine of all the mass is no measure of a model of two: above the anti-resonance one
    of them moves alone.
    """
    if turns_with_position(model.loop.plant.load) or isinstance(model.loop.plant, TwoMass | Transmission):
        return None
    scales = (getattr(model.loop.actuator, "gain", None), getattr(model.loop.sensor, "scale", None))
    gain, scale = (1.0 if one is None else float(one) for one in scales)
    inertia, coulomb, viscous = (model.nominal.get(name, 0.0) for name in ("inertia", "coulomb", "viscous"))
    return Numbers(inertia / (gain * scale), coulomb / gain, viscous / (gain * scale))


def _middle(log: Log) -> slice:
    first = max(0, (log.samples - MOST_ROWS) // 2)
    return slice(first, first + MOST_ROWS)


def _check_drive(logs: Sequence[Log], unit: str) -> None:
    """Refuse a log without torque, or logs that all have one and the same speed throughout.

    Runs at one steady speed each, at several speeds or in both directions, tell the friction together.

    Raises:
        InputError: for such logs.
    """
    for log in logs:
        if not np.any(log.torque):
            raise InputError(
                f"{log.name}: its torque is zero throughout, and the torque is what a diagnosis simulates from: was "
                "the right column mapped?"
            )
    speed = np.concatenate([_speed(log) for log in logs])
    size, spread = float(np.sqrt(np.mean(speed**2))), float(np.std(speed))
    if spread < THRESHOLDS.uniform * size:
        names, its = ", ".join(log.name for log in logs), "its" if len(logs) == 1 else "their"
        mean, within = float(np.mean(speed)), 100.0 * spread / size
        raise InputError(
            f"{names}: {its} speed stays at {mean:.4g} {unit} (within {within:.2g} %), at which friction, load and "
            "inertia look alike: record a run with reversals and several speeds."
        )


def _speed(log: Log) -> Values:
    """Speed in the middle of a log, at most `MOST_ROWS` of it."""
    part = _middle(log)
    columns = (None if column is None else column[part] for column in (log.velocity, log.position))
    return speed_of(dataclasses.replace(log, **dict(zip(("velocity", "position"), columns, strict=True))))


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
