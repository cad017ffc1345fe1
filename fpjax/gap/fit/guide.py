"""Guide: how firmly a simulation is held near the measured motion, so that a fit linearises where the log was.

A machine that its own torques trap or turn over (cogging, a pendulum) leaves the measured motion, whatever the law,
once some torque is missing; what it then sees of a position or a direction is not what the log saw, and no step of a
fit improves it. A guide accelerates all masses of the simulated machine alike towards the measured motion, as a spring
and a damper would, and what it adds to speed and position is taken off the prediction again: for a linear machine the
residual is what it is without a guide, so that the likelihood needs no other form. It is the gain of an extended Kalman
filter, taken constant. (Taking the guide's torque out through the *nominal* mass was tried: it ties the residual to
that mass, and a fit's inertia then went to a bound, drawn there by resonances.)
"""

from collections.abc import Sequence

import numpy as np

from ..data.record import Record, guide_of
from ..data.setting import Setting
from .band import Coefficients
from .modes import Modes
from .periods import repeating_periods, repeating_share

NEAR = 0.1  # of the motion in a window, and of a radian of a repeating torque's phase: how far a simulation may be off
REPEATS = 0.5  # share of the missing torque that a sine of the position holds where its phase must be kept
FASTEST = 0.1  # of the sampling frequency: the fastest guide; a faster one would follow the readings' noise
TRIED = 16  # bandwidths

Values = np.ndarray


def guide_bandwidth(
    records: Sequence[Record], modes: Modes, coefficients: Coefficients, setting: Setting, period: float = 0.0
) -> float:
    """Bandwidth [Hz] of the weakest guide that keeps simulations near the motion; zero where they stay there alone.

    The weakest: what the guide follows is a reading, with its noise and its timing, and a simulation has neither.

    Args:
        records: the logs.
        modes: of a window.
        coefficients: of the nominal model, which say how far it departs.
        setting: sizes.
        period: of a torque whose phase is to be kept too [1/rev]; 0 for none.
    """
    moved = float(np.sqrt(np.mean(np.concatenate([record.motion_squares() for record in records]))))
    encoder = records[0].position
    phase = 0.0 if encoder is None else period * encoder.noise * moved  # of the motion in a window [rad]
    squares = np.mean(np.concatenate([plain**2 for _, plain in coefficients]), axis=0)
    squares = np.where(modes.sensor, 0.0, squares)
    s = 2j * np.pi * modes.frequency

    def astray(bandwidth: float) -> float:
        stiffness, damping = guide_of(records[0], bandwidth)
        left = squares * np.abs(s**2 / (s**2 + damping * s + stiffness)) ** 2
        return float(np.sqrt(np.sum(left) / modes.basis.shape[0])) / moved

    tried = [0.0, *np.geomspace(1.0 / setting.window, FASTEST / setting.dt, TRIED)]
    return next((float(f) for f in tried if astray(f) * max(1.0, phase) < NEAR), float(tried[-1]))


def dominant_period(course: Values, record: Record, setting: Setting) -> float:
    """Periods a revolution [1/rev] with which most of a missing torque repeats; zero where there are none.

    Args:
        course: the missing torque [N m], NaN where unknown, shape (samples,).
        record: its motion.
        setting: sizes.
    """
    periods = repeating_periods(course, record, setting).get("torque", ())
    period, share = repeating_share(course, record, periods)
    return period if share > REPEATS else 0.0
