"""Plain references within the same limits, a sine and a sweep: parts of every plan, and what it is compared with."""

import numpy as np

from .limits import Limits

NAMES = ("sine", "sweep")
PERIODS = 2.0  # fewest periods of the sine in a run
SLOWEST = 1.0  # periods of the sweep's lowest frequency in a run


def plain_references(limits: Limits, time: np.ndarray, highest: float) -> np.ndarray:
    """Speeds of a sine and of a sweep, as large as the limits allow [in top speeds], shape (samples, 2).

    The sine is the slowest that the travel allows at the top speed. The frequency of the sweep grows exponentially, and
    its amplitude at each frequency is the largest that top speed, travel and acceleration allow.

    Args:
        limits: of the run.
        time: [s], shape (samples,).
        highest: frequency at which the sweep ends [Hz].
    """
    # A sine of speed amplitude v and frequency f has the travel v / (pi f) and the acceleration 2 pi f v.
    slowest = max(PERIODS / limits.duration, limits.speed / (np.pi * limits.travel))
    low = SLOWEST / limits.duration
    rate = np.log(highest / low) / limits.duration
    frequency = low * np.exp(rate * time)
    size = np.minimum.reduce([
        np.ones_like(time),
        limits.acceleration / (2.0 * np.pi * frequency * limits.speed),
        limits.travel * np.pi * frequency / limits.speed,
    ])  # fmt: skip
    sweep = size * np.sin(2.0 * np.pi * (frequency - low) / rate)
    return np.stack([np.sin(2.0 * np.pi * slowest * time), sweep], axis=1)
