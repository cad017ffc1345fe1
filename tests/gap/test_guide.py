"""The guide: a simulation that leaves the measured motion is held near it, and a linear one's residual stays."""

import math
from types import SimpleNamespace

import gap_search
import numpy as np
import numpy_machine
import pytest

from fpjax import load_model
from fpjax.gap import EFFECTS
from fpjax.gap.answer.free_replay import free_replay
from fpjax.gap.data.replay_tables import guide_of, tables_of
from fpjax.gap.fit.candidate import Start
from fpjax.gap.fit.guide import guide_bandwidth
from fpjax.gap.fit.least_squares import Fitter
from fpjax.gap.simulate.family import Runner
from fpjax.gap.verb import make_search
from fpjax.simulation.precision import double_precision

SLOW = 2.0 * np.pi * 0.2  # of a reference that turns slowly [rad/s]


def missing(search):
    """RMS of what the nominal model lacks [N m]."""
    return search.finish([search.exact])[0].missing_rms([np.arange(len(r.starts)) for r in search.records])


def guided_fitter(search, bandwidth):
    """A fitter of the rigid family whose simulations are held with that bandwidth [Hz]."""
    with double_precision():
        tables = [tables_of(record, bandwidth) for record in search.records]
    family = search.fitters[search.exact.family.key].family
    return Fitter(Runner(family, search.records, tables), search.setting, search.modes)


@pytest.mark.parametrize("sensors", [("position",), ("velocity",), ("velocity", "position")])
def test_a_guide_leaves_the_residual_of_a_linear_machine_as_it_is(sensors):
    linear = numpy_machine.Machine(coulomb=0.0, viscous=0.0)
    log = numpy_machine.record(linear, seconds=3.0, sensors=sensors, extra=lambda time, *_: 0.3 * math.sin(20.0 * time))
    model = gap_search.MODEL.replace("coulomb = 0.4", "coulomb = 0.0").replace("viscous = 0.03", "viscous = 0.0")
    search = make_search([log], [], load_model(model))
    c = search.candidate(Start((), ("inertia",), {"inertia": 0.06}))
    windows = search.train[0]
    free, held = (guided_fitter(search, bandwidth).coefficients([c], 0, windows)[0] for bandwidth in (0.0, 20.0))
    assert np.max(np.abs(free)) > 10.0  # standard deviations: there is something to see
    np.testing.assert_allclose(held, free, atol=1e-3 * np.max(np.abs(free)))


@pytest.mark.parametrize("damping", [0.0, 5.0, 50.0, 200.0])
def test_a_guide_that_is_chosen_again_is_no_firmer(damping):
    """Of one and the same missing torque: a guide changes the residual of a damped machine."""
    frequency = np.arange(0.5, 60.0) / 2.0
    modes = SimpleNamespace(frequency=frequency, sensor=np.zeros(60, bool), basis=np.zeros((500, 60)))
    record = SimpleNamespace(motion_squares=lambda: np.full(8, 1.0), integrated=False)
    setting = SimpleNamespace(damping=damping, window=0.5, dt=1e-3)
    s = 2j * np.pi * frequency
    own = s**2 + damping * s

    def chosen(present):
        stiffness, firm = guide_of(record, present)
        held = firm * s + stiffness
        residual = 4e3 * (s**2 + held) / (s**2 * (own + held))
        return guide_bandwidth([record], modes, [(np.ones(1), np.abs(residual)[None])], setting, present)

    first = chosen(0.0)
    assert first > 0.0
    assert chosen(first) == first


def test_under_a_guide_viscous_friction_answers_to_the_measured_speed():
    search = gap_search.search_of(numpy_machine.record(seconds=3.0, sensors=("position",)))
    c = search.candidate(Start((), ("viscous",), {"viscous": 2.0}))
    inertia, viscous = 0.05, c.values()["viscous"]  # within its bounds
    slow = int(np.argmin(search.modes.frequency))
    s = 2j * np.pi * search.modes.frequency[slow]
    for bandwidth in (0.0, 5.0, 100.0):
        pull = 2.0 * np.pi * bandwidth
        held = inertia * (s**2 + 1.4 * pull * s + pull**2)  # a damping ratio of 0.7
        expected = abs((held + viscous * s) / (held + 0.03 * s))
        assert guided_fitter(search, bandwidth).torque_scale(c)[slow] == pytest.approx(expected, rel=1e-6), bandwidth
    assert expected == pytest.approx(1.0, abs=0.1)  # held, it misses the torque that it misses


