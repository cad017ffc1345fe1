"""Details: what is taken on beside causes that explain the gap, and what it may not do to them."""

from types import SimpleNamespace

import numpy as np
import pytest

from fpjax.gap.fit.candidate import NOMINAL
from fpjax.gap.select import decision, wild_numbers
from fpjax.gap.select.decision import _further, _numbers_instead, _only_blurs, _with_stribeck
from fpjax.gap.select.detectability import blurs
from fpjax.gap.select.shares import Shares
from fpjax.gap.select.starts import nominal_for
from fpjax.gap.select.weighed import Weighed
from fpjax.gap.select.wild_numbers import mends_numbers
from fpjax.gap.thresholds import THRESHOLDS

DETAIL, SLIGHT = 0.9 * THRESHOLDS.matters, 0.9 * THRESHOLDS.weighs
FEW, MANY = (100.0 / (1.0 - factor * THRESHOLDS.weighs) for factor in (0.9, 1.1))
"""Nats of a model of which a further cause brings less, and more, than what makes it one, beside another's 100."""


def effect(name, *parameters):
    return SimpleNamespace(name=name, parameters=tuple(SimpleNamespace(name=p) for p in parameters))


WEIGHT, SPRING = effect("unbalance", "weight"), effect("compliance", "frequency", "share")


def fit(effects, deviations, together=0.0, ends=(), wide=(), evidence=0.0, undrowned=None):
    """A fit whose free parameters have these standard deviations, each pair of them with one correlation."""
    names, sizes = tuple(deviations), np.array(list(deviations.values()))
    correlation = np.full((len(names), len(names)), together)
    np.fill_diagonal(correlation, 1.0)
    scale = np.full(len(names), 0.1)
    normal = np.linalg.inv(correlation * sizes[:, None] * sizes) * scale[:, None] * scale
    candidate = SimpleNamespace(
        effects=tuple(effects), structural=tuple(e.name for e in effects), wide=frozenset(wide),
        family=SimpleNamespace(parameters=[SimpleNamespace(name=name) for name in names]),
        free=np.arange(len(names)), normal=normal, scale=scale, spread=np.full(len(names), 1e6),
        at_bound=lambda: list(ends), absent=lambda: [],
    )  # fmt: skip
    return SimpleNamespace(
        candidate=candidate, evidence=evidence, undrowned=evidence if undrowned is None else undrowned
    )


def test_a_detail_that_shares_a_causes_torque_makes_it_less_known():
    alone = fit([WEIGHT], {"inertia": 1.0, "weight": 0.5})
    assert not blurs(alone, fit([WEIGHT, SPRING], {"inertia": 2.0, "weight": 0.4, "frequency": 9.0}))
    assert blurs(alone, fit([WEIGHT, SPRING], {"inertia": 0.5, "weight": 0.6, "frequency": 9.0}))


def test_parameters_are_known_as_a_whole():
    """One may be less known where the others are far better known for it."""
    alone = fit([SPRING], {"frequency": 0.5, "share": 0.1})
    assert not blurs(alone, fit([SPRING, WEIGHT], {"frequency": 0.05, "share": 0.12, "weight": 1.0}))
    assert blurs(alone, fit([SPRING, WEIGHT], {"frequency": 0.45, "share": 0.12, "weight": 1.0}))


def test_what_a_detail_makes_impossible_to_tell_is_blurred():
    """A combination of two parameters about which the cost says nothing is not known, however well each was."""
    alone = fit([WEIGHT], {"weight": 0.5})
    both = fit([WEIGHT, SPRING], {"weight": 0.4, "frequency": 9.0})
    both.candidate.normal = np.array([[1.0, 1.0], [1.0, 1.0]]) * 1e17
    both.candidate.spread = np.full(2, np.inf)
    assert blurs(alone, both)
    assert not blurs(alone, fit([WEIGHT, SPRING], {"frequency": 9.0}))  # nothing to compare


def test_a_number_that_one_fit_alone_holds_at_a_bound_is_known_in_neither():
    """A Coulomb friction at zero makes the Stribeck torque beside it look better known than it is."""
    numbers = {"coulomb": 0.4, "weight": 0.5}
    held = fit([WEIGHT], numbers, together=0.9, ends=("coulomb",))
    beside = fit([WEIGHT, SPRING], numbers | {"weight": 0.3, "frequency": 1.0}, ends=())
    assert not blurs(held, beside)
    # At the bound in both, it is known in both: 0.5 (1 - 0.9^2)^(1/2) = 0.22 before.
    assert blurs(held, fit([WEIGHT, SPRING], {"coulomb": 0.4, "weight": 0.3, "frequency": 1.0}, ends=("coulomb",)))


