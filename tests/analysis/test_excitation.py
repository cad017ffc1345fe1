"""Error dynamics, slow modes and persistent excitation, against the simulator and against closed forms."""

import math

import numpy as np
import pytest
from model_files import LARGE_BODY

import fpjax as fp
from fpjax.analysis.excitation import error_matrix, pole
from fpjax.cli import main

DEGREE = math.pi / 180.0
INERTIA = 10.0 * DEGREE  # the thesis' loop runs in deg/s
TRUTH = {"coulomb": 20.0, "viscous": 2.0 * DEGREE}
# One period of 1 Hz.
TIME = np.arange(0.0, 1.0, 1e-4)
SINE = np.sin(2.0 * np.pi * TIME)


def efp(gain_1, gain_2, steepness=None):
    return fp.ExtendedFriedlandPark(INERTIA, gain_1 * DEGREE, gain_2, steepness)


@pytest.mark.parametrize(
    ("gain_2", "gain_1", "printed"), [(72.6, 298.0, 316.0), (10.0, 5e4, 1.7)], ids=["thesis", "fast"]
)
def test_slow_mode_at_the_thesis_gains(gain_2, gain_1, printed):
    """The time constants that an independent program found: 316 s, and 1.7 s where it is fast."""
    report = fp.assess_excitation(efp(gain_1, gain_2), SINE, 1e-4, TRUTH, duration=0.5)
    assert report.slow_mode == pytest.approx(printed, rel=0.02)
    assert not report.converges
    assert any(
        said.startswith("the viscous estimate (b_hat) cannot converge here: slow mode") for said in report.sentences
    )


def test_fast_gains_converge_in_half_a_minute_and_say_nothing():
    report = fp.assess_excitation(efp(5e4, 10.0), SINE, 1e-4, TRUTH, duration=30.0)
    assert report.converges
    assert report.sentences == ()


def test_a_constant_reference_is_not_persistently_exciting():
    report = fp.assess_excitation(efp(298.0, 72.6), np.ones_like(TIME), 1e-4, TRUTH, duration=100.0)
    assert report.smallest_eigenvalue < 1e-12
    assert math.isinf(report.slow_mode)
    assert not report.converges
    assert "infinite" in report.sentences[-1]


def test_gram_matrix_of_a_sine_is_the_closed_form():
    """Means over a period of sign^2 = 1, sign x sin = 2/pi, sin^2 = 1/2; scaled: 1 - sqrt(8)/pi."""
    report = fp.assess_excitation(efp(298.0, 72.6), SINE, 1e-4, TRUTH)
    # sign(0) = 0 at two of 10,000 samples.
    np.testing.assert_allclose(report.gram, [[1.0, 2.0 / math.pi], [2.0 / math.pi, 0.5]], atol=3e-4)
    assert report.smallest_eigenvalue == pytest.approx(1.0 - math.sqrt(8.0) / math.pi, abs=3e-4)
    gains = np.asarray([[72.6], [298.0 * DEGREE]])
    np.testing.assert_allclose(report.averaged, -gains * report.gram / INERTIA, rtol=1e-12)


@pytest.mark.parametrize(
    ("observer", "expected"),
    [
        (fp.ClassicalFriedlandPark(10.0, fp.Absolute(5.0)), -0.5),
        (fp.ClassicalFriedlandPark(10.0, fp.Quadratic(5.0)), -1.0),
        (fp.ModifiedFriedlandPark(10.0, fp.LogCosh(5.0, 100.0), 2.0), -0.5),
        (fp.NovelFriedlandPark(10.0, fp.Quadratic(5.0)), -2.0),
        (fp.SteepnessObserver(10.0, fp.Absolute(5.0), 20.0), -0.5 * 20.0 * 2.0 / math.cosh(0.2) ** 2),
    ],
    ids=["cfp_g2", "cfp_g1", "mfp_g3", "nfp_g1", "steepness_g2"],
)
def test_poles_of_one_parameter(observer, expected):
    """At w = 2 (4.13), (4.39); the averaged and the exact time constant are the pole's where w is constant."""
    parameters = {"coulomb": 20.0, "viscous": 2.0, "steepness": 0.1}
    assert pole(observer, 2.0, parameters) == pytest.approx(expected, rel=1e-12)
    report = fp.assess_excitation(observer, np.full(1000, 2.0), 1e-2, parameters)
    assert report.slow_mode == pytest.approx(-1.0 / expected, rel=1e-9)
    assert report.averaged_time_constants[0] == pytest.approx(-1.0 / expected, rel=1e-9)


def test_pole_of_several_parameters_and_an_observer_of_none_are_refused():
    with pytest.raises(fp.InputError, match="single"):
        pole(efp(1.0, 1.0), 1.0, TRUTH)
    with pytest.raises(fp.InputError, match="estimates nothing"):
        fp.assess_excitation(fp.NoObserver(), SINE, 1e-4, TRUTH)
    with pytest.raises(fp.InputError, match="viscous"):
        fp.assess_excitation(efp(1.0, 1.0), SINE, 1e-4, {"coulomb": 20.0})
    with pytest.raises(fp.InputError, match="finite"):
        fp.assess_excitation(efp(1.0, 1.0), [1.0, float("nan")], 1e-4, TRUTH)


