"""A controller's limit holds for the torque that leaves it, the observer's compensation included."""

import numpy as np
import pytest
from model_files import body

import fpjax as fp

LIMIT = 22.0
RECORD = ("control", "compensation", "torque", "applied", "reference", "velocity")
CONTROLLERS = {
    "pi": lambda limit: fp.ProportionalIntegral(200.0, 2000.0, limit=limit),
    "limited p": lambda limit: fp.Proportional(200.0) if limit is None else fp.Limited(fp.Proportional(200.0), limit),
}


def run(limit, stepping, controller="pi", observer=True, dt=1e-3, reference=None):
    law = fp.CoulombViscous(20.0, 2.0, steepness=50.0)
    loop = fp.ClosedLoop(
        fp.OneMass(10.0, law),
        CONTROLLERS[controller](limit),
        fp.ExtendedFriedlandPark(10.0, 100.0, 30.0, steepness=50.0) if observer else fp.NoObserver(),
    )
    return fp.simulate(
        loop, reference or fp.Square(1.0, 0.5), dt=dt, duration=4.0, stepping=stepping, record=RECORD, throw=True
    )


@pytest.mark.parametrize("stepping", [pytest.param("continuous", marks=pytest.mark.long), "sampled"])
@pytest.mark.parametrize("controller", CONTROLLERS)
def test_no_torque_beyond_the_limit_leaves(stepping, controller):
    free = run(None, stepping, controller).signals
    bound = run(LIMIT, stepping, controller).signals
    assert np.abs(free["torque"]).max() > 2.0 * LIMIT
    assert np.abs(free["compensation"]).max() > 0.5 * LIMIT  # it alone fills most of the limit
    for name in ("torque", "applied"):
        assert np.abs(bound[name]).max() <= LIMIT
    assert np.abs(bound["torque"]).max() == LIMIT
    np.testing.assert_allclose(bound["control"] + bound["compensation"], bound["torque"], rtol=1e-12, atol=1e-12)


@pytest.mark.parametrize("stepping", ["continuous", "sampled"])
def test_a_limit_that_is_never_reached_changes_nothing(stepping):
    free, bound = run(None, stepping).signals, run(1e6, stepping).signals
    for name in RECORD:
        np.testing.assert_allclose(bound[name], free[name], rtol=1e-12, atol=1e-12, err_msg=name)


@pytest.mark.parametrize("stepping", ["continuous", "sampled"])
def test_the_anti_windup_sees_the_compensation(stepping):
    """Saturated for two seconds, the integral follows what the limit leaves of it: it does not go on integrating."""
    step = fp.Square(1.0, 0.25)
    wound = run(LIMIT, stepping, reference=step)
    integral = np.asarray(wound.final_state.controller)
    # Without anti-windup it would hold ki x the error's integral, some thousand N m.
    assert np.abs(integral) < 200.0
    error = np.asarray(wound.signals["reference"] - wound.signals["velocity"])
    assert np.abs(error).max() > 1.0


def test_a_limit_in_the_model_file_holds_with_an_observer():
    text = (
        body(0.1, 0.4, 0.02)
        + """
[controller]
type = "pi"
kp = 10.0
ki = 50.0
limit = 0.5
[observer]
type = "efp"
gain_1 = 1.0
gain_2 = 5.0
[reference]
type = "sine"
amplitude = 5.0
frequency = 1.0
[simulation]
dt = 1e-3
duration = 2.0
stepping = "sampled"
"""
    )
    from fpjax.model_file import load_model

    model = load_model(text)
    found = fp.simulate(
        model.loop, model.needed_reference(), dt=model.dt, duration=2.0, stepping="sampled", record=("applied",)
    )
    assert np.abs(found.signals["applied"]).max() <= 0.5
