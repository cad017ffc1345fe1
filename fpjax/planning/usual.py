"""Usual: runs that need no plan, within the same limits: what a planned run is held against."""

import numpy as np

from .trajectory import Course, Motion

PERIODS = 2.0  # fewest of a sine in its run
SLOWEST = 1.0  # periods of the sweep's lowest frequency in its run


def usual(course: Course) -> dict[str, Motion]:
    """A sine and a sweep, as large as the limits of the run let them be.

    The sine is as slow as its travel lets it be at the top speed. The frequency of the sweep grows by equal factors up
    to the highest tone of a plan, and its speed is at each frequency what travel and acceleration leave of the top
    speed.

    Args:
        course: of the run.
    """
    limits, time = course.limits, course.time
    slowest = max(PERIODS / limits.duration, limits.speed / (np.pi * limits.travel))
    low, high = SLOWEST / limits.duration, float(np.max(course.frequencies))
    rate = np.log(high / low) / limits.duration
    frequency = low * np.exp(rate * time)
    size = np.minimum.reduce([
        np.ones_like(time),
        limits.acceleration / (2.0 * np.pi * frequency * limits.speed),
        limits.travel * np.pi * frequency / limits.speed,
    ])  # fmt: skip
    waves = {
        "sine": np.sin(2.0 * np.pi * slowest * time),
        "sweep": size * np.sin(2.0 * np.pi * (frequency - low) / rate),
    }
    return {name: course.within(wave) for name, wave in waves.items()}
