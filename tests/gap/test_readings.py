"""What the encoder tells of the velocity column beside it, and how well it knows where it was."""

import dataclasses

import gap_search
import numpy as np
import numpy_machine
import pytest

from fpjax import Log, diagnose
from fpjax.gap.data.record import make_records
from fpjax.gap.select.readings import LATE, material, readings, sure_readings
from fpjax.gap.thresholds import THRESHOLDS


def turning(*, scale=1.0, bias=0.0, jitter=0.0, noise=1e-5, seconds=20.0, dt=1e-3, seed=0):
    """A machine that turns one way at a varying speed, its velocity column, and an encoder read off its stamps."""
    rng = np.random.default_rng(seed)
    time = np.arange(0.0, seconds, dt)

    def angle(at):
        return 5.0 * at - 0.3 * np.cos(2.0 * np.pi * 0.7 * at) - 0.02 * np.cos(2.0 * np.pi * 9.0 * at)

    def speed(at):
        slow, fast = 0.7 * 2.0 * np.pi, 9.0 * 2.0 * np.pi
        return 5.0 + 0.3 * slow * np.sin(slow * at) + 0.02 * fast * np.sin(fast * at)

    position = angle(time + jitter * rng.standard_normal(time.size)) + noise * rng.standard_normal(time.size)
    velocity = scale * speed(time) + bias + 1e-3 * rng.standard_normal(time.size)
    torque = 0.2 * np.sign(speed(time)) + 0.01 * np.gradient(speed(time), dt)
    return Log(time, torque, velocity, position, None, dt, "turning")


def told(log):
    (one,) = make_records([log], [], 0.01)
    return {found.effect: found for found in readings(one, 0.01)}


def test_a_bias_and_a_scale_are_found_where_the_machine_turns_one_way():
    found = told(turning(scale=0.93, bias=0.4))
    # Scale and bias trade off where the speed hardly changes (5 +- 1.3 rad/s): 0.01 of scale is 0.05 rad/s of bias.
    assert found["velocity_scale_error"].values["scale"][0] == pytest.approx(0.93, abs=0.01)
    assert found["velocity_bias"].values["bias"][0] == pytest.approx(0.4, abs=0.06)


def test_what_an_observer_would_take_a_late_velocity_for_is_told_as_far_as_it_moves_the_machine():
    """J late d2v/dt2, the 9 Hz ripple of the speed among the frequencies that move this machine."""
    log, late = turning(noise=1e-7), 3e-3
    reading = np.interp(log.time - late, log.time, log.velocity)
    one = told(dataclasses.replace(log, velocity=reading))["velocity_delay"]
    assert one.values["delay"][0] == pytest.approx(late, abs=1e-4)
    slow, fast = 2.0 * np.pi * 0.7, 2.0 * np.pi * 9.0
    # Amplitudes of the speed are 0.3 slow and 0.02 fast; 9 Hz holds a third of the power and is the highest frequency.
    jerk = np.hypot(0.3 * slow**3, 0.02 * fast**3 / np.sqrt(2.0)) / np.sqrt(2.0)
    assert one.torque == pytest.approx(0.01 * late * jerk, rel=0.1)


def test_noise_of_the_encoder_is_no_bias_of_the_velocity():
    """A regression on a noisy rate is too flat, its offset passes for a bias where the machine turns one way."""
    log = turning()
    noise = 4e-2 * np.random.default_rng(1).standard_normal(log.time.size)
    found = told(dataclasses.replace(log, torque=2e4 * log.torque, position=log.position + noise))
    assert abs(found["velocity_bias"].values["bias"][0]) < 0.02
    assert found["velocity_scale_error"].values["scale"][0] == pytest.approx(1.0, abs=0.01)


def test_an_encoder_that_is_read_off_its_stamps_knows_its_place_no_better_than_the_way_in_between():
    """At rest it is quiet, and rest is most of this log."""
    rng, dt = np.random.default_rng(2), 1e-3
    time = np.arange(0.0, 20.0, dt)
    speed = np.where(time % 5.0 < 1.0, 20.0 * np.sin(np.pi * (time % 5.0)) ** 2, 0.0)
    late = 2e-4 * rng.standard_normal(time.size)
    exact = dt * np.cumsum(speed)
    velocity = speed + 1e-3 * rng.standard_normal(time.size)
    noise = []
    for off in (0.0 * late, late):
        position = exact + off * speed + 1e-5 * rng.standard_normal(time.size)
        log = Log(time, 50.0 * np.sign(np.gradient(speed)), velocity, position, None, dt, "resting")
        (one,) = make_records([log], [], 0.01)
        noise.append(one.position.noise)
    assert noise[0] < 5e-5
    # Position error = speed x jitter of the stamps.
    assert noise[1] == pytest.approx(2e-4 * np.sqrt(np.mean(speed**2)), rel=0.4)


