"""Who shares probability with whom, what is named as one, and how far each cause goes."""

import dataclasses
from types import SimpleNamespace

import gap_search
import numpy as np
import numpy_machine
import pytest
from weighed_models import BOTH, NOMINAL, RATE_ONLY, weighed

from fpjax import diagnose
from fpjax.gap import EFFECTS, Estimate, Ranked, Step
from fpjax.gap.answer.assemble import _instead
from fpjax.gap.answer.confusable import indistinguishable
from fpjax.gap.answer.gap_size import steps_of, with_readings
from fpjax.gap.answer.ranking import factor_twin, share_alike, told_apart
from fpjax.gap.effects.twins import Twin, exact_twins
from fpjax.gap.select import simpler
from fpjax.gap.select import weighed as weighing
from fpjax.gap.select.readings import Reading
from fpjax.gap.thresholds import THRESHOLDS


def estimate(value, half=0.01):
    return Estimate(value, value - half * abs(value), value + half * abs(value), "1")


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


# --- classes


def classes(chosen, rivals, effect, twins=(), alike=None):
    decision = SimpleNamespace(chosen=chosen, rivals=(chosen, *rivals), alike=alike or {})
    return indistinguishable(decision, effect, list(twins))


def test_a_class_wants_close_evidence_in_the_same_place():
    chosen = weighed("stribeck+actuator_lag", 100.0)
    rivals = [weighed("velocity_lag+stribeck", 97.0), weighed("cogging+unbalance", 99.9), weighed("stribeck", 99.9)]
    assert classes(chosen, rivals, "actuator_lag") == ("velocity_lag",)
    assert classes(chosen, rivals, "stribeck") == ()
    assert classes(chosen, [weighed("velocity_lag+stribeck", 95.0)], "actuator_lag") == ()


def test_a_number_that_makes_up_for_a_wrong_one_is_named_with_it():
    alike = {"coulomb_error": ("viscous_error",)}
    assert classes(weighed("", 100.0, wide=("coulomb", "viscous")), [], "coulomb_error", (), alike) == (
        "viscous_error",
    )
    assert classes(weighed("", 100.0, wide=("coulomb", "viscous")), [], "inertia_error", (), alike) == ()


def test_a_class_holds_three_names_and_the_exact_twin_comes_first():
    chosen = weighed("constant_torque", 100.0)
    rivals = [weighed("velocity_bias", 99.9), weighed("unbalance", 99.8)]
    twin = Twin(frozenset({"constant_torque"}), ("asymmetric_friction",))
    assert classes(chosen, rivals, "constant_torque", [twin]) == ("asymmetric_friction", "velocity_bias")
    several = Twin(frozenset({"constant_torque"}), ("a", "b"))
    assert classes(chosen, [], "constant_torque", [several]) == ("a", "b")
    assert classes(chosen, rivals[:1], "constant_torque", [several]) == ("velocity_bias",)


def test_a_lag_that_may_be_a_delay_names_it():
    torn, sure = (Reading("velocity_lag", {}, 0.1, 1.0, 50.0, "velocity_delay", share) for share in (0.7, 0.999))
    assert _instead((torn,), ()) == {"velocity_lag": ("velocity_delay",)}
    assert _instead((sure,), ()) == {}
    assert _instead((torn,), ("velocity_lag",)) == {}  # it was not allowed


# --- how far


def test_the_last_step_is_the_whole_with_its_details():
    def fit(names, missing):
        return SimpleNamespace(candidate=SimpleNamespace(structural=names), missing=(np.full(8, missing),))

    nominal, first, whole = fit((), 9.0), fit(("stribeck",), 4.0), fit(("stribeck", "actuator_lag"), 1.0)
    search = SimpleNamespace(withheld=[np.arange(8)])
    decision = SimpleNamespace(exact=nominal, path=(nominal, first, whole), chosen=SimpleNamespace(fit=whole))
    ladder = [(step.added, step.gap_after) for step in steps_of(search, decision, ("stribeck",))]
    assert ladder == [("stribeck", 2.0), ("actuator_lag", 1.0)]
    both = steps_of(search, decision, ("stribeck", "actuator_lag"))
    assert [(step.added, step.gap_after) for step in both] == ladder
    alone = SimpleNamespace(exact=nominal, path=(nominal, whole), chosen=SimpleNamespace(fit=whole))
    assert [(step.added, step.gap_after) for step in steps_of(search, alone, ("stribeck",))] == [("stribeck", 1.0)]


