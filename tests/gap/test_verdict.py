"""The verdict as a pure function of fits that no longer change."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from weighed_models import BOTH, NOMINAL, RATE_ONLY, judged, weighed

from fpjax.gap.answer import judge
from fpjax.gap.answer.judge import _persist, _with_effects_behind
from fpjax.gap.effects.twins import single_twins
from fpjax.gap.select.readings import ROUNDING, Reading
from fpjax.gap.select.statement import Verdict
from fpjax.gap.thresholds import THRESHOLDS


def test_a_gap_in_one_of_several_logs_is_a_gap_however_much_torque_the_others_hold():
    chosen = weighed("stribeck", 500.0)
    assert judged(chosen, [], before=0.04).word == "no_gap"
    assert judged(chosen, [], before=0.04, share=0.02, left=0.1).word == "explained"
    # what is left is held against the same log
    assert judged(chosen, [], before=0.04, share=0.03, left=0.6).word == "partly_explained"


def test_the_word_follows_what_is_left_and_how_sure_the_cause_is():
    chosen, rival = weighed("stribeck", 500.0), weighed("presliding", 400.0)
    assert judged(chosen, [rival]).word == "explained"
    assert judged(chosen, [rival]).causes == ("stribeck",)
    assert judged(chosen, [weighed("presliding", 200.0)], left=0.4).word == "partly_explained"
    assert judged(chosen, [rival], left=0.4).word == "unexplained"
    assert judged(chosen, [weighed("presliding", 499.0)], left=0.4).word == "unexplained"
    assert judged(chosen, [weighed("presliding", 499.0)], left=0.4).causes == ()
    assert judged(chosen, [rival], left=0.95).word == "unexplained"
    assert judged(chosen, [rival], before=0.01).word == "no_gap"
    assert judged(weighed("stribeck", 3.0), [], before=0.1).word == "no_gap"
    assert judged(weighed("stribeck", -20.0), [weighed("presliding", -30.0)], before=0.01).ahead == 0.0
    # a torque of importance that no effect follows is no agreement
    assert judged(weighed("stribeck", 3.0), [], before=1.0, left=1.0).word == "unexplained"


def test_a_share_of_a_sure_pair_is_the_main_cause_and_each_of_it_is_sure():
    chosen = weighed("unbalance+stribeck", 500.0)
    rivals = [weighed("stribeck+cogging", 300.0), weighed("stribeck", 100.0)]
    found = judged(chosen, rivals, shares={"unbalance": 0.6, "stribeck": 0.3, "inertia_error": 0.001})
    assert found.causes == ("unbalance", "stribeck")
    assert found.main["unbalance"] == pytest.approx(THRESHOLDS.right_explained[1], rel=0.05)
    assert found.main.get("stribeck", 0.0) < 1e-9
    assert found.among["stribeck"] == pytest.approx(found.among["unbalance"])
    assert sum(found.main.values()) <= 1.0
    assert found.probability == pytest.approx(found.main["unbalance"])


def test_a_part_is_led_by_a_cause_that_no_other_model_can_do_without():
    """Stribeck friction takes most, but a drag does nearly as well; nothing does without the offset."""
    chosen, shares = weighed("stribeck+constant_torque", 500.0), {"stribeck": 0.65, "constant_torque": 0.42}
    rivals = [weighed("quadratic_drag+constant_torque", 480.0), weighed("stribeck", 40.0)]
    found = judged(chosen, rivals, left=0.25, shares=shares)
    assert (found.word, found.causes) == ("partly_explained", ("constant_torque",))
    assert found.undecided == ("stribeck",)
    assert found.probability == pytest.approx(THRESHOLDS.right_partly[0])
    assert found.main["constant_torque"] == pytest.approx(found.probability)
    assert found.among["stribeck"] < found.among["constant_torque"]
    # With what no set that holds it does without, whatever does as well as a twin of it.
    twins = {"constant_torque": frozenset({"asymmetric_friction"})}
    both = [weighed("stribeck+asymmetric_friction", 495.0), weighed("constant_torque", 300.0)]
    asserted = judged(chosen, [*both, weighed("cogging+constant_torque", 300.0)], left=0.25, shares=shares, twins=twins)
    assert asserted.causes == ("stribeck", "constant_torque")
    near = [*rivals, weighed("stribeck+cogging", 470.0)]
    assert judged(chosen, near, left=0.25, shares=shares).word == "unexplained"
    # Not where it takes less than half as much, where all together take no part of the whole gap, where the size of the
    # largest is not told from nothing; nor for the whole gap.
    assert judged(chosen, rivals, left=0.25, shares=shares | {"constant_torque": 0.3}).word == "unexplained"
    assert judged(chosen, rivals, left=0.8, moved=0.3, shares=shares).word == "unexplained"
    assert judged(chosen, rivals, left=0.25, shares=shares, unshown=frozenset({"stribeck"})).word == "unexplained"
    several = [weighed(f"{name}+constant_torque", 499.0) for name in ("quadratic_drag", "cogging", "presliding")]
    assert judged(chosen, several, left=0.15, shares=shares).word != "explained"
    assert judged(chosen, rivals, left=0.05, shares=shares).causes == ("stribeck", "constant_torque")


def test_nothing_is_sure_where_nothing_explains():
    found = judged(weighed("stribeck", 500.0), [weighed("presliding", 100.0)], left=0.97)
    assert max(found.main.values()) <= max(THRESHOLDS.right_unexplained) <= 0.5
    assert (found.word, found.causes) == ("unexplained", ())
    assert judged(weighed("stribeck", 500.0), [], allowed=("backlash",)).word == "unexplained"


def test_a_gap_that_what_counts_as_right_closes_is_none():
    """A known load off by 2 %: what bends besides has no share of the gap, and must not stand for it."""
    chosen = weighed("position_dependent_friction", 500.0)
    shares = {"position_dependent_friction": 0.001}
    found = judged(chosen, [], before=0.5, shares=shares, numbers=0.1)
    assert (found.word, found.causes) == ("no_gap", ())
    # Where the numbers do not close it, the effects do together what none of them does alone.
    assert judged(chosen, [], before=0.5, shares=shares, numbers=0.5).causes == ("position_dependent_friction",)
    assert judged(chosen, [], before=0.5, numbers=0.1).causes == ("position_dependent_friction",)


def test_what_holds_a_cause_as_a_special_case_says_nothing_against_a_part_that_it_explains():
    spring = weighed("compliance", 500.0)
    found = judged(spring, [weighed("backlash", 498.0), weighed("stribeck", 100.0)], left=0.4)
    assert (found.word, found.causes) == ("partly_explained", ("compliance",))
    # Cogging over full turns is no unbalance: only what holds a cause exactly is it.
    assert judged(weighed("unbalance", 500.0), [weighed("cogging", 498.0)], left=0.4).word == "unexplained"
    assert judged(weighed("backlash", 500.0), [weighed("compliance", 498.0)], left=0.4).word == "unexplained"


def test_a_backlash_whose_gap_may_be_none_is_the_compliance_that_is_told(monkeypatch):
    monkeypatch.setattr(judge, "covariance", lambda search, fit: None)
    monkeypatch.setattr(judge, "insignificant_causes", lambda search, fit, spread: frozenset(fit.unshown))
    spring, free = weighed("compliance", 500.0), weighed("backlash", 498.0)
    for unshown, meaning in (({"backlash"}, {"backlash": "compliance"}), (set(), {})):
        free.fit.unshown = unshown
        decision = SimpleNamespace(chosen=spring, singles=(free,), rivals=())
        assert judge._meaning(None, decision) == meaning
        share = judged(spring, [free], meaning=meaning).main.get("backlash", 0.0)
        assert (share == 0.0) == bool(meaning)


def test_a_model_is_worth_its_evidence_times_how_far_it_shrinks_the_gap():
    shrinks, follows = weighed("asymmetric_friction", 400.0, left=0.5), weighed("presliding", 500.0, left=0.8)
    assert shrinks.worth > follows.worth
    assert follows.behind(shrinks) == pytest.approx(400.0 - 500.0 * np.log(0.8) / np.log(0.5) * 1.0, rel=1e-9)
    found = judged(shrinks, [follows], left=0.5)
    assert (found.word, found.causes) == ("partly_explained", ("asymmetric_friction",))
    # Among models that leave next to nothing, evidence decides.
    assert weighed("a", 500.0, left=0.02).worth > weighed("b", 490.0, left=0.001).worth
    assert weighed("a", 500.0, left=1.3).worth < 1.0
    assert weighed("a", -5.0, left=0.1).worth == 0.0


def test_the_chosen_causes_with_details_beside_them_are_no_rival():
    chosen = weighed("asymmetric_friction", 500.0)
    found = judged(chosen, [weighed("asymmetric_friction+cogging", 900.0), weighed("stribeck", 100.0)])
    assert found.main["asymmetric_friction"] == pytest.approx(THRESHOLDS.right_explained[0])
    # A wrong nominal number that takes most leads, and keeps its probability.
    found = judged(
        weighed("asymmetric_friction", 500.0, wide=("inertia",)), [weighed("asymmetric_friction+cogging", 900.0)],
        shares={"inertia_error": 0.6, "asymmetric_friction": 0.03},
    )  # fmt: skip
    assert found.causes == ("inertia_error",)
    assert found.main["inertia_error"] > 0.5


def test_several_wrong_numbers_beside_a_detail_are_no_rival_of_the_factor_that_makes_them_wrong(monkeypatch):
    monkeypatch.setattr("fpjax.gap.select.verdict.wrong_numbers", lambda fit, sizes: (0.0, tuple(fit.candidate.wide)))
    chosen = weighed("torque_gain_error+constant_torque", 500.0)
    shares = {"torque_gain_error": 0.8, "constant_torque": 0.1}
    numbers = weighed("constant_torque", 499.0, wide=("inertia", "coulomb", "viscous"))
    found = judged(chosen, [numbers], shares=shares, left=0.4)
    assert (found.word, found.causes) == ("partly_explained", ("torque_gain_error", "constant_torque"))
    # In different directions no factor makes them wrong.
    apart = weighed("constant_torque", 499.0, wide=("inertia", "coulomb"), wrong={"coulomb": 0.5 * NOMINAL["coulomb"]})
    assert judged(chosen, [apart], shares=shares, left=0.4).word == "unexplained"
    # With one number wrong the effect itself does what the factor would: a rival.
    one = weighed("constant_torque", 499.0, wide=("coulomb",))
    assert judged(chosen, [one], shares=shares, left=0.4).word == "unexplained"


def test_an_effect_is_measured_by_what_no_choice_of_the_numbers_closes():
    chosen = weighed("friction_drift", 500.0, wide=("inertia", "coulomb"))
    guess = {"inertia_error": 0.6, "coulomb_error": 0.14}
    shares = guess | {"friction_drift": 0.055}
    numbers = ("inertia_error", "coulomb_error")
    assert judged(chosen, [], shares=shares, numbers=1.0).causes == (*numbers, "friction_drift")
    # What the numbers leave is nearly all the drift's.
    assert judged(chosen, [], shares=shares, numbers=0.24).causes == ("friction_drift", *numbers)
    small = guess | {"friction_drift": 0.03}
    assert judged(chosen, [], shares=small, numbers=1.0).causes == numbers
    assert judged(chosen, [], shares=small, numbers=0.2).causes == ("friction_drift", *numbers)
    # Unless that is next to nothing beside the torque.
    assert judged(chosen, [], shares=small, numbers=0.2, before=0.2).causes == numbers


def test_one_wrong_number_beside_right_ones_stands_where_its_share_of_the_gap_puts_it():
    chosen = weighed("constant_torque", 500.0, wide=("viscous",))
    shares = {"viscous_error": 0.88, "constant_torque": 0.07}
    assert judged(chosen, [], shares=shares, numbers=0.27).causes == ("viscous_error", "constant_torque")
    assert judged(chosen, [], shares={"viscous_error": 0.2, "constant_torque": 0.7}).causes[0] == "constant_torque"


@pytest.mark.parametrize(
    ("alone", "beside", "bound", "told"),
    [
        (0.9, 0.8, (), True),
        (0.9, 0.52, (), False),
        (0.9, 0.3, (), False),
        (0.2, 0.25, (), True),
        (0.9, 0.8, ("coulomb",), False),
    ],
)
def test_numbers_are_told_alone_where_the_likeliest_effects_leave_them_wrong(alone, beside, bound, told):
    """A Coulomb level of 0.5 that bends after a Stribeck curve is right again beside that curve."""

    def fit(coulomb, ends=()):
        values = NOMINAL | {"coulomb": coulomb}
        return SimpleNamespace(candidate=SimpleNamespace(values=lambda: values, at_bound=lambda: list(ends)))

    numbers = SimpleNamespace(
        decision=SimpleNamespace(chosen=SimpleNamespace(fit=fit(alone, bound))),
        verdict=SimpleNamespace(causes=("coulomb_error", "velocity_bias")),
    )
    decision = SimpleNamespace(exact=fit(0.5), chosen=SimpleNamespace(fit=fit(beside)))
    assert _persist(numbers, decision) is told


def test_a_wrong_number_leads_by_its_share_of_what_all_causes_take():
    chosen = weighed("velocity_lag", 100.0, wide=("viscous",), left=0.5)
    shares = {"viscous_error": 0.35, "velocity_lag": 0.01}
    found = judged(chosen, [], shares=shares, left=0.5)
    assert (found.word, found.causes) == ("partly_explained", ("viscous_error",))
    assert found.ahead == pytest.approx(0.35 / 0.75)
    assert found.probability == pytest.approx(THRESHOLDS.right_partly_number)
    # The same share is little where the causes take nearly all.
    assert judged(chosen, [], shares={"viscous_error": 0.25, "velocity_lag": 0.01}, left=0.5).word == "unexplained"


def test_a_number_whose_error_is_immaterial_makes_the_others_no_guess():
    chosen = weighed("position_dependent_friction", 100.0, wide=("coulomb", "viscous"))
    both = ("viscous_error", "position_dependent_friction")
    shares = {"viscous_error": 0.44, "position_dependent_friction": 0.006, "coulomb_error": 0.003}
    assert judged(chosen, [], shares=shares, numbers=0.1).causes == both
    shares = {"viscous_error": 0.44, "position_dependent_friction": 0.006, "coulomb_error": 0.06}
    assert judged(chosen, [], shares=shares, numbers=0.1, share=0.5).causes[0] == "position_dependent_friction"
    # 0.006^(1/2) of a fifth of the torque is a ripple that every machine has.
    assert judged(chosen, [], shares=shares, numbers=0.1, share=0.2).causes[-1] == "position_dependent_friction"


def test_beside_one_wrong_number_an_effect_is_a_detail_unless_it_matters_or_explains_what_is_left():
    chosen = weighed("cogging", 100.0, wide=("inertia",))
    for share, told in ((0.006, ()), (0.0098, ("cogging",)), (0.06, ("cogging",))):  # the number leaves 0.01
        found = judged(chosen, [], shares={"inertia_error": 0.57, "cogging": share}, numbers=0.1)
        assert found.causes == ("inertia_error", *told)


def test_behind_numbers_that_are_told_alone_stand_the_effects_that_stood_beside_them():
    main = {"inertia_error": 0.8, "torque_gain_error": 0.05}
    numbers = Verdict("partly_explained", ("inertia_error",), 0.8, main, main, 50.0, 0.5)
    among = {"inertia_error": 0.2, "constant_torque": 0.2, "torque_gain_error": 0.01}
    beside = Verdict("unexplained", (), 0.75, {"inertia_error": 0.2}, among | {"velocity_lag": 0.98}, 5.0, 0.3)
    found = _with_effects_behind(numbers, beside, {"velocity_lag", "velocity_delay"})
    assert found.main == pytest.approx({**main, "constant_torque": 0.2 * 0.15})
    assert all(found.main[name] <= found.among[name] for name in found.main)
    assert (found.word, found.causes) == (numbers.word, numbers.causes)
    # Many that stood beside them share the room.
    many = replace(beside, among=dict.fromkeys(("cogging", "stribeck", "backlash"), 0.9))
    assert sum(_with_effects_behind(numbers, many, ()).main.values()) == pytest.approx(1.0)


def test_a_number_of_which_little_is_taken_leads_by_its_share_of_half_the_gap():
    chosen = weighed("", 100.0, wide=("inertia",), left=1.0)
    found = judged(chosen, [], shares={"inertia_error": 0.06}, left=1.0, moved=0.6)
    assert (found.word, found.ahead) == ("unexplained", pytest.approx(0.06 / (1.0 - THRESHOLDS.part**2)))


def test_an_effect_whose_size_may_be_nothing_is_not_asserted():
    chosen, shares = weighed("backlash+stribeck", 500.0), {"backlash": 0.6, "stribeck": 0.3}
    assert judged(chosen, [], shares=shares).causes == ("backlash", "stribeck")
    assert judged(chosen, [], shares=shares, unshown=frozenset({"stribeck"})).causes == ("backlash",)
    lost = judged(chosen, [], shares=shares, unshown=frozenset({"backlash"}))
    assert (lost.word, lost.causes) == ("unexplained", ())


def test_below_the_noise_is_no_gap_unless_effects_follow_it():
    assert judged(weighed("stribeck", 3.0), [], before=0.2, left=0.0, floor=0.5).word == "no_gap"
    assert judged(weighed("stribeck", 180.0), [], before=0.2, left=0.9, floor=0.5).word == "unexplained"
    assert judged(weighed("stribeck", 180.0), [], before=0.04, floor=0.5).word == "no_gap"
    assert judged(weighed("stribeck", 180.0), [], before=0.0, floor=0.5).word == "no_gap"


def test_an_exact_twin_is_no_rival_but_shares_the_probability():
    chosen, twin = weighed("actuator_delay", 500.0), weighed("velocity_delay", 499.9)
    apart = judged(chosen, [twin])
    assert (apart.word, apart.ahead) == ("explained", pytest.approx(0.1 / 500.0))
    crowd = [weighed(name, 499.0) for name in ("velocity_delay", "actuator_lag", "velocity_lag")]
    assert judged(chosen, crowd).word == "unexplained"
    assert judged(chosen, crowd[:2]).word == "explained"
    assert judged(chosen, crowd[:2], left=0.5).word == "unexplained"
    found = judged(chosen, [twin, weighed("stribeck", 100.0)], twins=single_twins(RATE_ONLY))
    assert (found.word, found.causes) == ("explained", ("actuator_delay",))
    assert found.ahead == pytest.approx(0.8)
    assert found.main["actuator_delay"] + found.main["velocity_delay"] == pytest.approx(
        THRESHOLDS.right_explained[0], abs=1e-6
    )
    assert found.main["velocity_delay"] == pytest.approx(found.main["actuator_delay"], rel=0.1)
    # With an encoder beside the rate they differ.
    assert judged(chosen, [twin], twins=single_twins(BOTH)).ahead < THRESHOLDS.contested


def test_evidence_that_is_not_finite_is_no_rival():
    found = judged(weighed("stribeck", 500.0), [weighed("backlash", -np.inf)])
    assert found.main["backlash"] < 1e-50


@pytest.mark.parametrize("left", [0.02, 0.5])
def test_nothing_is_asserted_of_a_log_that_cannot_be_what_it_says(left):
    chosen = weighed("cogging", 100.0, left=left)
    assert judged(chosen, [], left=left).causes == ("cogging",)
    found = judged(chosen, [], left=left, contradicted=True, readings=("velocity_scale_error",))
    assert (found.word, found.causes) == ("unexplained", ())
    assert "velocity_scale_error" not in found.among
    assert found.main["cogging"] <= THRESHOLDS.right_unexplained[0]
    assert judged(chosen, [], share=1e-3, left=left, contradicted=True).word == "no_gap"


def test_beside_a_limit_what_is_left_is_of_what_the_drive_gives():
    chosen, rivals = weighed("torque_saturation", 500.0), [weighed("presliding", 100.0)]
    for whole, word in ((1.0, "explained"), (0.3, "partly_explained"), (0.12, "unexplained")):
        assert judged(chosen, rivals, left=0.1, whole=whole).word == word
    # Shares are of that too; a reading's error is compared with them as of the whole gap.
    shares, misread = {"torque_saturation": 1.0, "unbalance": 0.2}, {"velocity_scale_error": 0.1}
    found = judged(chosen, rivals, shares=shares, whole=0.2, readings=tuple(misread), misread=misread, left=0.01)
    assert found.causes == ("velocity_scale_error", "torque_saturation", "unbalance")


def test_what_brings_much_of_the_evidence_is_a_cause_however_little_torque_it_takes():
    """A delay that takes 4 % of the gap's energy beside a friction by load, and a third of all the evidence."""
    chosen = weighed("load_dependent_friction+actuator_delay", 1700.0)
    shares = {"load_dependent_friction": 0.07, "actuator_delay": 0.038}
    told = [
        judged(chosen, [], shares=shares, lost={"load_dependent_friction": 0.6, "actuator_delay": lost}).causes
        for lost in (0.9 * THRESHOLDS.weighs, 1.1 * THRESHOLDS.weighs)
    ]
    assert told == [("load_dependent_friction",), ("load_dependent_friction", "actuator_delay")]
    # So is a number: a viscous friction a quarter off beside a weight, a 300th of the gap and a fifth of the nats.
    wide = weighed("unbalance", 1700.0, wide=("viscous",))
    shares = {"unbalance": 0.97, "viscous_error": 0.003}
    weighs = THRESHOLDS.weighs
    for lost, causes in ((0.9 * weighs, ("unbalance",)), (1.1 * weighs, tuple(shares))):
        assert judged(wide, [], shares=shares, lost={"unbalance": 0.9, "viscous_error": lost}).causes == causes