def test_beside_positions_that_are_read_off_their_stamps_the_velocity_is_fitted_too():
    """A bus that is busy now and then: a few readings come half a period late, which no white noise stands for."""
    rng, dt = np.random.default_rng(4), 1e-3
    time = np.arange(0.0, 20.0, dt)
    busy = rng.random(time.size) < 0.05
    late = np.where(busy, 5e-4, 2e-5 * rng.standard_normal(time.size))
    speed = 20.0 * np.sin(np.pi * time)
    kept = []
    for off in (0.0 * late, late):
        position = -20.0 / np.pi * np.cos(np.pi * (time - off)) + 1e-5 * rng.standard_normal(time.size)
        velocity = speed + 1e-3 * rng.standard_normal(time.size)
        (one,) = make_records([Log(time, np.sign(speed), velocity, position, None, dt, "busy")], [], 0.01)
        kept.append(one)
    exact, jittered = kept
    assert (exact.velocity is None, jittered.velocity is None) == (True, False)
    assert jittered.position.noise == pytest.approx(np.sqrt(np.mean(late**2) * np.mean(speed**2)), rel=0.3)


@pytest.mark.parametrize(("rows", "cause"), [(3, False), (12, True), (40, True)])
def test_a_filter_of_the_encoders_own_derivative_is_told_where_it_is_longer_than_one_needs(rows, cause):
    log = turning(noise=0.0)
    position = 1e-5 * np.round(log.position / 1e-5)
    read = np.gradient(position, log.dt)
    for k in range(1, len(read)):
        read[k] = read[k - 1] + (read[k] - read[k - 1]) / (1.0 + rows)
    found = told(dataclasses.replace(log, position=position, velocity=read))
    assert set(found) == ({"velocity_lag"} if cause else set())
    if cause:
        assert found["velocity_lag"].values["time_constant"][0] == pytest.approx(rows * log.dt, rel=0.06)


def test_a_filter_of_another_form_is_no_error_of_the_scale():
    """Two lags and a dead time take more off a ripple than one of them: no scale and no bias of a steady speed."""
    log = turning()
    ripple = 3.0 * np.sin(2.0 * np.pi * 50.0 * log.time)
    position = log.position - 3.0 / (2.0 * np.pi * 50.0) * np.cos(2.0 * np.pi * 50.0 * log.time)
    read = np.interp(log.time - 1e-3, log.time, log.velocity + ripple)
    for _ in range(2):
        for k in range(1, len(read)):
            read[k] = read[k - 1] + (read[k] - read[k - 1]) / 2.0
    (one,) = make_records([dataclasses.replace(log, position=position, velocity=read)], [], 0.01)
    late, *others = material(sure_readings([one], 0.01))
    assert late.effect in LATE
    assert others == []


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("scale", [1.0, 1.05])
def test_the_scale_of_a_late_velocity_is_told_from_a_sine_of_one_frequency(scale, seed):
    """Averages over whole periods of it tell nothing of a scale."""
    rng, time, turning = np.random.default_rng(seed), 1e-3 * np.arange(20_000), 2.0 * np.pi / 0.32
    lag = 5e-3
    position = -5.0 / turning * np.cos(turning * time) + 1e-6 * rng.standard_normal(time.size)
    late = (np.sin(turning * time) - turning * lag * np.cos(turning * time)) / (1.0 + (turning * lag) ** 2)
    velocity = scale * 5.0 * late + 1e-4 * rng.standard_normal(time.size)
    found = told(Log(time, np.sign(velocity), velocity, position, None, 1e-3, "one sine"))
    assert found["velocity_lag"].values["time_constant"][0] == pytest.approx(lag, rel=0.02)
    value, deviation, _ = found["velocity_scale_error"].values["scale"]
    assert value == pytest.approx(scale, abs=1e-3)
    assert deviation < 5e-3


