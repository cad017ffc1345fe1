"""Scoring of `benchmarks withheld` on answers written by hand."""

import math

import pytest
from withheld_labels import answer, entry, label

from benchmarks.withheld.score import number, score_case
from benchmarks.withheld.summary import summary_of


def test_the_right_name_with_the_right_verdict():
    given = answer(
        "explained",
        ["stribeck"],
        entry("stribeck", 0.9, stribeck_torque=(2.2, 1.9, 2.5), stribeck_velocity=(0.1, 0.11, 0.2)),
        entry("presliding", 0.1),
        gap={"signal": "velocity", "unit": "rad/s", "before": 0.11, "after": 0.02, "noise_floor": 0.015},
    )
    score = score_case(given, label(), 3.0)
    assert (score.right, score.name, score.strict, score.top3, score.exact) == (True,) * 5
    assert score.statement is True
    assert score.probability == pytest.approx(0.9)
    assert score.closed == pytest.approx(0.09 / 0.095)
    found = {p.name: p for p in score.parameters}
    assert found["stribeck_torque"].relative_error == pytest.approx(0.1)
    assert found["stribeck_torque"].covered is True
    assert found["stribeck_velocity"].covered is False
    assert score.column == "stribeck"


@pytest.mark.parametrize("verdict", ["explained", "partly_explained"])
def test_both_verdicts_that_assert_a_cause_are_statements(verdict):
    right = score_case(answer(verdict, ["stribeck"], entry("stribeck", 0.97)), label())
    assert (right.right, right.name, right.wrongly_sure, right.sure_statements) == (True, True, False, 1)
    wrong = score_case(answer(verdict, ["backlash"], entry("backlash", 0.97)), label())
    assert (wrong.right, wrong.wrongly_asserted, wrong.wrongly_sure) == (False, True, True)
    unsure = score_case(answer(verdict, ["backlash"], entry("backlash", 0.7)), label())
    assert (unsure.wrongly_asserted, unsure.wrongly_sure) == (True, False)
    outside = score_case(answer(verdict, ["backlash"], entry("backlash", 0.97)), label("outside", (), [[]]))
    assert (outside.wrongly_asserted, outside.wrongly_sure) == (True, True)
    # both causes of a pair are statements: the second one is wrong and sure
    pair = label("pairs", ("stribeck", "cogging"))
    second = entry("backlash", 0.4) | {"cause_probability": 0.99}
    score = score_case(answer(verdict, ["stribeck", "backlash"], entry("stribeck", 0.6), second), pair)
    assert (score.both, score.one, score.wrongly_sure) == (False, True, True)


def test_a_probability_above_the_limit_is_a_statement_whatever_the_verdict():
    score = score_case(answer("unexplained", [], entry("backlash", 0.96)), label())
    assert (score.wrongly_asserted, score.wrongly_sure, score.sure_statements) == (False, True, 1)
    score = score_case(answer("unexplained", [], entry("backlash", 0.94)), label())
    assert (score.wrongly_sure, score.sure_statements) == (False, 0)


def test_clutter_that_is_truly_there_may_be_asserted_and_is_not_the_cause():
    cluttered = label(also_true=["cogging"])
    both = answer("explained", ["stribeck", "cogging"], entry("stribeck", 0.97), entry("cogging", 0.02))
    score = score_case(both, cluttered)
    assert (score.right, score.wrongly_asserted, score.wrongly_sure) == (True, False, False)
    score = score_case(answer("explained", ["cogging"], entry("cogging", 0.97)), cluttered)
    assert (score.right, score.name, score.wrongly_sure) == (False, False, False)
    score = score_case(answer("explained", ["cogging"], entry("cogging", 0.97)), label())
    assert score.wrongly_sure is True


