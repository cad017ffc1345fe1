"""Rounded readings: a coarse rate, and one that is the difference of two counts."""

from dataclasses import replace

import numpy as np
import pytest

from fpjax.gap.answer.rounded import is_counted, is_rounded, rounding_of
from fpjax.gap.data.channel import make_channel
from fpjax.gap.data.octaves import details, gains
from fpjax.gap.fit.band import real_noise
from tests.helpers import gap_search, numpy_machine

DT = 2e-3
SPEED = 15.0 * np.sin(2.0 * np.pi * 0.7 * DT * np.arange(5000))


def counted(speed, step, dt):
    """[rad/s]: differences of a counter with so large a step in the rate."""
    angle = np.cumsum(speed) * dt
    return np.diff(np.floor(angle / (step * dt)), prepend=0.0) * step


@pytest.mark.parametrize("step", [0.4, 1.2])
def test_a_counted_rate_is_rounded_though_its_noise_is_twice_that_of_a_rounded_one(step):
    channel = make_channel(counted(SPEED, step, DT))
    assert channel.step == pytest.approx(step, rel=1e-4)
    assert channel.noise > 1.5 * step / 12.0**0.5
    assert is_counted(channel)
    assert is_rounded(channel)


def test_a_rate_whose_noise_dithers_its_rounding_is_neither():
    noise = np.random.default_rng(0).normal(size=SPEED.size)
    for size, steps in ((0.6, 1), (1.0, 1), (1.0, 8)):
        channel = make_channel(np.round((SPEED + size * noise) * steps) / steps)
        assert channel.step == pytest.approx(1.0 / steps, rel=1e-4)
        assert not is_counted(channel)
        assert not is_rounded(channel)
    assert not is_rounded(make_channel(SPEED + noise))  # no step


def test_noise_that_a_filter_weighs_is_as_large_in_each_octave_as_said():
    noise = np.random.default_rng(1).normal(size=100_001)
    for weights, column in (((1.0,), noise), ((1.0, -1.0), np.diff(noise))):
        found = [np.sqrt(np.mean(own**2)) for own in details(column, 3)[0]]
        np.testing.assert_allclose(found, gains(3, weights), rtol=0.02)


def test_a_right_model_leaves_what_the_counting_makes():
    log = numpy_machine.record(seconds=6.0, sensors=("velocity",))
    step = 1.0
    search = gap_search.search_of(replace(log, velocity=counted(log.velocity, step, log.dt)))
    (fit,), windows = search.finish([search.exact], 0), [np.arange(len(search.records[0].starts))]
    assert is_counted(search.records[0].velocity)
    beyond, of_velocity = rounding_of(search, fit, windows)
    assert 0.0 <= beyond <= fit.missing_rms(windows)
    # Simulated with the right model, differences of counts leave what they leave in the log, within a half.
    residual = search.fitters[search.exact.family.key].residuals(fit.candidate, 0, windows[0])
    plain = search.modes.plain(search.modes.coefficients(residual).T)
    weight = search.measure.weight(np.ones(len(plain)), np.ones(plain.shape[1]))
    assert of_velocity == pytest.approx(np.sqrt(np.sum(plain**2 * weight) / len(plain)), rel=0.5)


def test_windows_at_rest_under_equal_readings_tell_nothing_of_the_noise():
    search = gap_search.search_of(numpy_machine.record(seconds=6.0, sensors=("velocity",)))
    modes, windows = search.modes, 40
    level, noise = np.zeros(modes.bands), np.ones(windows)
    c = np.random.default_rng(2).normal(size=(windows, len(modes.gain))) * 0.5**0.5
    assert real_noise(modes, level, [(noise, c)]) == pytest.approx(0.5, rel=0.1)
    resting = np.where(np.arange(windows)[:, None] < 30, 0.0, c)
    assert real_noise(modes, level, [(noise, resting)]) == pytest.approx(0.5, rel=0.15)
