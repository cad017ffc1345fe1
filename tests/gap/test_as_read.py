"""A rate sensor with a scale, and the machine that a right one shows alike."""

import numpy as np
import pytest
from gap_search import search_of
from numpy_machine import record

from fpjax.gap.effects.vocabulary import EFFECTS
from fpjax.gap.fit.candidate import Start
from fpjax.gap.select.simpler import POWERS, SCALE, _as_read, _instead

NAMES = ("stribeck", "quadratic_drag", "position_dependent_friction", "cogging", SCALE)
VALUES = {
    "stribeck_torque": 0.2, "stribeck_velocity": 0.3, "stribeck_exponent": 1.5, "drag_coefficient": 0.002,
    "ripple_cosine_1": 0.05, "ripple_sine_2": 0.03, "ripple_periods": 2.3, "cogging_sine_1": 0.1,
    "cogging_cosine_2": 0.02, "cogging_periods": 7.0, "scale": 1.3, "inertia": 0.06, "coulomb": 0.35, "viscous": 0.04,
}  # fmt: skip


def candidate(search, names=NAMES, wide=("inertia", "coulomb", "viscous"), values=VALUES):
    effects = tuple(e for e in EFFECTS if e.name in names)
    return search.candidate(Start(effects, wide, values))


@pytest.fixture(scope="module")
def rate_alone():
    return search_of(record(seconds=6.0, sensors=("velocity",)))


@pytest.mark.parametrize("given", [{}, {"bias": 0.05}])
def test_a_right_sensor_shows_the_same_of_it(rate_alone, given):
    scaled = candidate(rate_alone)
    scaled.vector[scaled.family.index("bias")] = given.get("bias", 0.0)
    right = candidate(rate_alone)
    right.vector[:] = scaled.vector
    for name, value in (_as_read(scaled) | {"scale": 1.0}).items():
        right.vector[right.family.index(name)] = value
    fitter = rate_alone.fitter(scaled.family.key)
    windows = rate_alone.train[0]
    one, other = (fitter.residuals(c, 0, windows) for c in (scaled, right))
    assert np.max(np.abs(one)) > 5.0
    np.testing.assert_allclose(one, other, atol=2e-3 * np.max(np.abs(one)))


def test_every_unit_of_the_vocabulary_is_known_to_change_or_not():
    units = {p.unit for effect in EFFECTS for p in (*effect.parameters, *effect.fixed)}
    assert units == {*POWERS, "N m", "1", "s", "Hz", "1/(N m)^2"}


@pytest.mark.parametrize(("wide", "asked"), [(("inertia",), True), ((), False)])
def test_numbers_are_asked_for_where_the_scale_leaves_them_wrong(rate_alone, wide, asked):
    found = rate_alone.finish([candidate(rate_alone, ("stribeck", SCALE), wide, {"scale": 1.03})])[0]
    by_name = {effect.name: effect for effect in EFFECTS}
    starts = [option[0] for option in _instead(rate_alone, found, by_name)]
    without = [s for s in starts if {e.name for e in s.effects} == {"stribeck"}]
    assert bool(without) == asked
    assert all(set(s.wide) >= {"inertia", "viscous"} for s in without)
