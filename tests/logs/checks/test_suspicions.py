"""Suspicions: each is named on a log that has it, and a sound log raises none."""

import dataclasses
import math

import numpy as np
import pytest
from numpy_machine import Machine, nothing, record
from public_records import EMPS, needs_emps

from fpjax import Log
from fpjax.logs.checks.suspicions import Numbers, suspicions

BODY = Numbers(0.05, 0.4, 0.03)
DEGREES = 180.0 / np.pi


@pytest.fixture(scope="module")
def log():
    return record()


def without_position(log):
    return dataclasses.replace(log, position=None)


def kinds(log, body: Numbers | None = BODY):
    return [(s.severity, s.kind) for s in suspicions(log, body)]


@pytest.mark.parametrize("sensors", [("velocity",), ("position",), ("velocity", "position")])
@pytest.mark.parametrize(
    "extra",
    [
        lambda t, v, q, u: 0.0,
        lambda t, v, q, u: -0.3 * ((v > 0.0) - (v < 0.0)) * math.exp(-abs(v) / 0.2),
        lambda t, v, q, u: min(max(u, -1.4), 1.4) - u,
        lambda t, v, q, u: -0.25 * u,
        lambda t, v, q, u: 0.15 * math.sin(6 * q),
        lambda t, v, q, u: 0.2,
    ],
)
def test_a_sound_log_raises_none_whatever_the_gap(sensors, extra):
    assert suspicions(record(extra=extra, sensors=sensors), BODY) == []


@pytest.mark.parametrize(
    ("velocity", "rate", "position", "angle"),
    [("rpm", 30.0 / np.pi, "deg", DEGREES), ("rpm", 30.0 / np.pi, "rev", 0.5 / np.pi),
     ("deg/s", DEGREES, "rev", 0.5 / np.pi), ("rev/s", 0.5 / np.pi, "deg", DEGREES)],
)  # fmt: skip
def test_two_columns_in_other_units_are_named_together(log, velocity, rate, position, angle):
    other = dataclasses.replace(log, velocity=rate * log.velocity, position=angle * log.position)
    found = [each.sentence for each in suspicions(other, BODY) if each.kind == "unit"]
    assert f"--columns velocity=NAME:{velocity},position=NAME:{position}" in found[0]


def test_degrees_a_second_are_named_with_the_factor(log):
    found = suspicions(dataclasses.replace(log, velocity=DEGREES * log.velocity), BODY)
    assert found[0].severity == "warn"
    assert "velocity looks like deg/s: 57.3 x" in found[0].sentence
    assert "--columns velocity=NAME:deg/s" in found[0].sentence


def test_whole_numbers_are_counts_or_another_unit_and_no_radians(log):
    counts = np.round(200.0 * log.position)
    only = dataclasses.replace(log, position=counts, velocity=None)
    found = suspicions(only, None)
    assert [(s.severity, s.kind) for s in found] == [("warn", "unit")]
    assert "position holds whole numbers only" in found[0].sentence
    assert "position=NAME:deg or counts/4096" in found[0].sentence
    both = dataclasses.replace(log, position=counts, velocity=np.round(200.0 * log.velocity))
    assert any("whole numbers" in s.sentence for s in suspicions(both, None))


def test_degrees_in_all_columns_are_seen_by_the_torque(log):
    bent = dataclasses.replace(log, velocity=DEGREES * log.velocity, position=DEGREES * log.position)
    found = suspicions(bent, BODY)
    assert (found[0].severity, found[0].kind) == ("warn", "unit")
    assert "deg/s" in found[0].sentence
    assert "deg" in suspicions(dataclasses.replace(bent, velocity=None), BODY)[0].sentence


def test_a_position_in_degrees(log):
    found = suspicions(dataclasses.replace(log, position=DEGREES * log.position), BODY)
    assert "position looks like deg:" in found[0].sentence


@pytest.mark.parametrize("with_position", [True, False])
def test_rpm(log, with_position):
    bent = dataclasses.replace(log, velocity=30.0 / np.pi * log.velocity)
    bent = bent if with_position else without_position(bent)
    assert "looks like rpm" in suspicions(bent, BODY)[0].sentence


