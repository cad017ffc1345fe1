"""Where: an extra torque put in a known place is found there, and nothing is found where nothing is."""

import pathlib

import numpy as np
import pytest
from gap_machine import Machine, record

from fpjax.gap.locate import REGIMES, locate, regime_of
from fpjax.gap.residual import torque_residual
from fpjax.gap.rigid import RigidBody

BODY = RigidBody(0.05, 0.4, 0.03)
EMPS = pathlib.Path(__file__).parents[3] / "shared" / "data" / "emps"
SENSORS = [("velocity",), ("position",), ("velocity", "position")]


def inside(places, low, high):
    """The share of the energy that the places which stand out put within (low, high)."""
    return sum(p.share * max(0.0, min(p.stop, high) - max(p.start, low)) / (p.stop - p.start) for p in places)


@pytest.mark.parametrize("sensors", SENSORS)
@pytest.mark.parametrize("seed", [1, 2])
def test_a_perfect_model_leaves_nothing_that_stands_out(sensors, seed):
    where = locate(record(sensors=sensors, seed=seed), BODY)
    assert where.time == where.velocity == where.position == where.frequency == ()
    assert set(where.regime) == set(REGIMES)
    assert sum(where.regime.values()) == 0.0


@pytest.mark.parametrize("sensors", SENSORS)
def test_a_span_of_time(sensors):
    log = record(extra=lambda t, v, q, u: 0.25 if 3.0 <= t < 3.4 else 0.0, sensors=sensors)
    where = locate(log, BODY)
    assert inside(where.time, 2.85, 3.55) > 0.8
    assert sum(where.regime.values()) == pytest.approx(1.0)


@pytest.mark.parametrize("sensors", SENSORS)
def test_reversals(sensors):
    log = record(extra=lambda t, v, q, u: -0.3 * np.sign(v) * np.exp(-((v / 0.15) ** 2)), sensors=sensors)
    where = locate(log, BODY)
    assert where.regime["reversal"] + where.regime["low_speed"] > 0.8
    assert where.regime["reversal"] > 0.6
    assert inside(where.velocity, -0.8, 0.8) > 0.7


@pytest.mark.parametrize("sensors", [("position",), ("velocity", "position")])
def test_near_an_angle(sensors):
    log = record(extra=lambda t, v, q, u: 0.3 * np.exp(-(((q - 1.0) / 0.1) ** 2)), sensors=sensors)
    where = locate(log, BODY)
    assert inside(where.position, 0.7, 1.3) > 0.7


@pytest.mark.parametrize("sensors", SENSORS)
def test_around_25_hertz(sensors):
    log = record(extra=lambda t, v, q, u: 0.3 * np.sin(2 * np.pi * 25.0 * t), sensors=sensors)
    where = locate(log, BODY)
    assert inside(where.frequency, 19.0, 32.0) > 0.8


@pytest.mark.parametrize("sensors", SENSORS)
def test_at_the_limit(sensors):
    time = 1e-3 * np.arange(8000)
    steps = 3.0 * np.sin(2 * np.pi * 0.5 * time) + 3.0 * (np.floor(time / 1.1) % 2)
    log = record(
        extra=lambda t, v, q, u: -0.4 * np.sign(u) * (abs(u) > 2.0),
        sensors=sensors,
        reference=steps,
        position_noise=1e-6,
    )  # a coarser encoder alone cannot resolve the few milliseconds at the limit

    assert 0.01 < np.mean(np.abs(log.torque) > 2.0) < 0.05
    where = locate(log, BODY)
    assert where.regime["limit"] > 0.7


def test_the_gap_of_a_metre_is_that_of_a_radian():
    log = record(Machine(95.0, 20.0, 200.0, 4000.0, 2e4), extra=lambda t, v, q, u: 80.0 if 3.0 <= t < 3.4 else 0.0,
                 sensors=("position",), linear=True, position_noise=2e-7, velocity_noise=1e-5,
                 reference=0.1 * np.sin(2 * np.pi * 0.5 * np.arange(8000) * 1e-3))  # fmt: skip
    where = locate(log, RigidBody(95.0, 20.0, 200.0))
    assert inside(where.time, 2.85, 3.55) > 0.8


