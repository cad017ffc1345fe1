"""Usual: runs that need no plan, within the same limits: what a planned run begins with and is held against."""

import numpy as np

from .limits import Limits

NAMES = ("sine", "sweep")
PERIODS = 2.0  # fewest of a sine in its run
SLOWEST = 1.0  # periods of the sweep's lowest frequency in its run


def usual(limits: Limits, time: np.ndarray, highest: float) -> np.ndarray:
    """Speeds of a sine and of a sweep, as large as the limits of the run let them be [1], shape (samples, 2).

    The sine is as slow as its travel lets it be at the top speed. The frequency of the sweep grows by equal factors,
    and its speed is at each frequency what travel and acceleration leave of the top speed.

    Args:
        limits: of the run.
        time: [s], shape (samples,).
        highest: frequency at which the sweep ends [Hz].
    """
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
