"""What a true machine is made of: every physical parameter, its unit and its neutral value.

A case holds only what differs from neutral; `stack` joins many cases to vectors, because the
integrator steps all of them at once.
"""

from dataclasses import dataclass

import numpy as np

INFINITE = 1e30

NEUTRAL: dict[str, float] = {
    # one mass, or motor and load (kg m^2); `load_share` of the inertia behind the transmission
    "inertia": 1.0,
    "load_share": 0.0,
    "friction_load_share": 0.0,
    "sensor_on_load": 0.0,
    # friction (N m, N m s/rad)
    "coulomb_positive": 0.0,
    "coulomb_negative": 0.0,
    "viscous_positive": 0.0,
    "viscous_negative": 0.0,
    "drag": 0.0,
    # extra torque near rest; shape 0: exp(-(v/vs)^exponent), 1: 1/(1+(v/vs)^exponent)
    "stribeck_torque": 0.0,
    "stribeck_velocity": 1.0,
    "stribeck_exponent": 1.0,
    "stribeck_shape": 0.0,
    # Coulomb level against angle: fundamental amplitude (N m), harmonics relative to it
    "ripple": 0.0,
    "ripple_periods": 1.0,
    "ripple_phase": 0.0,
    "ripple_second": 0.0,
    "ripple_third": 0.0,
    "ripple_phase_second": 0.0,
    "ripple_phase_third": 0.0,
    # Coulomb level against time since the log's start
    "drift": 0.0,
    "drift_time": 1.0,
    # bristles: kind 0 none, 1 LuGre, 2 Dahl with an exponent, 3 Maxwell slip (N m/rad, N m s/rad)
    "bristle_kind": 0.0,
    "bristle_stiffness": 1.0,
    "bristle_damping": 0.0,
    "bristle_exponent": 1.0,
    # transmission: kind 0 rigid, 1 spring, 2 backlash with a contact spring
    "transmission": 0.0,
    "stiffness": 0.0,
    "damping": 0.0,
    "gap": 0.0,
    # torques that the motor has to hold: A sin(angle + phase), a cogging with a second harmonic
    "unbalance": 0.0,
    "unbalance_phase": 0.0,
    "known_unbalance": 0.0,
    "known_unbalance_phase": 0.0,
    "cogging": 0.0,
    "cogging_periods": 2.0,
    "cogging_phase": 0.0,
    "cogging_second": 0.0,
    "cogging_phase_second": 0.0,
    "constant_torque": 0.0,
    "known_offset": 0.0,
    # actuator; `softness` 0 is a hard limit, else 1/p of u/(1+|u/limit|^p)^(1/p)
    "gain": 1.0,
    "actuator_lag": 0.0,
    "actuator_delay": 0.0,
    "limit": INFINITE,
    "softness": 0.0,
    "dead_zone": 0.0,
    # velocity sensor (s, s, 1, rad/s) and encoder (rad)
    "velocity_lag": 0.0,
    "velocity_delay": 0.0,
    "scale": 1.0,
    "bias": 0.0,
    "velocity_step": 0.0,
    "velocity_noise": 0.0,
    "position_noise": 0.0,
    "position_step": 0.0,
    # controller: PI on the velocity reading, feed-forward of friction and of acceleration
    "kp": 0.0,
    "ki": 0.0,
    "forward_coulomb": 0.0,
    "forward_viscous": 0.0,
    "forward_velocity": 1.0,
    "forward_inertia": 0.0,
    "forward_ahead": 0.0,  # 1: it is for the period that begins: difference to the next sample, friction at their mean
    "start_position": 0.0,
    # outside the vocabulary: a spring to a position that follows through a backlash (N m, rad, rad)
    "hysteresis": 0.0,
    "hysteresis_play": 0.0,
    "hysteresis_width": 1.0,
}


@dataclass
class Machine:
    """One machine with its reference and its noise.

    `physics` overrides `NEUTRAL`; `reference` [rad/s] has `preroll` periods before the log starts;
    `velocity_normal` and `position_normal` are unit normals, `disturbance` [N m] acts on the
    machine (linear between samples), `held_reading` and `held_command` mark lost samples.
    """

    physics: dict[str, float]
    reference: np.ndarray
    velocity_normal: np.ndarray
    position_normal: np.ndarray
    preroll: int = 0
    disturbance: np.ndarray | None = None
    held_reading: np.ndarray | None = None
    held_command: np.ndarray | None = None
    dt: float = 1e-3


@dataclass
class Record:
    """A run, one row for each control period [s, N m, rad/s, rad]; `true_*` are hidden from the log."""

    time: np.ndarray
    torque: np.ndarray
    velocity: np.ndarray
    position: np.ndarray
    reference: np.ndarray
    true_velocity: np.ndarray
    true_position: np.ndarray


def stack(machines: list[Machine]) -> dict[str, np.ndarray]:
    """Every parameter as a vector over the machines."""
    for machine in machines:
        unknown = set(machine.physics) - set(NEUTRAL)
        if unknown:
            raise KeyError(f"unknown physics {sorted(unknown)}")
    return {
        name: np.array([m.physics.get(name, neutral) for m in machines], dtype=float)
        for name, neutral in NEUTRAL.items()
    }