def test_a_parameter_at_a_bound_is_not_traded_with():
    """One at a bound counts as known, as in the intervals: what it would trade off is no doubt of the others."""
    alone = fit([WEIGHT], {"weight": 0.5})
    parameters = {"weight": 0.6, "share": 1.0}
    assert blurs(alone, fit([WEIGHT, SPRING], parameters, together=0.8))
    assert not blurs(alone, fit([WEIGHT, SPRING], parameters, together=0.8, ends=("share",)))
    # A cause's own that is pushed there is not known at all any more.
    assert blurs(alone, fit([WEIGHT, SPRING], {"weight": 0.1, "share": 1.0}, ends=("weight",)))


def energies(*fits):
    """What fits leave: stands for what models are weighed against."""
    by_fit = {id(fit): energy for fit, energy in fits}
    nominal = SimpleNamespace(evidence=0.0, undrowned=0.0)
    return SimpleNamespace(fit=nominal, left=lambda one: np.sqrt(by_fit[id(one)]))


@pytest.mark.parametrize(
    ("takes", "deviation", "gain", "undrowned", "refused"),
    [
        (DETAIL, 0.6, FEW, FEW, True),
        (DETAIL, 0.4, FEW, FEW, False),
        (0.2, 0.6, FEW, FEW, False),
        (DETAIL, 0.6, MANY, MANY, False),
        (DETAIL, 0.6, MANY, FEW, True),  # evidence in what is noise more than torque
    ],
)
def test_only_a_detail_is_refused_for_it(takes, deviation, gain, undrowned, refused):
    """A cause of its own, by torque or by evidence, is told whatever it does to the others."""
    alone = fit([WEIGHT], {"weight": 0.5}, evidence=100.0)
    both = fit([WEIGHT, SPRING], {"weight": deviation, "frequency": 1.0}, evidence=gain, undrowned=undrowned)
    chosen, best = (Weighed(one, one.evidence, one.evidence, 0.0) for one in (alone, both))
    assert _only_blurs(energies((alone, 1.0), (both, 1.0 - takes * 2.0**2)), chosen, best, 2.0) == refused


def test_other_causes_are_no_detail_of_the_chosen_ones():
    """Two laws in the place of two others, of which one is the same, are another explanation."""
    wave = effect("cogging", "wave")
    chosen, best = fit([WEIGHT, wave], {"weight": 0.5, "wave": 1.0}), fit([WEIGHT, SPRING], {"weight": 0.6})
    weighed = [Weighed(one, 0.0, 9.0, 0.0) for one in (chosen, best)]
    assert not _only_blurs(energies((chosen, 1.0), (best, 0.99)), *weighed, 2.0)


def test_where_the_best_detail_only_blurs_the_next_one_is_taken(monkeypatch):
    wave = effect("cogging", "wave")
    chosen, blurring, good = (
        Weighed(one, one.evidence, one.evidence, 0.0)
        for one in (
            fit([WEIGHT], {"weight": 0.5}, evidence=100.0), fit([WEIGHT, SPRING], {"weight": 0.6}, evidence=110.0),
            fit([WEIGHT, wave], {"weight": 0.4}, evidence=108.0),
        )
    )  # fmt: skip
    exact = energies((chosen.fit, 1.0), (blurring.fit, 0.99), (good.fit, 0.99))
    for what, stand_in in {
        "settled": lambda search, exact, weighed: weighed, "_whole_left": lambda search, exact, fit, nominal: 2.0,
        "_better": lambda search, exact, chosen, best: best.gain > 105.0,
        "mends_numbers": lambda search, exact, chosen, best: False,
    }.items():  # fmt: skip
        monkeypatch.setattr(decision, what, stand_in)
    assert _further(None, exact, chosen, [blurring, good], chosen) is good
    assert _further(None, exact, chosen, [good, blurring], chosen) is good
    poor = Weighed(good.fit, 0.0, 102.0, 0.0)
    assert _further(None, exact, chosen, [blurring, poor, good], chosen) is None
    assert _further(None, exact, chosen, [], chosen) is None