@pytest.mark.parametrize("sensors", [("velocity",), ("position",), ("velocity", "position")])
def test_a_torque_of_the_wrong_sign(sensors):
    made = record(sensors=sensors)
    assert kinds(dataclasses.replace(made, torque=-made.torque)) == [("warn", "sign")]
    assert kinds(dataclasses.replace(made, torque=-made.torque), None) == [("warn", "sign")]


def _one_sine(extra=nothing):
    """A run of one sine, of which an unbalance could stand for the inertia."""
    machine = Machine(inertia=0.02, viscous=0.05, kp=0.8, ki=16.0, stribeck=0.4)
    reference = 3.0 * np.sin(2 * np.pi * 0.8 * 2e-3 * np.arange(3000))
    encoder = {"position_noise": 0.0, "position_step": 2 * np.pi / 32768}
    return record(machine, seconds=6.0, dt=2e-3, reference=reference, extra=extra, velocity_noise=3e-3, **encoder)


@pytest.mark.parametrize("lacking", ["", "velocity"])
def test_friction_that_would_drive_the_machine_is_a_torque_of_the_wrong_sign(lacking):
    log = dataclasses.replace(_one_sine(), **({lacking: None} if lacking else {}))
    assert suspicions(log, None) == []
    (found,) = suspicions(dataclasses.replace(log, torque=-log.torque), None)
    assert found.kind == "sign"
    assert "friction would drive the machine" in found.sentence
    assert "--columns torque=NAME*-1" in found.sentence


@pytest.mark.parametrize(
    "extra",
    [
        lambda t, v, q, u: -2.0 * q,
        lambda t, v, q, u: -3.0 * (q - min(max(q, -0.3), 0.3)),
        lambda t, v, q, u: -1.0 * math.sin(q),
        lambda t, v, q, u: 0.6,
        lambda t, v, q, u: 0.4 * math.sin(6 * q),
        lambda t, v, q, u: 0.38 * math.tanh(v / 0.05),  # of a friction of 0.4 hardly any is left
    ],
)
def test_no_torque_of_the_position_makes_friction_drive_an_honest_machine(extra):
    assert "sign" not in [kind for _, kind in kinds(_one_sine(extra), None)]


def test_a_load_that_follows_the_acceleration_is_no_turned_sign(log):
    """Another joint pushes with twice this one's inertia: the friction still takes power, so the sign is right."""
    acceleration = np.gradient(log.velocity, log.dt)
    pushed = dataclasses.replace(log, torque=log.torque - 3.0 * BODY.inertia * acceleration)
    assert "sign" not in [kind for _, kind in kinds(pushed, None)]


def test_a_velocity_of_the_wrong_sign(log):
    assert kinds(dataclasses.replace(log, velocity=-log.velocity)) == [("warn", "sign")]


@pytest.mark.parametrize(("scale", "told"), [(0.6, True), (1.12, True), (1.03, False), (1.0, False)])
def test_a_velocity_of_another_scale_than_the_position_is_told_and_contradicts_nothing(log, scale, told):
    found = suspicions(dataclasses.replace(log, velocity=scale * log.velocity), None)
    assert [(one.severity, one.kind) for one in found] == [("warn", "scale")] * told
    assert all(f"velocity is {scale:.3g} x the rate of change of position" in one.sentence for one in found)


@pytest.mark.parametrize("with_position", [True, False])
def test_torque_and_velocity_swapped(log, with_position):
    bent = dataclasses.replace(log, torque=log.velocity, velocity=log.torque)
    assert kinds(bent if with_position else without_position(bent))[0] == ("warn", "swapped")


@pytest.mark.parametrize("factor", [0.1, 10.0])
def test_a_model_ten_times_off(log, factor):
    body = Numbers(factor * 0.05, factor * 0.4, factor * 0.03)
    found = suspicions(log, body)
    assert (found[0].severity, found[0].kind) == ("warn", "machine")
    assert "10" in found[0].sentence or "9.9" in found[0].sentence


def test_a_friction_ten_times_off_is_a_warning(log):
    found = suspicions(log, Numbers(0.05, 4.0, 0.03))
    assert [(s.severity, s.kind) for s in found] == [("warn", "nominal")]
    assert "coulomb" in found[0].sentence


