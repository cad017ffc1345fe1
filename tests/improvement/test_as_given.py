"""The nominal machine with the torque that it misses leads where a diagnosis asserts no cause."""

import dataclasses
import math

import improve_case as case
import jax
import jax.experimental
import numpy as np
import numpy_machine
import pytest

from fpjax.gap.machine import nominal_machine
from fpjax.improvement.as_given import lead_as_given, missing_torque, slowest
from fpjax.improvement.machines import draw_machines, make_ground, ready, records_of
from fpjax.improvement.verb import followed, improve_known
from fpjax.output.stages import StageClock
from fpjax.simulation.precision import double_precision

PUSH = 0.15  # [N m], of a sine from outside at 2.7 Hz


@pytest.fixture(scope="module")
def pushed():
    def push(time, velocity, position, command):
        return PUSH * math.sin(2.0 * math.pi * 2.7 * time)

    return numpy_machine.record(case.TRUE, seconds=1.5, reference=case.log().reference, velocity_noise=5e-3, extra=push)


def unasserted(verdict="unexplained", *, likely=0.25, inertia=0.07, **changes):
    """What a diagnosis says that reports another inertia without asserting it."""
    known = case.known(values=(inertia, 0.4, 0.03), verdict=verdict)
    posterior = dataclasses.replace(known.posterior, causes=("inertia_error",), gap=0.1)
    size = PUSH / math.sqrt(2.0)
    return dataclasses.replace(
        known, posterior=posterior, causes=(), gap_before=size, gap_after=0.1, likely=likely, **changes
    )


def test_the_missing_torque_is_the_one_that_was_not_in_the_model(pushed):
    model = case.model(coulomb=0.4)
    record = records_of(pushed, model)[0]
    with double_precision():
        found = missing_torque(nominal_machine(model.loop.plant, model.loop.actuator, model.loop.sensor), record)
    true = PUSH * np.sin(2.0 * np.pi * 2.7 * pushed.time)
    slow = slowest(found, PUSH / math.sqrt(2.0))
    moving = np.abs(record.speed) > 0.5
    assert np.sqrt(np.mean((slow - true)[moving] ** 2)) < 0.25 * PUSH
    assert np.corrcoef(slow[moving], true[moving])[0, 1] > 0.97


def test_noise_of_the_acceleration_is_no_missing_torque():
    time = 1e-3 * np.arange(2000)
    torque = np.sin(2.0 * np.pi * 2.0 * time)
    noise = np.diff(np.random.default_rng(0).standard_normal(2001))
    assert slowest(torque + noise, 1.0 / math.sqrt(2.0)) == pytest.approx(torque, abs=0.3)
    assert slowest(torque, 1.0) == pytest.approx(torque)  # all of it where it is smaller


@pytest.mark.parametrize("share", [0.9, 0.99, 1.0, 1.1])
@pytest.mark.parametrize("kind", ["constant", "whole periods", "between"])
def test_of_one_strong_frequency_as_much_is_kept_as_is_missing(kind, share):
    time = 1e-3 * np.arange(2000)
    turns = {"constant": 0.0, "whole periods": 2.0, "between": 2.7}[kind]
    torque = np.cos(2.0 * np.pi * turns * time)
    size = float(np.sqrt(np.mean(torque**2)))
    found = slowest(torque + 0.02 * np.random.default_rng(0).standard_normal(2000), share * size)
    assert np.sqrt(np.mean(found**2)) == pytest.approx(min(share, 1.0) * size, rel=0.02)
    assert np.sqrt(np.mean((found - min(share, 1.0) * torque) ** 2)) < 0.4 * size  # between: it leaks over frequencies


@pytest.mark.parametrize("more", ["lag = 0.003", "delay = 0.003", "delay = 0.0"])
def test_a_model_of_single_precision_has_the_same_missing_torque(pushed, more):
    with (jax if hasattr(jax, "enable_x64") else jax.experimental).enable_x64(False):
        model = case.model(f"[actuator]\n{more}\n")
        record = records_of(pushed, model)[0]
        single = lead_as_given(unasserted(), model, record)
    double = lead_as_given(unasserted(), case.model(f"[actuator]\n{more}\n"), record)
    assert single.given
    np.testing.assert_allclose(single.posterior.missing[0], double.posterior.missing[0], atol=1e-3 * PUSH)


@pytest.mark.parametrize("verdict", ["unexplained", "no_gap"])
def test_without_an_asserted_cause_the_nominal_machine_leads(pushed, verdict):
    model, known = case.model(coulomb=0.4), unasserted(verdict)
    records = records_of(pushed, model)
    led = lead_as_given(known, model, records[0])
    assert led.given
    ground = make_ground(led, records, 0)
    machines = ready(draw_machines(led.posterior, model, ground, 16, 1), ground, (4, 4))
    assert [len(part.shares) for part in machines.parts] == [12, 4]
    assert np.asarray(machines.machine.plant.inertia) == pytest.approx(0.05)
    assert np.asarray(machines.parts[1].machine.plant.inertia) == pytest.approx(0.07, rel=0.1)
    assert np.sqrt(np.mean(ground.courses[0] ** 2)) == pytest.approx(known.gap_before, rel=0.1)


def test_every_machine_has_one_explanation(pushed):
    known = unasserted(likely=0.9)
    other = dataclasses.replace(known.posterior, causes=("coulomb_error",), rivals=())
    known = dataclasses.replace(known, posterior=dataclasses.replace(known.posterior, rivals=((0.6, other),)))
    model = case.model(coulomb=0.4)
    led = lead_as_given(known, model, records_of(pushed, model)[0])
    assert [share for share, _ in led.posterior.rivals] == pytest.approx([0.6, 0.4])  # both may hold together


def test_a_cause_that_is_asserted_leads(pushed):
    model = case.model()
    record = records_of(pushed, model)[0]
    asserted = dataclasses.replace(unasserted("explained"), causes=("inertia_error",))
    assert lead_as_given(asserted, model, record) is asserted
    nothing = dataclasses.replace(unasserted("no_gap"), gap_before=math.nan)
    assert lead_as_given(nothing, model, record) is nothing
    shaft = case.model("[transmission]\nstiffness = 200.0\n")
    assert not lead_as_given(unasserted(), shaft, record).given


def test_an_unexplained_log_is_predicted_by_the_machine_that_makes_it(pushed, monkeypatch):
    case.few(monkeypatch)
    model = case.model(coulomb=0.4)
    table = followed(pushed, model, "log")
    found = improve_known(unasserted(), pushed, model, table, ["controller"], 0, StageClock(None), None, None)
    assert found.decision == "change"
    assert not found.promised
    gains = found.after.gains
    machine = dataclasses.replace(case.TRUE, kp=gains["controller.kp"], ki=gains["controller.ki"])

    def push(time, velocity, position, command):
        return PUSH * math.sin(2.0 * math.pi * 2.7 * time)

    run = numpy_machine.record(machine, seconds=1.5, reference=table, velocity_noise=5e-3, extra=push)
    error = np.sqrt(np.mean((run.reference - run.velocity)[150:] ** 2) - 5e-3**2)
    assert found.after.error.value == pytest.approx(error, rel=0.15)
    assert any("inertia_error (25%)" in note for note in found.notes)
