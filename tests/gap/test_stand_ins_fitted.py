"""Wrong numbers and effects that could stand for each other, on simulated logs."""

import dataclasses
import math
import tomllib

import pytest
from gap_search import RUN
from model_files import body
from numpy_machine import Machine, record

from fpjax import load_model
from fpjax.gap import EFFECTS, diagnose
from fpjax.gap.select import decision
from fpjax.gap.verb import make_search

pytestmark = pytest.mark.long

NUMBERS = ("inertia_error", "coulomb_error", "viscous_error")


def causes(log, coulomb, *effects):
    """Causes that are told of the small machine, of a nominal Coulomb friction [N m], among some effects."""
    model = load_model(body(0.05, coulomb, 0.03) + RUN)
    return diagnose(log, model, effects=tuple(e for e in EFFECTS if e.name in (*NUMBERS, *effects))).causes


@pytest.mark.parametrize("ripple", [0.0, 0.15])
def test_a_doubled_coulomb_friction_is_no_friction_by_direction(ripple):
    """Beside a viscous friction that differs a little by direction; the fit without it ended in a wrong valley."""

    def extra(time, velocity, position, command):
        return -0.0015 * abs(velocity) + ripple * math.cos(7.0 * position)

    told = causes(record(Machine(coulomb=0.6), extra=extra, substeps=4), 0.3, "asymmetric_friction", "cogging")
    assert told == (("coulomb_error", "cogging") if ripple else ("coulomb_error",))


def test_a_drag_beside_a_ripple_is_no_viscous_friction():
    """The ripple and several times the given viscous friction explain the gap, so that nothing more is looked for."""

    def extra(time, velocity, position, command):
        return 0.9 * math.cos(7.0 * position) - 0.012 * velocity * abs(velocity)

    told = causes(
        record(Machine(), extra=extra, substeps=4), 0.4, "cogging", "quadratic_drag", "load_dependent_friction"
    )
    assert set(told) == {"cogging", "quadratic_drag"}


@pytest.mark.parametrize(("off", "alike"), [(1.04, True), (1.07, False)])
def test_a_factor_is_told_beside_numbers_that_it_nearly_makes_wrong(off, alike):
    """Friction that is off by what a law of another form makes of it, beside a torque constant of 0.8."""
    machine = Machine(constant=0.15)
    log = record(machine, substeps=4)
    effects = tuple(e for e in EFFECTS if e.name in (*NUMBERS, "torque_gain_error", "constant_torque"))
    model = load_model(body(machine.inertia, off * machine.coulomb, machine.viscous / off) + RUN)
    found = diagnose(dataclasses.replace(log, torque=log.torque / 0.8), model, effects=effects)
    assert set(found.causes) == {*NUMBERS, "constant_torque"}
    entries = {entry.effect: entry for entry in found.ranking}
    gain, first = entries["torque_gain_error"], entries["inertia_error"]
    assert (gain.cause_probability == pytest.approx(first.cause_probability)) == alike
    assert ("torque_gain_error" in first.indistinguishable_from) == alike
    assert any("fit this log alike" in sentence for sentence in found.same_as) == alike
    # Its row is that of the fit that does as well, and not of the gain without the constant torque.
    assert (gain.gap_after < 0.5 * machine.constant) == alike


def test_friction_numbers_do_not_stand_for_a_small_stribeck_friction():
    """Without the law of which they are a part, viscous friction would come out a third too small to miss 1 % more."""
    machine = Machine(constant=0.15, stribeck=0.05)
    effects = tuple(e for e in EFFECTS if e.name in (*NUMBERS, "constant_torque", "stribeck", "quadratic_drag"))
    found = diagnose(record(machine, substeps=4), load_model(body(0.06, 0.3, 0.04) + RUN), effects=effects)
    assert found.causes[0] == "constant_torque"
    friction = tomllib.loads(found.model)["friction"]
    assert friction["stribeck_torque"] == pytest.approx(machine.stribeck, rel=0.2)
    assert friction["viscous"] == pytest.approx(machine.viscous, rel=0.03)
    assert friction["coulomb"] == pytest.approx(machine.coulomb, rel=0.03)


def test_simpler_causes_are_looked_for_beside_a_stribeck_friction(monkeypatch):
    """Without it the Coulomb and viscous numbers stand for it, and are no more wrong by one factor."""
    machine = Machine(stribeck=0.03)
    effects = tuple(e for e in EFFECTS if e.name in (*NUMBERS, "cogging", "stribeck", "torque_gain_error"))
    model = load_model(body(machine.inertia, machine.coulomb, machine.viscous) + RUN)
    log = record(machine, extra=lambda t, speed, angle, u: 0.6 * math.cos(7.0 * angle), substeps=4)
    search = make_search([dataclasses.replace(log, torque=log.torque / 0.72)], [], model, effects)
    usual = decision.decide(search, lambda *arguments: None)
    (gain,) = (one for one in usual.singles if one.structural == ("torque_gain_error",))
    beside = decision._with_stribeck
    for plain in (None, gain):
        tried = []

        def stribeck(search, exact, chosen, nominal, tried=tried):
            tried.append(("stribeck", set(chosen.structural)))
            return beside(search, exact, chosen, nominal)

        def simplest(search, exact, chosen, tried=tried, plain=plain):
            tried.append(("simpler", set(chosen.structural)))
            return plain or chosen

        monkeypatch.setattr(decision, "_with_stribeck", stribeck)
        monkeypatch.setattr(decision, "simpler", simplest)
        decision.decide(search, lambda *arguments: None)
        assert tried[:2] == [("stribeck", {"cogging"}), ("simpler", {"cogging", "stribeck"})]
        # What is simpler and has none is tried beside one again.
        assert tried[2:] == ([("stribeck", {"torque_gain_error"})] if plain else [])
