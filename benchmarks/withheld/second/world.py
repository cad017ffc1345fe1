"""A machine of the second generator as numbers: every parameter with its neutral value, and the inputs of its log."""

from dataclasses import dataclass, field

import numpy as np

from .physics import POINTS

NEUTRAL: dict[str, float] = {
    # masses: one body unless `split` is 1
    "inertia": 1.0,
    "split": 0.0,
    "load_share": 0.5,
    "sensor_on_load": 0.0,
    "friction_on_load": 0.0,
    # friction: levels of both directions, stiffness of a level of one, damping of sticking elements
    "coulomb_positive": 0.0,
    "coulomb_negative": 0.0,
    "viscous_positive": 0.0,
    "viscous_negative": 0.0,
    "element_stiffness": 1.0,  # 1 / mean yield deflection
    "element_damping": 0.0,
    "curve_speed": 1.0,
    "drag": 0.0,
    "drift": 0.0,
    "drift_time": 1.0,
    "drift_slow": 0.0,
    "wave": 0.0,
    "wave_periods": 1.0,
    "wave_phase": 0.0,
    "wave_steepness": 1.5,
    "load_friction": 0.0,
    "geared": 0.8,  # share of the inertia that is behind the gear
    # torques that the motor has to hold
    "unbalance": 0.0,
    "unbalance_phase": 0.0,
    "unbalance_second": 0.0,
    "cogging": 0.0,
    "cogging_periods": 6.0,
    "cogging_phase": 0.0,
    "cogging_steepness": 1.5,
    "ripple": 0.0,
    "ripple_periods": 12.0,
    "ripple_phase": 0.0,
    "offset": 0.0,
    "known_offset": 0.0,
    # transmission
    "clearance": 0.0,
    "contact_stiffness": 0.0,
    "contact_loss": 0.0,
    "stiffness": 0.0,
    "hardening": 0.0,
    "damping": 0.0,
    # actuator
    "gain": 1.0,
    "gain_fade": 0.0,
    "gain_fade_time": 1.0,
    "delay": 0.0,
    "pole_1": 0.0,
    "pole_2": 0.0,
    "limit": 1e9,
    "limit_power": 8.0,
    "lost": 0.0,
    "lost_rounding": 0.0,
    "slew": 1e12,
    "magnet": 0.0,
    "magnet_width": 1.0,
    # inertia that changes with position or time
    "swing": 0.0,
    "swing_phase": 0.0,
    "payload": 0.0,
    "payload_time": 0.0,
    # sensors
    "rate_delay": 0.0,
    "rate_pole_1": 0.0,
    "rate_pole_2": 0.0,
    "rate_scale": 1.0,
    "rate_bias": 0.0,
    "rate_noise": 0.0,
    "rate_step": 0.0,
    "encoder_step": 1e-9,
    "encoder_noise": 0.0,
    "torque_step": 0.0,
    "torque_noise": 0.0,
    # controller
    "kp": 0.0,
    "ki": 0.0,
    "position_gain": 0.0,
    "reads_rate": 1.0,
    "average": 4.0,  # samples that the drive's velocity is differenced over
    "filter": 0.0,  # pole of its filter
    "forward_coulomb": 0.0,
    "forward_viscous": 0.0,
    "forward_inertia": 0.0,
    "forward_ahead": 0.0,  # 1: it is for the period that begins: difference to the next sample, friction at their mean
    "forward_speed": 1.0,
    "rating": 1e9,
    "start": 0.0,
}


@dataclass
class World:
    """One machine with its reference and all that is random in its log.

    Attributes:
        values: what differs from `NEUTRAL`.
        reference: velocity reference, one value for each period.
        seed: of the sensors' noise.
        curve: factor on the friction level over v / (v + curve_speed), shape (POINTS,).
        push: torque on the machine, held over a period, or None.
        lost_commands: periods in which the drive goes on with the last command, or None.
        measured: whether the log's torque is the measured one.
    """

    values: dict[str, float]
    reference: np.ndarray
    seed: int
    curve: np.ndarray = field(default_factory=lambda: np.ones(POINTS))
    push: np.ndarray | None = None
    lost_commands: np.ndarray | None = None
    measured: bool = False
    dt: float = 1e-3


@dataclass
class Trace:
    """The run of one machine, one row for each period; `true_*` are on the side of the sensors, hidden from the log."""

    time: np.ndarray
    torque: np.ndarray  # as logged
    command: np.ndarray
    rate: np.ndarray
    position: np.ndarray
    derived: np.ndarray
    reference: np.ndarray
    position_reference: np.ndarray
    true_velocity: np.ndarray
    true_position: np.ndarray
    # For the label alone, at the start of each period; None where the machine has no such part.
    twist: np.ndarray | None = None  # of the transmission, motor less load
    twist_rate: np.ndarray | None = None
    transmitted: np.ndarray | None = None  # torque through the transmission
    delivered: np.ndarray | None = None  # torque that the motor's is beyond friction: of all inertia and all loads
    load_level: np.ndarray | None = None  # what the load adds to the friction level, both sides together


def stack(worlds: list[World]) -> dict[str, np.ndarray]:
    """Every parameter as a vector over the machines."""
    for world in worlds:
        strange = sorted(set(world.values) - set(NEUTRAL))
        if strange:
            raise KeyError(f"unknown parameters {strange}")
    return {name: np.array([w.values.get(name, default) for w in worlds]) for name, default in NEUTRAL.items()}
