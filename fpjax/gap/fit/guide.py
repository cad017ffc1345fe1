"""Guide: how firmly a simulation is held near the measured motion, so that a fit linearises about that motion.

Some simulated machines leave the measured motion as soon as any torque is missing: one that cogging traps, a pendulum
that falls over. The torques that depend on position and direction then act at the wrong places, and no step of a fit
improves it. A guide accelerates all masses of the simulated machine alike towards the measured motion, as a spring and
a damper would, and what it adds to speed and position is taken off the prediction again: for a mass without friction
the residual is what it is without a guide, and what viscous friction changes of that is in the modes. It is the gain of
an extended Kalman filter, taken constant. (Taking the guide's torque out through the *nominal* mass was tried: it ties
the residual to that mass, and beside a resonance the fitted inertia went to its bound.)
"""

from collections.abc import Sequence

import numpy as np

from ..data.record import Record
from ..data.replay_tables import guide_of
from ..data.setting import Setting
from ..thresholds import THRESHOLDS
from .band import Coefficients
from .modes import Modes

TRIED = 16  # number of bandwidths, evenly spaced in logarithm


def guide_bandwidth(
    records: Sequence[Record], modes: Modes, coefficients: Coefficients, setting: Setting, present: float = 0.0
) -> float:
    """Bandwidth [Hz] of the weakest guide that keeps simulations near the motion; zero where none is needed.

    The weakest, because a guide follows readings, and lets their noise and their timing errors into the simulation.

    Args:
        records: the logs.
        modes: of a window.
        coefficients: residuals of the nominal model, from which its distance to the motion follows.
        setting: sizes.
        present: bandwidth of the guide under which that model was simulated [Hz].
    """
    moved = float(np.sqrt(np.mean(np.concatenate([record.motion_squares() for record in records]))))
    squares = np.mean(np.concatenate([plain**2 for _, plain in coefficients]), axis=0)
    squares = np.where(modes.sensor, 0.0, squares)
    s = 2j * np.pi * modes.frequency
    # A torque moves a free mass by 1 / (s^2 + b s) and a guided one by 1 / (s^2 + (b + d) s + k); what the guide has
    # added, (d s + k) / s^2 of that, is taken off the residual.
    own = s**2 + setting.damping * s
    stiffness, damping = guide_of(records[0], present)
    held = s**2 + damping * s + stiffness
    squares = squares * np.abs(s**2 * (own + damping * s + stiffness) / (own * held)) ** 2

    def distance(bandwidth: float) -> float:
        """Rms residual of the nominal model under a guide, over the rms motion [1]."""
        stiffness, damping = guide_of(records[0], bandwidth)
        left = squares * np.abs(own / (own + damping * s + stiffness)) ** 2
        return float(np.sqrt(np.sum(left) / modes.basis.shape[0])) / moved

    tried = [0.0, *np.geomspace(1.0 / setting.window, THRESHOLDS.fastest / setting.dt, TRIED)]
    return next((float(f) for f in tried if distance(f) < THRESHOLDS.near), float(tried[-1]))