def test_a_learned_law_is_no_statement_and_no_name():
    learned = entry("learned_velocity", 0.98)
    given = answer("partly_explained", ["learned_velocity"], learned, entry("stribeck", 0.01))
    score = score_case(given, label())
    assert (score.name, score.right, score.wrongly_asserted, score.wrongly_sure) == (False, False, False, False)
    outside = score_case(given, label("outside", (), [[]]))
    assert (outside.wrongly_asserted, outside.wrongly_sure, outside.sure_statements) == (False, False, 0)


MODEL = """[plant]
type = "one_mass"
inertia = 1.01
[friction]
coulomb = 2.0
viscous = 0.62
"""


def test_errors_of_a_wide_nominal_may_lead_and_are_to_be_named_or_corrected():
    wide = label("wide", nominal_error_percent={"inertia": 25.0, "coulomb": -15.0, "viscous": 20.0})
    ranked = (entry("inertia_error", 0.5), entry("stribeck", 0.45, stribeck_torque=(2.1, 1.9, 2.3)))
    given = answer("explained", ["inertia_error", "stribeck"], *ranked) | {"model": MODEL}
    score = score_case(given, wide)
    assert (score.name, score.right, score.strict, score.exact) == (True, True, False, True)
    assert (score.wrongly_asserted, score.wrongly_sure) == (False, False)
    assert {n.name: (n.named, n.corrected) for n in score.nominal} == {
        "inertia": (True, True),
        "coulomb": (False, True),
        "viscous": (False, False),
    }
    assert [p.covered for p in score.parameters] == [True]
    figures = summary_of([score])
    assert figures["nominal_corrected"] == pytest.approx(2 / 3)
    # where the nominal is exact, an error of it is a wrong name
    assert score_case(given, label()).name is False
    # of two masses the inertia is their sum; a diagnosis without a model corrects nothing
    two = "plant = {motor_inertia = 0.4, load_inertia = 0.6}\nfriction = {coulomb = 2.0, viscous = 0.5}"
    assert all(n.corrected for n in score_case(given | {"model": two}, wide).nominal)
    assert not any(n.corrected for n in score_case(given | {"model": "no ="}, wide).nominal)


def test_coverage_is_told_apart_for_laws_of_another_form():
    inside = answer("explained", ["stribeck"], entry("stribeck", 0.9, stribeck_torque=(2.1, 1.9, 2.3)))
    beside = answer("explained", ["stribeck"], entry("stribeck", 0.9, stribeck_torque=(2.5, 2.4, 2.6)))
    scores = [score_case(inside, label()), score_case(beside, label(other_form=["stribeck"]))]
    found = summary_of(scores)["parameters"]
    assert (found["coverage_same_law"], found["coverage_other_form"]) == (1.0, 0.0)
    assert found["coverage"] == 0.5


def test_the_right_name_that_calls_itself_unexplained_is_not_asserted():
    score = score_case(answer("unexplained", [], entry("stribeck", 0.8)), label())
    assert score.name is True
    assert score.right is False
    assert score.column == "unexplained"


def test_a_wrong_name_counts_only_in_the_top_three():
    given = answer("explained", ["presliding"], entry("presliding", 0.7), entry("stribeck", 0.3))
    score = score_case(given, label())
    assert (score.right, score.name, score.top3, score.statement) == (False, False, True, False)
    assert score.column == "presliding"
    assert not score.parameters


def test_a_declared_confusable_counts_but_a_class_of_everything_does_not():
    few = answer(
        "explained", ["presliding"], entry("presliding", 0.5, ["stribeck"]), entry("stribeck", 0.4, ["presliding"])
    )
    score = score_case(few, label())
    assert score.right is True
    assert score.strict is False
    # the class shares its probability: the statement is the class
    assert score.probability == pytest.approx(0.9)
    assert score.statement is True
    many = ["stribeck", "backlash", "compliance", "cogging"]
    score = score_case(answer("explained", ["presliding"], entry("presliding", 0.5, many)), label())
    assert score.right is False
    assert score.statement is False