def test_a_ladder_with_numbers_fits_each_step_to_its_own_end_from_where_the_whole_stands():
    def effect(name, *parameters):
        return SimpleNamespace(name=name, parameters=tuple(SimpleNamespace(name=p) for p in parameters))

    def fit(missing, candidate=None):
        return SimpleNamespace(candidate=candidate, missing=(np.full(8, missing),))

    effects = (effect("asymmetric_friction", "coulomb", "direction"), effect("actuator_lag", "lag"))
    values = {"inertia": 0.06, "coulomb": 0.7, "viscous": 0.2, "direction": 0.1, "lag": 0.01}
    whole = fit(1.0, SimpleNamespace(effects=effects, values=lambda: dict(values)))
    asked = []

    def fitted(starts, *, alone):
        asked.extend((tuple(e.name for e in s.effects), s.wide, s.values, alone) for s in starts)
        return [fit(9.0), fit(4.0)]

    search = SimpleNamespace(withheld=[np.arange(8)], fitted=fitted)
    decision = SimpleNamespace(chosen=SimpleNamespace(fit=whole))
    causes = ("asymmetric_friction", "inertia_error", "actuator_lag")
    ladder = [(step.added, step.gap_after) for step in steps_of(search, decision, causes)]
    assert ladder == [("asymmetric_friction", 3.0), ("inertia_error", 2.0), ("actuator_lag", 1.0)]
    # The Coulomb level is the effect's own: it starts as fitted. Inertia and viscous friction are as given until told.
    first = {"coulomb": 0.7, "direction": 0.1}
    assert asked == [
        (("asymmetric_friction",), (), first, True),
        (("asymmetric_friction",), ("inertia",), first | {"inertia": 0.06}, True),
    ]


def test_twins_by_wide_intervals_are_none_where_one_of_them_alone_is_far_behind():
    twin = Twin(frozenset({"asymmetric_friction"}), ("constant_torque",))
    for gain, apart in ((395.0, False), (100.0, True)):
        singles = (weighed("asymmetric_friction", 400.0), weighed("constant_torque", gain))
        assert told_apart(SimpleNamespace(singles=singles), twin) == apart
    # What was not fitted alone is not told apart.
    assert not told_apart(SimpleNamespace(singles=singles[:1]), twin)
    assert not told_apart(SimpleNamespace(singles=singles), Twin(twin.causes, ("coulomb_error", "constant_torque")))


@pytest.mark.parametrize(("missing", "left"), [(2.0, 0.25), (0.0, 1.0)])
def test_of_a_nominal_model_that_misses_nothing_nothing_is_taken(missing, left):
    def fit(rms):
        candidate = SimpleNamespace(effects=(), structural=())
        return SimpleNamespace(candidate=candidate, evidence=0.0, missing_rms=lambda windows, moving=False: rms)

    assert weighing.weighed_fit(None, weighing.Exact(fit(missing), ()), fit(0.5), 10.0).left == left


@pytest.fixture(autouse=True)
def _stand_ins_have_no_likelihood(monkeypatch):
    """Of a stand-in's evidence wrong numbers cost a nat each."""
    monkeypatch.setattr(simpler, "wrong_numbers", lambda fit, sizes: (fit.evidence - len(fit.candidate.wide), ()))
    monkeypatch.setattr(simpler, "nominal_sizes", lambda setting: {})


GIVEN = {"inertia": 2.0, "coulomb": 0.5, "viscous": 0.1}


