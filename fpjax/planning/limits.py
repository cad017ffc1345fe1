"""Limits of a planned run: speed, acceleration, torque, travel and duration, and where each number comes from."""

from __future__ import annotations

from dataclasses import dataclass, fields
from typing import TYPE_CHECKING, Any

import numpy as np

from ..blocks.controllers import AbstractController
from ..errors import InputError

if TYPE_CHECKING:
    from ..logs import Log
    from ..model_file import Model

DURATION = 10.0  # [s] where neither the user nor model nor log gives a duration
SHORTEST = 1.0  # [s] two windows of the diagnosis
FEWEST = 512  # fewest samples of a run that can be diagnosed
# Most samples of a planned run: four times what a diagnosis simulates of a long log; the planner holds many such
# arrays.
MOST_SAMPLES = 200_000
HEADROOM = 0.9  # share of the torque limit that a plan uses; the controller needs the rest
RAMP = 0.25  # [s] to the top speed where no torque limit is known
TURNS = 1.0  # [rev] of travel where none is known
SPEED = 1.0  # [rad/s] where none is known


@dataclass(frozen=True)
class Limits:
    """Limits of a run; at every moment the tightest one counts.

    Attributes:
        speed: largest [rad/s].
        acceleration: largest [rad/s^2].
        torque: largest commanded [N m]; infinite where none is known.
        travel: largest distance between both ends of the motion [rad].
        duration: length of the run [s].
    """

    speed: float
    acceleration: float
    torque: float
    travel: float
    duration: float

    def to_dict(self) -> dict[str, float | None]:
        """By name; None for a torque without a limit."""
        values = {one.name: getattr(self, one.name) for one in fields(self)}
        return {name: value if np.isfinite(value) else None for name, value in values.items()}


UNITS = {"speed": "rad/s", "acceleration": "rad/s^2", "torque": "N m", "travel": "rad", "duration": "s"}
_LINEAR = {"rad/s": "m/s", "rad/s^2": "m/s^2", "rad": "m", "N m": "N"}


def unit_of(limit: str, model: Model) -> str:
    """The unit of a limit on this machine."""
    unit = UNITS[limit]
    if limit == "torque":
        return model.units.name(unit)
    return _LINEAR.get(unit, unit) if model.linear else unit