def test_a_constant_column(log):
    for name in ("torque", "velocity", "position"):
        still = dataclasses.replace(log, **{name: np.full(len(log), 0.3)})
        assert kinds(still)[0] == ("warn", "still")
    nothing = dataclasses.replace(log, velocity=np.full(len(log), 0.3), position=None)
    assert kinds(nothing)[0] == ("stop", "still")


def test_a_machine_at_rest(log):
    noise = np.random.default_rng(0).standard_normal((2, len(log)))
    rest = dataclasses.replace(log, velocity=2e-3 * noise[0], position=1e-5 * noise[1])
    assert kinds(rest)[0] == ("warn", "still")


def test_motion_one_way():
    made = record(reference=3.0 + np.sin(2 * np.pi * 0.5 * np.arange(8000) * 1e-3))
    assert kinds(made) == [("warn", "one_way")]


def test_not_a_number(log):
    torque = log.torque.copy()
    torque[7] = np.nan
    found = suspicions(dataclasses.replace(log, torque=torque), BODY)
    assert found[0].kind == "missing"
    assert "row 7" in found[0].sentence


def test_repeated_readings(log):
    velocity = log.velocity.copy()
    held = np.flatnonzero(np.random.default_rng(1).random(len(velocity)) < 0.03)
    for k in held[held > 0]:
        velocity[k] = velocity[k - 1]
    assert kinds(dataclasses.replace(log, velocity=velocity)) == [("warn", "repeated")]


def test_a_drive_that_is_off_repeats_nothing(log):
    """Four fifths of a log at rest without torque, the gyro's noise beside them; what repeats in motion counts."""
    rest = 4 * log.samples
    noise = 2e-3 * np.random.default_rng(7).standard_normal(rest)
    columns = (np.zeros(rest), noise, np.full(rest, log.position[0]))
    joined = {
        name: np.concatenate([before, getattr(log, name)])
        for name, before in zip(("torque", "velocity", "position"), columns, strict=True)
    }
    resting = dataclasses.replace(log, time=np.arange(5 * log.samples) * log.dt, reference=None, **joined)
    assert "repeated" not in [kind for _, kind in kinds(resting)]
    torque = resting.torque.copy()
    held = rest + np.flatnonzero(np.random.default_rng(1).random(log.samples) < 0.03)
    torque[held] = torque[held - 1]
    assert "repeated" in [kind for _, kind in kinds(dataclasses.replace(resting, torque=torque))]


def test_dropped_samples(log):
    keep = np.delete(np.arange(len(log)), [1000, 1001, 5000])
    cut = {name: getattr(log, name)[keep] for name in ("time", "torque", "velocity", "position", "reference")}
    found = suspicions(dataclasses.replace(log, **cut), BODY)
    assert ("warn", "clock") in [(s.severity, s.kind) for s in found]
    assert any("3 samples are missing" in s.sentence for s in found)


def test_a_clock_that_runs_backwards(log):
    time = log.time.copy()
    time[4000:] -= 1.0
    assert ("stop", "clock") in kinds(dataclasses.replace(log, time=time))


def test_a_clipped_torque(log):
    largest = 0.7 * np.max(np.abs(log.torque))
    found = suspicions(dataclasses.replace(log, torque=np.clip(log.torque, -largest, largest)), BODY)
    assert {s.kind for s in found} == {"clipped"}
    assert found[0].severity == "warn"


@pytest.mark.parametrize(("limit", "count"), [(0.7, 2), (2.0, 0)])
def test_a_clipped_torque_that_is_rounded(log, limit, count):
    """A drive's limit shows in a torque of 12 bits; the peaks of a torque that is only rounded are no limit."""
    largest = np.max(np.abs(log.torque))
    step = largest / 2048
    torque = step * np.round(np.clip(log.torque, -limit * largest, limit * largest) / step)
    found = suspicions(dataclasses.replace(log, torque=torque), BODY)
    assert [one.kind for one in found].count("clipped") == count