def test_withheld_windows_and_all_of_them_count_their_noise_once():
    """Of 1 N m 73.75 % are closed on withheld windows with a floor of 0.2: 0.2625 of what stands out are left."""
    after = judge._withheld_shows(1.0, 0.14, 0.7375)
    chosen = weighed("cogging", 500.0)
    assert (after - 0.14) / (1.0 - 0.14) == pytest.approx(0.2625)
    assert judged(chosen, [], left=after, floor=0.14).word == "partly_explained"
    assert judge._withheld_shows(0.1, 0.14, 0.7) == 0.1  # nothing stands out


def test_what_is_left_is_held_against_what_noise_alone_shows():
    """As the share closed is: 100 % closed is no part."""
    chosen = weighed("cogging", 500.0)
    assert judged(chosen, [], left=0.34, floor=1e-3).word == "partly_explained"
    assert judged(chosen, [], left=0.34, floor=0.35).word == "explained"
    assert judged(chosen, [], left=0.34, floor=0.1).word == "partly_explained"
    # Where the gap hardly stands out of the noise, one per cent less explains nothing.
    assert judged(chosen, [], left=0.99, floor=0.98).word == "unexplained"


def test_what_rounding_makes_is_not_left():
    """Its energy is no torque's: 0.3 of rounding in 0.31 leave 0.08, 0.2 of it 0.24."""
    chosen = weighed("velocity_delay", 500.0)
    words = [judged(chosen, [], left=0.31, of_rounding=rounding).word for rounding in (0.0, 0.2, 0.3)]
    assert words == ["partly_explained", "partly_explained", "explained"]
    # Where it is all that the nominal model misses, nothing was explained.
    assert judged(chosen, [], left=0.9, of_rounding=1.1).word == "unexplained"


