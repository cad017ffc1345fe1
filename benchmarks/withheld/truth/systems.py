"""Three types of machines of different size; plant, noise and controller are drawn around them."""

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class Kind:
    """A type of machine: scales [kg m^2, N m, N m s/rad, rad/s], bandwidths [rad/s], noise."""

    name: str
    inertia: float
    coulomb: float
    viscous: float
    speed: float
    bandwidth: tuple[float, float]
    velocity_noise: tuple[float, float]
    position_noise: float
    position_step: float
    highest: float  # highest reference frequency [Hz]


KINDS = {
    "gimbal": Kind("gimbal", 10.0, 20.0, 2.0, 1.0, (30, 70), (1e-4, 4e-4), 1.5e-5, 2 * np.pi / 2**17, 2.5),
    "servo": Kind("servo", 2e-4, 0.012, 1.5e-4, 20.0, (80, 180), (4e-3, 1.6e-2), 1e-4, 2 * np.pi / 2**14, 6.0),
    "drive": Kind("drive", 0.05, 0.5, 0.04, 5.0, (60, 130), (1e-3, 4e-3), 3e-5, 2 * np.pi / 2**16, 5.0),
}

CONTROLLERS = ("plain", "friction", "friction_and_inertia")


@dataclass
class Draw:
    """One machine of a kind before any effect: true plant, noise, bandwidth, controller."""

    kind: Kind
    inertia: float
    coulomb: float
    viscous: float
    bandwidth: float
    integral_rate: float
    velocity_noise: float
    controller: str
    start_position: float


def spread(rng: np.random.Generator, low: float, high: float) -> float:
    """A number of a range, uniform in its logarithm."""
    return float(np.exp(rng.uniform(np.log(low), np.log(high))))


def draw_system(kind: Kind, rng: np.random.Generator) -> Draw:
    """A machine of a kind: 30 % around its inertia and Coulomb level, a factor 1.6 in viscosity."""
    bandwidth = spread(rng, *kind.bandwidth)
    return Draw(
        kind=kind,
        inertia=kind.inertia * spread(rng, 0.77, 1.3),
        coulomb=kind.coulomb * spread(rng, 0.77, 1.3),
        viscous=kind.viscous * spread(rng, 0.62, 1.6),
        bandwidth=bandwidth,
        integral_rate=bandwidth * rng.uniform(0.08, 0.25),
        velocity_noise=spread(rng, *kind.velocity_noise),
        controller=str(rng.choice(CONTROLLERS)),
        start_position=float(rng.uniform(-3, 3)),
    )


def base_physics(draw: Draw) -> dict[str, float]:
    """Physics of a drawn machine without effects; the controller is tuned on its true inertia."""
    kind = draw.kind
    # Velocity loop J s w = kp e: bandwidth kp / J.
    kp = draw.inertia * draw.bandwidth
    physics = {
        "inertia": draw.inertia,
        "coulomb_positive": draw.coulomb,
        "coulomb_negative": draw.coulomb,
        "viscous_positive": draw.viscous,
        "viscous_negative": draw.viscous,
        "kp": kp,
        "ki": kp * draw.integral_rate,
        "velocity_noise": draw.velocity_noise,
        "position_noise": kind.position_noise,
        "position_step": kind.position_step,
        "start_position": draw.start_position,
    }
    if draw.controller != "plain":
        physics["forward_coulomb"] = 0.9 * draw.coulomb
        physics["forward_viscous"] = draw.viscous
        physics["forward_velocity"] = 0.02 * kind.speed
    if draw.controller == "friction_and_inertia":
        physics["forward_inertia"] = 0.95 * draw.inertia
    return physics


def peak_torque(physics: dict[str, float], reference: np.ndarray, dt: float) -> float:
    """Torque that the loop commands in its hardest moments [N m]: a plain simulation with one step
    in each period and without noise is accurate enough for that.
    """
    inertia, coulomb = physics["inertia"], physics["coulomb_positive"]
    viscous = physics["viscous_positive"]
    forward = physics.get("forward_coulomb", 0.0) * np.tanh(reference / physics.get("forward_velocity", 1.0))
    forward = forward + physics.get("forward_viscous", 0.0) * reference
    forward = forward + physics.get("forward_inertia", 0.0) * np.gradient(reference, dt)
    velocity = integral = 0.0
    torques = np.zeros(len(reference))
    for k, wanted in enumerate(reference.tolist()):
        error = wanted - velocity
        torque = physics["kp"] * error + integral + forward[k]
        integral += physics["ki"] * dt * error
        torques[k] = torque
        free = velocity + dt * (torque - viscous * velocity) / inertia
        # Coulomb friction takes up to k dt / J of the speed, and all of it when that is less: sticking.
        velocity = free - np.clip(free, -dt * coulomb / inertia, dt * coulomb / inertia)
    # Not the maximum, which a single step of the reference would set.
    return float(np.quantile(np.abs(torques), 0.998))
