"""What stands for something else: a wild friction number for an effect, numbers for a machine that vibrates."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from fpjax.gap.answer import judge
from fpjax.gap.answer.judge import Judged
from fpjax.gap.effects.parameters import RIPPLE
from fpjax.gap.fit.candidate import Fit, Start
from fpjax.gap.select import wild_numbers
from fpjax.gap.select.detectability import _drives
from fpjax.gap.select.statement import Verdict
from fpjax.gap.select.weighed import Weighed
from fpjax.gap.select.wild_numbers import STRIBECK, _stribeck_anew, plausible, with_right_numbers
from fpjax.gap.thresholds import THRESHOLDS

GIVEN = {"inertia": 2.0, "coulomb": 0.5, "viscous": 0.1}


def model(effects, evidence, left, numbers=None, given=None):
    """A weighed model with wrong nominal numbers by name."""
    numbers = numbers or {}
    candidate = SimpleNamespace(
        effects=tuple(law(name, ("position",) if name == "cogging" else ("velocity",)) for name in effects),
        structural=tuple(effects), wide=frozenset(numbers), values=lambda: GIVEN | (given or {}) | numbers,
    )  # fmt: skip
    fit = SimpleNamespace(candidate=candidate, evidence=evidence, undrowned=evidence)
    fit.model = Weighed(fit, evidence, evidence, left)
    return fit.model


def replaced(monkeypatch, chosen, found, given=None, anew=()):
    """(what is told in place of a chosen model where the models beside it are `found`, what they stood beside).

    Beside them are the models `anew`, where a Stribeck friction and the numbers begin anew.
    """
    monkeypatch.setattr(wild_numbers, "nominal_sizes", lambda setting: GIVEN)
    monkeypatch.setattr(wild_numbers, "settled", lambda search, exact, weighed: weighed)
    starts = [SimpleNamespace(effects=w.fit.candidate.effects) for w in found] or [SimpleNamespace(effects=())]
    monkeypatch.setattr(wild_numbers, "weigh", lambda search, exact, models: [getattr(m, "model", m) for m in models])
    monkeypatch.setattr(wild_numbers, "beside", lambda search, bases, likely: tried.append((bases, likely)) or starts)
    monkeypatch.setattr(
        wild_numbers, "_stribeck_anew",
        lambda search, start: [start] if any(effect.name == STRIBECK for effect in start.effects) else [],
    )  # fmt: skip
    monkeypatch.setattr(wild_numbers, "resolved", lambda search, fit: "unresolved" not in fit.candidate.structural)
    tried = []
    laws = [law(name) for name in ("quadratic_drag", "stribeck", "unresolved")] + [law("compliance", ())]
    by_direction = law("asymmetric_friction", held=("coulomb", "viscous"))
    search = SimpleNamespace(
        setting=None, effects=(*laws, by_direction), explore=lambda starts, keep, white: found,
        fitted=lambda starts: list(anew),
    )  # fmt: skip
    exact = SimpleNamespace(fit=model((), 0.0, 1.0, given=given).fit)
    got, beside = plausible(search, exact, chosen, found)
    assert bool(beside) == (got is not chosen)
    for _, likely in tried:
        # No structure of the machine, and none that holds the number itself.
        assert likely == ["quadratic_drag", "stribeck", "unresolved"]
    return got, [[base.structural for base in bases] for bases, _ in tried]


def law(name, follows=("velocity",), held=()):
    return SimpleNamespace(name=name, follows=follows, parameters=tuple(SimpleNamespace(name=n) for n in held))


@pytest.mark.parametrize("effects", [("cogging",), ()])
def test_a_viscous_friction_of_five_times_the_given_one_stands_for_a_likelier_drag(monkeypatch, effects):
    wild = model(effects, 1500.0, 0.13, {"viscous": 0.5})
    drag = model((*effects, "quadratic_drag"), 2100.0, 0.05)

    def told(found, chosen=wild):
        return replaced(monkeypatch, chosen, found)[0]

    assert told([drag]) is drag
    # Beside which the number must be right; the next likely one may make it so. Other numbers may be wrong.
    more = model((*effects, "stribeck"), 2200.0, 0.04, {"viscous": 0.12})
    assert told([more]) is wild
    assert told([more, drag]) is drag
    other = model((*effects, "quadratic_drag"), 2100.0, 0.05, {"inertia": 2.1})
    assert told([other]) is other
    # But none as far off, which would stand for the law in its turn.
    swapped = model((*effects, "quadratic_drag"), 2100.0, 0.05, {"inertia": 2.0 * (1.0 - 1.1 * THRESHOLDS.wild)})
    assert told([swapped]) is wild
    # It must be likelier for sure, leave less, and be resolved by the log.
    for near in (
        model(drag.structural, 1500.0 + 0.5 * THRESHOLDS.decisive, 0.05),
        model(drag.structural, 2100.0, 0.14),
        model((*effects, "unresolved"), 2100.0, 0.05),
    ):
        assert told([near]) is wild
    # A number as far off as a guess is one, and an inertia is no friction.
    for numbers in ({"viscous": 0.1 * (1.0 + 0.9 * THRESHOLDS.wild)}, {"inertia": 9.0}):
        guess = model(effects, 1500.0, 0.13, numbers)
        assert told([drag], guess) is guess
    assert told([]) is wild
    # Friction that the nominal model has none of stands for itself.
    assert replaced(monkeypatch, wild, [drag], given={"viscous": 0.0})[0] is wild


def test_a_factor_stands_for_wild_numbers_where_a_friction_by_load_is_hardly_likelier(monkeypatch):
    """A motor that hardly ever brakes, with a gain of 0.78."""
    wild, sure = model(("cogging",), 1500.0, 0.13, {"coulomb": 0.7, "viscous": 0.14}), THRESHOLDS.decisive
    for ahead, factor in ((0.9, True), (1.1, False)):
        loaded = model(("cogging", "load_dependent_friction"), 1500.0 + 1.5 * sure, 0.12)
        gain = model(("cogging", "torque_gain_error"), loaded.evidence - ahead * sure, 0.12)
        assert replaced(monkeypatch, wild, [loaded, gain])[0] is (gain if factor else loaded)


@pytest.mark.parametrize(
    ("effects", "tried"),
    [
        (("cogging",), 1),
        (("cogging", "ripple"), 1),
        (("cogging", "ripple", "stribeck"), 1),  # which is not counted
        (("cogging", "ripple", "unbalance"), 0),
    ],
)
def test_no_more_causes_are_tried_than_there_may_be(monkeypatch, effects, tried):
    chosen = model(effects, 1500.0, 0.13, {"viscous": 0.5})
    drag = model((*chosen.structural, "quadratic_drag"), 2100.0, 0.05)
    got, bases = replaced(monkeypatch, chosen, [drag])
    assert bases == [[chosen.structural]] * tried
    assert got is (drag if tried else chosen)


def test_a_drag_is_found_where_a_stribeck_curve_stands_for_the_coulomb_friction(monkeypatch):
    """It falls all along the speeds there, and beside a drag the numbers stay as they are until it begins anew."""
    wild = model(("stribeck",), 1500.0, 0.06, {"coulomb": 0.0, "viscous": 0.3})
    stuck = model(("stribeck", "quadratic_drag"), 1600.0, 0.05, {"coulomb": 0.01, "viscous": 0.25})
    back = model(("stribeck", "quadratic_drag"), 2100.0, 0.04)
    assert replaced(monkeypatch, wild, [stuck])[0] is wild
    assert replaced(monkeypatch, wild, [stuck], anew=[back.fit])[0] is back
    # Without a Stribeck friction nothing begins anew.
    plain = model(("cogging",), 1500.0, 0.06, {"viscous": 0.3})
    beside = model(("cogging", "quadratic_drag"), 1600.0, 0.05, {"viscous": 0.25})
    assert replaced(monkeypatch, plain, [beside], anew=[back.fit])[0] is plain


def test_a_drag_beside_right_numbers_is_told_where_a_stribeck_curve_with_two_wild_ones_bends_a_little_better(
    monkeypatch,
):
    """As on a simulated motor whose drag is of another form: 29 nats more, with a third of the Coulomb friction."""
    monkeypatch.setattr(wild_numbers, "nominal_sizes", lambda setting: GIVEN)
    monkeypatch.setattr(wild_numbers, "settled", lambda search, exact, weighed: weighed)
    monkeypatch.setattr(wild_numbers, "resolved", lambda search, fit: "unresolved" not in fit.candidate.structural)
    monkeypatch.setattr(wild_numbers, "whole_gap", lambda search, exact, fit: 1.0)
    exact = SimpleNamespace(fit=model((), 0.0, 1.0).fit, left=lambda fit: fit.model.left)
    wild = model(("stribeck", "offset"), 8800.0, 0.05, {"coulomb": 0.15, "viscous": 0.25})
    drag = model(("quadratic_drag", "offset"), 8770.0, 0.06, {"inertia": 2.1})

    def told(*found, chosen=wild):
        return with_right_numbers(SimpleNamespace(setting=None), exact, chosen, [chosen, *found])

    assert told(drag) is drag
    assert told(model(("quadratic_drag",), 8730.0, 0.06), drag) is drag
    for worse in (
        model(drag.structural, 8800.0 * (1.0 - 1.1 * THRESHOLDS.factor), 0.06),
        model(drag.structural, 8770.0, 1.1 * THRESHOLDS.matters**0.5),
        model((*drag.structural, "cogging"), 8770.0, 0.06),
        model((), 8770.0, 0.06),
        model(("unresolved",), 8770.0, 0.06),
        # Nor where one of the two stays wrong, another one goes off, or a law of its own holds them.
        model(drag.structural, 8770.0, 0.06, {"viscous": 0.12}),
        model(drag.structural, 8770.0, 0.06, {"inertia": 1.0}),
        by_direction(8770.0, 0.06),
    ):
        assert told(worse) is wild
    # One number alone may come back by chance.
    single = model(wild.structural, 8800.0, 0.05, {"coulomb": 0.15})
    assert told(drag, chosen=single) is single


def by_direction(evidence, left):
    found = model(("asymmetric_friction",), evidence, left)
    found.fit.candidate.effects = (law("asymmetric_friction", held=("coulomb", "viscous")),)
    return found


def test_a_start_anew_has_the_numbers_as_given_and_a_stribeck_friction_of_its_own():
    own, exponent = [{"stribeck_torque": 0.1}, {"stribeck_torque": 0.2}], SimpleNamespace(name="stribeck_exponent")
    stribeck = SimpleNamespace(name=STRIBECK, starts=lambda setting: own, parameters=(exponent,))
    drag = SimpleNamespace(name="quadratic_drag", starts=lambda setting: [{}])
    values = {"viscous": 0.3, "stribeck_torque": 5.0, "stribeck_exponent": 0.4, "drag_coefficient": 0.7}
    start, search = Start((stribeck, drag), ("viscous",), values, None, or_given=True), SimpleNamespace(setting=None)
    again = _stribeck_anew(search, start)
    assert [one.values for one in again] == [{"stribeck_torque": t, "drag_coefficient": 0.7} for t in (0.1, 0.2)]
    assert [(one.effects, one.wide, one.or_given) for one in again] == [(start.effects, ("viscous",), False)] * 2
    assert _stribeck_anew(search, replace(start, effects=(drag,))) == []


def test_missing_torque_may_count_as_far_as_it_moves_the_machine():
    missing, moving = (np.array([1.0, 4.0, 9.0]),), (np.array([0.25, 1.0, 0.0]),)
    fit = Fit(SimpleNamespace(), 0.0, 0.0, missing, 0.0, moving)
    windows = [np.array([0, 1])]
    assert fit.missing_rms(windows) == pytest.approx(2.5**0.5)
    assert fit.missing_rms(windows, moving=True) == pytest.approx(0.625**0.5)


def verdict(word, causes=()):
    return Verdict(word, causes, 0.25, dict.fromkeys(causes, 0.7), dict.fromkeys(causes, 0.7), 0.0, 0.0)


@pytest.mark.parametrize("structural", [("compliance",), ()])
@pytest.mark.parametrize("persists", [True, False])
@pytest.mark.parametrize("explains", [
    "all", "what moves", "what moves, an effect more of it", "what moves, an unlikely effect more of it", "nothing",
])  # fmt: skip
@pytest.mark.parametrize("given", [0.0, 0.5])
def test_friction_that_the_model_has_none_of_is_told_by_what_moves_a_machine_that_vibrates(
    monkeypatch, structural, persists, explains, given
):
    """A cart whose Coulomb friction is missing in the model, and whose belt vibrates at 60 Hz."""
    exact = SimpleNamespace(candidate=SimpleNamespace(values=lambda: {"coulomb": given}), moving=(np.ones(4),))
    less = 0.3 if explains.endswith("more of it") else 0.5
    effect = SimpleNamespace(
        structural=("presliding",), fit=SimpleNamespace(moving=(less**2 * np.ones(4),)),
        evidence=90.0 if "unlikely" in explains else 110.0,
    )  # fmt: skip
    told = SimpleNamespace(effects=structural, structural=structural, wide=frozenset({"coulomb"}))
    found = SimpleNamespace(
        exact=exact,
        chosen=SimpleNamespace(
            fit=SimpleNamespace(candidate=told, moving=(0.25 * np.ones(4),)), structural=structural, evidence=120.0
        ),
        singles=(effect,),
        nominal=SimpleNamespace(fit=SimpleNamespace(candidate=told)),
    )

    def by_numbers(search, decision, *, moving):
        return SimpleNamespace(moving=moving, exact=exact, chosen=SimpleNamespace(evidence=100.0))

    def judged(search, decision, read, curves, unit):
        whole = decision is found
        closes = not whole and (explains == "all" or (explains.startswith("what moves") and decision.moving))
        # A rounding that is told beside it is no friction.
        word = verdict("partly_explained", ("coulomb_error", "velocity_quantisation") if closes else ())
        word = word if closes else verdict("unexplained")
        return Judged(decision, word, SimpleNamespace(closed_moving=0.5), None, None, (), ())

    monkeypatch.setattr(judge, "by_numbers", by_numbers)
    monkeypatch.setattr(judge, "_judge", judged)
    monkeypatch.setattr(judge, "_persist", lambda numbers, decision: persists)
    answer = judge.judge(None, found, SimpleNamespace(readings=()), None, "N m")
    # Without an effect the numbers were judged by the whole gap already.
    by_all, by_moving = (
        explains == "all" and bool(structural),
        explains not in ("what moves, an effect more of it", "nothing") and given == 0.0,
    )
    asserted = persists and (by_all or by_moving)
    assert answer.verdict.word == ("partly_explained" if asserted else "unexplained")
    if asserted:
        assert answer.decision.moving == (not by_all)


@pytest.mark.parametrize("scale", [1.0, 1e-4])
@pytest.mark.parametrize(
    ("wave", "lowest", "drives"), [(0.9, -1.0, False), (1.08, -1.0, False), (1.3, -1.0, True), (1.3, 0.0, False)]
)
def test_a_friction_by_position_that_drives_where_the_machine_was_is_none(scale, wave, lowest, drives):
    """A level of 1 and a wave: 0.1 at least, then 0.08 and 0.3 below zero, the last not where the machine was."""
    values = {p.name: 0.0 for p in RIPPLE} | {
        "coulomb": scale, "ripple_sine_1": scale * wave, "ripple_cosine_3": 0.0, "ripple_periods": 2.0,
    }  # fmt: skip
    angles = [np.linspace(lowest, 0.2, 50), np.linspace(0.0, 0.7, 50)]
    search = SimpleNamespace(records=[SimpleNamespace(angle=angle) for angle in angles])
    assert _drives(search, values) is drives