def test_a_machine_that_its_cogging_traps_is_held_and_its_cogging_found():
    strong = 1.5
    log = numpy_machine.record(
        seconds=8.0, sensors=("position",), reference=2.0 + 0.5 * np.sin(SLOW * 1e-3 * np.arange(8000)),
        extra=lambda time, speed, angle, command: strong * math.sin(24.0 * angle),
    )  # fmt: skip
    search = gap_search.search_of(log)
    assert search.guide > 0.0
    effect = next(one for one in EFFECTS if one.name == "cogging")
    fits = search.explore([Start((effect,), (), values) for values in effect.starts(search.setting)])
    found = next(f for f in fits if f.names == ("cogging",))
    values = found.candidate.values()
    assert values["cogging_periods"] == pytest.approx(24.0, rel=1e-3)
    assert np.hypot(values["cogging_sine_1"], values["cogging_cosine_1"]) == pytest.approx(strong, rel=0.03)
    free = free_replay(search, search.finish([search.exact])[0], found)
    assert free.guide == search.guide
    assert free.before > 0.5  # of the motion: why it was held
    assert free.after < 0.05  # with its cogging it needs no hold


@pytest.mark.parametrize(
    ("name", "torque"),
    [
        ("constant", lambda time, speed, angle, u: -2.0),
        ("weight", lambda time, speed, angle, u: -2.0 * np.sin(angle)),
    ],
)
def test_the_gap_is_the_torque_that_is_missing(name, torque):
    time = 1e-3 * np.arange(12_000)
    log = numpy_machine.record(seconds=12.0, sensors=("position",), reference=2.0 * np.sin(SLOW * time), extra=torque)
    angle = log.position
    truth = np.sqrt(np.mean(torque(time, 0.0, angle, 0.0) ** 2 * np.ones(len(time))))
    assert missing(gap_search.search_of(log)) == pytest.approx(truth, rel=0.15), name


def test_a_model_that_stays_near_is_left_to_itself():
    assert gap_search.search_of(numpy_machine.record(seconds=3.0)).guide == 0.0


def test_friction_that_holds_a_guided_machine_makes_no_torque_of_its_own():
    time = 1e-3 * np.arange(12_000)
    moving = np.sign(np.sin(np.pi * time / 2.0)) * (np.mod(time, 2.0) < 1.0)  # a second to or fro, a second of rest
    log = numpy_machine.record(
        numpy_machine.Machine(ki=0.0), seconds=12.0, sensors=("position",), reference=3.0 * moving,
        extra=lambda time, speed, angle, command: -0.3 * math.sin(2.0 * angle),
    )  # fmt: skip
    search = gap_search.search_of(log)
    fitter = guided_fitter(search, 5.0)
    search.fitters = dict.fromkeys(search.fitters, fitter)
    course, record = search.missing_course(search.exact)[0], search.records[0]
    still = np.convolve(np.abs(record.speed) < 0.02, np.ones(200) / 200, "same") > 0.999  # 100 ms from any motion
    known, lacking = np.isfinite(course), -0.3 * np.sin(2.0 * log.position)
    assert np.sqrt(np.mean(lacking[still & known] ** 2)) > 0.1  # friction holds it, in the machine and in its model
    assert np.sqrt(np.mean(course[still & known] ** 2)) < 0.01
    moves = known & (np.abs(record.speed) > 0.5)
    np.testing.assert_allclose(np.sqrt(np.mean(course[moves] ** 2)), np.sqrt(np.mean(lacking[moves] ** 2)), rtol=0.05)


def test_a_guide_is_as_firm_whatever_the_scale_of_the_rate_sensor():
    """Twice the reading of half the motion of twice the mass: the same log, and the same residual under any guide."""
    search = gap_search.search_of(numpy_machine.record(seconds=3.0, sensors=("velocity",)))
    effect = next(one for one in EFFECTS if one.name == "velocity_scale_error")
    wide, family = ("inertia", "viscous"), search.family((effect,))
    with double_precision():
        tables = [tables_of(record, 10.0) for record in search.records]
    fitter = Fitter(Runner(family, search.records, tables), search.setting, search.modes)
    one, two = (
        search.candidate(Start((effect,), wide, {"scale": s, "inertia": 0.06 * s, "viscous": 0.04 * s}))
        for s in (1.0, 2.0)
    )
    first, second = (fitter.coefficients([c], 0, search.train[0])[0] for c in (one, two))
    assert np.max(np.abs(first)) > 10.0
    np.testing.assert_allclose(second, first, atol=1e-3 * np.max(np.abs(first)))
