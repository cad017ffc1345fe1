"""A nominal model by least squares on a log: inertia, Coulomb, viscous and offset, with zero-order-hold timing.

Both sides of J a = torque - C sign(v) - B v - offset are averaged over the same window, so that the torque's hold needs
no correction and no derivative is taken sample by sample: v(t + T) - v(t - T) is the integral of a over the window, and
q(t + T) - 2 q(t) + q(t - T) its integral under a triangle. Windows in which the speed turns are left out.
"""

from dataclasses import dataclass

import numpy as np

from .log import Log

WINDOW = 0.02  # s: long against an encoder's step, short against a servo's motion
SLOWEST = 0.02  # of the largest speed: below it the direction is noise


@dataclass(frozen=True)
class Nominal:
    """Least-squares fit in the log's units.

    Attributes:
        inertia: J.
        coulomb: C.
        viscous: B.
        offset: same sign as positive friction.
        deviations: standard deviation of the four, widened for the overlap of the windows.
        residual: rms torque left [N m].
        share: of the torque's variance that the model explains [1].
        rows: windows used.
    """

    inertia: float
    coulomb: float
    viscous: float
    offset: float
    deviations: tuple[float, float, float, float]
    residual: float
    share: float
    rows: int

    @property
    def plausible(self) -> bool:
        """Whether signs and fit are those of a machine."""
        return self.inertia > 0.0 and self.coulomb > 0.0 and self.share > 0.3


def speed_of(log: Log) -> np.ndarray:
    """Velocity, smoothed over the window; from the position where there is no velocity."""
    half = half_window(log)
    if log.velocity is not None:
        return smooth(log.velocity, half)
    assert log.position is not None
    ahead = np.minimum(np.arange(log.samples) + half, log.samples - 1)
    behind = np.maximum(np.arange(log.samples) - half, 0)
    return (log.position[ahead] - log.position[behind]) / ((ahead - behind) * log.dt)


def half_window(log: Log) -> int:
    """Half the window in samples."""
    return max(1, min(round(0.5 * WINDOW / log.dt), log.samples // 10))


def smooth(values: np.ndarray, half: int) -> np.ndarray:
    """Mean over 2 half + 1 samples, fewer at the ends."""
    total = np.concatenate([[0.0], np.cumsum(values)])
    index = np.arange(values.size)
    ahead, behind = np.minimum(index + half + 1, values.size), np.maximum(index - half, 0)
    return (total[ahead] - total[behind]) / (ahead - behind)


def fit_nominal(log: Log) -> Nominal | None:
    """The fit; None where too few windows keep their direction."""
    half = half_window(log)
    speed = speed_of(log)
    if log.velocity is not None:
        weights = np.ones(2 * half)  # of each held torque: its time within the window
        change = log.velocity[2 * half :] - log.velocity[: -2 * half]
    else:
        assert log.position is not None
        # Of each held torque: the integral of the triangle T - |s| over its period.
        edges = np.arange(-half, half + 1) * log.dt
        area = np.where(edges < 0, 0.5 * (half * log.dt + edges) ** 2, (half * log.dt) ** 2)
        area = np.where(edges >= 0, area - 0.5 * (half * log.dt - edges) ** 2, area)
        weights = np.diff(area) / log.dt
        q = log.position
        change = q[2 * half :] - 2.0 * q[half:-half] + q[: -2 * half]
    middle = 0.5 * (speed + np.roll(speed, -1))  # over each period
    size = weights.sum()

    def averaged(values: np.ndarray) -> np.ndarray:
        return np.convolve(values, weights[::-1], "valid")[: change.size] / size

    acceleration = change / (size * log.dt)
    direction = np.sign(middle)
    side, drag, torque = averaged(direction), averaged(middle), averaged(log.torque)
    limit = SLOWEST * float(np.quantile(np.abs(speed), 0.99))
    good = (np.abs(side) > 0.999) & (np.abs(drag) > limit)
    if good.sum() < 20:
        return None
    columns = np.column_stack([acceleration, side, drag, np.ones_like(side)])[good]
    target = torque[good]
    scale = np.linalg.norm(columns, axis=0)
    scale[scale == 0.0] = 1.0
    solution, _, rank, _ = np.linalg.lstsq(columns / scale, target, rcond=1e-9)
    if rank < 4:  # one direction only, or one speed: what cannot be told apart is not told
        return None
    values = solution / scale
    residual = target - columns @ values
    spread = float(residual @ residual) / max(target.size - 4, 1)
    covariance = np.linalg.pinv((columns / scale).T @ (columns / scale)) * spread * 2 * half
    deviations = np.sqrt(np.maximum(np.diag(covariance), 0.0)) / scale
    variance = float(np.var(target))
    share = 1.0 - spread / variance if variance > 0.0 else 0.0
    return Nominal(
        *(float(value) for value in values),
        deviations=tuple(float(each) for each in deviations),  # type: ignore[arg-type]
        residual=float(np.sqrt(spread)),
        share=share,
        rows=int(good.sum()),
    )
