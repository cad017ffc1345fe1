"""What a log does not tell from nothing is not asserted, and what only cancels something else is no candidate."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from fpjax.gap import EFFECTS
from fpjax.gap.answer import warning_texts
from fpjax.gap.answer.insignificant import insignificant_causes
from fpjax.gap.data.setting import Setting
from fpjax.gap.select.detectability import resolved

BY_NAME = {effect.name: effect for effect in EFFECTS}
SETTING = Setting(4.8, 2.0, 0.1, friction=2.0, speed=5.0, torque=10.0, travel=6.0, duration=10.0, dt=1e-3)


def fitted(values, *, effects=(), wide=(), bounds=(), load_error=()):
    """A fit whose free parameters are `values`, with those of `bounds` at an end of what is allowed."""
    candidate = SimpleNamespace(
        effects=tuple(BY_NAME[name] for name in effects),
        structural=tuple(effects),
        wide=frozenset(wide),
        family=SimpleNamespace(parameters=[SimpleNamespace(name=name) for name in values]),
        free=np.arange(len(values)),
        scale=np.ones(len(values)),
        vector=np.array(list(values.values())),
        values=lambda: dict(values),
        at_bound=lambda: list(bounds),
        load_error=load_error,
    )
    return SimpleNamespace(candidate=candidate)


def shown(values, deviations, **more):
    records = [SimpleNamespace(linear=False, speed=np.full(100, 3.0), acceleration=np.full(100, 15.0))]
    search = SimpleNamespace(setting=SETTING, records=records)
    return insignificant_causes(search, fitted(values, **more), np.diag(np.square(deviations)))


@pytest.mark.parametrize(("deviation", "told"), [(2.6, False), (0.3, True)])
def test_a_number_whose_interval_holds_the_number_as_given_is_not_wrong(deviation, told):
    missing = shown({"inertia": 2.0}, [deviation], wide=("inertia",))
    assert missing == (frozenset() if told else {"inertia_error"})


@pytest.mark.parametrize(("value", "told"), [(1.05, False), (1.3, True)])
def test_a_gain_whose_interval_holds_one_is_no_error(value, told):
    missing = shown({"gain": value}, [0.05], effects=("torque_gain_error",))
    assert missing == (frozenset() if told else {"torque_gain_error"})


@pytest.mark.parametrize(("deviation", "told"), [(2.6, False), (0.1, True)])
def test_a_spring_of_unknown_frequency_is_not_asserted(deviation, told):
    values = {"inertia": 4.8, "frequency": 1.4, "load_share": 0.5, "relative_hardening": 0.0}
    missing = shown(values, [1e-6, deviation, 1e-6, 1e-6], effects=("compliance",))
    assert missing == (frozenset() if told else {"compliance"})


@pytest.mark.parametrize(
    ("effect", "values", "told"),
    [
        ("velocity_scale_error", {"scale": 1.005}, False),
        ("velocity_scale_error", {"scale": 0.98}, True),
        ("velocity_bias", {"bias": 0.02}, False),
        ("velocity_bias", {"bias": -0.04}, True),
        ("velocity_lag", {"velocity_lag": 1e-3}, False),
        ("velocity_lag", {"velocity_lag": 3e-3}, True),
        ("velocity_delay", {"velocity_delay": 1e-3}, False),
        ("velocity_delay", {"velocity_delay": 3e-3}, True),
    ],
)
def test_an_error_of_the_velocity_of_less_than_a_hundredth_is_no_cause_however_sure(effect, values, told):
    """At 3 rad/s that changes by 15 rad/s^2."""
    assert shown(values, [1e-6], effects=(effect,)) == (frozenset() if told else {effect})


def test_large_torques_that_cancel_something_are_no_candidates():
    search = SimpleNamespace(setting=SETTING, records=[SimpleNamespace(speed=np.full(100, 3.0))])
    values = {"unbalance_cosine": -10.0, "unbalance_sine": 1.0, "torque": 9.0}
    effects = ("unbalance", "constant_torque")
    assert resolved(search, fitted(values, effects=effects))
    assert not resolved(search, fitted(values, effects=effects, bounds=("unbalance_cosine",)))
    assert resolved(search, fitted({"dead_zone": 2.0}, effects=("torque_dead_zone",)))
    assert not resolved(search, fitted({"dead_zone": 6.0}, effects=("torque_dead_zone",)))
    friction = {"coulomb": 2.0, "coulomb_difference": -0.5}
    assert resolved(search, fitted(friction, effects=("asymmetric_friction",)))
    assert not resolved(search, fitted(friction | {"coulomb_difference": -2.5}, effects=("asymmetric_friction",)))
    # A friction of none is at its bound too, and is no torque that cancels another.
    for none in (0.0, 1e-9):
        assert resolved(
            search, fitted(values | {"stribeck_torque": none}, effects=effects, bounds=("stribeck_torque",))
        )


@pytest.mark.parametrize(("slowest", "seen"), [(0.0, True), (0.3, True), (0.33, False), (2.0, False)])
def test_a_stribeck_friction_whose_tail_alone_is_in_the_log_is_no_candidate(slowest, seen):
    speed = slowest + np.abs(np.sin(np.linspace(0.0, 6.0, 100)))
    search = SimpleNamespace(setting=SETTING, records=[SimpleNamespace(speed=speed)])
    values = {"stribeck_torque": 1.0, "stribeck_velocity": 0.3, "stribeck_exponent": 2.0}
    assert resolved(search, fitted(values, effects=("stribeck",))) == seen


def test_a_known_load_that_is_as_far_off_as_it_may_be_hides_no_other_effect():
    search = SimpleNamespace(setting=SETTING, records=[SimpleNamespace(speed=np.full(100, 3.0))])
    values = {"cogging_cosine_1": 0.3, "cogging_periods": 9.0, "unbalance_cosine": -0.3}
    held = {"bounds": ("unbalance_cosine",), "load_error": ("unbalance_cosine", "unbalance_sine")}
    assert resolved(search, fitted(values, effects=("cogging",), **held))
    assert not resolved(search, fitted(values, effects=("cogging",), bounds=("cogging_cosine_1",)))


def test_a_shaft_that_carries_nothing_until_it_is_wound_up_is_none():
    setting = replace(SETTING, travel=20.0)
    search = SimpleNamespace(setting=setting, records=[SimpleNamespace(speed=np.full(100, 3.0))])
    values = {"inertia": 4.8, "frequency": 10.0, "damping_ratio": 0.2, "load_share": 0.5, "relative_hardening": 0.1}
    assert resolved(search, fitted(values, effects=("compliance",)))
    assert not resolved(search, fitted(values, effects=("compliance",), bounds=("relative_hardening",)))
    # Of two masses one is next to nothing.
    for share in (0.05, 0.052, 0.95):
        assert not resolved(search, fitted(values | {"load_share": share}, effects=("compliance",)))
    assert resolved(search, fitted(values, effects=("compliance",), bounds=("friction_share",)))


@pytest.mark.parametrize(("ratio", "told"), [(0.0, True), (0.05, True), (0.2, False), (0.5, False)])
def test_a_soft_spring_that_rings_is_told_and_one_that_follows_slow_torques_is_not(ratio, told):
    search = SimpleNamespace(setting=SETTING, records=[SimpleNamespace(speed=np.full(100, 3.0))])
    # J s (1 - s) (2 pi f)^2 = 1.07 N m/rad: a friction of 2 N m winds it up by 1.9 of 6 rad.
    values = {"inertia": 4.8, "frequency": 0.15, "damping_ratio": ratio, "load_share": 0.5, "relative_hardening": 0.0}
    ends = ("damping_ratio",) if ratio in (0.0, 0.5) else ()
    assert resolved(search, fitted(values, effects=("compliance",), bounds=ends)) == told
    # One that friction hardly winds up may be damped, but not overdamped.
    stiff = values | {"frequency": 5.0}
    assert resolved(search, fitted(stiff, effects=("compliance",), bounds=ends)) == (ratio < 0.5)


@pytest.mark.parametrize(("deviation", "shown"), [(0.003, True), (0.01, False)])
def test_a_backlash_whose_gap_may_be_none_is_a_spring_of_stiff_faces(deviation, shown):
    search = SimpleNamespace(setting=SETTING, records=[SimpleNamespace(speed=np.full(100, 3.0))])
    fit = fitted({"gap": 0.012, "frequency": 20.0, "load_share": 0.5}, effects=("backlash",))
    fit.candidate.normal = np.diag([deviation**-2, 1.0, 1.0])
    fit.candidate.spread = np.array([1.0, 1.0, 1.0])
    assert resolved(search, fit) == shown
    fit.candidate.at_bound = lambda: ["gap"]
    assert not resolved(search, fit)


@pytest.mark.parametrize(("apart", "told"), [(0.02, True), (0.5, False)])
def test_harmonics_that_stand_for_each_other_are_a_friction_all_the_same(apart, told):
    """Over less than a period neither amplitude is known, and their sum is: zero is not among what both may be."""
    names = [p.name for p in BY_NAME["position_dependent_friction"].parameters]
    values = dict.fromkeys(names, 0.0) | {"ripple_cosine_1": 2.0, "ripple_cosine_2": 1.0, "ripple_periods": 2.0}
    spread = np.diag([1e-6] * len(names))
    first, second = (names.index(f"ripple_cosine_{n}") for n in (1, 2))
    # Their difference may be anything, their sum is 3 within `apart`.
    for a, b, sign in ((first, first, 1), (second, second, 1), (first, second, -1), (second, first, -1)):
        spread[a, b] = 9.0 * sign + apart**2
    records = [SimpleNamespace(linear=False, speed=np.full(100, 3.0), acceleration=np.full(100, 15.0))]
    search = SimpleNamespace(setting=SETTING, records=records)
    fit = fitted(values, effects=("position_dependent_friction",))
    if not told:
        fit.candidate.vector[[first, second]] = 0.9, -0.5  # a sum of 0.4, and a difference that may be zero
        fit.candidate.values = lambda: dict(zip(names, fit.candidate.vector, strict=True))
    missing = insignificant_causes(search, fit, spread)
    assert missing == (frozenset() if told else {"position_dependent_friction"})


def gap(before, closed=0.0):
    return SimpleNamespace(before=before, noise_floor=0.01, unit="N m", closed=closed)


def test_a_gap_above_the_commanded_torque_is_said_to_be_no_friction():
    (sentence,) = warning_texts.beyond_torque(gap(0.8), 0.2)
    assert "0.8 N m where 0.2 N m rms were commanded" in sentence
    assert warning_texts.beyond_torque(gap(0.1), 0.2) == []


def test_a_gap_that_no_withheld_window_holds_is_said_to_be_unconfirmed():
    (sentence,) = warning_texts.where_fitted_alone(gap(0.004), 0.08)
    assert "0.08 N m over all windows" in sentence
    assert warning_texts.where_fitted_alone(gap(0.05), 0.08) == []
    assert warning_texts.where_fitted_alone(gap(0.004), 0.005) == []


def test_what_the_corrected_model_holds_beside_the_causes_is_said():
    chosen = fitted({}, effects=("stribeck", "actuator_lag"))
    (sentence,) = warning_texts.details(chosen, ["stribeck", "viscous_error"])
    assert "also holds actuator_lag: a detail, not a cause" in sentence
    (sentence,) = warning_texts.details(chosen, ["viscous_error"])
    assert "also holds stribeck and actuator_lag: details, not causes" in sentence
    assert warning_texts.details(chosen, ["stribeck", "actuator_lag"]) == []
    assert warning_texts.details(chosen, []) == []
