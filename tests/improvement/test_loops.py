"""improve around other loops: an observer's gains, and a position cascade."""

import dataclasses

import improve_case as case
import numpy as np
import pytest

import fpjax as fp
from fpjax.improvement.verb import followed, improve_known
from fpjax.output.stages import StageClock

pytestmark = pytest.mark.long
OBSERVER = '[observer]\ntype = "efp"\n'  # its gains by pole placement
MODEL = case.text(inertia="{inertia}", coulomb="{coulomb}")  # both numbers to be filled in
CASCADE = '[units]\nreference = "position"\nsensors = "both"\n' + MODEL.replace(
    'type = "pi"\nkp = 1.5\nki = 8.0', 'type = "position_cascade"\nkp = 15.0\nkv = 1.5\nki = 8.0'
)
SINE = '[reference]\ntype = "sine"\namplitude = {amplitude}\nfrequency = 1.3\n'


def simulated(text, amplitude):
    """A log of the true machine under this model's loop, and the nominal model, whose friction is half of it."""
    true = fp.load_model(text.format(inertia=0.05, coulomb=0.4) + SINE.format(amplitude=amplitude))
    run = fp.simulate(true, samples=1500)
    noise = np.random.default_rng(5).standard_normal((2, 1500))
    names = ("torque", "measured_velocity", "measured_position", "reference")
    torque, velocity, position, reference = (np.asarray(run.signals[name]) for name in names)
    log = fp.Log(
        1e-3 * np.arange(1500), torque, velocity + 5e-3 * noise[0], position + 1e-5 * noise[1], reference, 1e-3, "made"
    )
    return log, fp.load_model(text.format(inertia=0.05, coulomb=0.2) + SINE.format(amplitude=amplitude))


@pytest.fixture(autouse=True)
def small(monkeypatch):
    case.few(monkeypatch)


def test_an_observers_gains_and_inertia_are_tuned():
    log, model = simulated(MODEL + OBSERVER, 5.0)
    corrected = (MODEL + OBSERVER).format(inertia=0.05, coulomb=0.4) + SINE.format(amplitude=5.0)
    known = dataclasses.replace(case.known(), model=corrected)
    found = improve_known(known, log, model, followed(log, model, "log"), [], 0, StageClock(None), None, None)
    assert {change.gain for change in found.changes} == {"observer.gain_1", "observer.gain_2", "observer.inertia"}
    assert found.before.unstable == 0.0
    assert found.measured == pytest.approx(found.before.error.value, rel=0.05)
    if found.decision == "change":
        assert "efp" in found.model


def test_a_position_cascade_is_judged_by_its_position():
    log, model = simulated(CASCADE, 0.6)
    known = dataclasses.replace(case.known(), model=CASCADE.format(inertia=0.05, coulomb=0.4))
    table = followed(log, model, "log")
    found = improve_known(known, log, model, table, ["controller"], 0, StageClock(None), None, None)
    assert found.signal == "position"
    assert found.before.error.unit == "rad"
    assert found.measured == pytest.approx(found.before.error.value, rel=0.05)
    assert found.decision == "change"
    assert {change.gain for change in found.changes} == {"controller.kp", "controller.kv", "controller.ki"}
    assert set(found.after.margins) == {"modulus", "gain", "phase", "delay"}


def test_a_position_cascade_is_given_a_feedforward():
    log, model = simulated(CASCADE, 0.6)
    known = dataclasses.replace(case.known(), model=CASCADE.format(inertia=0.05, coulomb=0.4))
    table = followed(log, model, "log")
    found = improve_known(known, log, model, table, ["feedforward"], 0, StageClock(None), None, None)
    assert {change.gain for change in found.changes} == {
        "feedforward.velocity", "feedforward.inertia", "feedforward.coulomb", "feedforward.viscous",
    }  # fmt: skip
    assert found.decision == "change"
    # A cascade lags by v / kp; told the rate, it does not.
    assert found.after.error.value < 0.2 * found.before.error.value
    again = fp.load_model(found.model)
    assert isinstance(again.loop.controller, fp.PositionFeedforward)
    assert float(again.loop.controller.velocity) == pytest.approx(1.0, abs=0.2)
