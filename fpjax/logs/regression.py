"""Rough regressions that tell one unit from another, made on means over many periods so that noise hardly counts."""

from dataclasses import dataclass

import numpy as np

Values = np.ndarray


@dataclass(frozen=True)
class Regression:
    """torque = inertia x acceleration + coulomb x sign + viscous x speed + constant, fitted by least squares.

    Attributes:
        inertia: [kg m^2].
        inertia_error: its standard deviation [kg m^2].
        coulomb: [N m].
        viscous: [N m s/rad].
        explained: share of the torque's variance that inertia and friction explain [1].
        torque: rms of the torque [N m].
    """

    inertia: float
    inertia_error: float
    coulomb: float
    viscous: float
    explained: float
    torque: float


def regress(torque: Values, speed: Values, dt: float) -> Regression:
    """Inertia and friction from a torque that is held over each period and the speed at its start.

    Args:
        torque: [N m], shape (samples,).
        speed: [rad/s], shape (samples,).
        dt: [s].
    """
    size = int(np.clip(len(speed) // 400, 4, 25))
    count = (len(speed) - 1) // size
    ends = size * np.arange(count + 1)
    # the held torque's mean over a block and the change of speed from end to end belong together exactly
    mean_torque = np.mean(torque[: size * count].reshape(count, size), axis=1)
    half = max(1, size // 3)
    smooth = np.convolve(np.pad(speed, half, mode="edge"), np.ones(2 * half + 1) / (2 * half + 1), mode="valid")
    gained = np.diff(smooth[ends]) / (size * dt)
    within = speed[: size * count].reshape(count, size)
    columns = np.stack([gained, np.mean(np.sign(within), axis=1), np.mean(within, axis=1), np.ones(count)], axis=1)
    scale = np.maximum(np.sqrt(np.mean(columns**2, axis=0)), 1e-300)
    solution, *_ = np.linalg.lstsq(columns / scale, mean_torque, rcond=1e-9)
    left = mean_torque - (columns / scale) @ solution
    gram = np.linalg.pinv((columns / scale).T @ (columns / scale), rcond=1e-9)
    variance = float(left @ left) / max(count - 4, 1)
    error = np.sqrt(np.maximum(np.diag(gram), 0.0) * variance) / scale
    spread = float(np.sum((mean_torque - np.mean(mean_torque)) ** 2))
    inertia, coulomb, viscous, _ = (float(value) for value in solution / scale)
    explained = 1.0 - float(left @ left) / max(spread, 1e-300)
    return Regression(inertia, float(error[0]), coulomb, viscous, explained, float(np.sqrt(np.mean(mean_torque**2))))


def travelled(velocity: Values, position: Values, dt: float) -> tuple[float, float]:
    """(velocity's integral over position's change, their correlation), over blocks of many periods.

    Args:
        velocity: [rad/s], shape (samples,).
        position: [rad], shape (samples,).
        dt: [s].
    """
    size = int(np.clip(len(velocity) // 100, 4, 200))
    ends = np.arange(0, len(velocity), size)
    walked = np.concatenate([[0.0], np.cumsum(0.5 * dt * (velocity[1:] + velocity[:-1]))])
    by_rate, by_angle = np.diff(walked[ends]), np.diff(position[ends])
    power, rate_power = float(by_angle @ by_angle), float(by_rate @ by_rate)
    if power == 0.0 or rate_power == 0.0:
        return float("nan"), 0.0
    across = float(by_rate @ by_angle)
    # both are noisy: the ratio of their sizes, with the sign of what they share
    return float(np.sign(across) * np.sqrt(rate_power / power)), abs(across) / np.sqrt(power * rate_power)
