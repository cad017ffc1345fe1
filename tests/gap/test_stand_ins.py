"""What stands for something else: a wild friction number for an effect, numbers for a machine that vibrates."""

from types import SimpleNamespace

import numpy as np
import pytest

from fpjax.gap.answer import judge
from fpjax.gap.answer.judge import Judged
from fpjax.gap.fit.candidate import Fit
from fpjax.gap.select import decision
from fpjax.gap.select.decision import _plausible
from fpjax.gap.select.verdict import Verdict
from fpjax.gap.select.weighed import Weighed
from fpjax.gap.thresholds import THRESHOLDS

GIVEN = {"inertia": 2.0, "coulomb": 0.5, "viscous": 0.1}


def model(effects, evidence, left, numbers=None):
    """A weighed model with wrong nominal numbers by name."""
    numbers = numbers or {}
    candidate = SimpleNamespace(
        effects=tuple(SimpleNamespace(name=name, follows=("velocity",), parameters=()) for name in effects),
        structural=tuple(effects), wide=frozenset(numbers), values=lambda: GIVEN | numbers,
    )  # fmt: skip
    return Weighed(SimpleNamespace(candidate=candidate), evidence, evidence, left)


def replaced(monkeypatch, chosen, found):
    """What is told in place of a chosen model where the models beside it are `found`."""
    monkeypatch.setattr(decision, "nominal_sizes", lambda setting: GIVEN)
    monkeypatch.setattr(decision, "settled", lambda search, exact, weighed: weighed)
    monkeypatch.setattr(decision, "weigh", lambda search, exact, fits: fits)
    monkeypatch.setattr(decision, "_beside", lambda search, bases, likely: [])
    search = SimpleNamespace(setting=None, effects=(), explore=lambda starts, keep, white: found)
    exact = SimpleNamespace(fit=model((), 0.0, 1.0).fit)
    return _plausible(search, exact, chosen, found)


@pytest.mark.parametrize("effects", [("cogging",), ()])
def test_a_viscous_friction_of_five_times_the_given_one_stands_for_a_likelier_drag(monkeypatch, effects):
    wild = model(effects, 1500.0, 0.13, {"viscous": 0.5})
    drag = model((*effects, "quadratic_drag"), 2100.0, 0.05)
    assert replaced(monkeypatch, wild, [drag]) is drag
    # Beside which the number must be right: else there is one cause more, which was not needed.
    more = model((*effects, "stribeck"), 2100.0, 0.05, {"viscous": 0.12})
    assert replaced(monkeypatch, wild, [more]) is wild
    other = model((*effects, "quadratic_drag"), 2100.0, 0.05, {"inertia": 2.1})
    assert replaced(monkeypatch, wild, [other]) is other
    # It must be likelier for sure, and leave less.
    for near in (
        model(drag.structural, 1500.0 + 0.5 * THRESHOLDS.decisive, 0.05),
        model(drag.structural, 2100.0, 0.14),
    ):
        assert replaced(monkeypatch, wild, [near]) is wild
    # A number as far off as a guess is one.
    guess = model(effects, 1500.0, 0.13, {"viscous": 0.1 * (1.0 + 0.9 * THRESHOLDS.wild)})
    assert replaced(monkeypatch, guess, [drag]) is guess
    assert replaced(monkeypatch, wild, []) is wild


def test_missing_torque_may_count_as_far_as_it_moves_the_machine():
    missing, moving = (np.array([1.0, 4.0, 9.0]),), (np.array([0.25, 1.0, 0.0]),)
    fit = Fit(SimpleNamespace(), 0.0, missing, 0.0, moving)
    windows = [np.array([0, 1])]
    assert fit.missing_rms(windows) == pytest.approx(2.5**0.5)
    assert fit.missing_rms(windows, moving=True) == pytest.approx(0.625**0.5)


def verdict(word, causes=()):
    return Verdict(word, causes, 0.25, dict.fromkeys(causes, 0.7), dict.fromkeys(causes, 0.7), 0.0, 0.0)


@pytest.mark.parametrize("structural", [("compliance",), ()])
@pytest.mark.parametrize("persists", [True, False])
@pytest.mark.parametrize("explains", ["all", "what moves", "what moves, an effect more of it", "nothing"])
@pytest.mark.parametrize("given", [0.0, 0.5])
def test_friction_that_the_model_has_none_of_is_told_by_what_moves_a_machine_that_vibrates(
    monkeypatch, structural, persists, explains, given
):
    """A cart whose Coulomb friction is missing in the model, and whose belt vibrates at 60 Hz."""
    exact = SimpleNamespace(candidate=SimpleNamespace(values=lambda: {"coulomb": given}))
    told = SimpleNamespace(effects=structural, structural=structural, wide=frozenset({"coulomb"}))
    found = SimpleNamespace(
        chosen=SimpleNamespace(fit=SimpleNamespace(candidate=told), structural=structural),
        nominal=SimpleNamespace(fit=SimpleNamespace(candidate=told)),
    )

    def by_numbers(search, decision, *, moving):
        return SimpleNamespace(moving=moving, exact=exact)

    def judged(search, decision, read, curves, unit):
        whole = decision is found
        closes = not whole and (explains == "all" or (explains.startswith("what moves") and decision.moving))
        word = verdict("partly_explained", ("coulomb_error",)) if closes else verdict("unexplained")
        less = whole and explains == "what moves, an effect more of it"
        return Judged(decision, word, None, None, None, (), (), 0.3 if less else 0.5)

    monkeypatch.setattr(judge, "by_numbers", by_numbers)
    monkeypatch.setattr(judge, "_judge", judged)
    monkeypatch.setattr(judge, "_persist", lambda numbers, decision: persists)
    answer = judge.judge(None, found, SimpleNamespace(readings=()), None, "N m")
    # Without an effect the numbers were judged by the whole gap already.
    by_all, by_moving = explains == "all" and bool(structural), explains in ("all", "what moves") and given == 0.0
    asserted = persists and (by_all or by_moving)
    assert answer.verdict.word == ("partly_explained" if asserted else "unexplained")
    if asserted:
        assert answer.decision.moving == (not by_all)
