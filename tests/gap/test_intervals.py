"""Intervals widen with what a model leaves, and with nothing else."""

from types import SimpleNamespace

import numpy as np
import pytest

from fpjax.gap import Estimate
from fpjax.gap.answer import insignificant, intervals
from fpjax.gap.data.setting import Setting
from fpjax.gap.fit.make_modes import make_modes


@pytest.fixture
def width(monkeypatch):
    """Standard deviations of two parameters, of a fit that leaves a torque of some level."""
    monkeypatch.setattr(intervals, "_scores", lambda search, c: np.zeros((4, 2)))
    modes = make_modes(200, 1e-3, 0.05, 0.0, 2e-5)

    def found(level, windows=20, blur=0.0, prior=1e4, names=("a", "b"), absent=(), shared=0.0):
        search = SimpleNamespace(
            fitters={"key": SimpleNamespace(noise=[np.ones(windows)])}, modes=modes, train=[np.arange(windows)],
            setting=None,
        )  # fmt: skip
        c = SimpleNamespace(
            free=np.arange(2), scale=np.ones(2), spread=np.full(2, prior),
            normal=np.array([[400.0, shared], [shared, 100.0]]),
            level=np.full(modes.bands, level), at_bound=list, absent=lambda: absent, wide=frozenset(), effects=(),
            family=SimpleNamespace(
                key="key",
                parameters=[SimpleNamespace(name=name, blur=lambda setting: blur) for name in names],
            ),
        )  # fmt: skip
        return np.sqrt(np.diag(intervals.covariance(search, SimpleNamespace(candidate=c))))

    return found


def test_a_fit_that_leaves_nothing_knows_what_its_curvature_says(width):
    np.testing.assert_allclose(width(0.0), [1 / 20, 1 / 10], rtol=1e-3)


def test_a_detail_that_the_law_does_without_widens_nothing(width):
    """Traded off with another parameter, it would: 1 / (400 - 160^2 / 100) in place of 1 / 400."""
    np.testing.assert_allclose(width(0.0, shared=160.0)[0], (400.0 - 256.0) ** -0.5, rtol=1e-6)
    np.testing.assert_allclose(width(0.0, shared=160.0, absent=("b",)), [0.05, 0.0], rtol=1e-6)


def test_a_torque_that_is_left_widens_them_and_more_windows_do_not_narrow_them(width):
    little, much = width(0.01), width(10.0)
    assert np.all(much > 3.0 * width(0.0))
    assert np.all(much >= little)
    # Twice the windows hold twice the modes of one and the same unknown law.
    np.testing.assert_allclose(width(10.0, windows=40) / much, np.sqrt(2.0), rtol=1e-6)


def test_what_a_prior_knows_it_knows_whatever_is_left(width):
    """A gain beside nominal numbers that count as right is known as well as they are."""
    alone, known = width(10.0), width(10.0, prior=0.02)
    np.testing.assert_allclose(known, 1.0 / np.hypot(1.0 / alone, 1.0 / 0.02), rtol=1e-3)
    assert np.all(known < 0.02)


def test_nominal_numbers_that_count_as_right_tell_together_as_much_as_one(width):
    """What bends one of them may bend the others alike."""
    numbers = width(10.0, prior=0.02, names=("coulomb", "viscous"))
    np.testing.assert_allclose(numbers, width(10.0, prior=0.02 * np.sqrt(2.0)), rtol=1e-9)
    one = width(10.0, prior=0.02, names=("coulomb", "b"))
    np.testing.assert_allclose(one, width(10.0, prior=0.02), rtol=1e-9)


def test_what_the_sampling_blurs_is_never_known_better(width):
    np.testing.assert_allclose(width(0.0, blur=0.2), np.hypot([1 / 20, 1 / 10], 0.2), rtol=1e-3)


@pytest.mark.parametrize(
    ("low", "value", "high", "hidden"),
    [(-0.1, 0.2, 0.5, True), (0.1, 0.2, 0.5, False), (-0.5, -0.2, -0.1, False), (np.nan, 0.0, np.nan, True)],
)
def test_a_size_that_may_be_nothing_is_not_shown(monkeypatch, low, value, high, hidden):
    monkeypatch.setattr(insignificant, "estimates", lambda *_: {"gap": Estimate(value, low, high, "rad")})
    effects = [SimpleNamespace(name=name) for name in ("backlash", "asymmetric_friction")]
    family = SimpleNamespace(parameters=[])
    candidate = SimpleNamespace(effects=effects, family=family, free=(), wide=frozenset(), values=dict)
    fit = SimpleNamespace(candidate=candidate)
    search = SimpleNamespace(setting=Setting(1.0, 0.1, 0.1, 0.1, 1.0, 1.0, 1.0, 1.0, 1e-3))
    found = insignificant.insignificant_causes(search, fit, np.zeros((1, 1)))
    assert found == (frozenset({"backlash"}) if hidden else frozenset())