@pytest.mark.parametrize(
    ("first", "then", "mended"),
    [
        ({"coulomb": 0.0, "viscous": 6.0}, {"coulomb": 0.7, "viscous": 2.3}, True),
        ({"coulomb": 0.0, "viscous": 6.0}, {"coulomb": 0.7, "viscous": 7.0}, False),  # one of them alone
        ({"coulomb": 0.9, "viscous": 1.2}, {"coulomb": 1.0, "viscous": 1.0}, False),  # were guesses
        ({"coulomb": 0.0, "viscous": 6.0}, {"coulomb": 0.7, "viscous": 5.9}, False),  # hardly
        ({"coulomb": 0.9, "viscous": 6.0}, {"coulomb": 5.0, "viscous": 2.0}, False),  # another one goes off
    ],
)
def test_a_detail_beside_which_friction_is_what_was_given_is_taken(monkeypatch, first, then, mended):
    """A viscous friction of six times the given one, and no Coulomb friction, stood for a drag."""
    given, chosen, best = (
        SimpleNamespace(candidate=SimpleNamespace(values=values.copy, wide=frozenset(values)))
        for values in ({"coulomb": 1.0, "viscous": 1.0}, first, then)
    )
    monkeypatch.setattr(wild_numbers, "nominal_sizes", lambda setting: {"coulomb": 1.0, "viscous": 1.0})
    search, exact = SimpleNamespace(setting=None), SimpleNamespace(fit=given)
    assert mends_numbers(search, exact, chosen, best) == mended


def test_no_number_is_free_beside_a_factor_on_the_torque():
    delay, gain, scale = (effect(name) for name in ("actuator_delay", "torque_gain_error", "velocity_scale_error"))
    assert nominal_for(delay) == [NOMINAL]
    assert nominal_for(delay, gain) == nominal_for(gain) == [()]
    # One on the rate leaves the Coulomb friction as it is.
    assert nominal_for(scale, delay) == [NOMINAL, ()]


@pytest.mark.parametrize(("gap", "replaced"), [(True, False), (False, True)])
def test_a_friction_by_direction_gives_way_to_numbers_that_leave_no_gap(monkeypatch, gap, replaced):
    """Beside a lag it brings two fifths of the evidence, and its numbers leave a gap; a doubled level leaves none."""
    delay, held = effect("actuator_delay", "delay"), effect("asymmetric_friction", "coulomb", "viscous")
    found, without = numbers_instead(monkeypatch, delay, held, DETAIL, 1.1 * THRESHOLDS.weighs, gap=gap)
    assert (found.fit is without) == replaced


def numbers_instead(monkeypatch, cause, other, share, lost, *, ahead=5.0, left=0.3, gap=True, off=(), alike=()):
    """(what stands for a model of two effects, the fit without the other one), which takes a share of the gap.

    Beside them numbers are `off`; causes `alike` would do as well as the other effect.
    """
    both, without = fit([cause, other], {"delay": 1.0}), fit([cause], {"delay": 1.0}, wide=("inertia",))
    both.evidence, asked = ahead, []
    search = SimpleNamespace(setting=None, fitted=lambda starts: asked.extend(starts) or [without])
    exact = SimpleNamespace(left=lambda one: left if one is without else 0.25)
    for what, stand_in in {
        "whole_gap": lambda search, exact, fit: 2.0, "nominal_sizes": lambda setting: {},
        "wrong_numbers": lambda fit, sizes: (7.0, ()), "settled": lambda search, exact, weighed: weighed,
        "weighed_fit": lambda search, exact, fit, evidence: Weighed(fit, evidence, 0.0, 0.0),
        "_without": lambda fit, left_out: (fit, left_out.name), "resolved": lambda search, fit: True,
        "_is_gap": lambda search, missing: gap, "far_off": lambda search, exact, fit: set(off),
    }.items():  # fmt: skip
        monkeypatch.setattr(decision, what, stand_in)
    chosen = Weighed(both, 0.0, 0.0, 0.0)
    shares = Shares(
        {cause.name: 0.9, other.name: share}, {cause.name: 0.9, other.name: lost}, {other.name: tuple(alike)}
    )
    found = _numbers_instead(search, exact, chosen, shares)
    assert all(one == (both, other.name) for one in asked)
    return found, without


@pytest.mark.parametrize(
    ("name", "share", "lost", "ahead", "left", "replaced"),
    [
        ("torque_gain_error", DETAIL, SLIGHT, 5.0, 0.3, True),
        ("torque_gain_error", 0.2, SLIGHT, 5.0, 0.3, False),  # a cause
        ("torque_gain_error", DETAIL, 1.1 * THRESHOLDS.weighs, 5.0, 0.3, False),  # a cause by its evidence
        ("torque_gain_error", DETAIL, 1.1 * THRESHOLDS.weighs, -5.0, 0.3, True),  # but the numbers are likelier
        ("torque_gain_error", DETAIL, SLIGHT, 5.0, 0.9, False),  # the numbers do not make up for it
        ("constant_torque", DETAIL, SLIGHT, 5.0, 0.3, False),  # no number does
    ],
)
def test_a_factor_that_is_a_detail_is_wrong_numbers(monkeypatch, name, share, lost, ahead, left, replaced):
    delay, factor = effect("actuator_delay", "delay"), effect(name, "gain")
    found, without = numbers_instead(monkeypatch, delay, factor, share, lost, ahead=ahead, left=left)
    assert (found.fit is without and found.evidence == 7.0) if replaced else found.fit is not without


