"""A known load that turns with the position, and a log that does not tell where the position starts."""

import math

import gap_search
import numpy as np
import numpy_machine
import pytest

from fpjax import Unbalance, load_model
from fpjax.blocks.position_torque import ConstantTorque, Loads, PositionTorque, first_harmonic
from fpjax.gap import EFFECTS, diagnose
from fpjax.gap.answer.intervals import identifiability
from fpjax.gap.answer.warning_texts import load_error
from fpjax.gap.fit.candidate import SPIKE_RANGE, Start
from fpjax.gap.verb import make_search

WEIGHT, START = 0.5, 0.7  # N m, rad
MODEL = gap_search.MODEL + f'[load]\ntype = "unbalance"\namplitude = {WEIGHT}\n'


# A load taken START away from where it is lacks 2 WEIGHT sin(START / 2) cos(...): its rms.
ELSEWHERE = 2.0 * WEIGHT * np.sin(0.5 * START) / np.sqrt(2.0)


def left(sensors):
    """Missing torque of the nominal model as given [N m], rms."""
    log = numpy_machine.record(
        seconds=4.0, sensors=sensors, extra=lambda time, speed, angle, command: -WEIGHT * math.sin(angle + START)
    )
    search = make_search([log], [], load_model(MODEL))
    windows = [np.arange(len(record.starts)) for record in search.records]
    return search.finish([search.exact])[0].missing_rms(windows)


@pytest.mark.long  # its fit compiles for 13 s of processor time
def test_the_model_as_given_is_not_judged_at_another_angle_than_the_log_s():
    assert left(("velocity",)) < 0.1 * ELSEWHERE


@pytest.mark.long  # the same fit with one channel more compiles for 6 s of processor time
def test_an_encoder_that_is_zero_elsewhere_than_the_load_is_a_gap():
    assert left(("velocity", "position")) > 0.8 * ELSEWHERE


def turning(amplitude, phase):
    return lambda time, speed, angle, command: -amplitude * math.sin(angle + phase)


@pytest.mark.long  # two whole diagnoses
@pytest.mark.parametrize(
    ("factor", "phase", "stribeck", "causes"),
    [(1.03, 0.02, 0.2, {"stribeck"}), (1.0, 0.1, 0.6, {"stribeck", "unbalance"})],
)
def test_a_load_known_to_some_percent_hides_no_cause_and_one_that_is_wrong_is_told(factor, phase, stribeck, causes):
    machine = numpy_machine.Machine(stribeck=stribeck)
    # In the model file the load is four times the friction: 3 % of it are 12 % of that, which is what bends a cause.
    log = numpy_machine.record(machine, seconds=6.0, extra=turning(4 * WEIGHT * factor, phase))
    model = gap_search.MODEL + f'[load]\ntype = "unbalance"\namplitude = {4 * WEIGHT}\n'
    effects = tuple(
        e for e in EFFECTS if e.name in ("stribeck", "unbalance", "torque_gain_error", "asymmetric_friction")
    )
    assert set(diagnose(log, model, effects=effects).causes) == causes


def test_the_load_of_a_model_is_free_as_far_as_a_number_that_counts_as_right():
    log = numpy_machine.record(seconds=4.0)
    unbalance = tuple(e for e in EFFECTS if e.name == "unbalance")
    search = make_search([log], [], load_model(MODEL), unbalance)
    assert above(search.candidate(Start((), (), {}))) == pytest.approx(SPIKE_RANGE * WEIGHT, rel=0.01)
    assert above(search.candidate(Start(unbalance, (), {}))) > WEIGHT
    assert len(search.exact.free) == 0


def test_only_what_a_load_holds_of_once_a_turn_is_free():
    held = Loads((ConstantTorque(3.0), Unbalance(WEIGHT), PositionTorque((0.2,), (0.0,), 6.0)))
    assert abs(first_harmonic(held)) == pytest.approx(WEIGHT)
    assert abs(first_harmonic(held.parts[-1])) < 1e-9
    # Of a ripple that does not repeat from turn to turn nothing is once a turn, whatever one turn of it holds.
    ripple = PositionTorque((0.3,), (0.4,), 1.5)
    assert abs(first_harmonic(ripple)) == 0.0
    assert abs(first_harmonic(Loads((ripple, Unbalance(WEIGHT, 0.3), Unbalance(WEIGHT, 0.3))))) == pytest.approx(
        2 * WEIGHT
    )


def test_what_is_changed_in_a_known_load_is_said():
    search = make_search([numpy_machine.record(seconds=4.0)], [], load_model(MODEL))
    fit = search.finish([search.candidate(Start((), (), {}))], 0)[0]
    c, setting = fit.candidate, search.setting
    for share, said in (
        (0.01, ""),
        (0.03, "changes the known load by 0.015 N m (3 % of"),
        (0.05, "an unbalance is likely"),
    ):
        c.vector[c.family.index("unbalance_cosine")], c.vector[c.family.index("unbalance_sine")] = share * WEIGHT, 0.0
        assert said in "".join(load_error(fit, setting, written=True)), share
        assert [bool(load_error(fit, setting, written=written)) for written in (True, False)] == [bool(said)] * 2
    c.vector[c.family.index("unbalance_cosine")] = 0.03 * WEIGHT
    assert "the corrected model keeps it" in load_error(fit, setting, written=False)[0]
    names = [one.parameter for one in identifiability(search, fit, np.eye(len(c.free)))]
    assert "load_error_cosine" in names
    assert not any("unbalance" in name for name in names)


def above(candidate):
    """How far the load may be above its nominal value [N m]."""
    place = [candidate.family.parameters[i].name for i in candidate.free].index("unbalance_sine")
    return candidate.high[place] - candidate.center[place]


def test_beside_an_encoder_a_load_acts_at_the_measured_position():
    """Else a simulated pendulum falls over for the torque that it lacks, and lacks ever more of it."""
    log = numpy_machine.record(seconds=6.0, extra=turning(4 * WEIGHT, 0.08))
    model = gap_search.MODEL + f'[load]\ntype = "unbalance"\namplitude = {4 * WEIGHT}\n'
    search = make_search([log], [], load_model(model))
    truth = 4 * WEIGHT * (np.sin(log.position + 0.08) - np.sin(log.position))
    found = search.finish([search.exact])[0].missing_rms([np.arange(len(r.starts)) for r in search.records])
    # At reversals, which the simulated machine reaches at other times, its friction adds to what is missing.
    assert found == pytest.approx(np.sqrt(np.mean(truth**2)), rel=0.25)
