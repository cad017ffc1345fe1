"""Motion: speed, acceleration and angle of a log by local quadratics (Savitzky-Golay filters).

They give the windows' start values and sizes for bounds. Residuals are formed with the readings themselves.
"""

import numpy as np
from jaxtyping import Float

from ...logs.arrays import Values
from ...logs.dynamics.derivative import local_polynomial
from .channel import Channel

HALVES = (2, 3, 4, 6, 9, 13, 19, 28, 40)  # samples on either side of a local quadratic
# Noise of the speed over the top speed [1] that is small enough: a wider quadratic would round the corners of reversals
# more than it takes of the noise.
QUIET_SPEED = 0.01


def motion(
    velocity: Channel | None, position: Channel | None, dt: float
) -> tuple[Float[Values, " samples"], Float[Values, " samples"], Float[Values, " samples"], float]:
    """(speed [rad/s], acceleration [rad/s^2], angle [rad], standard deviation of the speed), each (samples,).

    Args:
        velocity: the rate sensor's column, or None.
        position: the encoder's, or None; without it the angle is the integral of the rate and starts at zero.
        dt: control period [s].
    """
    if velocity is not None:
        # A rounded rate needs a wider fit, in which steps average out.
        half = 5 if velocity.step == 0 else 10
        speed, slope = smoothed(velocity.values, half)
        deviation = velocity.noise
    else:
        assert position is not None
        speed, deviation, half = encoder_rate(velocity, position, dt)
        slope = smoothed(speed, max(half, 5))[1]
    if position is not None:
        angle = smoothed(position.values, smoothing_width(velocity, position))[0]
    else:
        assert velocity is not None
        # The exact integral of straight lines between the samples; no sensor measures where it starts, so at zero.
        angle = np.concatenate([[0.0], np.cumsum(0.5 * dt * (velocity.values[1:] + velocity.values[:-1]))])
    return speed, slope / dt, angle, deviation


def encoder_rate(
    velocity: Channel | None, position: Channel, dt: float
) -> tuple[Float[Values, " samples"], float, int]:
    """(rate [rad/s], its standard deviation [rad/s], samples on either side that it is smoothed over) of an encoder."""
    half = smoothing_width(velocity, position)
    return smoothed(position.values, half)[1] / dt, slope_noise(position, half) / dt, half


def smoothed(
    values: Float[Values, " samples"], half: int
) -> tuple[Float[Values, " samples"], Float[Values, " samples"]]:
    """(value, slope per sample) of a local quadratic over 2 half + 1 samples; the ends repeat the nearest fit."""
    half = min(half, (len(values) - 1) // 2)
    return local_polynomial(values, half), local_polynomial(values, half, derivative=1)


def smoothing_width(velocity: Channel | None, position: Channel) -> int:
    """Samples on either side of the local quadratics through a position.

    Beside a rate reading few: only the angle is taken from them. Else those of the narrowest quadratic whose slope has
    little noise, which rounds reversals least.
    """
    if velocity is not None:
        return 5
    for half in HALVES:
        slope = smoothed(position.values, half)[1]
        if slope_noise(position, half) < QUIET_SPEED * float(np.quantile(np.abs(slope), 0.95)):
            return half
    return HALVES[-1]


def slope_noise(position: Channel, half: int) -> float:
    """Standard deviation of the fitted slope [rad per sample]: sigma / sqrt(sum k^2), of white noise."""
    return position.noise / float(np.sqrt(np.sum(np.arange(-half, half + 1.0) ** 2)))
