"""A position counter that ends: the position stays at an extreme while the velocity column moves on."""

import itertools
from collections.abc import Iterator

import numpy as np

from ..arrays import Values, runs_of
from ..dynamics.derivative import smooth_motion, travel
from ..log import Log
from ..noise import rounding_step
from .agreement import TOGETHER, one_unit
from .suspicion import Suspicion

OFTEN = 0.02  # share of the rows at an extreme with the machine in motion
FAR = 0.1  # of the position's range: what the velocity travels meanwhile; play and twist at an end stop are less
STEPS = 5.0  # rounding steps of the position, likewise: within one of a coarse encoder a machine turns round
MOVING = 0.1  # of the speed that a twentieth of the rows exceed: a sensor's bias at rest is less
BLOCKS = 10  # stretches away from the extremes, at least, in which the columns must agree


def clipped_counter(log: Log, columns: dict[str, Values]) -> Iterator[Suspicion]:
    """A counter of a fixed width (16 bit) that stops at its largest or smallest value.

    A machine that rests at an end stop or at a set point has a constant position too. So the velocity column must
    contradict it, after it has shown between the extremes that it is this position's rate.
    """
    velocity, position = columns.get("velocity"), columns.get("position")
    if velocity is None or position is None or np.ptp(position) == 0.0:
        return
    at_end = [(position == end, word) for end, word in ((position.max(), "largest"), (position.min(), "smallest"))]
    walked = travel(velocity, log.dt)
    if not _agree(walked, position, at_end[0][0] | at_end[1][0]):
        return
    speed = np.abs(smooth_motion(velocity, None, log.dt)[0])
    moving = speed > MOVING * np.quantile(speed, 0.95)
    far = max(FAR * float(np.ptp(position)), STEPS * rounding_step(position))
    unit = "m" if log.linear else "rad"
    for at, word in at_end:
        passed = np.zeros(len(at), dtype=bool)
        for first, last in runs_of(at):
            passed[first:last] = np.ptp(walked[first:last]) > far
        share = float(np.mean(passed & moving))
        if share > OFTEN:
            yield Suspicion(
                f"position stays at its {word} value, {position[np.argmax(at)]:.4g} {unit}, in {np.mean(passed):.0%} "
                f"of the rows, while the velocity column moves on: its counter is clipped there; log a wider counter "
                f"or one that wraps, or give a log without this column.",
                "warn",
                "inconsistent",
            )


def _agree(walked: Values, position: Values, at_end: Values) -> bool:
    """Whether, by blocks without a row at an extreme, the position changes by what the velocity travels."""
    size = int(np.clip(len(position) // 100, 4, 200))
    ends = np.arange(0, len(position), size)
    inside = np.array([not at_end[first : last + 1].any() for first, last in itertools.pairwise(ends)])
    if np.sum(inside) < BLOCKS:
        return False
    by_rate, by_angle = np.diff(walked[ends])[inside], np.diff(position[ends])[inside]
    power = float(np.sqrt((by_rate @ by_rate) * (by_angle @ by_angle)))
    if power == 0.0:
        return False
    ratio = np.sqrt((by_rate @ by_rate) / (by_angle @ by_angle))
    return float(by_rate @ by_angle) > TOGETHER * power and one_unit(float(ratio))