@pytest.mark.parametrize("side", [1.0, -1.0])
def test_a_position_counter_that_ends_is_said(log, side):
    """16 bits that reach to 0.6 of the furthest position."""
    step = 0.6 * np.max(np.abs(log.position)) / 32768
    counts = np.clip(np.round(side * log.position / step), -32768, 32767)
    clipped = dataclasses.replace(log, velocity=side * log.velocity, torque=side * log.torque, position=step * counts)
    found = [one for one in suspicions(clipped, BODY) if one.kind == "inconsistent"]
    assert found
    assert all("its counter is clipped there" in one.sentence for one in found)
    word = "largest" if np.mean(counts == 32767) > np.mean(counts == -32768) else "smallest"
    assert f"position stays at its {word} value" in found[0].sentence
    # without a velocity nothing tells it from an end stop
    assert "inconsistent" not in [kind for _, kind in kinds(dataclasses.replace(clipped, velocity=None), None)]


@pytest.mark.parametrize("bias", [0.0, 0.02])
@pytest.mark.parametrize("levels", [4096.0, 12.0])
def test_a_machine_at_an_end_stop_or_a_coarse_encoder_is_no_clipped_counter(bias, levels):
    """Half of the run at the highest position, where a loop presses on and off and the rate sensor has a bias."""
    time = 1e-3 * np.arange(12000)
    moving = np.minimum(time, 4.0) + np.maximum(time - 10.0, 0.0)
    position = 1.0 + np.cos(0.5 * np.pi * (moving - 4.0))  # 2 from 4 to 10 s
    velocity = np.gradient(position, 1e-3)
    torque = 0.05 * np.gradient(velocity, 1e-3) + 0.4 * np.sign(velocity) + 2.0 * (velocity == 0.0) * np.sin(9.0 * time)
    noise = 2e-3 * np.random.default_rng(2).standard_normal(time.size)
    step = 2.0 / levels
    stopped = Log(time, torque, velocity + bias + noise, step * np.round(position / step), None, 1e-3, "stop.csv")
    assert not [one for one in suspicions(stopped, None) if "counter" in one.sentence]


def test_a_drive_that_is_off_is_not_clipped_at_zero(log):
    torque = np.where(log.time < 0.5 * log.time[-1], np.abs(log.torque), 0.0)
    assert not [one for one in suspicions(dataclasses.replace(log, torque=torque)) if one.kind == "clipped"]


def test_a_velocity_of_another_axis(log):
    other = 3.0 * np.sin(2 * np.pi * 1.7 * log.time + 1.0) + 2e-3 * np.random.default_rng(4).standard_normal(len(log))
    found = suspicions(dataclasses.replace(log, position=np.cumsum(other) * 1e-3), BODY)
    assert [s.kind for s in found] == ["inconsistent"]


@needs_emps
@pytest.mark.parametrize("name", ["DATA_EMPS", pytest.param("DATA_EMPS_PULSES", marks=pytest.mark.long)])
def test_a_real_axis(name):
    from scipy.io import loadmat

    data = {key: values.ravel() for key, values in loadmat(EMPS.parent / f"{name}.mat").items() if key[0] != "_"}
    body = Numbers(95.11, 20.39, 203.5)
    log = Log(data["t"], 35.15 * data["vir"], None, data["qm"], data["qg"], 1e-3, name, True)
    assert suspicions(log, body) == []
    assert "mm" in suspicions(dataclasses.replace(log, position=1e3 * log.position), body)[0].sentence
    assert kinds(dataclasses.replace(log, torque=-log.torque), body) == [("warn", "sign")]
    assert kinds(dataclasses.replace(log, torque=data["vir"]), body) == [("warn", "machine")]


def test_a_velocity_is_held_against_its_reference_where_there_is_no_position(log):
    bent = dataclasses.replace(without_position(log), velocity=DEGREES * log.velocity)
    found = suspicions(bent, None)
    assert (found[0].severity, found[0].kind) == ("warn", "unit")
    assert "looks like deg/s" in found[0].sentence
    assert "x the reference" in found[0].sentence


@pytest.mark.parametrize(("unit", "factor"), [("rpm", 30.0 / np.pi), ("deg/s", DEGREES), ("rev/s", 0.5 / np.pi)])
@pytest.mark.parametrize("change", [lambda log: log, without_position])
def test_a_reference_in_another_unit_than_the_velocity_is_told_and_contradicts_nothing(log, unit, factor, change):
    (found,) = suspicions(dataclasses.replace(change(log), reference=factor * log.reference), BODY)
    assert (found.severity, found.kind) == ("warn", "reference")
    assert f"the reference looks like {unit}: " in found.sentence
    assert "x the velocity" in found.sentence
    assert f"--columns reference=NAME:{unit}." in found.sentence