@pytest.mark.parametrize("sensors", SENSORS)
def test_a_held_torque_shows_no_delay(sensors):
    """A perfect model's residual has no part along the torque's change, which half a period of delay would add."""
    log = record(sensors=sensors, velocity_noise=1e-4, position_noise=1e-7)
    residual = torque_residual(log, BODY)
    moving = np.abs(residual.velocity) > 0.3
    change = np.gradient(log.torque)
    smooth = np.convolve(residual.values, np.ones(9) / 9, "same")
    slope = np.convolve(change, np.ones(9) / 9, "same")
    periods = float(smooth[moving] @ slope[moving] / (slope[moving] @ slope[moving]))
    assert abs(periods) < 0.05


def test_regimes_of_a_known_motion():
    log = record()
    names = np.array(REGIMES)[regime_of(torque_residual(log, BODY))]
    assert np.all(np.abs(log.velocity[names == "cruise"]) > 0.5)
    assert np.mean(names == "limit") == pytest.approx(0.05, abs=0.005)
    crossing = np.flatnonzero(np.diff(np.sign(torque_residual(log, BODY).velocity)) != 0)
    assert np.mean(np.isin(names[crossing], ["reversal", "limit"])) == 1.0


@pytest.mark.skipif(not EMPS.exists(), reason="the EMPS records are not bundled")
def test_pulses_left_out_of_the_torque_of_a_real_axis_are_found_in_time():
    from scipy.io import loadmat

    from fpjax.logs import Log

    data = {name: values.ravel() for name, values in loadmat(EMPS / "DATA_EMPS_PULSES.mat").items() if name[0] != "_"}
    pulses = 35.15 * data["pulses_N"]
    log = Log(data["t"], 35.15 * data["vir"] - pulses, None, data["qm"], data["qg"], 1e-3, "pulses", True)
    body = RigidBody(95.11, 20.39, 203.5, load=lambda v, q, t: -3.165 + 36.9 * np.abs(v))
    where = locate(log, body)
    near = np.convolve(np.abs(pulses) > 0.0, np.ones(101), "same") > 0.0
    found = sum(p.share for p in where.time)
    struck = sum(p.share for p in where.time if np.any(near[(log.time >= p.start) & (log.time < p.stop)]))
    assert found > 0.5
    assert struck > 0.9 * found


def test_the_numbers_of_a_machine_are_those_of_its_blocks():
    import fpjax as fp
    from fpjax.gap.machine import nominal_machine
    from fpjax.gap.rigid import rigid_body

    plant = fp.OneMass(0.05, fp.CoulombViscous(0.4, 0.03), fp.Unbalance(0.2, 0.3, 0.1))
    body = rigid_body(nominal_machine(plant, fp.Actuator(gain=0.9, delay=1.5e-3, limit=2.0)))
    assert (body.inertia, body.coulomb, body.viscous) == pytest.approx((0.05, 0.4, 0.03))
    angle = np.linspace(-3.0, 3.0, 7)
    assert body.load is not None
    assert body.applied is not None
    np.testing.assert_allclose(body.load(angle, angle, angle), 0.2 * np.sin(angle + 0.3) + 0.1, atol=1e-6)
    command = np.array([0.0, 0.0, 1.0, 1.0, 1.0, 4.0, 4.0, 4.0, 4.0])
    expected = np.array([0.0, 0.0, 0.0, 0.45, 0.9, 0.9, 2.0, 2.0, 2.0])
    np.testing.assert_allclose(body.applied(command, np.zeros(9), 1e-3), expected, atol=1e-9)


def test_a_log_made_by_a_nominal_model_with_a_load_leaves_nothing():
    import fpjax as fp
    from fpjax.gap.machine import nominal_machine
    from fpjax.gap.rigid import rigid_body

    log = record(extra=lambda t, v, q, u: -0.2 * np.sin(q + 0.3) - 0.1)
    plant = fp.OneMass(0.05, fp.CoulombViscous(0.4, 0.03), fp.Unbalance(0.2, 0.3, 0.1))
    assert sum(locate(log, rigid_body(nominal_machine(plant))).regime.values()) == 0.0
    assert locate(log, BODY).frequency != ()
