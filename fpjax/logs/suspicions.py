"""What looks wrong about a log: units, signs, swapped columns, too little motion. A sentence each, never a verdict."""

import math

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


def suspicions(log: Log, *, inertia: float | None = None, nominal: Nominal | None = None) -> list[str]:
    """Sentences on what looks wrong, most serious first.

    Args:
        log: the log.
        inertia: of the model that is to go with it [kg m^2]; None without one.
        nominal: from `fit_nominal`, where it is there already.
    """
    found = [*_motion(log), *_velocity_against(log)]
    fit = nominal if nominal is not None else fit_nominal(log)
    swapped = _swapped(log, fit)
    if swapped:
        found.append(swapped)
    elif fit is not None and fit.share > 0.5 and fit.inertia < 0.0:
        found.append(
            "the motion accelerates against the torque: torque or motion has the wrong sign (map it with a factor "
            "of -1, as torque=NAME*-1)"
        )
    elif fit is not None and fit.share > 0.5 and fit.inertia > 0.0 and fit.coulomb < -3.0 * fit.deviations[1]:
        found.append("friction comes out negative: does a friction compensation act that the torque column leaves out?")
    if inertia is not None and fit is not None and fit.plausible:
        found.extend(_against_model(fit.inertia / inertia, log))
    return found


def _motion(log: Log) -> list[str]:
    speed = speed_of(log)
    fastest = float(np.max(np.abs(speed)))
    if fastest == 0.0 or float(np.ptp(log.torque)) == 0.0:
        what = "the motion" if fastest == 0.0 else "the torque"
        return [f"{what} is constant over the whole log: nothing can be learnt from it, so record one that moves"]
    moving = np.abs(speed) > 0.05 * fastest
    forward = float(np.mean(speed[moving] > 0.0))
    if min(forward, 1.0 - forward) < 0.02:
        return [
            "the axis moves in one direction only: Coulomb friction, offset and gravity cannot be told apart, so "
            "record a run with reversals"
        ]
    return []


def _velocity_against(log: Log) -> list[str]:
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
        return [f"velocity and {word} do not go together (correlation {likeness:.2f}): are they of one axis?"]
    found = []
    if ratio < 0.0 and word != "the reference":
        found.append(f"velocity has the opposite sign of {word}: map one of them with a factor of -1")
    for value, name in RATIOS.items():
        if abs(abs(ratio) / value - 1.0) < 0.1 and (log.linear or "mm" not in name):
            found.append(f"velocity looks like {name} {word}; map its unit with --columns velocity=NAME:UNIT")
            break
    else:
        if word != "the reference" and not 0.8 < abs(ratio) < 1.25:
            found.append(f"velocity is {abs(ratio):.3g} x {word}: check the units of both")
    return found


def _without_velocity(log: Log) -> Log:
    import dataclasses

    return dataclasses.replace(log, velocity=None)


def _swapped(log: Log, fit: Nominal | None) -> str | None:
    """Torque and velocity in each other's place: then the exchange explains much more."""
    import dataclasses

    if log.velocity is None:
        return None
    other = fit_nominal(dataclasses.replace(log, torque=log.velocity, velocity=log.torque))
    if other is None or not (other.inertia > 0.0 and other.coulomb > 0.0 and other.viscous > -other.coulomb):
        return None
    own = fit.share if fit is not None and fit.inertia > 0.0 and fit.coulomb > 0.0 else 0.0
    if other.share > 0.9 and 1.0 - other.share < 0.2 * (1.0 - own):
        return "torque and velocity look exchanged: the one explains the other only the other way round"
    return None


def _against_model(ratio: float, log: Log) -> list[str]:
    for value, name in ((180.0 / math.pi, "deg/s"), (60.0 / (2.0 * math.pi), "rpm")):
        # J = torque / acceleration: a motion that is too large by a factor makes an inertia too small by it.
        if abs(ratio * value - 1.0) < 0.25 and not log.linear:
            return [f"the motion looks like {name}: it is {value:.1f} x what the model's inertia says"]
    if not 0.2 < ratio < 5.0:
        return [f"the log's inertia is {ratio:.3g} x the model's: the model is far off, or a unit is wrong"]
    return []