def test_a_rival_that_shares_a_detail_is_named_by_what_it_has_in_the_place_of_what_leads():
    chosen = weighed("stribeck+load_dependent_friction", 500.0)
    shares = {"load_dependent_friction": 0.9, "stribeck": 0.01}
    rivals = [weighed("stribeck+torque_gain_error", 499.0), weighed("stribeck+actuator_delay", 498.0)]
    found = judged(chosen, rivals, shares=shares)
    assert {n for n, p in found.main.items() if p > 0.1} == {
        "load_dependent_friction",
        "torque_gain_error",
        "actuator_delay",
    }
    # Two others may do as well in its place; three say nothing.
    assert found.word == "explained"
    assert judged(chosen, [*rivals, weighed("stribeck+actuator_lag", 498.0)], shares=shares).word == "unexplained"


def test_numbers_that_are_all_too_large_say_the_same_as_a_friction_by_load(monkeypatch):
    monkeypatch.setattr("fpjax.gap.select.verdict.wrong_numbers", lambda fit, sizes: (0.0, tuple(fit.candidate.wide)))
    chosen, large = weighed("load_dependent_friction", 500.0), ("inertia", "coulomb")
    same = weighed("unbalance", 499.0, wide=large)
    small = weighed("unbalance", 499.0, wide=large, wrong={name: 0.8 * NOMINAL[name] for name in large})
    assert "unbalance" not in judged(chosen, [same]).main
    assert "unbalance" in judged(chosen, [small]).main
    # Beside a number that is wrong all the same it is another explanation.
    assert "unbalance" in judged(weighed("load_dependent_friction", 500.0, wide=("viscous",)), [same]).main


def test_a_rounding_counts_by_what_it_makes_of_the_missing_torque():
    exact = SimpleNamespace(moving=(np.ones(4),))
    coarse = Reading(ROUNDING, {"step": (0.1, 1e-6, "rad/s")}, 0.01, 0.01, np.inf)
    read = judge.Read(1.0, (coarse,), ())
    assert judge._beside_gap(exact, read, 0.5, 0.0)[ROUNDING] < 0.01
    assert judge._beside_gap(exact, read, 0.5, 0.2)[ROUNDING] == pytest.approx(0.16)