def test_high_order_observer_is_judged_as_the_one_it_wraps():
    inner = fp.ExtendedFriedlandPark(10.0, 298.0, 72.6, 40.0)
    outer = fp.HighOrderFeedforward(inner, 4.0, 6.0, 1e5, 50.0)
    np.testing.assert_array_equal(error_matrix(outer, SINE[:9], TRUTH), error_matrix(inner, SINE[:9], TRUTH))


def propagated(observer, velocity, dt, error):
    """The errors that (4.12) predicts along a motion, shape (samples, 2), from one error at its start."""
    middle = 0.5 * (velocity[1:] + velocity[:-1])
    matrices = np.asarray(error_matrix(observer, middle, TRUTH))
    # of rank one, so exp(A dt) = I + A (exp(tr(A) dt) - 1) / tr(A)
    trace = np.trace(matrices, axis1=1, axis2=2)
    safe = np.where(trace == 0.0, 1.0, trace)
    factors = np.where(trace == 0.0, dt, np.expm1(safe * dt) / safe)
    errors = [error]
    for matrix, factor in zip(matrices, factors, strict=True):
        errors.append(errors[-1] + factor * (matrix @ errors[-1]))
    return np.stack(errors)


def deviation(steepness, dt):
    """Largest deviation of the simulated estimate errors from e' = -(1/J) s phi^T e, over the largest error."""
    observer = efp(298.0, 72.6, steepness)
    plant = fp.OneMass(INERTIA, fp.CoulombViscous(*TRUTH.values(), steepness))
    loop = fp.ClosedLoop(plant, fp.ProportionalIntegral(150.0, 200.0), observer)
    record = ("velocity", "estimates.coulomb", "estimates.viscous")
    run = fp.simulate(loop, fp.Sine(1.0, 1.0), dt=dt, duration=0.5, record=record)
    errors = np.stack([value - run.signals[f"estimates.{name}"] for name, value in TRUTH.items()], axis=1)
    predicted = propagated(observer, run.signals["velocity"], dt, errors[0])
    return np.max(np.abs(predicted - errors) / np.max(np.abs(errors), axis=0))


@pytest.mark.parametrize(("dt", "bound"), [(1e-4, 3e-3), (1e-5, 1e-5)])
def test_error_dynamics_hold_for_the_smooth_law(dt, bound):
    assert deviation(150.0, dt) < bound


def test_error_dynamics_do_not_hold_for_sign_because_the_mass_sticks():
    assert deviation(None, 1e-5) > 0.5


def test_sticking_rate_is_the_one_of_the_chattering_loop():
    """While the mass sticks under sign and |w|, k_hat grows by (alpha/J) u^2 / (k - k_hat)."""
    observer = fp.ClassicalFriedlandPark(10.0, fp.Absolute(100.0))
    loop = fp.ClosedLoop(fp.OneMass(10.0, fp.Coulomb(20.0)), fp.ProportionalIntegral(1.0, 0.0), observer)
    record = ("control", "estimates.coulomb", "velocity")
    run = fp.simulate(loop, fp.Constant(5.0), dt=1e-5, duration=0.5, solver="euler", record=record)
    estimate, control = np.asarray(run.signals["estimates.coulomb"]), np.asarray(run.signals["control"])
    # After the start, and before the estimate reaches k: the mass sticks all the time.
    stuck = slice(5000, 30000)
    assert np.max(np.abs(run.signals["velocity"][stuck])) < 1e-3
    measured = (estimate[stuck][-1] - estimate[stuck][0]) / (25000 - 1) / 1e-5
    predicted = np.mean(100.0 / 10.0 * control[stuck] ** 2 / (20.0 - estimate[stuck]))
    assert measured == pytest.approx(predicted, rel=0.02)


def test_simulate_says_which_estimates_cannot_converge(tmp_path, capsys):
    """The same sentence as `tune` and `estimate`, from the run's own motion."""
    text = (
        LARGE_BODY + 'steepness = 50.0\n[controller]\ntype = "pi"\nkp = 150.0\nki = 200.0\n'
        '[observer]\ntype = "efp"\ngain_1 = 2000.0\ngain_2 = 2000.0\n[reference]\ntype = "sine"\namplitude = 1.0\n'
        "frequency = 1.0\n[simulation]\ndt = 1e-3\nduration = {}\n"
    )
    said = {}
    for name, duration in (("short", 4.0), ("long", 100.0)):
        (tmp_path / f"{name}.toml").write_text(text.format(duration))
        assert main(["simulate", str(tmp_path / f"{name}.toml"), "--no-cache"]) == 0
        said[name] = capsys.readouterr().err
    assert "(b_hat) cannot converge here" in said["short"]
    assert "cannot converge" not in said["long"]
