"""How large a gap is against the noise: the nominal model re-simulated in short windows.

Each window starts from the true state and is driven by the logged torque; the reduced chi-square of
the velocity reading is 1 where the nominal model is right. Used to check the generator itself.
"""

import numpy as np

from .actuator import shaped
from .integrate import Body
from .machine import Machine, Record, stack
from .sensor import rounded


def noise_floor(physics: dict[str, float]) -> dict[str, float]:
    """Rms that a perfect model leaves, per signal [rad/s, rad]."""
    velocity = np.hypot(physics["velocity_noise"], physics.get("velocity_step", 0.0) / np.sqrt(12))
    position = np.hypot(physics["position_noise"], physics["position_step"] / np.sqrt(12))
    return {"velocity": float(velocity), "position": float(position)}


def window_residual(
    nominal: dict[str, float],
    record: Record,
    dt: float,
    length: int = 50,
    substeps: int = 10,
    change: dict[str, float] | None = None,
) -> np.ndarray:
    """Velocity reading minus the nominal model's, (window, sample) [rad/s].

    `change` is physics (without memory) to be put into the nominal model.
    """
    count = (len(record.time) - 1) // length
    physics = {
        "inertia": nominal["inertia"],
        "coulomb_positive": nominal["coulomb"],
        "coulomb_negative": nominal["coulomb"],
        "viscous_positive": nominal["viscous"],
        "viscous_negative": nominal["viscous"],
        "known_offset": nominal.get("offset", 0.0),
        "known_unbalance": nominal.get("unbalance", 0.0),
        "known_unbalance_phase": nominal.get("unbalance_phase", 0.0),
    } | (change or {})
    nothing = np.zeros(1)
    p = stack([Machine(physics, nothing, nothing, nothing)] * count)
    body = Body(p)
    start = np.arange(count) * length
    body.position = record.true_position[start].copy()
    body.velocity = record.true_velocity[start].copy()
    body.change = 0.0
    h = dt / substeps
    residual = np.zeros((count, length))
    for k in range(length):
        torque = shaped(record.torque[start + k], p)
        for _ in range(substeps):
            body.drift(h / 2)
            body.kick(torque, h, 0.0)
            body.drift(h / 2)
        seen = rounded(p["scale"] * body.velocity + p["bias"], p["velocity_step"])
        residual[:, k] = record.velocity[start + k + 1] - seen
    return residual


def chi_square(nominal: dict[str, float], physics: dict[str, float], record: Record, dt: float) -> float:
    """Reduced chi-square of the nominal model's window residual against sensor noise alone."""
    residual = window_residual(nominal, record, dt)
    return float(np.mean(residual**2) / physics["velocity_noise"] ** 2)
