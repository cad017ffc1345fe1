"""From the command to the torque on the machine: dead zone, gain, limit, delay, lag."""

import numpy as np

Parameters = dict[str, np.ndarray]


def shaped(command: np.ndarray, p: Parameters) -> np.ndarray:
    """Torque of a held command after dead zone, gain and limit, before dead time and lag [N m]."""
    lost = np.clip(command, -p["dead_zone"], p["dead_zone"])
    torque = p["gain"] * (command - lost)
    hard = np.clip(torque, -p["limit"], p["limit"])
    if not np.any(p["softness"] > 0):
        return hard
    power = 1 / np.where(p["softness"] > 0, p["softness"], 1.0)
    soft = torque / (1 + np.abs(torque / p["limit"]) ** power) ** (1 / power)
    return np.where(p["softness"] > 0, soft, hard)


class Actuator:
    """Dead time, any fraction of a period, by two held values in each period; then a lag, integrated exactly."""

    def __init__(self, p: Parameters, dt: float, substeps: int):
        self.p, self.substeps = p, substeps
        self.delayed = bool(np.any(p["actuator_delay"] > 0))
        self.lagged = bool(np.any(p["actuator_lag"] > 0))
        count = len(p["gain"])
        periods = p["actuator_delay"] / dt
        self.whole = np.floor(periods).astype(int)
        self.fraction = (periods - self.whole) * substeps
        self.history = np.zeros((int(self.whole.max()) + 2, count))
        self.index = np.arange(count)
        h = dt / substeps
        lag = p["actuator_lag"]
        self.decay = np.where(lag > 0, np.exp(-h / np.where(lag > 0, lag, 1.0)), 0.0)
        # Mean of the lag's exponential over a substep h: input + weight (state - input), weight = (1 - e^(-h/T)) T / h.
        self.weight = np.where(lag > 0, (1 - self.decay) * lag / h, 0.0)
        self.state = np.zeros(count)

    def hold(self, command: np.ndarray) -> None:
        """A new command, at the start of a period."""
        self.history = np.roll(self.history, 1, axis=0)
        self.history[0] = shaped(command, self.p)
        self.new = self.history[self.whole, self.index]
        self.old = self.history[self.whole + 1, self.index]

    def torque(self, substep: int) -> np.ndarray:
        """Mean torque over one substep [N m]."""
        torque = self.new
        if self.delayed:
            share = np.clip(self.fraction - substep, 0.0, 1.0)
            torque = torque + share * (self.old - torque)
        if self.lagged:
            mean = torque + self.weight * (self.state - torque)
            self.state = torque + self.decay * (self.state - torque)
            return mean
        return torque
