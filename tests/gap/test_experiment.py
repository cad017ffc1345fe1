"""The next experiment: a sentence for every pair of the vocabulary."""

import itertools
import re

import pytest

from fpjax.gap import EFFECTS
from fpjax.gap.effects.experiments import FAMILIES, PAIRS, PLAINEST, SIGNATURE, TELLS, experiment_for, next_experiment

NAMES = sorted({effect.name for effect in EFFECTS} | {"velocity_quantisation"})


def test_every_effect_is_in_one_family():
    listed = [name for effects in FAMILIES.values() for name in effects]
    assert sorted(listed) == NAMES
    assert len(NAMES) == 25
    assert set(SIGNATURE) == set(TELLS) == set(FAMILIES) == set(PLAINEST)
    assert all(name in NAMES for pair in PAIRS for name in pair)
    assert all(len(pair) == 2 for pair in PAIRS)


@pytest.mark.parametrize(("first", "second"), list(itertools.combinations(NAMES, 2)))
def test_every_pair_has_a_sentence_that_does_not_depend_on_the_order(first, second):
    found = experiment_for(first, second)
    assert found.separates == (first, second)
    assert re.fullmatch(r"[A-Z].{40,}\.", found.do)
    assert experiment_for(second, first).do == found.do


@pytest.mark.parametrize(
    ("first", "second", "word"),
    [
        ("actuator_delay", "velocity_delay", "position"),
        ("backlash", "compliance", "load"),
        ("stribeck", "presliding", "slow reversals"),
        ("torque_gain_error", "inertia_error", "payloads"),
        ("constant_torque", "asymmetric_friction", "coast down"),
        ("compliance", "actuator_delay", "resonance"),
        ("torque_saturation", "viscous_error", "amplitude"),
        ("velocity_scale_error", "inertia_error", "position"),
    ],
)
def test_known_confusions_name_the_known_experiment(first, second, word):
    assert word in experiment_for(first, second).do


def test_each_pair_is_named_once():
    pairs = [
        ("backlash", "compliance"),
        ("compliance", "backlash"),
        ("backlash", "backlash"),
        ("my_effect", "stribeck"),
    ]
    found = next_experiment(pairs)
    assert [entry.separates for entry in found] == [("backlash", "compliance"), ("my_effect", "stribeck")]
    assert next_experiment(itertools.combinations(NAMES, 2), most=3)[2].separates
    assert len(next_experiment(itertools.combinations(NAMES, 2), most=3)) == 3
    assert "amplitude" in next_experiment([("mine", "yours")])[0].do