def test_of_a_velocity_later_than_all_that_is_tried_it_is_not_known_how_late():
    log = turning(noise=0.0)
    position = 1e-5 * np.round(log.position / 1e-5)
    read = np.gradient(position, log.dt)
    for k in range(1, len(read)):
        read[k] = read[k - 1] + (read[k] - read[k - 1]) / 201.0
    found = told(dataclasses.replace(log, position=position, velocity=read))
    value, deviation, _ = found["velocity_lag"].values["time_constant"]
    assert abs(value - 0.2) < deviation


@pytest.mark.parametrize("factor", [-1.0, 1.0 / 6.33, 57.3])
def test_a_column_in_another_unit_is_not_fitted_and_its_factor_is_told(factor):
    """However short the log, and also where the drive derived the column from the encoder."""
    short = turning(noise=1e-3, seconds=1.5, dt=2e-3)
    for velocity in (short.velocity, np.gradient(short.position, short.dt)):
        log = dataclasses.replace(short, velocity=factor * velocity)
        (one,) = make_records([log], [], 0.01)
        assert one.velocity is None
        (found,) = readings(one, 0.01)
        scale, deviation, _ = found.values["scale"]
        assert found.effect == "velocity_scale_error"
        assert not found.of_sensor  # the drive's loop did not see the logger's unit
        assert scale == pytest.approx(factor, rel=0.05)
        assert abs(scale - factor) < 4.0 * deviation


def test_of_several_logs_the_velocity_of_none_is_fitted_where_that_of_one_is_turned_round():
    right = turning(noise=1e-3, seconds=4.0, dt=2e-3)
    turned = dataclasses.replace(right, velocity=-right.velocity)
    for logs in ([right, turned], [turned, right]):
        assert [one.velocity for one in make_records(logs, [], 0.01)] == [None, None]
        (found,) = sure_readings(make_records(logs, [], 0.01), 0.01)
        assert found.values["scale"][0] == pytest.approx(-1.0, rel=0.05)


def test_what_is_below_a_thousandth_of_the_speed_is_the_differentiators():
    (one,) = make_records([turning(scale=1.0 + 2e-4, noise=1e-7)], [], 0.01)
    assert any(found.evidence > THRESHOLDS.decisive for found in readings(one, 0.01))
    assert sure_readings([one], 0.01) == ()


@pytest.mark.parametrize(("scale", "cause"), [(1.02, True), (1.005, False)])
def test_an_error_of_a_hundredth_of_the_speed_is_a_cause_however_little_torque_it_would_be(scale, cause):
    (one,) = make_records([turning(scale=scale)], [], 0.01)
    sure = sure_readings([one], 1e-9)
    assert any(found.effect == "velocity_scale_error" for found in sure)
    assert any(found.effect == "velocity_scale_error" for found in material(sure)) == cause


@pytest.mark.long  # a diagnosis each
@pytest.mark.parametrize("scale", [1.003, 1.02])
def test_a_scale_of_a_hundredth_is_told_where_nothing_is_missing_and_a_slighter_one_is_a_warning(scale):
    log = numpy_machine.record()
    found = diagnose(dataclasses.replace(log, velocity=scale * log.velocity), gap_search.MODEL)
    warned = any("velocity_scale_error" in warning for warning in found.warnings)
    if scale < 1.0 + THRESHOLDS.reading:
        assert (found.verdict, found.causes, warned) == ("no_gap", (), True)
        return
    assert (found.verdict, found.causes, warned) == ("explained", ("velocity_scale_error",), False)
    assert found.ranking[0].parameters["scale"].value == pytest.approx(scale, rel=1e-3)
    assert found.only_misread


@pytest.mark.long
def test_a_slightly_late_velocity_is_told_with_its_twin():
    log = numpy_machine.record()
    reading = np.interp(log.time - 8e-4, log.time, log.velocity)
    found = diagnose(dataclasses.replace(log, velocity=reading), gap_search.MODEL)
    assert not any("fitted windows alone" in warning for warning in found.warnings)
    one, other = found.ranking[:2]
    assert found.verdict == "explained"
    assert found.causes == (one.effect,)
    assert {one.effect, other.effect} == set(LATE)
    assert (one.indistinguishable_from, other.indistinguishable_from) == ((other.effect,), (one.effect,))
    # Either of them is what is sure.
    assert one.probability + other.probability == pytest.approx(found.probability)
    assert found.probability == pytest.approx(THRESHOLDS.right_read)
    assert found.only_misread
    assert found.gap.closed == 0.0
