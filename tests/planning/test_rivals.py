"""The machines that a plan tells apart: each effect at a size that shows, the rivals of a diagnosis, exact twins."""

import cmath
import dataclasses
import math
import re

import pytest
from plan_case import LIMITS, ranking, servo, servo_text

from fpjax import InputError, load_model, plan
from fpjax.gap.effects.parameters import HARDENING
from fpjax.planning.machines import detectable, make_shop, reported, rival
from fpjax.planning.rivals import (
    hidden_by_twin,
    machines_of,
    read_diagnosis,
    rivals_of,
    settled_of,
    twins_of,
    unlikely,
)


def shop_of(model):
    return make_shop(model, LIMITS, 3.0, 0.5)


def test_every_effect_has_a_detectable_size_that_is_not_neutral():
    shop = shop_of(servo("both"))
    assert len(shop.effects()) == 24
    for effect in shop.effects():
        variant = detectable(shop, effect)
        neutral = {p.name: p.neutral(shop.setting) for p in effect.parameters}
        assert any(variant.values.get(name, value) != value for name, value in neutral.items()), effect.name


def test_a_rival_has_the_parameters_that_the_diagnosis_reported():
    shop = shop_of(servo())
    for effect in shop.effects():
        told = {name: one.value for name, one in reported(detectable(shop, effect), shop).items()}
        again = rival(shop, effect.name, told)
        assert again is not None
        found = {name: one.value for name, one in reported(again, shop).items()}
        for name, value in told.items():
            assert abs(found[name]) == pytest.approx(abs(value), rel=1e-6, abs=1e-12), (effect.name, name)


def test_what_a_run_shows_on_a_linear_axis_has_linear_units():
    shop = shop_of(load_model(servo_text().replace("[units]", '[units]\nmotion = "linear"')))
    units = {one.unit for effect in shop.effects() for one in reported(detectable(shop, effect), shop).values()}
    assert {"N", "kg", "N s/m"} <= units
    assert not any(word in unit for unit in units for word in ("N m", "/rad", "rad/s", "1/rev"))


def test_a_shaft_that_hardens_is_planned_for_by_its_line():
    shop, told = shop_of(servo()), {"frequency": 12.0, "stiffness": 40.0}
    line, hard = (rival(shop, "compliance", told | more) for more in ({}, {"hardening": 1e7}))
    assert line is not None
    assert line == hard
    assert line.values[HARDENING.name] == 0.0


def test_a_weight_beside_a_known_one_is_planned_for_at_its_angle():
    """1 N m in the model and 1 N m a sixth of a turn further on in the machine: 1 N m is missing, not none."""
    shop = shop_of(servo("both"))
    shop = dataclasses.replace(shop, setting=dataclasses.replace(shop.setting, turning_load=1.0))
    found = rival(shop, "unbalance", {"amplitude": 1.0, "phase": math.pi / 3.0})
    assert found is not None
    added = complex(found.values["unbalance_sine"], found.values["unbalance_cosine"])
    assert added == pytest.approx(cmath.exp(1j * math.pi / 3.0) - 1.0)
    assert abs(added) == pytest.approx(1.0)


def test_rivals_that_are_improbable_even_together_are_not_planned_for():
    few = rivals_of(ranking(("stribeck", 0.15, []), ("viscous_error", 0.1, [])))
    assert "25% together" in unlikely(few)
    assert "stribeck, viscous error" in unlikely(few)
    assert not unlikely(rivals_of(ranking(("stribeck", 0.3, []), ("viscous_error", 0.2, []))))


def test_delays_without_a_position_are_twins_and_with_one_are_not():
    for sensors, twins in (("velocity", 1), ("both", 0)):
        shop = shop_of(servo(sensors))
        variants = [detectable(shop, e) for e in shop.effects() if e.name in ("actuator_delay", "velocity_delay")]
        assert len(twins_of(shop, variants)) == twins


def test_a_torque_gain_hides_behind_the_nominal_numbers():
    shop = shop_of(servo())
    by_name = {effect.name: effect for effect in shop.effects()}
    assert "exactly the same log" in hidden_by_twin(shop, detectable(shop, by_name["torque_gain_error"]))
    assert hidden_by_twin(shop, detectable(shop, by_name["stribeck"])) == ""


def test_rivals_are_the_first_its_confusables_and_what_is_near():
    found = rivals_of(ranking(("stribeck", 0.3, ["presliding"]), ("viscous_error", 0.1, []), ("presliding", 0.0, [])))
    assert [one.name for one in found] == ["stribeck", "presliding", "viscous_error"]


def test_a_second_cause_that_is_settled_is_in_every_rival_and_no_rival():
    content = ranking(("stribeck", 0.3, ["viscous_error"]), ("constant_torque", 0.2, []), ("viscous_error", 0.1, []))
    content |= {"verdict": "explained", "causes": ["stribeck", "constant_torque"]}
    content["ranking"][1]["parameters"] = {"torque": {"value": 0.07}}
    rivals, settled = rivals_of(content), settled_of(content)
    assert [one.name for one in rivals] == ["stribeck", "viscous_error"]
    assert [one.name for one in settled] == ["constant_torque"]
    assert all(one.values["torque"] == 0.07 for one in machines_of(shop_of(servo()), rivals, settled))


@pytest.mark.parametrize(
    "content",
    [
        ranking(("stribeck", 0.96, []), ("viscous_error", 0.001, [])),
        {**ranking(("stribeck", 0.5, ["presliding"])), "verdict": "no_gap"},
        {**ranking(), "verdict": "unexplained"},
    ],
)
def test_a_diagnosis_without_rivals_is_told_so(content):
    with pytest.raises(InputError, match="no rivals"):
        rivals_of(content)


def test_rivals_that_are_all_exact_twins_need_another_sensor():
    content = ranking(("actuator_delay", 0.4, ["velocity_delay"]), ("velocity_delay", 0.4, []))
    with pytest.raises(InputError, match=re.compile("inseparable by any run.*second sensor")):
        plan(servo(), diagnosis=content, speed=5.0, torque=3.0, travel=6.0, duration=4.0)


def test_a_folder_without_a_diagnosis_is_told_so(tmp_path):
    with pytest.raises(InputError, match="cannot be read"):
        read_diagnosis(tmp_path)
    (tmp_path / "diagnosis.json").write_text("{}")
    with pytest.raises(InputError, match="no ranking"):
        read_diagnosis(tmp_path)
