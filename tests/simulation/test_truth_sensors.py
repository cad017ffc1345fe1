"""Sensors, fusion, anti-windup: against their statistics, an independent Kalman filter in numpy, and closed forms."""

import jax
import numpy as np
import pytest

import fpjax as fp

DT = 1e-3


def moving(sensor, samples=4000, key=0, reference=None):
    """A loop whose sensor moves nothing that matters: an open-loop torque turns the mass; signals as arrays."""
    loop = fp.ClosedLoop(fp.OneMass(1.0, fp.Viscous(1.0)), fp.TorqueInput(), sensor=sensor)
    run = fp.simulate(
        loop,
        reference or fp.Sine(1.0, 0.5),
        dt=DT,
        samples=samples,
        stepping="sampled",
        substeps=1,
        record=("velocity", "position", "measured_velocity", "measured_position"),
        key=jax.random.key(key),
    )
    return {name: np.asarray(values) for name, values in run.signals.items()}


def test_gyro_noise_bias_and_scale():
    samples = 20_000
    signals = moving(fp.Gyro(0.02, 0.05, 0.0, 1.01), samples)
    left = signals["measured_velocity"] - 1.01 * signals["velocity"]
    # Five standard errors of a mean and of a standard deviation.
    assert np.mean(left) == pytest.approx(0.05, abs=5 * 0.02 / np.sqrt(samples))
    assert np.std(left) == pytest.approx(0.02, rel=5 / np.sqrt(2 * samples))
    white = left - np.mean(left)
    # The correlation at lag one of white noise has the standard error sigma^2 / sqrt(n).
    assert abs(np.mean(white[1:] * white[:-1])) < 5 * 0.02**2 / np.sqrt(samples)


def test_gyro_random_walk_grows_with_the_root_of_time():
    walk, samples, runs = 0.1, 400, 400
    loop = fp.ClosedLoop(fp.OneMass(1.0, fp.Viscous(1.0)), fp.TorqueInput(), sensor=fp.Gyro(0.0, 0.0, walk))

    def drift(key):
        run = fp.simulate(
            loop,
            fp.Constant(0.0),
            dt=DT,
            samples=samples,
            stepping="sampled",
            record=("measured_velocity",),
            key=key,
        )
        return run.signals["measured_velocity"]

    readings = np.asarray(jax.vmap(drift)(jax.random.split(jax.random.key(1), runs)))
    for index in (100, 399):
        expected = walk * np.sqrt(index * DT)
        assert np.std(readings[:, index]) == pytest.approx(expected, rel=5 / np.sqrt(2 * runs))


def test_encoder_quantisation():
    step = 2e-3
    signals = moving(fp.Encoder(step))
    reading = signals["measured_position"]
    counts = reading / step
    np.testing.assert_allclose(counts, np.round(counts), atol=1e-9)
    error = reading - signals["position"]
    assert np.max(np.abs(error)) <= 0.5 * step * (1 + 1e-9)
    # A uniform error within half a step; the sine crosses few hundred steps, so that it is not exactly uniform.
    assert np.std(error) == pytest.approx(step / np.sqrt(12.0), rel=0.15)
    difference = np.diff(reading, prepend=reading[0]) / DT
    np.testing.assert_allclose(signals["measured_velocity"], difference, atol=1e-9)


def test_encoder_velocity_filter_is_a_first_order_low_pass():
    signals = moving(fp.Encoder(0.0, 0.0, 5e-3))
    difference = np.diff(signals["position"], prepend=signals["position"][0]) / DT
    share, velocity = DT / (DT + 5e-3), 0.0
    truth = []
    for value in difference:
        velocity += share * (value - velocity)
        truth.append(velocity)
    np.testing.assert_allclose(signals["measured_velocity"], truth, atol=1e-12)


GYRO = fp.Gyro(0.05, 0.2, 0.02)
FUSION = fp.KalmanFusion(GYRO, fp.Encoder(0.0, 1e-3), 1e-3)


def kalman(rates, readings):
    """The textbook filter: x = (angle, bias), F = [[1, -dt], [0, 1]], matrices and the Joseph form."""
    # Angle and bias: the angle grows by (rate - bias) dt; noise of the rate, 0.05, and of the bias, 0.02 a root second.
    transition = np.asarray([[1.0, -DT], [0.0, 1.0]])
    process = np.diag([(0.05 * DT) ** 2, 0.02**2 * DT])
    measurement, variance = np.asarray([[1.0, 0.0]]), 1e-6
    state, covariance = np.zeros(2), np.diag([1e-6, 1.0])
    states, covariances = [], []
    for rate, reading in zip(rates, readings, strict=True):
        innovation = (measurement @ covariance @ measurement.T).item() + variance
        gain = (covariance @ measurement.T / innovation).ravel()
        state = state + gain * (reading - state[0])
        left = np.eye(2) - np.outer(gain, measurement)
        covariance = left @ covariance @ left.T + variance * np.outer(gain, gain)
        states.append(state.copy())
        covariances.append(covariance.copy())
        state = transition @ state + np.asarray([DT * rate, 0.0])
        covariance = transition @ covariance @ transition.T + process
    return np.asarray(states), np.asarray(covariances)


