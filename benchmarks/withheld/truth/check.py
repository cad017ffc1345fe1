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
    return window_residuals([nominal], [record], dt, length, substeps, [change or {}])[0]


def window_residuals(
    nominals: list[dict[str, float]],
    records: list[Record],
    dt: float,
    length: int = 50,
    substeps: int = 10,
    changes: list[dict[str, float]] | None = None,
) -> np.ndarray:
    """`window_residual` of several models, each on its record, side by side: (model, window, sample) [rad/s]."""
    count = (len(records[0].time) - 1) // length
    nothing, machines = np.zeros(1), []
    for nominal, change in zip(nominals, changes or [{}] * len(nominals), strict=True):
        physics = {
            "inertia": nominal["inertia"],
            "coulomb_positive": nominal["coulomb"],
            "coulomb_negative": nominal["coulomb"],
            "viscous_positive": nominal["viscous"],
            "viscous_negative": nominal["viscous"],
            "known_offset": nominal.get("offset", 0.0),
            "known_unbalance": nominal.get("unbalance", 0.0),
            "known_unbalance_phase": nominal.get("unbalance_phase", 0.0),
        } | change
        machines += [Machine(physics, nothing, nothing, nothing)] * count
    p = stack(machines)
    body = Body(p)

    def read(name: str, shift: int) -> np.ndarray:
        """A signal `shift` samples into every window."""
        return np.concatenate([getattr(one, name)[shift : shift + count * length : length] for one in records])

    body.position = read("true_position", 0)
    body.velocity = read("true_velocity", 0)
    body.change = 0.0
    h = dt / substeps
    residual = np.zeros((len(machines), length))
    for k in range(length):
        torque = shaped(read("torque", k), p)
        for _ in range(substeps):
            body.drift(h / 2)
            body.kick(torque, h, 0.0)
            body.drift(h / 2)
        seen = rounded(p["scale"] * body.velocity + p["bias"], p["velocity_step"])
        residual[:, k] = read("velocity", k + 1) - seen
    return residual.reshape(len(nominals), count, length)


def chi_square(nominal: dict[str, float], physics: dict[str, float], record: Record, dt: float) -> float:
    """Reduced chi-square of the nominal model's window residual against sensor noise alone."""
    residual = window_residual(nominal, record, dt)
    return float(np.mean(residual**2) / physics["velocity_noise"] ** 2)


def refit_each(
    nominals: list[dict[str, float]], records: list[Record], dt: float, iterations: int = 4
) -> list[tuple[dict[str, float], np.ndarray]]:
    """Inertia, Coulomb and viscous that fit each record's windows best, and the residual that they leave.

    Gauss-Newton with differences: what no nominal value can explain is the effect's own.
    """
    names = ("inertia", "coulomb", "viscous")
    current = [dict(nominal) for nominal in nominals]
    residuals = window_residuals(current, records, dt, substeps=4)
    best = [(dict(one), residual) for one, residual in zip(current, residuals, strict=True)]
    for _ in range(iterations):
        moved = [one | {name: 1.005 * one[name]} for one in current for name in names]
        beside = window_residuals(moved, [one for one in records for _ in names], dt, substeps=4)
        for at, (one, residual) in enumerate(zip(current, residuals, strict=True)):
            columns = (beside[len(names) * at : len(names) * (at + 1)] - residual).reshape(len(names), -1).T / 0.005
            step = np.linalg.lstsq(columns, -residual.ravel(), rcond=None)[0]
            for name, change in zip(names, step, strict=True):
                one[name] *= float(np.clip(1 + change, 0.5, 2))
        residuals = window_residuals(current, records, dt, substeps=4)
        for at, (one, residual) in enumerate(zip(current, residuals, strict=True)):
            if np.mean(residual**2) < np.mean(best[at][1] ** 2):
                best[at] = dict(one), residual
    return best