@pytest.mark.parametrize("change", [lambda log: log, without_position])
def test_a_reference_of_the_other_sign_is_told(log, change):
    (found,) = suspicions(dataclasses.replace(change(log), reference=-log.reference), BODY)
    assert (found.severity, found.kind) == ("warn", "reference")
    assert "the reference runs against the velocity" in found.sentence


def test_a_reference_in_another_unit_than_the_position_is_told(log):
    (found,) = suspicions(dataclasses.replace(log, reference=DEGREES * (log.position + 3.0)), BODY)
    assert "reference looks like deg: 57.3 x the position" in found.sentence
    assert suspicions(dataclasses.replace(log, reference=log.position + 3.0), BODY) == []


def test_a_compensation_that_the_torque_column_leaves_out(log):
    less = log.torque - 0.8 * np.sign(log.velocity)
    found = suspicions(dataclasses.replace(log, torque=less), None)
    assert [(s.severity, s.kind) for s in found] == [("warn", "compensated")]


@pytest.mark.parametrize("lacking", ["", "velocity", "position"])
@pytest.mark.parametrize(("unit", "size"), [("ms", 1e-3), ("us", 1e-6)])
def test_a_time_in_milliseconds_is_not_blamed_on_the_velocity(log, lacking, unit, size):
    bent = dataclasses.replace(log, time=log.time / size, dt=log.dt / size, **({lacking: None} if lacking else {}))
    found = suspicions(bent, BODY)
    assert [one.kind for one in found] == ["clock"]
    assert f"is its time in {unit}? Then say so with --columns time=NAME:{unit}." in found[0].sentence


def test_a_slow_log_whose_sensors_agree_with_its_clock_is_believed(log):
    """An hour of a slow axis: velocity is the position's change in these very seconds."""
    slow = dataclasses.replace(log, time=1e3 * log.time, dt=1e3 * log.dt, velocity=1e-3 * log.velocity)
    assert not [one for one in suspicions(slow) if one.kind == "clock"]


def test_two_levels_of_torque_are_no_limit(log):
    bang = dataclasses.replace(log, torque=0.5 * np.sign(np.sin(9.0 * log.time)))
    assert not [one for one in suspicions(bang) if one.kind == "clipped"]
    clipped = dataclasses.replace(log, torque=np.clip(log.torque, -0.3, 0.3))
    assert [one.kind for one in suspicions(clipped)].count("clipped") == 2


def test_a_weight_makes_no_exchange_of_columns(log):
    """A heavy arm moved slowly: its torque follows the angle, and the speed follows the torque's rate."""
    time = np.arange(0.0, 20.0, 0.01)
    position = 0.2 * np.sin(0.8 * time) + 0.05 * np.sin(2.1 * time)
    velocity = np.gradient(position, 0.01)
    torque = 0.03 * np.gradient(velocity, 0.01) + 2.0 * np.sin(position) + 0.02 * np.sign(velocity)
    heavy = dataclasses.replace(
        log, time=time, dt=0.01, torque=torque, velocity=velocity, position=position, reference=None
    )
    for one in (heavy, without_position(heavy)):
        assert "swapped" not in [kind for _, kind in kinds(one, None)]


def test_a_torque_of_whole_numbers_and_one_without_its_sign_are_said():
    log = record(seconds=4.0)
    for name, torque, word in (
        ("counts", np.round(400 * log.torque), "whole numbers only"),
        ("magnitude", np.abs(log.torque), "recorded without its sign"),
    ):
        found = {each.kind: each.sentence for each in suspicions(dataclasses.replace(log, torque=torque))}
        assert word in found[name]
    # a label that holds counts, and a weight that is held, are no reason to ask
    labelled = dataclasses.replace(log, torque=np.round(400 * log.torque), torque_unit="‰")
    held = dataclasses.replace(log, torque=2.0 * np.ptp(log.torque) + log.torque)
    for each in (labelled, held):
        assert not {"counts", "magnitude"} & {one.kind for one in suspicions(each)}
