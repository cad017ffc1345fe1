"""What looks wrong about a log: units, signs, exchanged columns, too little motion. A sentence each, no verdict."""

import dataclasses
import math
from typing import NamedTuple

import numpy as np

from .log import Log
from .nominal import Nominal, fit_nominal, half_window, smooth, speed_of

RATIOS = {
    180.0 / math.pi: "deg/s: 57.3 x",
    math.pi / 180.0: "rad/s where position is in deg: 0.01745 x",
    60.0 / (2.0 * math.pi): "rpm: 9.55 x",
    1.0 / (2.0 * math.pi): "rev/s: 0.159 x",
    1e3: "mm/s: 1000 x",
    1e-3: "m/s where position is in mm: 0.001 x",
}


class Suspicion(NamedTuple):
    """What looks wrong.

    Attributes:
        sentence: for the user.
        serious: anything fitted to the log as it is would be wrong.
    """

    sentence: str
    serious: bool


def suspicions(log: Log, *, inertia: float | None = None, nominal: Nominal | None = None) -> list[Suspicion]:
    """What looks wrong about a log, most serious first.

    Args:
        log: the log.
        inertia: of the model that is to go with it [kg m^2]; None without one.
        nominal: from `fit_nominal`, where it is there already.
    """
    found = [*_motion(log), *_velocity_against(log)]
    fit = nominal if nominal is not None else fit_nominal(log)
    if _exchanged(log, fit):
        found.append(_serious("torque and velocity look exchanged: one explains the other only the other way round"))
    elif fit is not None and fit.share > 0.5 and fit.inertia < -3.0 * fit.deviations[0]:
        found.append(
            _serious(
                "the motion accelerates against the torque: one of them has the wrong sign; map it with a factor, as "
                "--columns torque=NAME*-1"
            )
        )
    elif fit is not None and fit.share > 0.5 and fit.inertia > 0.0 and fit.coulomb < -3.0 * fit.deviations[1]:
        sentence = "friction comes out negative: does a compensation act that the torque column leaves out?"
        found.append(Suspicion(_sentence(sentence), False))
    if inertia is not None and fit is not None and fit.plausible:
        found.extend(_against_model(fit.inertia / inertia, log))
    return sorted(found, key=lambda one: not one.serious)


def _serious(sentence: str) -> Suspicion:
    return Suspicion(_sentence(sentence), True)


def _sentence(text: str) -> str:
    text = text[0].upper() + text[1:]
    return text if text.endswith(("?", ".")) else f"{text}."


def _motion(log: Log) -> list[Suspicion]:
    speed = speed_of(log)
    fastest = float(np.max(np.abs(speed)))
    if fastest == 0.0 or float(np.ptp(log.torque)) == 0.0:
        what = "the motion" if fastest == 0.0 else "the torque"
        return [_serious(f"{what} is constant over the whole log: nothing can be learnt from it")]
    moving = np.abs(speed) > 0.05 * fastest
    forward = float(np.mean(speed[moving] > 0.0))
    if min(forward, 1.0 - forward) < 0.02:
        sentence = "the axis moves in one direction only: Coulomb friction, offset and gravity cannot be told apart"
        return [Suspicion(_sentence(f"{sentence}, so record a run with reversals"), False)]
    return []


def _velocity_against(log: Log) -> list[Suspicion]:
    """Velocity against the derivative of the position, or against a velocity reference."""
    if log.velocity is None:
        return []
    half = half_window(log)
    velocity = smooth(log.velocity, half)
    if log.position is not None:
        other, word = speed_of(_without_velocity(log)), "the derivative of position"
    elif log.reference is not None:
        other, word = smooth(log.reference, half), "the reference"
    else:
        return []
    size = float(other @ other)
    power = float(velocity @ velocity)
    if size == 0.0 or power == 0.0:
        return []
    likeness = float(velocity @ other) / math.sqrt(size * power)
    ratio = math.sqrt(power / size) * math.copysign(1.0, likeness)
    if abs(likeness) < 0.8:
        if word == "the reference":  # which may be a position, or badly followed
            return []
        sentence = f"velocity and {word} do not go together (correlation {likeness:.2f}): are they of one axis?"
        return [_serious(sentence)]
    found = []
    if ratio < 0.0 and word != "the reference":
        found.append(_serious(f"velocity has the opposite sign of {word}: map one of them with a factor of -1"))
    for value, name in RATIOS.items():
        if abs(abs(ratio) / value - 1.0) < 0.1 and (log.linear or "mm" not in name):
            sentence = f"velocity looks like {name} {word}; map its unit with --columns velocity=NAME:UNIT"
            found.append(_serious(sentence))
            break
    else:
        if word != "the reference" and not 0.8 < abs(ratio) < 1.25:
            found.append(Suspicion(_sentence(f"velocity is {abs(ratio):.3g} x {word}: check the units of both"), False))
    return found


def _without_velocity(log: Log) -> Log:
    return dataclasses.replace(log, velocity=None)


def _exchanged(log: Log, fit: Nominal | None) -> bool:
    """Torque and velocity in each other's place: then the exchange explains much more."""
    if log.velocity is None:
        return False
    other = fit_nominal(dataclasses.replace(log, torque=log.velocity, velocity=log.torque))
    if other is None or not (other.inertia > 0.0 and other.coulomb > 0.0 and other.share > 0.9):
        return False
    own = 0.0 if fit is None else fit.share  # of whatever sign: a wrong sign is another mistake
    return 1.0 - other.share < 0.2 * (1.0 - own)


def _against_model(ratio: float, log: Log) -> list[Suspicion]:
    says = f"the log's inertia is {ratio:.3g} x the model's"
    if abs(ratio * 180.0 / math.pi - 1.0) < 0.25 and not log.linear:
        # J = torque / acceleration: a motion that is too large by a factor makes an inertia too small by it.
        sentence = f"velocity looks like deg/s: 57.3 x ({says}); map its unit with --columns velocity=NAME:deg/s"
        return [_serious(sentence if log.velocity is not None else sentence.replace("velocity", "position"))]
    if abs(ratio * 60.0 / (2.0 * math.pi) - 1.0) < 0.25 and not log.linear:
        return [Suspicion(_sentence(f"{says}: is the motion in rpm (9.55 x), or is the model ten times off?"), False)]
    if not 0.2 < ratio < 5.0:
        return [Suspicion(_sentence(f"{says}: the model is far off, or a unit is wrong"), False)]
    return []
