"""Measures against numpy on the recorded trace, step information against python-control."""

import math

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from measures import MEASURES

import fpjax as fp


@pytest.fixture(scope="module")
def run():
    friction = fp.CoulombViscous(20.0, 2.0, steepness=200.0)
    observer = fp.ExtendedFriedlandPark(10.0, 100.0, 300.0, steepness=200.0)
    loop = fp.ClosedLoop(fp.OneMass(10.0, friction), fp.ProportionalIntegral(800.0, 8000.0), observer)
    measures = MEASURES | {
        "error": fp.EstimateError("coulomb", 20.0, start=0.5),
        "last": fp.EstimateFinal("coulomb"),
        "peak": fp.EstimatePeak("coulomb"),
        "settling": fp.SettlingTime("coulomb", 20.0, 0.05),
        "never": fp.SettlingTime("coulomb", 40.0, 0.05),
    }
    record = ("reference", "velocity", "torque", "friction", "compensation", "estimates.coulomb")
    return fp.simulate(loop, fp.Sine(1.0, 0.5), dt=1e-3, duration=2.0, measures=measures, record=record)


def test_measures_equal_numpy_on_the_trace(run):
    trace = {name: np.asarray(values) for name, values in run.signals.items()}
    error = trace["reference"] - trace["velocity"]
    coulomb, time = trace["estimates.coulomb"], np.asarray(run.time)
    outside = np.flatnonzero(np.abs(coulomb - 20.0) > 1.0)
    expected = {
        "mean": np.mean(np.abs(error)),
        "root": np.sqrt(np.mean(error**2)),
        "square": np.mean(error**2),
        "spread": np.std(error),
        "largest": np.max(np.abs(trace["friction"] - trace["compensation"])),
        "final": error[-1],
        "gradient": np.sqrt(np.mean(np.diff(error) ** 2)),
        "effort": np.sqrt(np.mean(trace["torque"] ** 2)),
        "torque": np.mean(np.abs((20.0 - coulomb) * np.sign(trace["velocity"]))),
        "error": np.mean(((coulomb - 20.0) / 20.0)[time >= 0.5] ** 2),
        "last": coulomb[-1],
        "peak": np.max(np.abs(coulomb)),
        "settling": time[outside[-1] + 1],
        "never": math.inf,
    }
    assert set(expected) == set(run.measures)
    for name, value in expected.items():
        np.testing.assert_allclose(run.measures[name], value, rtol=1e-9, err_msg=name)


def test_gradient_of_a_measure_is_finite(run):
    del run

    def cost(gain):
        loop = fp.ClosedLoop(fp.OneMass(10.0, fp.SmoothCoulomb(20.0, 200.0)), fp.Proportional(gain))
        return fp.simulate(loop, fp.Sine(1.0, 1.0), dt=1e-3, samples=200, measures={"m": fp.MeanSquare()}).measures["m"]

    assert jnp.isfinite(jax.grad(cost)(jnp.asarray(500.0)))


@pytest.mark.parametrize("damping", [0.2, 0.5, 0.9, 2.0])
def test_step_info_agrees_with_python_control(damping):
    control = pytest.importorskip("control", reason="python-control is an extra: pip install fpjax[control]")
    system = control.tf([4.0], [1.0, 4.0 * damping, 4.0])
    time = np.linspace(0.0, 40.0 * max(1.0, damping), 20001)
    time, response = control.step_response(system, time)
    theirs = control.step_info(response, T=time, yfinal=1.0)
    ours = fp.step_info(time, response, final_value=1.0)
    for name in ("RiseTime", "SettlingTime", "PeakTime", "Overshoot", "Undershoot", "Peak"):
        if name == "PeakTime" and theirs["Overshoot"] < 1e-9:
            continue  # no peak to speak of
        assert ours[name] == pytest.approx(theirs[name], rel=1e-3, abs=2.0 * (time[1] - time[0])), name


def test_step_info_is_nan_where_undefined():
    info = fp.step_info([0.0, 1.0, 2.0], [0.0, 0.0, 0.0])
    assert all(math.isnan(value) for value in info.values())
