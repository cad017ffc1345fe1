"""One factor on the torque or the reading in the place of wrong numbers, judged on stand-ins for fits."""

from types import SimpleNamespace

import pytest

from fpjax.gap import EFFECTS
from fpjax.gap.select.simpler import _puts_off

SIDES = tuple(effect for effect in EFFECTS if effect.name == "asymmetric_friction")
DELAY = tuple(effect for effect in EFFECTS if effect.name == "actuator_delay")


def fit(inertia, coulomb, viscous, effects=()):
    values = {"inertia": inertia, "coulomb": coulomb, "viscous": viscous}
    return SimpleNamespace(candidate=SimpleNamespace(effects=effects, values=lambda: values))


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
    chosen = fit(*(scale * v for v in (95.0, 19.0, 210.0)), SIDES)
    assert _puts_off(given, fit(*(scale * v for v in (inertia, coulomb, viscous)), SIDES), chosen) is off


def test_numbers_that_no_effect_holds_have_a_prior_of_their_own():
    given, after = fit(80.0, 20.0, 200.0), fit(80.0, 30.0, 300.0, DELAY)
    assert not _puts_off(given, after, fit(95.0, 20.0, 200.0, DELAY))