def fit(names, wide, strain, left, evidence=990.0, values=None):
    values = GIVEN | (values or {})
    candidate = SimpleNamespace(
        structural=names, effects=tuple(effect for effect in EFFECTS if effect.name in names), wide=frozenset(wide),
        names=names, at_bound=list, strain=strain or 0.0, values=lambda: values,
    )  # fmt: skip
    return SimpleNamespace(candidate=candidate, evidence=evidence, missing_rms=lambda windows, moving=False: left)


def simpler_search(fits, hopeless, plain=0.0, turning_load=0j):
    """A search in which some sets of effects have these fits, and all others a hopeless one."""

    def fitted(starts):
        names = [{effect.name for effect in start.effects} for start in starts]
        return [next((f for f in fits if set(f.candidate.structural) == own), hopeless) for own in names]

    setting = SimpleNamespace(turning_load=turning_load)
    asked = SimpleNamespace(effects=EFFECTS, records=[], fitted=fitted, setting=setting)
    asked.refit = lambda fit, wide: SimpleNamespace(evidence=plain)
    return asked


OFF = {"inertia": 1.2 * GIVEN["inertia"], "coulomb": 1.3 * GIVEN["coulomb"]}
BOTH_OFF = ("inertia", "coulomb")
NEAR = 1000.0 - 0.9 * THRESHOLDS.close


@pytest.mark.parametrize(
    ("wide", "values", "beside", "evidence", "left", "alike"),
    [
        (BOTH_OFF, OFF, "stribeck", NEAR, 0.1, True),  # by its strain alone no simpler cause
        (BOTH_OFF, OFF, "stribeck", NEAR - THRESHOLDS.close, 0.1, False),  # the numbers are likelier
        (BOTH_OFF, OFF, "stribeck", NEAR, 0.3, False),  # more is missing
        (BOTH_OFF, OFF | {"coulomb": 0.4}, "stribeck", NEAR, 0.1, False),  # one is too large, one too small
        (BOTH_OFF, OFF, "load_dependent_friction", NEAR, 0.1, False),  # one for many is there already
        (BOTH_OFF[:1], OFF, "stribeck", 1100.0, 0.1, False),  # one number is no more than it is
    ],
)
def test_a_factor_that_would_do_as_well_as_wrong_numbers_is_told_beside_them(
    monkeypatch, wide, values, beside, evidence, left, alike
):
    monkeypatch.setattr(simpler, "resolved", lambda search, fit: True)
    chosen = weighing.Weighed(fit((beside,), wide, 0.0, 0.1, 1000.0, values), 1000.0, 1000.0, 0.1)
    exact, hopeless = weighing.Exact(fit((), (), 0.0, 1.0, 0.0), ()), fit((), (), 0.0, 9.0, -1e9)
    factor = fit((beside, "torque_gain_error"), (), 2.0 * THRESHOLDS.unlike, left, evidence, {"gain": 0.8})
    found = simpler.alike_factor(simpler_search([factor], hopeless), exact, chosen)
    assert (found is not None and found.fit is factor) == alike
    decided = SimpleNamespace(factor=found)
    twins = factor_twin(decided, ["stribeck", "inertia_error", "coulomb_error"])
    assert [one.sentence() for one in twins] == (
        ["coulomb_error + inertia_error and torque_gain_error (gain 0.8) fit this log alike."] if alike else []
    )
    assert factor_twin(decided, ["stribeck", "inertia_error"]) == []  # no factor does what one number does


def test_what_stands_for_a_detail_is_likelier_than_nothing_in_its_place(monkeypatch):
    """A ripple of 20 of 1,000 nats: a weight that brings none of them is no simpler form of it."""
    monkeypatch.setattr(simpler, "resolved", lambda search, fit: True)
    chosen = weighing.Weighed(fit(("stribeck", "cogging"), (), 0.0, 0.1, 1000.0), 1000.0, 1000.0, 0.1)
    exact, hopeless = weighing.Exact(fit((), (), 0.0, 1.0, 0.0), ()), fit((), (), 0.0, 9.0, -1e9)
    weight = fit(("stribeck", "unbalance"), (), 0.0, 0.1, 980.0)
    for evidence, told in ((985.0, chosen.structural), (970.0, ("stribeck", "unbalance"))):
        search = simpler_search([weight, fit(("stribeck",), (), 0.0, 0.1, evidence)], hopeless)
        assert simpler.simpler(search, exact, chosen).structural == told


