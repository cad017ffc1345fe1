# pyright: reportArgumentType=false
"""RigidBody: the nominal model as numbers, for residuals that need no simulation."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from ..blocks.signals import Motion
from .precision import double_precision

Values = np.ndarray


@dataclass(frozen=True)
class RigidBody:
    """The nominal model as numbers: torque = J a + friction + load, and what the actuator is known to do.

    Attributes:
        inertia: J [kg m^2].
        coulomb: k [N m].
        viscous: b [N m s/rad].
        level: further set-valued friction [N m] by (velocity, position, time), added to coulomb; None for none.
        load: known torque that the motor must hold [N m] by (velocity, position, time); None for none.
        applied: applied torque [N m] by (commanded torque, position, dt); None where they are the same.
    """

    inertia: float
    coulomb: float
    viscous: float
    level: Callable[[Values, Values, Values], Values] | None = None
    load: Callable[[Values, Values, Values], Values] | None = None
    applied: Callable[[Values, Values, float], Values] | None = None


def rigid_body(machine: Any) -> RigidBody:
    """The numbers of a `fpjax.gap.machine.Machine`, whose law is `GeneralFriction`; a transmission counts as rigid.

    A lag of the actuator is taken as a dead time of the same length, which is what it is to slow motion.
    """
    law, actuator, load = machine.law, machine.actuator, machine.plant.load

    def number(value: Any, neutral: float = 0.0) -> float:
        return neutral if value is None else float(value)

    names = ("coulomb_difference", "stribeck_torque", "stribeck_velocity", "stribeck_exponent", "drift_amplitude")
    names = (*names, "drift_time", "position_periods", "viscous_difference", "drag_coefficient")
    at = {name: float(getattr(law, name)) for name in names}
    ripple = [(float(c), float(s)) for c, s in zip(law.position_cosine, law.position_sine, strict=True)]

    # Where no sensor tells the position, positions are counted from the log's start, and the machine's lie beside them.
    origin = float(machine.origin)

    def level(velocity: Values, position: Values, time: Values) -> Values:
        side, position = np.sign(velocity), position + origin
        total = at["coulomb_difference"] * side + at["drift_amplitude"] * np.exp(-time / at["drift_time"])
        speed = np.abs(velocity) / at["stribeck_velocity"]
        total = total + at["stribeck_torque"] * np.exp(-(speed ** at["stribeck_exponent"]))
        for order, (cosine, sine) in enumerate(ripple, start=1):
            angle = order * at["position_periods"] * position
            total = total + cosine * np.cos(angle) + sine * np.sin(angle)
        return total

    def held(velocity: Values, position: Values, time: Values) -> Values:
        with double_precision():
            known = np.asarray(load.readout(Motion(velocity, position + origin, time)), float)
        drag = at["viscous_difference"] * np.abs(velocity) + at["drag_coefficient"] * velocity * np.abs(velocity)
        return known + drag

    gain, limit = number(actuator.gain, 1.0), number(actuator.limit, np.inf)
    dead, offset = number(actuator.dead_zone), number(actuator.offset)
    late = number(actuator.delay) + number(actuator.lag)
    amplitude, periods = number(actuator.cogging_amplitude), number(actuator.cogging_periods)
    phase = number(actuator.cogging_phase)

    def applied(torque: Values, position: Values, dt: float) -> Values:
        whole, fraction = int(late // dt), late / dt - late // dt
        torque = (1.0 - fraction) * _later(torque, whole) + fraction * _later(torque, whole + 1)
        torque = gain * torque
        torque = np.clip(torque - np.clip(torque, -dead, dead), -limit, limit)
        return torque + offset + amplitude * np.sin(periods * (position + origin) + phase)

    plant = machine.plant
    return RigidBody(float(plant.inertia), float(law.coulomb), float(law.viscous), level, held, applied)


def _later(values: Values, periods: int) -> Values:
    return values if periods == 0 else np.concatenate([np.full(periods, values[0]), values[:-periods]])
