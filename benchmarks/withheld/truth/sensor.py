"""The rate sensor (lag, dead time, scale, bias, noise, step) and the encoder's rounding."""

import numpy as np


def rounded(value: np.ndarray, step: np.ndarray) -> np.ndarray:
    """Round to a step; a step of 0 leaves the value as it is."""
    if not np.any(step > 0):
        return value
    return np.where(step > 0, np.round(value / np.where(step > 0, step, 1.0)) * step, value)


class VelocitySensor:
    """Follows the true velocity in every substep where it has a memory; is read once in each period."""

    def __init__(self, p: dict[str, np.ndarray], dt: float, substeps: int):
        self.p = p
        count = len(p["scale"])
        h = dt / substeps
        self.lagged = bool(np.any(p["velocity_lag"] > 0))
        self.delayed = bool(np.any(p["velocity_delay"] > 0))
        self.follows = self.lagged or self.delayed
        lag = p["velocity_lag"]
        self.decay = np.where(lag > 0, np.exp(-h / np.where(lag > 0, lag, 1.0)), 0.0)
        self.state, self.before = np.zeros(count), np.zeros(count)
        steps = p["velocity_delay"] / h
        self.whole = np.floor(steps).astype(int)
        self.fraction = steps - self.whole
        self.history = np.zeros((int(self.whole.max()) + 2, count))
        self.newest = 0
        self.index = np.arange(count)

    def follow(self, velocity: np.ndarray) -> None:
        """The true velocity at the end of a substep [rad/s]."""
        if self.lagged:
            # The lag of a velocity that is linear within the substep, by its mean: second order.
            mean = (velocity + self.before) / 2
            lagged = mean + self.decay * (self.state - mean)
            self.state = np.where(self.p["velocity_lag"] > 0, lagged, velocity)
            self.before = velocity
        else:
            self.state = velocity
        if self.delayed:
            self.newest = (self.newest + 1) % len(self.history)
            self.history[self.newest] = self.state

    def read(self, noise: np.ndarray) -> np.ndarray:
        """The reading at the start of a period [rad/s]."""
        p, value = self.p, self.state
        if self.delayed:
            size = len(self.history)
            late = self.history[(self.newest - self.whole) % size, self.index]
            later = self.history[(self.newest - self.whole - 1) % size, self.index]
            value = late + self.fraction * (later - late)
        return rounded(p["scale"] * value + p["bias"] + noise, p["velocity_step"])
