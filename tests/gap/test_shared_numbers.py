"""A number that stands beside every one of several effects that do as well as each other is told without them."""

from types import SimpleNamespace

import numpy as np
import pytest
from weighed_models import NOMINAL, judged, weighed

from fpjax.gap.answer import judge
from fpjax.gap.answer.warning_texts import undecided_effects
from fpjax.gap.select import shared_numbers, verdict
from fpjax.gap.thresholds import THRESHOLDS

SHARES = {"compliance": 0.5, "coulomb_error": 0.35}
NAMES = ("actuator_lag", "torque_dead_zone", "velocity_delay")


@pytest.fixture(autouse=True)
def wrong(monkeypatch):
    """Every number that is free in a model is wrong in it."""
    for module in (shared_numbers, verdict):
        monkeypatch.setattr(module, "wrong_numbers", lambda fit, sizes: (0.0, tuple(fit.candidate.wide)))


def model(names, evidence, coulomb=0.9, bound=()):
    found = weighed(names, evidence, wide=("coulomb",), wrong={"coulomb": coulomb})
    found.fit.candidate.at_bound = lambda: list(bound)
    return found


CHOSEN = model("compliance", 500.0)


def told(rivals, shares=SHARES, lost=0.6, shared=True, left=0.3, numbers=("", 100.0), **more):
    lost = {"coulomb_error": lost}
    return judged(CHOSEN, rivals, left=left, shares=shares, lost=lost, shared=shared, nominal=model(*numbers), **more)


def test_a_number_that_every_near_model_has_is_told_without_them():
    near = [model(name, 490.0) for name in NAMES]
    found = told(near)
    assert (found.word, found.causes) == ("partly_explained", ("coulomb_error",))
    assert found.undecided == ("compliance",)
    assert found.probability == pytest.approx(THRESHOLDS.right_partly_number)
    assert told(near, shared=False).word == "unexplained"
    # Also where the effects close nearly all of it.
    assert told(near, left=0.05).causes == ("coulomb_error",)
    assert told(near, left=0.05).word == "partly_explained"


@pytest.mark.parametrize(
    "other",
    [
        weighed("load_dependent_friction", 480.0),  # without the number
        model("velocity_scale_error", 480.0, coulomb=0.3),  # the other way
        model("velocity_scale_error", 480.0, coulomb=0.6),  # hardly
        model("velocity_scale_error", 480.0, bound=("coulomb",)),
    ],
    ids=["without", "the other way", "hardly", "at a bound"],
)
def test_a_number_that_one_near_model_does_without_is_not_sure(other):
    near = [model(name, 490.0) for name in NAMES]
    assert told([*near, other]).word == "unexplained"
    # One that is far behind says nothing.
    far = weighed("load_dependent_friction", (1.0 - THRESHOLDS.clear) * 499.0)
    assert told([*near, far]).word == "partly_explained"


def test_a_number_leads_only_where_it_takes_much_and_its_evidence_is_needed():
    near = [model(name, 490.0) for name in NAMES]
    assert told(near, shares=SHARES | {"coulomb_error": 0.2}).word == "unexplained"
    assert told(near, lost=0.2, shares=SHARES | {"coulomb_error": 0.27}).word == "unexplained"
    assert told(near, unshown=frozenset({"compliance"})).word == "unexplained"
    assert told(near, contradicted=True).word == "unexplained"
    assert told(near, left=0.8).word == "unexplained"
    # Without an effect it is another one.
    assert told(near, numbers=("", 100.0, 0.4)).word == "unexplained"


@pytest.mark.parametrize(("left", "told"), [(0.84, True), (0.86, False), (1.0, False)])
def test_a_number_that_takes_little_without_an_effect_is_no_surer_than_that(left, told):
    """Its share is 0.35 beside the effect, of which 0.28 are to be taken without it."""
    windows = [np.zeros(4)]
    search = SimpleNamespace(fitted=lambda starts: [SimpleNamespace(missing_rms=lambda windows: left)])
    exact = SimpleNamespace(missing=windows, missing_rms=lambda windows: 1.0)
    decision = SimpleNamespace(exact=exact, shares=SHARES)
    assert judge._take_alone(search, decision, SimpleNamespace(causes=("coulomb_error", "velocity_lag"))) is told


def test_what_is_undecided_is_said_with_what_would_do_in_its_place():
    assert undecided_effects((), ("coulomb_error",), ("backlash",)) == []
    (sentence,) = undecided_effects(("compliance",), ("coulomb_error",), ("backlash", "actuator_lag"))
    assert "holds compliance, which takes a part" in sentence
    assert "backlash or actuator_lag would do nearly as well" in sentence
    assert "coulomb_error stands beside it" in sentence


def test_near_models_are_those_within_reach_of_the_chosen_one():
    decision = SimpleNamespace(
        chosen=CHOSEN, nominal=weighed("", 10.0), singles=(model("backlash", 400.0),), rivals=(model("x", 450.0),)
    )
    assert [w.structural for w in shared_numbers.near_models(decision)] == [("x",), ("backlash",)]
    assert NOMINAL["coulomb"] == 0.5
