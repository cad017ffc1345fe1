"""What is computed by a short way, against the long one."""

import numpy as np
import pytest
from scipy.signal import butter, lfilter, sosfiltfilt

from fpjax.gap.fit.backlash_starts import ORDER, _filters, _passed
from fpjax.gap.fit.period_starts import _energies
from fpjax.gap.select.readings import _lagged


@pytest.mark.parametrize("time", [1e-5, 2e-4, 1e-3, 3e-2])
def test_a_lag_is_the_recursion(time):
    values, dt = np.cumsum(np.random.default_rng(0).standard_normal(3001)), 1e-3
    decay = np.exp(-dt / time)
    gain = time / dt * (1.0 - decay)
    wanted, _ = lfilter([1.0 - gain, gain - decay], [1.0, -decay], values, zi=[values[0] * gain])
    np.testing.assert_allclose(_lagged(values, time, dt), wanted, rtol=1e-12, atol=1e-11)


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
    for corner, found in zip(corners, _passed(course, _filters(samples, corners)), strict=True):
        wanted = sosfiltfilt(butter(ORDER, 2.0 * corner, output="sos"), course, axis=0)
        inside = slice(100, -100)
        np.testing.assert_allclose(found[inside], wanted[inside], atol=2e-2 * np.std(course))
        if samples > 1000:
            np.testing.assert_allclose(found[1000:-1000], wanted[1000:-1000], atol=1e-8)
