# pyright: reportArgumentType=false, reportAttributeAccessIssue=false
"""Hints: where a search had better begin, from regressions on the one-step torque residual."""

from typing import Any

import numpy as np

from ..blocks.signals import Motion
from .effect import Setting
from .record import Record

MOST = 3  # starts a hint gives
HIGHEST = 48.0  # periods per revolution looked at


def torque_residual(record: Record, setting: Setting, load: np.ndarray | float = 0.0) -> np.ndarray:
    """Commanded torque less what the nominal motion needed [N m]; the held torque is paired as (u_k + u_(k-1)) / 2."""
    before = np.concatenate([record.torque[:1], record.torque[:-1]])
    needed = setting.inertia * record.acceleration + setting.viscous * record.speed
    return 0.5 * (record.torque + before) - needed - setting.coulomb * np.sign(record.speed) - load


def known_torque(record: Record, load: Any, origin: float = 0.0) -> np.ndarray:
    """The nominal model's load along the log [N m]."""
    motion = Motion(record.speed, record.angle + origin, record.time - record.time[0])
    return np.broadcast_to(np.asarray(load.readout(motion), float), record.speed.shape)


def position_hints(record: Record, setting: Setting, load: np.ndarray | float = 0.0) -> dict[str, tuple[float, ...]]:
    """Periods per revolution at which torque, and torque times direction, repeat with position."""
    travel = float(np.ptp(record.angle))
    if travel <= 0.0:
        return {}
    residual = torque_residual(record, setting, load)
    moving = np.abs(record.speed) > 0.05 * setting.speed
    keep = np.flatnonzero(moving)[:: max(1, int(np.sum(moving)) // 3000)]
    if len(keep) < 50:
        return {}
    angle, speed, residual = record.angle[keep], record.speed[keep], residual[keep]
    step = max(np.pi / (2 * travel), HIGHEST / 1500)
    periods = np.arange(max(0.5, step), HIGHEST, step)
    common = np.stack([np.ones_like(speed), np.sign(speed), speed, record.acceleration[keep]], 1)
    basis, _ = np.linalg.qr(common / np.maximum(np.linalg.norm(common, axis=0), 1e-30))
    cogging = _energy(residual, angle, np.ones_like(speed), periods, basis)
    ripple = _energy(residual, angle, np.sign(speed), periods, basis)
    found = {
        "cogging_periods": _peaks(periods, np.where(periods >= 1.5, cogging, 0.0)),
        "ripple_periods": _peaks(periods, ripple),
    }
    if travel < 3.0 * np.pi:
        # Little more than a period was seen: the peak is as wide as its place, and the fit wants starts around it.
        found = {name: (*peaks, *(f * peaks[0] for f in (0.7, 0.85, 1.2))) for name, peaks in found.items() if peaks}
    return found


def _energy(
    residual: np.ndarray, angle: np.ndarray, factor: np.ndarray, periods: np.ndarray, basis: np.ndarray
) -> np.ndarray:
    left = residual - basis @ (basis.T @ residual)
    phase = np.exp(1j * periods[:, None] * angle[None]) * factor[None]
    columns = np.stack([phase.real, phase.imag], 1)  # (periods, 2, samples)
    columns = columns - (columns @ basis) @ basis.T
    gram = columns @ columns.transpose(0, 2, 1) + 1e-9 * len(angle) * np.eye(2)
    right = columns @ left
    return np.einsum("pi,pi->p", right, np.linalg.solve(gram, right[:, :, None])[:, :, 0])


def _peaks(periods: np.ndarray, energy: np.ndarray) -> tuple[float, ...]:
    order = np.argsort(-energy)
    width = 2.5 * (periods[1] - periods[0])
    found: list[float] = []
    for index in order:
        if all(abs(periods[index] - other) > width for other in found):
            found.append(float(periods[index]))
        if len(found) == MOST:
            break
    return tuple(found)
