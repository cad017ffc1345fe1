"""The starter model: the truth of simulated machines, and of real ones, whatever the sensor."""

import dataclasses
import math

import numpy as np
import pytest
from numpy_machine import Machine, record
from public_records import EMPS, PENDULUM, needs_emps, needs_pendulum

from fpjax import read_log
from fpjax.logs.checks.suspicions import Numbers, suspicions
from fpjax.logs.dynamics.friction_curve import friction_curve
from fpjax.logs.dynamics.nominal import fit_nominal

INERTIA, COULOMB, VISCOUS = 0.01, 0.1, 0.01


def made(
    *, closed=True, bits=None, gyro=None, unbalance=0.0, cogging=0.0, balance=0.0, limit=np.inf, push=0.0, size=1.0,
    seed=1, seconds=8.0,
):  # fmt: skip
    """A log of a machine under a velocity loop or a given torque: an encoder of some bits, a noisy gyro or both."""
    time = 1e-3 * np.arange(round(1e3 * seconds))
    drawn = np.random.default_rng(seed).uniform([[0.5], [0.3], [0]], [[1.5], [3], [6]], (3, 4))
    wanted = size * sum(2 * a * np.sin(2 * np.pi * f * time + p) for a, f, p in drawn.T)
    given = sum(0.25 * a * np.sin(2 * np.pi * f * time) for a, f, _ in drawn.T)

    def extra(time, velocity, position, command):
        pushed = push * math.sin(9.1 * time) * math.sin(2.3 * time)
        turning = unbalance * math.sin(position + 0.3) + cogging * math.sin(9 * position + 0.9) + balance
        return min(max(command, -limit), limit) - command - turning + pushed

    return record(
        Machine(INERTIA, COULOMB, VISCOUS, kp=0.5 * closed, ki=5.0 * closed),
        seconds=seconds,
        extra=extra,
        velocity_noise=gyro or 0.0,
        position_noise=0.0,
        position_step=2 * np.pi / 2**bits if bits else 0.0,
        seed=seed,
        reference=wanted,
        feedforward=None if closed else given,
        sensors=["velocity"] * (gyro is not None) + ["position"] * (bits is not None),
        substeps=4,
    )


@pytest.mark.parametrize("closed", [True, False])
@pytest.mark.parametrize(
    "sensors", [{"bits": 12}, {"bits": 16}, {"gyro": 0.01}, {"gyro": 0.1}, {"bits": 12, "gyro": 0.01}]
)
def test_the_truth_of_a_simulated_machine(sensors, closed):
    found = fit_nominal(made(closed=closed, **sensors))
    assert found.plausible
    assert found.inertia == pytest.approx(INERTIA, rel=0.02)
    assert found.coulomb == pytest.approx(COULOMB, rel=0.02)
    assert found.viscous == pytest.approx(VISCOUS, rel=0.05)
    assert found.amplitude == 0.0
    assert abs(found.offset) < 5e-4
    assert found.least_inertia == pytest.approx(INERTIA, rel=0.05)


def test_an_unbalance_is_found_and_not_read_as_inertia():
    found = fit_nominal(made(bits=14, unbalance=0.2))
    assert found.inertia == pytest.approx(INERTIA, rel=0.02)
    assert found.amplitude == pytest.approx(0.2, rel=0.03)
    assert found.phase == pytest.approx(0.3, abs=0.03)


@pytest.mark.parametrize(
    ("machine", "told"),
    [({"cogging": 0.04}, 0.0), ({"unbalance": 0.2}, 0.2), ({"unbalance": 0.2, "balance": -0.04}, 0.2)],
)
def test_an_unbalance_that_the_offset_takes_back_over_a_short_travel_is_none(machine, told):
    log = made(bits=18, size=0.4, **machine)
    assert np.ptp(log.position) < 1.0
    found = fit_nominal(log)
    assert found.amplitude == pytest.approx(told, rel=0.05)
    assert found.inertia == pytest.approx(INERTIA, rel=0.1)
    assert found.offset == pytest.approx(machine.get("balance", 0.0), abs=0.01)
    assert found.deviations[3] < 0.05
    if not told:  # of the numbers that are told
        assert found.residual > 0.01


def test_a_known_load_is_taken_off():
    log = made(bits=14, unbalance=0.2)
    found = fit_nominal(log, load=lambda angle: 0.2 * np.sin(angle + 0.3))
    assert found.amplitude == 0.0
    assert found.inertia == pytest.approx(INERTIA, rel=0.02)


def test_a_limit_of_the_torque_shows_as_two_inertias():
    found = fit_nominal(made(gyro=0.01, limit=0.25))
    assert found.least_inertia < 0.7 * found.most_inertia


@pytest.mark.parametrize(("noise", "reverse"), [(0.1, False), (4.0, True), (5.0, True)])
def test_a_torque_that_was_measured_with_noise_makes_no_inertia(noise, reverse):
    """A joint's current: the motion is exact beside it, and the torque is solved for."""
    log = made(bits=18, seconds=20.0)
    rng = np.random.default_rng(4)
    found = fit_nominal(dataclasses.replace(log, torque=log.torque + noise * rng.standard_normal(len(log))))
    assert found.plausible
    assert found.inertia == pytest.approx(INERTIA, rel=0.1)
    assert abs(found.coulomb - COULOMB) < 3.0 * found.deviations[1]
    assert found.reverse is reverse
    assert found.least_inertia <= found.inertia <= found.most_inertia
    if reverse:  # what the torque taken as exact would give
        assert found.most_inertia > 2.0 * INERTIA