def test_exact_twins_count_and_a_twin_of_three_causes_wants_all_three():
    sets = [["torque_gain_error"], ["coulomb_error", "inertia_error", "viscous_error"]]
    gain = label(effects=("torque_gain_error",), accepted=sets)
    three = ["inertia_error", "coulomb_error", "viscous_error"]
    whole = answer("explained", three, entry("inertia_error", 0.6))
    part = answer("explained", ["inertia_error"], entry("inertia_error", 0.6))
    assert score_case(whole, gain).right is True
    assert score_case(whole, gain).column == "torque_gain_error"
    assert score_case(part, gain).right is False
    delay = label(effects=("actuator_delay",), accepted=[["actuator_delay"], ["velocity_delay"]])
    twin = answer("explained", ["velocity_delay"], entry("velocity_delay", 0.5))
    assert score_case(twin, delay).strict is True


def test_nominal_errors_are_true_causes_where_the_nominal_is_off():
    given = answer("explained", ["stribeck", "coulomb_error"], entry("stribeck", 0.9))
    off = label("single_off", nominal_error_percent={"inertia": 1.0, "coulomb": -2.0, "viscous": 0.5})
    assert score_case(given, off).exact is True
    assert score_case(given, label("single")).exact is False


def test_pairs():
    both = label("pairs", ("stribeck", "cogging"))
    found = answer("explained", ["cogging", "stribeck"], entry("cogging", 0.5), entry("stribeck", 0.5))
    score = score_case(found, both)
    assert (score.both, score.one, score.both_ranked, score.exact) == (True,) * 4
    half = answer("explained", ["cogging", "backlash"], entry("cogging", 0.9))
    score = score_case(half, both)
    assert (score.both, score.one, score.exact) == (False, True, False)
    # one class cannot stand for both causes
    lumped = answer("explained", ["cogging"], entry("cogging", 0.9, ["stribeck"]))
    assert score_case(lumped, both).both is False
    declared = answer(
        "explained", ["cogging", "presliding"], entry("cogging", 0.5), entry("presliding", 0.2, ["stribeck"])
    )
    assert score_case(declared, both).both is True
    assert score_case(answer("unexplained", ["cogging"]), both).one is True
    # of a pair the parameters of the cause that was found are scored
    assert {p.effect for p in score_case(found, both).parameters} == set()
    given = answer(
        "explained", ["stribeck"], entry("cogging", 0.5), entry("stribeck", 0.5, stribeck_torque=(2.0, 1.0, 3.0))
    )
    assert [p.covered for p in score_case(given, both).parameters] == [True]


def test_no_gap_and_outside():
    none = label("none", (), [[]])
    assert score_case(answer("no_gap", []), none).false_alarm is False
    assert score_case(answer("unexplained", []), none).false_alarm is True
    false = score_case(answer("explained", ["cogging"], entry("cogging", 0.8)), none)
    assert false.false_alarm is True
    assert false.statement is False
    outside = label("outside", (), [[]], outside="hysteresis")
    assert score_case(answer("unexplained", []), outside).wrongly_asserted is False
    assert score_case(answer("explained", ["backlash"]), outside).wrongly_asserted is True
    assert score_case(answer("no_gap", []), outside).wrongly_sure is False


def test_a_failed_diagnosis_is_wrong_everywhere():
    assert score_case(None, label()).right is False
    assert score_case(None, label("pairs", ("stribeck", "cogging"))).both is False
    assert score_case(None, label("none", (), [[]])).false_alarm is True
    # it asserts nothing, but it is counted and shown
    score = score_case(None, label("outside", (), [[]], outside="hysteresis"))
    assert score.column == "failed"
    assert summary_of([score])["failed"] == 1


def test_numbers_with_and_without_intervals():
    assert number({"value": 3, "low": 2, "high": 4}) == 3.0
    assert math.isnan(number(None))
    assert math.isnan(number("much"))
