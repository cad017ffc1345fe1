"""The size of a gap relative to the noise: the nominal model simulated again in short windows.

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


def refit(
    nominal: dict[str, float], record: Record, dt: float, iterations: int = 4
) -> tuple[dict[str, float], np.ndarray]:
    """Inertia, Coulomb and viscous that fit the windows best, and the residual that they leave.

    Gauss-Newton with differences: what no nominal value can explain is the effect's own.
    """
    names = ("inertia", "coulomb", "viscous")
    best = dict(nominal)
    left = window_residual(best, record, dt, substeps=4)
    current, residual = dict(best), left
    for _ in range(iterations):
        columns = [
            (window_residual(current | {n: 1.005 * current[n]}, record, dt, substeps=4) - residual).ravel() / 0.005
            for n in names
        ]
        step = np.linalg.lstsq(np.stack(columns, axis=1), -residual.ravel(), rcond=None)[0]
        for name, change in zip(names, step, strict=True):
            current[name] *= float(np.clip(1 + change, 0.5, 2))
        residual = window_residual(current, record, dt, substeps=4)
        if np.mean(residual**2) < np.mean(left**2):
            best, left = dict(current), residual
    return best, left