def test_a_factor_is_no_simpler_cause_where_the_numbers_beside_it_are_off(monkeypatch):
    def of(factor, plain=0.0):
        return simpler_search([factor], fit((), (), 0.0, 9.0, -1e9), plain)

    chosen = weighing.Weighed(fit(("stribeck",), ("inertia", "coulomb"), 0.0, 0.1), 1000.0, 1000.0, 0.1)
    exact = weighing.Exact(fit((), (), 0.0, 1.0, 0.0), ())
    monkeypatch.setattr(simpler, "resolved", lambda search, fit: True)
    both = ("stribeck", "torque_gain_error")
    for strain, evidence, told in ((2.9, 990.0, both), (3.1, 990.0, ("stribeck",)), (3.1, 1010.0, ("stribeck",))):
        factor = fit(both, (), strain, 0.1, evidence)
        assert simpler.simpler(of(factor), exact, chosen).structural == told
    # As a factor does, a friction that grows with the load: where the motor hardly ever brakes it is nearly one.
    loaded = ("stribeck", "load_dependent_friction")
    assert simpler.simpler(of(fit(loaded, (), 0.0, 0.1)), exact, chosen).structural == loaded
    # What it loses is of what the numbers bring: five of a thousand, not five of fifteen.
    assert simpler.simpler(of(fit(both, (), 0.0, 0.1, 985.0)), exact, chosen).structural == both
    assert simpler.simpler(of(fit(both, (), 0.0, 0.1, 985.0), 975.0), exact, chosen).structural == ("stribeck",)
    # In the place of one wrong number it must be the likelier of the two.
    chosen = weighing.Weighed(fit(("stribeck",), ("inertia",), 0.0, 0.1), 1000.0, 1000.0, 0.1)
    for evidence, told in ((990.0, ("stribeck",)), (1010.0, both)):
        factor = fit(both, (), 0.0, 0.1, evidence)
        assert simpler.simpler(of(factor), exact, chosen).structural == told
    # Unless a friction by direction stands beside it whose means are off by as much, and as they were given beside one.
    sides = "asymmetric_friction"
    off = fit((sides,), ("inertia",), 0.0, 0.1, values={"inertia": 1.6, "coulomb": 0.4, "viscous": 0.08})
    chosen, both = weighing.Weighed(off, 1000.0, 1000.0, 0.1), (sides, "torque_gain_error")
    for coulomb, told in ((0.99 * 0.5, both), (0.94 * 0.5, (sides,)), (1.2 * 0.5, (sides,))):
        factor = fit(both, (), 0.0, 0.1, values={"inertia": 2.0, "coulomb": coulomb, "viscous": 0.1})
        assert simpler.simpler(of(factor), exact, chosen).structural == told


@pytest.mark.parametrize(
    ("turning_load", "wide", "stands"),
    [(3.0 + 1.0j, ("coulomb",), True), (0j, ("coulomb",), False), (3.0 + 1.0j, (), False)],  # a weight alone is one
)
def test_a_factor_stands_for_the_error_of_a_known_load_and_of_the_numbers_together(
    monkeypatch, turning_load, wide, stands
):
    monkeypatch.setattr(simpler, "resolved", lambda search, fit: True)
    chosen = weighing.Weighed(fit(("cogging", "unbalance"), wide, 0.0, 0.1, 1000.0), 1000.0, 1000.0, 0.1)
    exact, hopeless = weighing.Exact(fit((), (), 0.0, 1.0, 0.0), ()), fit((), (), 0.0, 9.0, -1e9)
    factor, rest = fit(("cogging", "torque_gain_error"), (), 0.0, 0.1, 990.0), fit(("cogging",), (), 0.0, 0.3, 900.0)
    search = simpler_search([factor, rest], hopeless, turning_load=turning_load)
    told = ("cogging", "torque_gain_error") if stands else ("cogging", "unbalance")
    assert simpler.simpler(search, exact, chosen).structural == told