@pytest.mark.parametrize("push", [0.1, 0.3])
def test_pushes_on_a_machine_without_a_loop_leave_the_torque_exact(push):
    found = fit_nominal(made(bits=16, closed=False, push=push))
    assert not found.reverse
    assert found.inertia == pytest.approx(INERTIA, rel=0.25)


def test_a_fit_that_is_no_machine_says_why():
    sound = fit_nominal(made(gyro=0.01))
    assert (sound.plausible, sound.doubt) == (True, "")
    for change, words in (
        ({"inertia": -sound.inertia}, "inertia is negative (-0.01"),
        ({"inertia": 1e-3 * sound.deviations[0]}, "is not told from zero"),
        ({"share": 0.2}, "explain only 20%"),
        ({"coulomb": -sound.coulomb}, "Coulomb friction is negative (-0.0"),
    ):
        wrong = dataclasses.replace(sound, **change)
        assert not wrong.plausible
        assert words in wrong.doubt


def test_what_shows_nothing_gives_none():
    log = made(gyro=0.01, seconds=3.0)
    assert fit_nominal(dataclasses.replace(log, torque=np.zeros(3000))) is None
    assert (
        fit_nominal(dataclasses.replace(log, velocity=np.ones(3000))) is None
        or not fit_nominal(dataclasses.replace(log, velocity=np.ones(3000))).plausible
    )


@pytest.mark.parametrize("sensors", [{"bits": 14}, {"gyro": 0.01}])
def test_friction_in_bins_lies_on_the_law(sensors):
    log = made(**sensors)
    curve = friction_curve(log, fit_nominal(log))
    law = COULOMB * np.sign(curve.velocity) + VISCOUS * curve.velocity
    moving = np.abs(curve.velocity) > 0.1
    np.testing.assert_allclose(curve.middle[moving], law[moving], atol=0.05 * COULOMB)
    assert np.all(np.diff(curve.velocity) >= 0.0)
    assert np.all((curve.low <= curve.middle) & (curve.middle <= curve.high))


@needs_emps
def test_emps():
    found = fit_nominal(read_log(EMPS, columns="emps"))
    # Janot, Gautier, Brunot, 2019: 95.11 kg, 20.39 N, 203.5 N s/m
    assert found.inertia == pytest.approx(95.11, rel=0.01)
    assert found.coulomb == pytest.approx(20.39, rel=0.03)
    assert found.viscous == pytest.approx(203.5, rel=0.03)


@needs_pendulum
@pytest.mark.filterwarnings("ignore::fpjax.errors.FpjaxWarning")
@pytest.mark.parametrize(
    ("name", "inertia", "amplitude"),
    [("energy_shaping", 0.213, 4.17), ("energy_shaping_1kg", 0.429, 8.38), ("sac", 0.209, 4.17)],
)
def test_a_pendulum_whose_encoder_has_steps_of_3_mrad(name, inertia, amplitude):
    """Figures of an independent multiple-shooting fit (the README beside the records); regression finds 0.008."""
    found = fit_nominal(read_log(PENDULUM / f"{name}.csv"))
    assert found.plausible
    assert found.inertia == pytest.approx(inertia, rel=0.05)
    assert found.amplitude == pytest.approx(amplitude, rel=0.05)


def test_checks_take_a_sine_of_the_position_and_a_known_load_into_account():
    log = made(bits=14, unbalance=0.2)
    known = Numbers(INERTIA, COULOMB, VISCOUS, load=lambda velocity, angle, time: 0.2 * np.sin(angle + 0.3))
    assert suspicions(log, known) == []
    assert suspicions(log, Numbers(INERTIA, COULOMB, VISCOUS)) == []


@pytest.mark.parametrize("noise", [0.3, 1.5])
def test_what_moves_is_not_taken_for_rest_under_a_noisy_sensor(noise):
    log = made(gyro=2e-3)
    shaken = log.velocity + noise * np.random.default_rng(4).standard_normal(len(log))
    found = fit_nominal(dataclasses.replace(log, velocity=shaken))
    assert found.inertia == pytest.approx(INERTIA, rel=0.1)


@pytest.mark.parametrize("bits", [None, 16])
@pytest.mark.parametrize("bias", [0.0, 0.02])
def test_a_machine_that_mostly_rests(bits, bias):
    """At rest, most of the time, a torque is held by static friction; those windows set what counted as odd."""
    log = made(bits=bits, gyro=2e-3 if bits is None else None)
    count, random = 4 * len(log.time), np.random.default_rng(5)
    held = 0.5 * COULOMB * np.sin(0.002 * np.arange(count)) + 0.2 * COULOMB
    readings = {"torque": np.concatenate([held, log.torque])}
    if bits is None:
        readings["velocity"] = np.concatenate([2e-3 * random.standard_normal(count), log.velocity]) + bias
    else:
        readings["position"] = np.concatenate([np.full(count, log.position[0]), log.position])
    rested = dataclasses.replace(log, time=log.dt * np.arange(5 * len(log.time)), reference=None, **readings)
    found, moving = fit_nominal(rested), fit_nominal(log)
    for name, within in (("inertia", 0.01), ("coulomb", 0.02), ("viscous", 0.05)):
        assert getattr(found, name) == pytest.approx(getattr(moving, name), rel=within)
    assert abs(found.offset) < (0.02 if bias == 0.0 else 0.05) * COULOMB