@pytest.mark.parametrize(
    ("off", "alike", "lost", "left", "replaced"),
    [
        (("coulomb",), ("viscous_error", "coulomb_error"), SLIGHT, 0.3, True),
        (("inertia",), ("inertia_error",), SLIGHT, 0.3, True),  # a soft spring beside twice the inertia
        ((), ("viscous_error", "coulomb_error"), SLIGHT, 0.3, False),  # no number is far off beside it
        (("coulomb",), ("viscous_error",), SLIGHT, 0.3, False),  # another one is
        (("coulomb",), ("coulomb_error",), 1.1 * THRESHOLDS.weighs, 0.3, False),  # a cause by its evidence
        (("coulomb",), ("coulomb_error",), SLIGHT, 0.9, False),  # the numbers do not make up for it
    ],
)
def test_a_law_that_stands_for_the_numbers_it_puts_off_is_wrong_numbers(monkeypatch, off, alike, lost, left, replaced):
    """A drag beside fifteen times the Coulomb friction and no viscous one, where the viscous number was half."""
    delay, drag = effect("actuator_delay", "delay"), effect("quadratic_drag", "drag_coefficient")
    found, without = numbers_instead(monkeypatch, delay, drag, 0.86, lost, left=left, off=off, alike=alike)
    assert (found.fit is without) == replaced


@pytest.mark.parametrize(
    ("gains", "left", "resolved", "blurs", "ends", "taken"),
    [
        (1.1 * THRESHOLDS.decisive, 0.249, True, False, (), True),  # however little torque it takes
        (0.9 * THRESHOLDS.decisive, 0.1, True, False, (), False),
        (1.1 * THRESHOLDS.decisive, 0.251, True, False, (), False),  # it follows details at the others' cost
        (1.1 * THRESHOLDS.decisive, 0.1, False, False, (), False),
        (1.1 * THRESHOLDS.decisive, 0.1, True, True, (), False),
        (1.1 * THRESHOLDS.decisive, 0.1, True, False, ("stribeck_torque",), False),  # none: the others fit better now
    ],
)
def test_a_stribeck_friction_is_taken_on_by_its_evidence(monkeypatch, gains, left, resolved, blurs, ends, taken):
    with_it = [WEIGHT, effect("stribeck", "stribeck_torque")]
    plain, curved = fit([WEIGHT], {"weight": 1.0}), fit(with_it, {"weight": 1.0}, ends=ends)
    chosen, best = Weighed(plain, 50.0, 50.0, 0.25), Weighed(curved, 50.0 + gains, 50.0 + gains, left)
    for what, stand_in in {
        "beside": lambda search, bases, names: [(base, *names) for base in bases],
        "weigh": lambda search, exact, fits: fits,
        "settled": lambda search, exact, weighed: weighed,
        "resolved": lambda search, fit: resolved,
        "_whole_left": lambda search, exact, fit, nominal: 2.0,
        "_only_blurs": lambda exact, chosen, best, whole: blurs,
    }.items():
        monkeypatch.setattr(decision, what, stand_in)
    asked = []
    search = SimpleNamespace(explore=lambda starts, keep, white: asked.extend(starts) or [best])
    exact = SimpleNamespace(left=lambda one: left if one is curved else 0.25)
    found, tried = _with_stribeck(search, exact, chosen, chosen)
    assert found is (best if taken else chosen)
    assert tried == [best]
    assert asked == [(chosen, "stribeck")]
    monkeypatch.setattr(decision, "beside", lambda search, bases, names: [])  # it is among the causes already
    assert _with_stribeck(None, exact, chosen, chosen) == (chosen, [])


@pytest.mark.parametrize(("details", "kept"), [(2, ()), (1, ("stribeck",)), (0, ("compliance", "stribeck"))])
def test_numbers_take_the_place_of_one_effect_after_the_other(monkeypatch, details, kept):
    effects = [effect("compliance", "frequency"), effect("stribeck", "stribeck_torque")]
    models = [Weighed(fit(effects[gone:], {}, wide=("inertia",)), 0.0, 0.0, 0.0) for gone in range(3)]

    def instead(search, exact, chosen, shares):
        assert shares == len(chosen.structural)  # of the model that is left, not of one before
        return models[min(3 - len(chosen.structural), details)]

    monkeypatch.setattr(decision, "_numbers_instead", instead)
    monkeypatch.setattr(decision, "shares_of", lambda search, exact, fit, known: len(fit.candidate.structural))
    chosen, shares = decision._with_numbers(None, None, models[0], [])
    assert chosen.structural == kept
    assert shares == len(kept)