def make_limits(model: Model, log: Log | None, given: dict[str, float | None], notes: list[str]) -> Limits:
    """The limits given, completed from the file's [limits], the log, the model and default values.

    An option cannot widen the file's [limits]. Every choice is written to `notes`.

    Args:
        model: the nominal model.
        log: log of an earlier run, whose extent is safe to repeat; None without one.
        given: by name of `Limits`; None where not given.
        notes: gets a sentence for every number that was chosen.

    Raises:
        InputError: for a limit that is not a positive number, or limits within which the machine cannot move.
    """
    for name, value in given.items():
        if value is not None and not 0.0 < value < float("inf"):
            raise InputError(f"--{name} must be a number above zero [{unit_of(name, model)}], got {value:g}.")
    given = _within_file(model, given, notes)
    shown = _seen(model, log)

    def chosen(name: str, otherwise: float, why: str) -> float:
        value = given.get(name)
        if value is not None:
            return float(value)
        size, source = shown.get(name, (otherwise, why))
        notes.append(f"--{name} is not given: {size:.4g} {unit_of(name, model)} is used, {source}.")
        return size

    torque = _torque(model, given.get("torque"), shown, notes)
    nominal = model.nominal
    drag = nominal["coulomb"] + abs(nominal["offset"])  # [N m] needed to move at all
    if torque <= 1.02 * drag:
        raise InputError(
            f"The machine cannot move within its limits: torque {torque:.4g} {unit_of('torque', model)} is not above "
            f"the {drag:.4g} {unit_of('torque', model)} of the model's Coulomb friction and offset; give a larger "
            "--torque, or check [friction]."
        )
    speed = chosen("speed", SPEED, "a guess: neither model nor log gives a speed")
    left = HEADROOM * torque - drag - nominal["viscous"] * speed  # [N m] left to accelerate at the top speed
    if left <= 0.0 and nominal["viscous"] > 0.0:
        # Half the speed at which viscous friction would take all of the torque, so that half is left to accelerate.
        fastest = 0.5 * (HEADROOM * torque - drag) / nominal["viscous"]
        if fastest <= 0.0:
            raise InputError(
                f"The machine cannot move within its limits: {1 - HEADROOM:.0%} of the torque {torque:.4g} "
                f"{unit_of('torque', model)} is kept for the controller, and friction needs the rest; give a larger "
                "--torque."
            )
        notes.append(
            f"--speed {speed:.4g} {unit_of('speed', model)} needs more torque against viscous friction than the limit "
            f"allows: {fastest:.4g} is used."
        )
        speed = fastest
        left = HEADROOM * torque - drag - nominal["viscous"] * speed
    by_torque = left / nominal["inertia"]
    if np.isfinite(by_torque):  # a torque limit is a better bound than the acceleration of a gentle log
        shown["acceleration"] = (by_torque, "the torque limit less friction, over the inertia")
    acceleration = chosen("acceleration", speed / RAMP, f"top speed in {RAMP:g} s: neither a torque limit nor a log")
    if acceleration > 1.001 * by_torque:
        notes.append(
            f"acceleration {acceleration:.4g} {unit_of('acceleration', model)} needs more than the torque limit: "
            f"{by_torque:.4g} is used."
        )
        acceleration = by_torque
    travel = chosen("travel", TURNS * 2.0 * np.pi, "one revolution: neither model nor log gives a travel")
    least = max(SHORTEST, FEWEST * model.dt)
    if "duration" in shown and shown["duration"][0] < least:
        shown["duration"] = (least, "the shortest that can be diagnosed")
    most = MOST_SAMPLES * model.dt
    if "duration" in shown and shown["duration"][0] > most:
        shown["duration"] = (most, "more than a diagnosis simulates of a long log")
    duration = chosen("duration", max(DURATION, least), "the usual length of a log")
    if duration < least:
        raise InputError(
            f"--duration {duration:g} s is too short for a diagnosis at dt = {model.dt:g} s: give {least:.3g} s."
        )
    if duration > most:
        raise InputError(
            f"--duration {duration:g} s has {duration / model.dt:.3g} samples at dt = {model.dt:g} s, of which a "
            f"diagnosis simulates a small part only: give at most {most:g} s."
        )
    # Accelerating over half the travel and braking over the other half: v^2 = 2 a (travel / 2).
    fastest = np.sqrt(acceleration * travel)
    if fastest < 0.02 * speed:
        raise InputError(
            f"The limits contradict each other: within a travel of {travel:.4g} {unit_of('travel', model)} an "
            f"acceleration of {acceleration:.4g} {unit_of('acceleration', model)} reaches {fastest:.3g} "
            f"{unit_of('speed', model)} at most, but a speed of {speed:.4g} was asked for; give more travel or "
            "acceleration, or a smaller --speed."
        )
    if fastest < speed:
        notes.append(
            f"within the travel and the acceleration the machine reaches {fastest:.4g} {unit_of('speed', model)} at "
            f"most; a top speed of {speed:.4g} is not used."
        )
        speed = float(fastest)
    if travel / speed > 50.0 * duration:  # a travel that is never reached would only lose digits
        travel = speed * duration
    return Limits(speed, acceleration, torque, travel, duration)


def _within_file(model: Model, given: dict[str, float | None], notes: list[str]) -> dict[str, float | None]:
    """The limits given, cut to [limits] of the file; those of the file where none was given."""
    found = dict(given)
    for name, size in model.limits.items():
        unit, value = unit_of(name, model), given.get(name)
        if value is None:
            notes.append(f"--{name} is not given: {size:.4g} {unit} is used, as [limits] of the model.")
        elif value > size:
            notes.append(f"--{name} {value:.4g} is above [limits] {name} of the model: {size:.4g} {unit} is used.")
        found[name] = size if value is None else min(value, size)
    return found


