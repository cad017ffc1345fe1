"""Exact twins that depend on what loads the gear."""

import dataclasses
from types import SimpleNamespace

import gap_search
import numpy_machine
import pytest

from fpjax.gap import Estimate
from fpjax.gap.answer.ranking import log_of, told_apart
from fpjax.gap.effects.twins import LogFacts, exact_twins

LIGHT = LogFacts(
    position=True, known_torque=True, known_turning=False, nominal={"inertia": 2.0, "coulomb": 0.5, "viscous": 0.1},
    unloaded=True,
)  # fmt: skip


def known(value):
    return Estimate(value, 0.98 * value, 1.02 * value, "1")


def test_where_friction_is_the_only_load_its_growth_with_the_load_is_more_of_all_friction():
    (twin,) = exact_twins(["load_dependent_friction"], {"load_dependent_friction": {"coefficient": known(0.2)}}, LIGHT)
    assert twin.instead == ("coulomb_error", "viscous_error")
    assert "0.8" in twin.sentence()
    found = {"coulomb_error": {"coulomb": known(0.625)}, "viscous_error": {"viscous": known(0.125)}}
    (twin,) = exact_twins(list(found), found, LIGHT)
    assert twin.instead == ("load_dependent_friction",)
    assert "coefficient 0.2" in twin.sentence()


def test_a_loaded_gear_and_frictions_in_another_proportion_are_told_apart():
    loaded = dataclasses.replace(LIGHT, unloaded=False)
    one = {"load_dependent_friction": {"coefficient": known(0.2)}}
    assert exact_twins(list(one), one, loaded) == []
    for coulomb, viscous in ((0.625, 0.1), (0.4, 0.08)):  # one alone; both less than the nominal ones
        found = {"coulomb_error": {"coulomb": known(coulomb)}, "viscous_error": {"viscous": known(viscous)}}
        assert exact_twins(list(found), found, LIGHT) == []


@pytest.mark.parametrize(("inertia", "unloaded"), [(0.002, True), (0.05, False)])
def test_a_gear_that_accelerates_little_is_unloaded(inertia, unloaded):
    from fpjax.gap.verb import make_search
    from fpjax.model_file import load_model

    log = numpy_machine.record(numpy_machine.Machine(inertia=inertia), seconds=3.0, sensors=("position",))
    model = load_model(gap_search.MODEL.replace("inertia = 0.05", f"inertia = {inertia}"))
    assert log_of(make_search([log], [], model)).unloaded is unloaded


def test_over_a_short_travel_an_unbalance_is_no_more_than_a_torque_of_the_position():
    found = {"unbalance": {"amplitude": known(0.4)}}
    short = dataclasses.replace(LIGHT, travel=0.3)
    (twin,) = exact_twins(["unbalance"], found, short)
    assert twin.instead == ("cogging",)
    # The fits tried cogging that repeats within the travel, and so do not tell the two apart.
    worse = SimpleNamespace(structural=("cogging",), worth=1.0)
    better = SimpleNamespace(structural=("unbalance",), worth=100.0)
    assert not told_apart(SimpleNamespace(singles=(better, worse)), twin)
    for log in (LIGHT, dataclasses.replace(LIGHT, travel=3.0)):
        assert exact_twins(["unbalance"], found, log) == []
    assert exact_twins(["unbalance", "cogging"], found, short) == []
