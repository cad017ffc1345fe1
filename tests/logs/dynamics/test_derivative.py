"""Derivatives and integrals of sampled motions, on signals whose truth is known."""

import numpy as np
import pytest

from fpjax import InputError, Log
from fpjax.logs.dynamics.derivative import local_polynomial, measured_velocity, quiet_half, slope, smooth_motion, travel
from fpjax.logs.dynamics.regression import solved

TIME = 1e-3 * np.arange(10_000)
SWING = np.sin(2 * np.pi * TIME) + 0.3 * np.sin(2 * np.pi * 2.7 * TIME)


@pytest.mark.parametrize("half", [2, 7, 31])
@pytest.mark.parametrize("derivative", [0, 1, 2])
def test_a_polynomial_is_its_own_local_polynomial_to_the_ends(half, derivative):
    t = TIME[:400]
    cubic = np.polynomial.Polynomial([0.3, -1.0, 4.0, 2.0])
    found = local_polynomial(cubic(t), half, dt=1e-3, degree=3, derivative=derivative)
    expected = cubic.deriv(derivative)(t) if derivative else cubic(t)
    np.testing.assert_allclose(found, expected, rtol=1e-6, atol=1e-7)


def test_the_window_widens_with_the_noise():
    noise = np.random.default_rng(3).normal(size=TIME.size)
    halves = [quiet_half(SWING + level * noise, level) for level in (1e-6, 1e-4, 1e-2)]
    assert halves == sorted(halves)
    assert halves[0] < halves[-1]
    truth = np.gradient(SWING, 1e-3)
    inner = slice(halves[-1], -halves[-1])  # half a window is worth less at the ends
    errors = [
        np.std((local_polynomial(SWING + 1e-2 * noise, half, dt=1e-3, derivative=1) - truth)[inner])
        for half in (halves[-1] // 2, halves[-1], halves[-1] * 2)
    ]
    assert errors[1] == min(errors)


def test_slope_and_travel_are_exact_where_they_say_so():
    """Central differences are exact on a quadratic, the integral on lines between the samples."""
    t = TIME[:50]
    np.testing.assert_allclose(slope(3.0 * t**2, 1e-3)[1:-1], 6.0 * t[1:-1], rtol=1e-9, atol=1e-12)
    ramp = 2.0 + 5.0 * t
    np.testing.assert_allclose(travel(ramp, 1e-3), 2.0 * t + 2.5 * t**2, rtol=1e-12, atol=1e-15)


def test_either_half_of_a_motion_gives_the_other():
    noise = np.random.default_rng(5).normal(size=TIME.size)
    rate = slope(SWING, 1e-3)
    from_position, angle = smooth_motion(None, SWING + 1e-4 * noise, 1e-3)
    assert np.std(from_position - rate) < 0.02 * np.std(rate)
    assert np.std(slope(SWING + 1e-4 * noise, 1e-3) - rate) > np.std(from_position - rate)
    np.testing.assert_array_equal(angle, SWING + 1e-4 * noise)
    speed, from_rate = smooth_motion(rate + 0.05 * noise, None, 1e-3)
    assert np.std(speed - rate) < 0.03
    walk = 0.05 * 1e-3 * np.sqrt(TIME.size)  # what the noise adds up to, one deviation
    assert np.max(np.abs(from_rate - (SWING - SWING[0]))) < 4.0 * walk
    with pytest.raises(InputError, match="needs a velocity or a position"):
        smooth_motion(None, None, 1e-3)


def test_a_log_without_motion_or_with_an_unknown_differentiator_is_refused():
    still = Log(TIME, SWING, None, None, None, 1e-3, "a run")
    with pytest.raises(InputError, match="a run has neither velocity nor position"):
        measured_velocity(still)
    moving = Log(TIME, SWING, None, SWING, None, 1e-3, "a run")
    with pytest.raises(InputError, match='choose "zero_phase" or "causal"'):
        measured_velocity(moving, differentiator="backward")  # type: ignore[arg-type]
    with pytest.raises(InputError, match="between 0 and 500 Hz, got 600 Hz"):
        measured_velocity(moving, cutoff=600.0)


def test_columns_of_unlike_size_are_solved_and_equal_ones_are_not():
    table = np.stack([1e-9 * SWING, np.ones(TIME.size), 1e9 * TIME], axis=1)
    np.testing.assert_allclose(solved(table, table @ [3e9, -2.0, 5e-9]), [3e9, -2.0, 5e-9], rtol=1e-9)
    assert solved(np.stack([SWING, 2.0 * SWING], axis=1), SWING) is None
    assert solved(np.stack([SWING, 0.0 * SWING], axis=1), SWING) is None
    assert solved(table[:3], SWING[:3]) is None
