"""A shaft that gets stiffer as it is wound up: told as a compliance, with its stiffness over the log's motion."""

import dataclasses
import tomllib
from types import SimpleNamespace

import numpy as np
import pytest
from gap_search import RUN
from model_files import body

import fpjax as fp
from fpjax.gap.effects.parameters import FREQUENCY, HARDENING
from fpjax.gap.effects.vocabulary import EFFECTS
from fpjax.gap.fit.candidate import Candidate

TOTAL, DAMPING, COULOMB, VISCOUS = 0.012, 0.01, 0.12, 0.02  # kg m^2, N m s/rad, N m, N m s/rad
STIFFNESS = 30.0  # N m/rad at small twists: a resonance of 16 Hz
MODEL = body(TOTAL, COULOMB, VISCOUS) + RUN


def recorded(hardening, gap=0.0, seconds=8.0, dt=1e-3, fine=20):
    """(log, twist) of two halves with the encoder on the motor and steps of the speed that get smaller by and by."""
    h = dt / fine
    motor, load, position, behind = 0.0, 0.0, 0.0, 0.0
    rows, twists, sums = [], [], 0.0
    noise = np.random.default_rng(4)
    for k in range(round(seconds / dt)):
        time = dt * k
        wanted = np.sign(np.sin(2 * np.pi * 0.9 * time)) * (6.0 if time < 2.5 else 2.5 if time < 5.0 else 1.2)
        sums += dt * (wanted - motor)
        torque = float(np.clip(0.25 * (wanted - motor) + 1.2 * sums, -3.0, 3.0))
        rows.append((time, torque, position))
        twists.append(position - behind)
        for _ in range(fine):
            twist = position - behind
            beyond = twist - np.clip(twist, -0.5 * gap, 0.5 * gap)
            shaft = (STIFFNESS + hardening * beyond**2) * beyond + DAMPING * (motor - load) * (beyond != 0.0)
            motor += h * (torque - shaft - VISCOUS * motor) / (TOTAL / 2)
            slow = COULOMB * h / (TOTAL / 2)
            load += h * shaft / (TOTAL / 2)
            load -= np.clip(load, -slow, slow)
            position, behind = position + h * motor, behind + h * load
    time, torque, position = np.array(rows).T
    position = position + 2e-6 * noise.standard_normal(len(position))
    return {"time": time, "torque": torque, "position": position}, np.array(twists)


def line(twist, hardening):
    """Slope of the least-squares line through the shaft's torque over its twist [N m/rad]."""
    return float(np.sum((STIFFNESS + hardening * twist**2) * twist**2) / np.sum(twist**2))


def test_the_stiffness_that_is_told_is_that_of_the_line_over_the_twists():
    (compliance,) = (effect for effect in EFFECTS if effect.name == "compliance")
    torque = np.linspace(-4.0, 4.0, 401)
    hard = 2.0  # 1/(N m)^2: x + 2 x^3 for x = stiffness x twist
    twist = np.array([root.real for t in torque for root in np.roots([hard, 0.0, 1.0, -t]) if abs(root.imag) < 1e-9])
    wanted = np.sum(torque * twist) / np.sum(twist**2)
    values = {"inertia": TOTAL, "frequency": 16.0, "load_share": 0.5, "relative_hardening": hard}
    setting = dataclasses.replace(some_setting(), shaft=torque)
    found, plain = (compliance.describe(values | {"relative_hardening": h}, setting) for h in (hard, 0.0))
    assert set(plain) == {"frequency", "stiffness"}
    assert found["stiffness"][0] / plain["stiffness"][0] == pytest.approx(wanted, rel=1e-6)
    assert found["frequency"][0] / plain["frequency"][0] == pytest.approx(wanted**0.5, rel=1e-6)
    assert found["hardening"] == (pytest.approx(hard * plain["stiffness"][0] ** 3), "N m/rad^3")
    # A log in which nothing is known of the shaft's torque.
    assert compliance.describe(values, some_setting())["stiffness"] == plain["stiffness"]


def some_setting():
    return fp.gap.Setting(TOTAL, COULOMB, VISCOUS, COULOMB, 6.0, 3.0, 10.0, 8.0, 1e-3)


@pytest.mark.long  # a diagnosis each
@pytest.mark.parametrize("hardening", [0.0, 6e4])
def test_a_shaft_is_named_with_its_stiffness_and_how_far_it_hardens(hardening):
    log, twist = recorded(hardening)
    found = fp.diagnose(log, MODEL)
    told = found.ranking[0]
    assert (found.verdict, found.causes, told.effect) == ("explained", ("compliance",), "compliance")
    stiffness = told.parameters["stiffness"]
    assert stiffness.low <= line(twist, hardening) <= stiffness.high
    assert stiffness.value == pytest.approx(line(twist, hardening), rel=0.05)
    shaft = tomllib.loads(found.model)["transmission"]
    if hardening:
        assert line(twist, hardening) > 1.5 * STIFFNESS, "else this log tells nothing"
        assert told.parameters["hardening"].value == pytest.approx(hardening, rel=0.2)
        assert shaft["stiffness"] == pytest.approx(STIFFNESS, rel=0.1)
        assert shaft["hardening"] == told.parameters["hardening"].value
    else:
        # A plain spring ends at the bound of a plain one, which is no limit of the search.
        assert not any("hardening" in warning for warning in found.warnings)
        assert shaft.get("hardening", 0.0) * np.max(np.abs(twist)) ** 2 < 0.1 * STIFFNESS
        (detail,) = (one for one in found.identifiability if one.parameter == HARDENING.name)
        assert (detail.value, detail.standard_deviation, detail.verdict) == (0.0, 0.0, "absent")


@pytest.mark.long
def test_a_gap_is_no_shaft_that_hardens():
    log, _ = recorded(0.0, gap=0.02)
    found = fp.diagnose(log, MODEL)
    assert found.ranking[0].effect == "backlash"


@pytest.mark.parametrize(
    ("value", "ended", "absent"),
    [(0.0, [], ["relative_hardening"]), (1.0, [], []), (2.0, ["relative_hardening"], [])],
)
def test_a_plain_law_is_no_bound_of_the_search(value, ended, absent):
    low, high, unknown = np.array([0.0, 1.0]), np.array([2.0, 50.0]), np.zeros(2)
    family = SimpleNamespace(parameters=[HARDENING, FREQUENCY])
    c = Candidate(
        (), frozenset(), family, np.array([value, 5.0]), np.array([0, 1]), low, high, unknown, unknown,
        np.array([0.1, 1.0]), unknown, [], [],
    )  # fmt: skip
    assert (c.at_bound(), c.absent()) == (ended, absent)
    c.vector[1] = 1.0
    assert (c.at_bound(), c.absent()) == ([*ended, "frequency"], absent)
