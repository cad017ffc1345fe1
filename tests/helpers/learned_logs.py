"""Logs of a mass under a held torque and one more law; and the engine's fit of the nominal model."""

from types import SimpleNamespace

import gap_search
import numpy as np
from model_files import body
from numpy_machine import Machine, record

INERTIA, VISCOUS, DT = 0.05, 0.02, 1e-3
MODEL = body(INERTIA, 0.0, VISCOUS) + gap_search.RUN


def drive(law, *, seconds=10.0, seed=0, noise=2e-3, push=None, encoder=False, drift=0.0):
    """A log of a mass that follows two sines; `law(velocity, position, torque, time)` opposes it.

    Args:
        law: its torque [N m].
        seconds: length of the log.
        seed: of the noise.
        noise: of the velocity [rad/s].
        push: (from [s], to [s], torque [N m]) that nobody recorded.
        encoder: a position column instead of a rate.
        drift: mean speed of the reference [rad/s].
    """
    time = DT * np.arange(round(seconds / DT))

    def extra(at, velocity, position, torque):
        pushed = push[2] if push is not None and push[0] <= at < push[1] else 0.0
        return pushed - law(velocity, position, torque, at)

    return record(
        Machine(INERTIA, coulomb=0.0, viscous=VISCOUS, kp=0.5, ki=0.0),
        seconds=seconds,
        extra=extra,
        velocity_noise=noise,
        position_noise=2e-5,
        seed=seed,
        reference=3.0 * np.sin(2.1 * time) + 1.5 * np.sin(5.3 * time + 0.4) + drift,
        feedforward=INERTIA * (6.3 * np.cos(2.1 * time) + 7.95 * np.cos(5.3 * time + 0.4)),
        sensors=("position",) if encoder else ("velocity",),
        substeps=8,
    )


def searched(log):
    """(search, the nominal model as given, finished)."""
    search = gap_search.search_of(log, MODEL)
    return SimpleNamespace(search=search, fit=search.finish([search.exact])[0])
