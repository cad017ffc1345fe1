"""Simpler causes in the place of others, judged on stand-ins for fits."""

from types import SimpleNamespace

import pytest

from fpjax.gap import EFFECTS
from fpjax.gap.select import simpler
from fpjax.gap.select.weighed import Exact, Weighed

NAMED = {effect.name: effect for effect in EFFECTS}


@pytest.fixture(autouse=True)
def _stand_ins_have_no_likelihood(monkeypatch):
    """Of a stand-in's evidence wrong numbers cost a nat each."""
    monkeypatch.setattr(simpler, "wrong_numbers", lambda fit, sizes: (fit.evidence - len(fit.candidate.wide), ()))
    monkeypatch.setattr(simpler, "nominal_sizes", lambda setting: {})


def fit(inertia, coulomb, viscous, *effects, wide=()):
    values = {"inertia": inertia, "coulomb": coulomb, "viscous": viscous}
    candidate = SimpleNamespace(
        effects=tuple(NAMED[name] for name in effects), structural=effects, wide=set(wide), values=lambda: values
    )
    return SimpleNamespace(candidate=candidate, evidence=0.0)


@pytest.mark.parametrize("scale", [1.0, 1e-3])
@pytest.mark.parametrize(
    ("inertia", "coulomb", "viscous", "off"),
    [
        (80.0, 20.0, 200.0, False),  # all three come back
        (80.0, 19.5, 193.0, False),  # as near as before, or within what counts as right
        (80.0, 17.0, 200.0, True),  # the Coulomb level would be wrong in the place of the inertia
        (80.0, 20.0, 240.0, True),
    ],
)
def test_a_factor_that_puts_the_means_of_a_friction_by_direction_off_makes_nothing_simpler(
    inertia, coulomb, viscous, off, scale
):
    given = fit(*(scale * v for v in (80.0, 20.0, 200.0)))
    chosen = fit(*(scale * v for v in (95.0, 19.0, 210.0)), "asymmetric_friction")
    after = fit(*(scale * v for v in (inertia, coulomb, viscous)), "asymmetric_friction")
    assert simpler._puts_off(given, after, chosen) is off


def test_numbers_that_no_effect_holds_have_a_prior_of_their_own():
    given, after = fit(80.0, 20.0, 200.0), fit(80.0, 30.0, 300.0, "actuator_delay")
    assert not simpler._puts_off(given, after, fit(95.0, 20.0, 200.0, "actuator_delay"))


def test_numbers_that_a_factor_does_not_make_wrong_together_stay_numbers():
    """Three guesses of one sign lie within some per cent of one factor by chance."""
    given = with_missing(fit(1.0, 1.0, 1.0), 0.0, 1.0)
    chosen = with_missing(fit(0.78, 0.85, 0.79, wide=("inertia", "coulomb", "viscous")), 1000.0, 0.1)
    told = {}
    for strain in (1.0, 4.5):
        after = with_missing(fit(1.0, 1.0, 1.0, "torque_gain_error"), 1010.0, 0.1, strain)
        told[strain] = simpler._stands_for(Exact(given, ()), after, chosen, 1.0, 0.0)
    assert told == {1.0: True, 4.5: False}


def with_missing(one, evidence, left, strain=0.0):
    one.candidate.strain = strain
    one.evidence, one.missing_rms = evidence, lambda windows, moving=False: left
    return one


def test_what_gave_way_does_not_come_back(monkeypatch):
    """An inertia gave way to a scale of the rate sensor, that to inertia and viscous friction, these to the scale: a
    development log of the second generator was diagnosed without end."""
    numbers = fit(1.0, 1.0, 1.0, wide=("inertia",))
    scale = fit(1.0, 1.0, 1.0, "velocity_scale_error")
    both = fit(1.0, 1.0, 1.0, wide=("inertia", "viscous"))
    follows = {id(numbers): scale, id(scale): both, id(both): scale}
    tried = []

    def instead(search, one, by_name):
        tried.append(one)
        yield (follows[id(one)],)

    def chosen_as(search, exact, one, evidence):
        return Weighed(one, evidence, 1.0, 0.5)

    for name, value in {
        "_instead": instead, "weighed_fit": chosen_as, "resolved": lambda *_: True, "_stands_for": lambda *_: True,
        "whole_gap": lambda *_: 1.0,
    }.items():  # fmt: skip
        monkeypatch.setattr(simpler, name, value)
    search = SimpleNamespace(effects=(), setting=None, fitted=list, refit=lambda *_: numbers)
    exact = SimpleNamespace(fit=numbers)
    assert simpler.simpler(search, exact, chosen_as(search, exact, numbers, 0.0)).fit is both
    assert tried == [numbers, scale, both]
