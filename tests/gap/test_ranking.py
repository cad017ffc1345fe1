"""Who shares probability with whom: sets of causes, exact twins, and signatures that are alike."""

import dataclasses
from types import SimpleNamespace

import numpy as np
import pytest

from fpjax.gap import Estimate, Ranked, Step
from fpjax.gap.confusable import indistinguishable
from fpjax.gap.posterior import Posterior, make_posterior
from fpjax.gap.ranking import in_order, share_alike
from fpjax.gap.signature import basis, without
from fpjax.gap.twins import Log, Twin, exact_twins

NOMINAL = {"inertia": 2.0, "coulomb": 0.5, "viscous": 0.1}
RATE_ONLY = Log(position=False, known_torque=False, known_turning=False, nominal=NOMINAL)
BOTH = dataclasses.replace(RATE_ONLY, position=True)


def fit(names, evidence):
    return SimpleNamespace(names=tuple(names.split("+")), evidence=evidence)


def estimate(value, half=0.01):
    return Estimate(value, value - half * abs(value), value + half * abs(value), "1")


# --- probabilities of sets


def test_a_sure_pairs_main_cause_has_its_probability_and_each_of_it_is_sure():
    rivals = [fit("stribeck+unbalance", 500.0), fit("stribeck+cogging", 300.0), fit("stribeck", 100.0)]
    found = make_posterior(rivals, explained=True, gap=True, quantised=False, order=("unbalance", "stribeck"))
    total = sum(share for _, share in found.sets)
    assert total <= 1.0
    assert found.share("unbalance") == pytest.approx(total)
    assert found.share("stribeck") < 1e-9
    assert found.cause("unbalance") == pytest.approx(total)
    assert found.cause("stribeck") == pytest.approx(total)
    assert found.share("cogging") < 1e-9
    assert found.statement(("stribeck", "unbalance"), {}) == pytest.approx(total)


def test_the_cause_that_rivals_share_is_surer_than_its_companions():
    rivals = [fit("stribeck+actuator_lag", 500.0), fit("velocity_lag+stribeck", 499.9), fit("cogging", 1.0)]
    found = make_posterior(rivals, explained=True, gap=True, quantised=False)
    assert found.cause("stribeck") > 0.98
    assert 0.4 < found.cause("velocity_lag") < found.cause("actuator_lag") < 0.6
    names = ("stribeck", "actuator_lag", "velocity_lag", "cogging")
    assert sum(found.share(name) for name in names) == pytest.approx(sum(share for _, share in found.sets))
    alone = found.statement(("stribeck", "actuator_lag"), {})
    told = found.statement(("stribeck", "actuator_lag"), {"actuator_lag": ("velocity_lag",)})
    assert told == pytest.approx(alone + found.cause("velocity_lag"))


def test_a_set_counts_once_however_often_it_was_tried():
    once = make_posterior([fit("a+b", 10.0), fit("c", 9.0)], True, True, False)
    twice = make_posterior([fit("a+b", 10.0), fit("b+a", 8.0), fit("c", 9.0)], True, True, False)
    assert once.sets == twice.sets


def test_a_rounded_reading_is_a_cause_beside_whatever_else_there_is():
    beside = make_posterior([fit("velocity_bias", 10.0)], True, True, True)
    assert beside.cause("velocity_quantisation") == pytest.approx(beside.cause("velocity_bias"))
    alone = make_posterior([fit("velocity_bias", 10.0)], True, False, True)
    assert alone.cause("velocity_quantisation") > 0.9
    unexplained = make_posterior([fit("velocity_bias", 10.0)], False, True, True)
    assert unexplained.cause("velocity_quantisation") > 0.9
    assert unexplained.none() == pytest.approx(1.0 - unexplained.cause("velocity_bias"))
    for found in (beside, alone, unexplained):
        assert sum(share for _, share in found.sets) <= 1.0


def test_evidence_that_is_not_finite_is_no_rival():
    found = make_posterior([fit("a", 10.0), fit("b", -np.inf)], True, True, False)
    assert found.share("b") < 1e-100
    assert isinstance(found, Posterior)


# --- exact twins