def test_a_model_that_is_less_likely_than_one_it_contains_leaves_no_less_torque():
    likelier, less = weighed("compliance+cogging", 500.0, left=0.5), weighed("backlash+cogging", 480.0, left=0.4)
    other = weighed("backlash+stribeck", 400.0, left=0.3)
    found = {w.structural: w for w in weighing.no_better_than_contained([less, likelier, other])}
    assert found[less.structural].left == 0.5
    assert found[less.structural].worth < found[likelier.structural].worth
    assert found[other.structural] is other  # its compliance was not tried
    (kept, _) = weighing.no_better_than_contained([dataclasses.replace(less, evidence=510.0, gain=510.0), likelier])
    assert kept.left == 0.4


def test_a_likelier_special_case_takes_the_place_of_what_contains_it(monkeypatch):
    def fit(name, evidence, left):
        candidate = SimpleNamespace(
            structural=(name,), effects=tuple(effect for effect in EFFECTS if effect.name == name), wide=frozenset(),
            names=(name,), at_bound=list, values=dict,
        )  # fmt: skip
        return SimpleNamespace(candidate=candidate, evidence=evidence, missing_rms=lambda windows, moving=False: left)

    monkeypatch.setattr(simpler, "resolved", lambda search, fit: True)
    chosen = weighing.Weighed(fit("backlash", 1000.0, 0.4), 1000.0, 1000.0, 0.4)
    exact = weighing.Exact(SimpleNamespace(evidence=0.0, missing_rms=lambda windows, moving=False: 1.0), ())
    for evidence, told in ((1020.0, "compliance"), (1005.0, "backlash"), (990.0, "backlash")):
        fits = [fit("compliance", evidence, 0.6), fit("", -1e9, 1.0)]  # leaves a fifth of the energy more; nothing
        setting = SimpleNamespace(turning_load=0j)
        search = SimpleNamespace(effects=EFFECTS, records=[], setting=setting, fitted=lambda starts, fits=fits: fits)
        assert simpler.simpler(search, exact, chosen).structural == (told,)


def test_an_error_of_the_reading_stands_in_its_place_and_takes_nothing():
    gap = SimpleNamespace(before=9.0, before_interval=(8.0, 10.0))
    steps = (Step("stribeck", 4.0, (3.0, 5.0)), Step("cogging", 1.0, (0.5, 1.5)))

    def ladder(*causes):
        return [(s.added, s.gap_after) for s in with_readings(steps, causes, ("velocity_lag",), gap)]

    assert ladder("velocity_lag", "stribeck", "cogging") == [("velocity_lag", 9.0), ("stribeck", 4.0), ("cogging", 1.0)]
    assert ladder("stribeck", "velocity_lag") == [("stribeck", 4.0), ("velocity_lag", 4.0), ("cogging", 1.0)]
    assert ladder("stribeck") == [("stribeck", 4.0), ("cogging", 1.0)]


@pytest.mark.long
def test_a_wrong_number_before_an_effect_is_credited_with_its_own_step():
    def cogs(time, velocity, position, command):
        return 0.05 * np.sin(12.0 * position)

    log = numpy_machine.record(numpy_machine.Machine(coulomb=0.6), extra=cogs)
    found = diagnose(log, gap_search.MODEL)
    assert found.causes == ("coulomb_error", "cogging")
    first, second = found.steps
    assert (first.added, second.added) == found.causes
    # What is left of 0.2 N m of friction and 0.035 N m rms of cogging.
    assert first.gap_after < 0.3 * found.gap.before
    assert second.gap_after < 0.3 * first.gap_after
    assert second.gap_after == found.gap.after