def _torque(model: Model, given: float | None, shown: dict[str, tuple[float, str]], notes: list[str]) -> float:
    """The torque limit [N m]: the one given, the model's, or the log's; infinite without any."""
    known = _controller_limit(model.loop.controller)
    known = min(known, float(getattr(model.loop.actuator, "limit", None) or np.inf))
    if given is not None:
        if given > known:
            notes.append(f"--torque {given:.4g} is above the model's own limit: {known:.4g} is used.")
        return min(given, known)
    if np.isfinite(known):
        notes.append(f"--torque is not given: {known:.4g} {unit_of('torque', model)} is used, the model's own limit.")
        return known
    if "torque" in shown:
        size, source = shown["torque"]
        notes.append(f"--torque is not given: {size:.4g} {unit_of('torque', model)} is used, {source}.")
        return size
    notes.append("--torque is not given and the model has no limit: the torque is not limited, only the acceleration.")
    return float("inf")


def _controller_limit(controller: AbstractController) -> float:
    """The tightest torque limit in a controller [N m]; infinite without one."""
    found = float("inf")
    for name in ("limit", "controller", "velocity_controller"):
        part: Any = getattr(controller, name, None)
        if isinstance(part, AbstractController):
            found = min(found, _controller_limit(part))
        elif part is not None:
            found = min(found, float(part))
    return found


def _seen(model: Model, log: Log | None) -> dict[str, tuple[float, str]]:
    """(size, where it comes from) by limit: the extent of a log, or of the model's own reference."""
    if log is not None:
        return _seen_in_log(log)
    if model.reference is None:
        return {} if model.duration is None else {"duration": (model.duration, "the model's")}
    return _seen_in_reference(model)


def _seen_in_log(log: Log) -> dict[str, tuple[float, str]]:
    from ..gap.data.channel import make_channel
    from ..gap.data.motion import motion

    speed, acceleration, angle, _ = motion(
        None if log.velocity is None else make_channel(log.velocity),
        None if log.position is None else make_channel(log.position),
        float(log.dt),
    )
    source = "as in the log (a run that goes further shows more)"
    # Quantiles instead of maxima: a few outliers of a differentiated reading must not become limits.
    return {
        "speed": (float(np.quantile(np.abs(speed), 0.995)), source),
        "acceleration": (float(np.quantile(np.abs(acceleration), 0.99)), source),
        "torque": (1.2 * float(np.max(np.abs(log.torque))), "a fifth above the log's largest"),
        "travel": (float(np.ptp(angle)), source),
        "duration": (float(log.time[-1] - log.time[0]), "as in the log"),
    }


def _seen_in_reference(model: Model) -> dict[str, tuple[float, str]]:
    duration = model.duration or DURATION
    time = np.arange(0.0, duration, max(model.dt, duration / 20_000))
    values = np.asarray(model.needed_reference().readout(time), float)  # pyright: ignore[reportArgumentType]
    place = model.units.reference == "position"
    rate = np.gradient(values, time) if place else values
    angle = values if place else np.cumsum(rate) * (time[1] - time[0])
    source = "as the model's own reference asks for"
    found = {"duration": (duration, "the model's")}
    if np.max(np.abs(rate)) > 0.0:
        found["speed"] = (float(np.max(np.abs(rate))), source)
        found["travel"] = (max(float(np.ptp(angle)), 1e-9), source)
        steepest = float(np.quantile(np.abs(np.gradient(rate, time)), 0.99))
        if steepest > 0.0 and not np.isfinite(_controller_limit(model.loop.controller)):
            found["acceleration"] = (steepest, source)
    return found