def test_one_for_one_twins():
    assert exact_twins(("constant_torque",), {}, BOTH) == [
        Twin(frozenset({"constant_torque"}), ("asymmetric_friction",))
    ]
    delay = [Twin(frozenset({"actuator_delay"}), ("velocity_delay",))]
    assert exact_twins(("actuator_delay",), {}, RATE_ONLY) == delay
    assert exact_twins(("actuator_delay",), {}, BOTH) == []
    assert exact_twins(("actuator_delay", "friction_drift"), {}, RATE_ONLY) == []


def sides(positive, negative, viscous=(0.1, 0.1)):
    values = {"coulomb_positive": positive, "coulomb_negative": negative}
    values |= {"viscous_positive": viscous[0], "viscous_negative": viscous[1]}
    return {"asymmetric_friction": {name: estimate(value) for name, value in values.items()}}


@pytest.mark.parametrize(
    ("found", "instead"),
    [
        (sides(0.6, 0.4), ("constant_torque",)),
        (sides(0.8, 0.5), ("coulomb_error", "constant_torque")),
        (sides(0.6, 0.4, (0.2, 0.2)), ("viscous_error", "constant_torque")),
        (sides(0.6, 0.4, (0.12, 0.08)), None),
    ],
)
def test_asymmetric_friction_is_a_torque_only_where_its_viscous_part_has_no_direction(found, instead):
    twins = exact_twins(("asymmetric_friction",), found, BOTH)
    assert [twin.instead for twin in twins] == ([] if instead is None else [instead])


def test_a_torque_and_a_level_are_asymmetric_friction():
    twins = exact_twins(("coulomb_error", "constant_torque"), {}, BOTH)
    assert twins == [Twin(frozenset({"coulomb_error", "constant_torque"}), ("asymmetric_friction",))]


def test_a_gain_is_three_wrong_values_in_one_proportion():
    gain = {"torque_gain_error": {"gain": estimate(0.8)}}
    (twin,) = exact_twins(("torque_gain_error",), gain, BOTH)
    assert set(twin.instead) == {"inertia_error", "coulomb_error", "viscous_error"}
    assert "0.8" in twin.sentence()
    assert exact_twins(("torque_gain_error",), gain, dataclasses.replace(BOTH, known_torque=True)) == []

    def values(factor, odd=1.0):
        return {
            f"{name}_error": {name: estimate(value / factor * (odd if name == "viscous" else 1.0))}
            for name, value in NOMINAL.items()
        }

    causes = ("inertia_error", "coulomb_error", "viscous_error")
    (twin,) = exact_twins(causes, values(0.8), BOTH)
    assert twin.instead == ("torque_gain_error",)
    assert exact_twins(causes, values(0.8, odd=1.2), BOTH) == []


def test_a_scale_is_two_wrong_values_where_no_position_tells():
    scale = {"velocity_scale_error": {"scale": estimate(1.1)}}
    (twin,) = exact_twins(("velocity_scale_error",), scale, RATE_ONLY)
    assert twin.instead == ("inertia_error", "viscous_error")
    assert exact_twins(("velocity_scale_error",), scale, BOTH) == []
    assert exact_twins(("velocity_scale_error", "cogging"), scale, RATE_ONLY) == []
    assert exact_twins(("velocity_scale_error",), scale, dataclasses.replace(RATE_ONLY, known_turning=True)) == []
    wrong = {"inertia_error": {"inertia": estimate(2.0 / 1.1)}, "viscous_error": {"viscous": estimate(0.1 / 1.1)}}
    (twin,) = exact_twins(("inertia_error", "viscous_error"), wrong, RATE_ONLY)
    assert twin.instead == ("velocity_scale_error",)


def entries(**probabilities):
    return {name: Ranked(name, p, 0.0, {}, cause_probability=p) for name, p in probabilities.items()}


