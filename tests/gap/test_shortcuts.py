"""What is computed by a short way, against the long one."""

from types import SimpleNamespace

import numpy as np
import pytest
from scipy.signal import butter, lfilter, sosfiltfilt

from fpjax.gap.data.late_reading import lagged
from fpjax.gap.fit.bounded import bounded_steps
from fpjax.gap.fit.imposed_motion import ORDER, _filters, _passed
from fpjax.gap.fit.period_starts import _energies, _wave


@pytest.mark.parametrize("time", [1e-5, 2e-4, 1e-3, 3e-2])
def test_a_lag_is_the_recursion(time):
    values, dt = np.cumsum(np.random.default_rng(0).standard_normal(3001)), 1e-3
    decay = np.exp(-dt / time)
    gain = time / dt * (1.0 - decay)
    wanted, _ = lfilter([1.0 - gain, gain - decay], [1.0, -decay], values, zi=[values[0] * gain])
    np.testing.assert_allclose(lagged(values, time, dt), wanted, rtol=1e-12, atol=1e-11)


def test_a_period_explains_what_least_squares_says():
    rng = np.random.default_rng(1)
    count = 400
    angle, side = np.cumsum(rng.standard_normal(count)), np.sign(rng.standard_normal(count))
    basis, _ = np.linalg.qr(np.stack([np.ones(count), side, rng.standard_normal(count)], 1))
    left, periods = rng.standard_normal(count) + np.sin(3.0 * angle), np.arange(1.0, 12.0, 0.1)
    torque, friction = _energies(left, angle, side, periods, basis)
    for found, factor in ((torque, np.ones(count)), (friction, side)):
        for place in (0, 20, 57, 109):
            phase = periods[place] * angle
            columns = np.concatenate([basis, (factor * np.array([np.cos(phase), np.sin(phase)])).T], 1)
            rest = left - basis @ (basis.T @ left)
            explained = columns @ np.linalg.lstsq(columns, rest)[0]
            assert found[place] == pytest.approx(np.sum(rest**2) - np.sum((rest - explained) ** 2), rel=1e-4)


@pytest.mark.parametrize("samples", [300, 4001])
def test_low_passes_are_butterworths_forwards_and_backwards(samples):
    corners, course = [0.02, 0.08], np.random.default_rng(2).standard_normal((samples, 3)).cumsum(axis=0)
    for corner, found in zip(corners, _passed(course.T, _filters(samples, corners)), strict=True):
        wanted = sosfiltfilt(butter(ORDER, 2.0 * corner, output="sos"), course, axis=0)
        found, inside = found.T, slice(100, -100)
        np.testing.assert_allclose(found[inside], wanted[inside], atol=2e-2 * np.std(course))
        if samples > 1000:
            np.testing.assert_allclose(found[1000:-1000], wanted[1000:-1000], atol=1e-8)


@pytest.mark.parametrize("kind", ["torque", "friction"])
def test_a_start_of_what_repeats_has_the_amplitudes_of_the_missing_torque(kind):
    """Two harmonics beside an offset, a Coulomb and an inertial torque: a machine that cogging traps rests without."""
    time = np.arange(0.0, 10.0, 2e-3)
    record = SimpleNamespace(
        angle=6.0 * np.sin(time), speed=6.0 * np.cos(time), acceleration=-6.0 * np.sin(time), time=time
    )
    side = np.sign(record.speed) if kind == "friction" else 1.0
    wave = 0.4 * np.cos(7.0 * record.angle) - 0.2 * np.sin(14.0 * record.angle)
    # What the simulation lacks drives the machine, a load and a friction brake it.
    course = -side * wave + 0.1 + 0.3 * np.sign(record.speed) + 0.02 * record.acceleration
    course[:100] = np.nan
    course[np.abs(record.speed) < 0.2] += 1.0  # at rest static friction takes what it will
    start = _wave(kind, 7.0, course, record, SimpleNamespace(speed=6.0))
    name = {"torque": "cogging", "friction": "ripple"}[kind]
    assert start.pop(f"{name}_periods") == 7.0
    assert start.pop(f"{name}_cosine_1") == pytest.approx(0.4, abs=1e-6)
    assert start.pop(f"{name}_sine_2") == pytest.approx(-0.2, abs=1e-6)
    assert all(abs(value) < 1e-6 for value in start.values())
    assert len(start) == (2 if kind == "torque" else 4)


