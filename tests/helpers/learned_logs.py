"""Logs of a mass under a held torque and one more law, by numpy alone; and the engine's fit of the nominal model."""

from types import SimpleNamespace

import numpy as np

from fpjax.gap.data.record import make_records
from fpjax.gap.data.setting import make_setting
from fpjax.gap.effects.vocabulary import EFFECTS
from fpjax.gap.fit.search import Search
from fpjax.gap.simulate.family import Nominal
from fpjax.logs import Log
from fpjax.model_file import load_model

INERTIA, VISCOUS, DT = 0.05, 0.02, 1e-3
SUBSTEPS = 8
MODEL = """[plant]
type = "one_mass"
inertia = 0.05
[friction]
type = "coulomb_viscous"
coulomb = 0.0
viscous = 0.02
[controller]
type = "unknown"
[simulation]
dt = 1e-3
"""


def drive(law, *, seconds=10.0, seed=0, noise=2e-3, push=None, encoder=False, drift=0.0):
    """A log of a mass that follows two sines; `law(velocity, position, torque, time)` opposes it.

    Args:
        push: (from [s], to [s], torque [N m]) that nobody recorded.
        encoder: a position column instead of a rate.
        drift: mean speed of the reference [rad/s].
    """
    random = np.random.default_rng(seed)
    count = round(seconds / DT)
    time = DT * np.arange(count)
    speed, angle, u = np.zeros(count), np.zeros(count), np.zeros(count)
    v = x = 0.0
    h = DT / SUBSTEPS
    for k in range(count):
        t = time[k]
        wanted = 3.0 * np.sin(2.1 * t) + 1.5 * np.sin(5.3 * t + 0.4) + drift
        slope = 6.3 * np.cos(2.1 * t) + 7.95 * np.cos(5.3 * t + 0.4)
        speed[k], angle[k] = v, x
        u[k] = INERTIA * slope + 0.5 * (wanted - v - noise * random.standard_normal())
        extra = push[2] if push is not None and push[0] <= t < push[1] else 0.0
        for i in range(SUBSTEPS):
            middle = v + 0.5 * h * (u[k] - VISCOUS * v - law(v, x, u[k], t + i * h) + extra) / INERTIA
            at = (middle, x + 0.5 * h * v, u[k], t + (i + 0.5) * h)
            v, x = v + h * (u[k] - VISCOUS * middle - law(*at) + extra) / INERTIA, x + h * middle
    velocity = None if encoder else speed + noise * random.standard_normal(count)
    position = angle + 2e-5 * random.standard_normal(count) if encoder else None
    return Log(time=time, torque=u, velocity=velocity, position=position, reference=None, dt=DT, name="log")


def searched(log):
    """(search, the nominal model as given, finished)."""
    model = load_model(MODEL)
    records = make_records([log], [], INERTIA)
    setting = make_setting(records, model)
    loop = model.loop
    search = Search(records, Nominal(loop.plant, loop.actuator, loop.sensor), EFFECTS, setting)
    return SimpleNamespace(search=search, fit=search.finish([search.exact])[0])
