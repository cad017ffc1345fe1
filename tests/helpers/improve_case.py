"""A small servo, its log and what a diagnosis would say of it, made by hand: no test waits for a diagnosis."""

import dataclasses
import functools

import numpy as np
from model_files import body
from numpy_machine import Machine, record

from fpjax import load_model
from fpjax.gap.answer.posterior import Posterior
from fpjax.improvement.from_diagnosis import Known

TRUE = Machine(inertia=0.05, coulomb=0.4, viscous=0.03, kp=1.5, ki=8.0)
LOOP = """
[controller]
type = "pi"
kp = 1.5
ki = 8.0
[simulation]
dt = 1e-3
duration = 1.5
stepping = "sampled"
solver = "exact"
"""
FORWARD = """\
[feedforward]
coulomb = 0.1
speed = 0.1
"""


@functools.cache
def log(seconds=1.5):
    """The true machine's closed loop under a sine that turns round."""
    time = 1e-3 * np.arange(round(seconds / 1e-3))
    return record(TRUE, seconds=seconds, reference=5.0 * np.sin(2.0 * np.pi * 1.3 * time), velocity_noise=5e-3)


def text(more="", *, inertia=0.05, coulomb=0.2):
    """The nominal model's file; its Coulomb level is half of the true one."""
    return body(inertia, coulomb, 0.03) + LOOP + more


def model(more="", **given):
    """The nominal model."""
    return load_model(text(more, **given))


def known(*, spread=0.01, missing=0.0, values=(0.05, 0.4, 0.03), verdict="explained", learned=(), seconds=1.5):
    """What a diagnosis would say.

    Args:
        spread: standard deviation of the three values, relative.
        missing: rms of the missing torque [N m].
        values: inertia, coulomb, viscous.
        verdict: of the diagnosis.
        learned: laws.
        seconds: of the log.
    """
    values = np.array(values)
    count = round(seconds / 1e-3)
    course = missing * np.sqrt(2.0) * np.sin(2.0 * np.pi * 3.1 * 1e-3 * np.arange(count))
    posterior = Posterior(
        key=("rigid", ()),
        names=("inertia", "coulomb", "viscous"),
        values=values,
        free=("inertia", "coulomb", "viscous"),
        covariance=np.diag((spread * values) ** 2),
        low=0.2 * values,
        high=5.0 * values,
        noise=(5e-3, 1e-5),
        missing=(course,),
    )
    return Known(posterior, verdict, ("coulomb_error",), missing, learned, True, corrected(), "")


def corrected():
    """The corrected model's text."""
    return text(coulomb=0.4)


def few(monkeypatch):
    """Searches of a few loops in place of thousands: the same paths in a second."""
    from fpjax.improvement import judge, search, verb

    monkeypatch.setattr(verb, "TUNED_ON", 4)
    monkeypatch.setattr(verb, "JUDGED_ON", 12)
    monkeypatch.setattr(verb, "MARGINED", 3)
    monkeypatch.setattr(judge, "LANES", 64)
    monkeypatch.setattr(search, "SCREENED", 12)
    monkeypatch.setattr(search, "CANDIDATES", 8)
    monkeypatch.setattr(search, "GENERATIONS", 3)


replace = dataclasses.replace