def test_twins_share_and_the_simpler_statement_keeps_its_probability():
    found = entries(constant_torque=0.9, asymmetric_friction=0.04)
    share_alike(found, Twin(frozenset({"constant_torque"}), ("asymmetric_friction",)))
    assert [entry.probability for entry in found.values()] == pytest.approx([0.47, 0.47])
    found = entries(inertia_error=0.4, viscous_error=0.4, velocity_scale_error=0.0)
    share_alike(found, Twin(frozenset({"inertia_error", "viscous_error"}), ("velocity_scale_error",)))
    assert [entry.probability for entry in found.values()] == pytest.approx([0.2, 0.2, 0.4])
    assert sum(entry.probability for entry in found.values()) == pytest.approx(0.8)
    found = entries(velocity_scale_error=0.9, inertia_error=0.01, viscous_error=0.0)
    share_alike(found, Twin(frozenset({"velocity_scale_error"}), ("inertia_error", "viscous_error")))
    assert found["velocity_scale_error"].probability == 0.9


# --- signatures


def test_what_a_nuisance_can_copy_is_taken_out_as_far_as_its_prior_allows():
    random = np.random.default_rng(0)
    nuisance = random.standard_normal((200, 2))
    copied = nuisance @ np.array([[1.0], [-2.0]])
    own = random.standard_normal((200, 1))
    left = without(copied + own, nuisance, np.zeros((2, 2)))
    assert np.max(np.abs(nuisance.T @ left)) < 1e-9
    assert np.linalg.norm(without(copied, nuisance, np.zeros((2, 2)))) < 1e-9
    tight = without(copied, nuisance, 1e12 * np.eye(2))
    assert np.allclose(tight, copied)
    assert np.array_equal(without(own, nuisance[:, :0], np.zeros((0, 0))), own)


def test_columns_that_change_nothing_span_nothing():
    column = np.linspace(1.0, 2.0, 50)[:, None]
    assert basis(np.concatenate([column, 0.0 * column, 3.0 * column], 1)).shape == (50, 1)
    assert basis(0.0 * column).shape == (50, 0)


def classes(monkeypatch, chosen, rivals, alike, twins=()):
    monkeypatch.setattr("fpjax.gap.confusable.canonical_correlation", lambda *words: alike[words[-1]])
    return indistinguishable(None, chosen, chosen.names[-1], [chosen, *rivals], list(twins))


def test_a_class_wants_close_evidence_and_a_signature_that_is_alike(monkeypatch):
    chosen = fit("stribeck+actuator_lag", 100.0)
    rivals = [fit("velocity_lag+stribeck", 97.0), fit("stribeck+actuator_delay", 96.5), fit("cogging+unbalance", 99.9)]
    alike = {"velocity_lag": 0.99, "actuator_delay": 0.5}
    assert classes(monkeypatch, chosen, rivals, alike) == ("velocity_lag",)
    alike["velocity_lag"] = 0.9
    assert classes(monkeypatch, chosen, rivals, alike) == ()
    far = [fit("velocity_lag+stribeck", 95.0)]
    assert classes(monkeypatch, chosen, far, {"velocity_lag": 1.0}) == ()
    toss = [fit("velocity_lag+stribeck", 99.5)]
    assert classes(monkeypatch, chosen, toss, {"velocity_lag": 0.0}) == ("velocity_lag",)


def test_a_class_holds_three_names_and_the_exact_twin_comes_first(monkeypatch):
    chosen = fit("constant_torque", 100.0)
    rivals = [fit("velocity_bias", 99.9), fit("unbalance", 99.8)]
    alike = {"velocity_bias": 1.0, "unbalance": 1.0}
    twin = Twin(frozenset({"constant_torque"}), ("asymmetric_friction",))
    assert classes(monkeypatch, chosen, rivals, alike, [twin]) == ("asymmetric_friction", "velocity_bias")
    several = Twin(frozenset({"constant_torque"}), ("a", "b"))
    assert classes(monkeypatch, chosen, [], alike, [several]) == ("a", "b")
    assert classes(monkeypatch, chosen, rivals[:1], alike, [several]) == ("velocity_bias",)


def test_causes_are_told_in_the_order_of_the_ladder():
    ladder = [Step(name, 0.1, (0.0, 0.2)) for name in ("quadratic_drag", "inertia_error")]
    assert in_order(("inertia_error", "quadratic_drag"), ladder) == ["quadratic_drag", "inertia_error"]
    assert in_order(("cogging", "inertia_error"), ladder) == ["inertia_error", "cogging"]