def test_waves_over_a_small_part_of_their_period_have_no_huge_amplitudes():
    time = np.arange(0.0, 10.0, 2e-3)
    record = SimpleNamespace(angle=0.05 * np.sin(time), speed=0.05 * np.cos(time), acceleration=-0.05 * np.sin(time))
    course = 0.3 * record.angle + 1e-3 * np.random.default_rng(3).standard_normal(len(time))
    start = _wave("friction", 2.0, course, record, SimpleNamespace(speed=0.05))
    assert max(abs(value) for name, value in start.items() if name != "ripple_periods") < 1.0


def equations(count, dampings, sizes, singular=False):
    """(normal matrices, gradients) with the given sizes of the parameters; the last two may be one and the same."""
    rng = np.random.default_rng(5)
    columns = rng.standard_normal((40, count)) * sizes
    if singular:
        columns[:, -1] = columns[:, -2]
    matrix, slope = columns.T @ columns, columns.T @ rng.standard_normal(40)
    return np.repeat(matrix[None], len(dampings), 0), np.repeat(slope[None], len(dampings), 0)


def parameters(count, at_low=(), at_high=()):
    value = np.zeros(count)
    low, high = np.full(count, -1.0), np.full(count, 1.0)
    low[list(at_low)], high[list(at_high)] = 0.0, 0.0
    return SimpleNamespace(free=np.arange(count), vector=value, low=low, high=high, scale=np.full(count, 0.1))


@pytest.mark.parametrize("singular", [False, True])
def test_damped_steps_are_those_of_least_squares(singular):
    dampings = np.array([1e-6, 1e-2, 1.0, 100.0])
    matrices, slopes = equations(5, dampings, np.array([1.0, 1e-3, 1e3, 10.0, 10.0]), singular)
    found = bounded_steps(parameters(5), matrices, slopes, dampings)
    for step, matrix, slope, damping in zip(found, matrices, slopes, dampings, strict=True):
        damped = matrix + np.diag(damping * np.diag(matrix))
        np.testing.assert_allclose(damped @ step, -slope, rtol=1e-4, atol=1e-7 * np.max(np.abs(slope)))


@pytest.mark.parametrize("every", [False, True])
def test_a_parameter_at_a_bound_is_held_and_the_others_go_on_without_it(every):
    dampings = np.array([1e-3, 10.0])
    matrices, slopes = equations(4, dampings, np.ones(4))
    free = bounded_steps(parameters(4), matrices, slopes, dampings)
    outwards = list(range(4)) if every else [1]
    c = parameters(
        4, at_low=[k for k in outwards if free[0, k] < 0.0], at_high=[k for k in outwards if free[0, k] > 0.0]
    )
    found = bounded_steps(c, matrices, slopes, dampings)[0]
    assert np.all(found[outwards] == 0.0)
    assert np.all((found >= 0.0) | (c.low < 0.0))
    assert np.all((found <= 0.0) | (c.high > 0.0))
    go = np.flatnonzero(found)
    damped = (matrices[0] + np.diag(dampings[0] * np.diag(matrices[0])))[np.ix_(go, go)]
    np.testing.assert_allclose(damped @ found[go], -slopes[0][go], atol=1e-8)


def test_without_free_parameters_there_is_no_step():
    assert bounded_steps(parameters(0), np.zeros((2, 0, 0)), np.zeros((2, 0)), np.ones(2)).shape == (2, 0)
