"""Agreement: whether a velocity and a position are readings of one motion, and in which proportion."""

import numpy as np

from ..arrays import Values
from ..dynamics.derivative import travel

BLOCKS = 100  # of a log, over which both are compared
TOGETHER = 0.5  # correlation over blocks, from which on one is the other's rate
ANOTHER = 0.5  # times the position's rate, below which (and above whose inverse) a velocity is in another unit


def travelled(velocity: Values, position: Values, dt: float) -> tuple[float, float]:
    """(integral of the velocity over the change of the position [1], their correlation [1]), by blocks of many periods.

    Over a block the noise of the two sensors is small beside the travel, and no reading is differentiated.

    Args:
        velocity: [rad/s], shape (samples,).
        position: [rad], shape (samples,).
        dt: control period [s].
    """
    size = int(np.clip(len(velocity) // BLOCKS, 4, 200))
    ends = np.arange(0, len(velocity), size)
    walked = travel(velocity, dt)
    by_rate, by_angle = np.diff(walked[ends]), np.diff(position[ends])
    power, rate_power = float(by_angle @ by_angle), float(by_rate @ by_rate)
    if power == 0.0 or rate_power == 0.0:
        return float("nan"), 0.0
    across = float(by_rate @ by_angle)
    # Both are noisy, so a regression either way is biased: the ratio of their rms is not, with the correlation's sign.
    return float(np.sign(across) * np.sqrt(rate_power / power)), abs(across) / np.sqrt(power * rate_power)


def in_another_unit(velocity: Values, position: Values, dt: float) -> bool:
    """Whether a velocity is a multiple of the position's rate that no scale error is: no motion has both.

    Args:
        velocity: [rad/s], shape (samples,).
        position: [rad], shape (samples,).
        dt: control period [s].
    """
    ratio, together = travelled(velocity, position, dt)
    return together > TOGETHER and not one_unit(ratio)


def one_unit(ratio: float) -> bool:
    """Whether a velocity over the position's rate [1] is near enough to 1 to be a scale error."""
    return ANOTHER < ratio < 1.0 / ANOTHER