def raw_readings(signals_of, key):
    """What the gyro and the encoder inside the fusion read, from the same normals."""
    channels = [np.asarray(jax.random.normal(jax.random.fold_in(jax.random.key(key), i), (4000,))) for i in range(3)]
    wander = np.concatenate([[0.0], np.cumsum(0.02 * np.sqrt(DT) * channels[1])[:-1]])
    rates = signals_of["velocity"] + 0.2 + wander + 0.05 * channels[0]
    return rates, signals_of["position"] + 1e-3 * channels[2], 0.2 + wander


def test_fusion_is_the_textbook_kalman_filter():
    signals = moving(FUSION)
    rates, readings, _ = raw_readings(signals, 0)
    states, _ = kalman(rates, readings)
    np.testing.assert_allclose(signals["measured_position"], states[:, 0], atol=1e-10)
    np.testing.assert_allclose(signals["measured_velocity"], rates - states[:, 1], atol=1e-9)


@pytest.mark.long  # thirty runs and their filters in numpy
def test_fusion_is_consistent():
    """Its errors are as large as its own covariance says: NEES of two states averages 2 (95 % band over 30 runs)."""
    runs, total = 30, 0.0
    for key in range(runs):
        signals = moving(FUSION, key=key)
        rates, readings, bias = raw_readings(signals, key)
        _, covariances = kalman(rates, readings)
        error = np.stack(
            [signals["position"] - signals["measured_position"], bias - (rates - signals["measured_velocity"])]
        )
        total += error[:, -1] @ np.linalg.solve(covariances[-1], error[:, -1])
    # Sum over runs is chi-squared with 60 degrees of freedom: 99.9 % band 32 to 99.6.
    assert 32.0 < total < 99.6


def test_fusion_beats_both_of_its_sensors():
    fused, gyro = moving(FUSION), moving(GYRO)
    encoder = moving(fp.Encoder(0.0, 1e-3, 5e-3))

    def error(signals):
        return np.sqrt(np.mean((signals["measured_velocity"] - signals["velocity"])[1000:] ** 2))

    assert error(fused) < 0.5 * error(gyro)
    assert error(fused) < 0.5 * error(encoder)
    angle = np.std((fused["measured_position"] - fused["position"])[1000:])
    assert angle < 0.5e-3  # the encoder's own is 1e-3


def windup(limited):
    """A step too large for the limit, then back: the velocity's overshoot [rad/s]."""
    controller = (
        fp.ProportionalIntegral(50.0, 500.0, 20.0, 0.02)
        if limited
        else fp.Limited(fp.ProportionalIntegral(50.0, 500.0), 20.0)
    )
    loop = fp.ClosedLoop(fp.OneMass(10.0, fp.Viscous(1.0)), controller)
    run = fp.simulate(loop, fp.Constant(2.0), dt=1e-3, duration=8.0, record=("velocity", "control"))
    control, velocity = np.asarray(run.signals["control"]), np.asarray(run.signals["velocity"])
    assert np.max(np.abs(control)) <= 20.0 + 1e-12
    assert np.sum(np.abs(control) > 19.999) > 100
    # 20 N m on 10 kg m^2 reach 2 rad/s in one second: the limit acts for a thousand samples.
    return np.max(velocity) - 2.0, velocity[-1]


def test_anti_windup():
    """Back-calculation keeps the integral near the limit; without it the overshoot is many times as large."""
    (with_it, end), (without, _) = windup(True), windup(False)
    assert with_it < 0.25 * without
    assert end == pytest.approx(2.0, abs=0.01)


def test_anti_windup_integral_settles_where_back_calculation_says():
    """Held at the limit with error e, the integral rests at limit - kp e + tracking_time ki e."""
    controller = fp.ProportionalIntegral(50.0, 500.0, 20.0, 0.02)
    loop = fp.ClosedLoop(fp.OneMass(1e9, fp.NoFriction()), controller)
    run = fp.simulate(loop, fp.Constant(2.0), dt=1e-3, duration=1.0)
    assert float(run.final_state.controller) == pytest.approx(20.0 - 50.0 * 2.0 + 0.02 * 500.0 * 2.0, rel=1e-6)


def test_anti_windup_is_silent_below_the_limit():
    free, limited = fp.ProportionalIntegral(50.0, 500.0), fp.ProportionalIntegral(50.0, 500.0, 1e4)
    ends = [
        fp.simulate(fp.ClosedLoop(fp.OneMass(10.0, fp.Viscous(1.0)), each), fp.Sine(1.0, 1.0), dt=1e-3, duration=1.0)
        for each in (free, limited)
    ]
    assert float(ends[0].final_state.plant.velocity) == pytest.approx(float(ends[1].final_state.plant.velocity), abs=0)
