"""Rounded readings: a coarse rate, and one that is the difference of two counts."""

import numpy as np
import pytest

from fpjax.gap.answer.rounded import is_rounded, rounding_error
from fpjax.gap.data.channel import make_channel
from fpjax.gap.data.octaves import details, gains
from fpjax.gap.fit.band import real_noise
from tests.helpers import gap_search, numpy_machine

DT = 2e-3
TIME = DT * np.arange(5000)
SPEED = 15.0 * np.sin(2.0 * np.pi * 0.7 * TIME)
NOISE = np.random.default_rng(0).normal(size=SPEED.size)


def counted(speed, step):
    """[rad/s]: differences of a counter with so large a step in the rate."""
    return np.diff(np.floor(np.cumsum(speed) / step), prepend=0.0) * step


def moves(resting):
    """Smooth moves that take one second each, with rests between them that are so large a share of the time."""
    phase = TIME % (1.0 / (1.0 - resting))
    return np.where(phase < 1.0, 15.0 * np.sin(np.pi * phase) ** 2, 0.0)


OUTLIER = np.where(np.arange(5000) == 2500, 20.0, 0.0)


@pytest.mark.parametrize(
    ("speed", "step"),
    [(SPEED, 0.4), (SPEED, 1.2), (moves(0.3), 0.4), (moves(0.5), 0.4), (moves(0.8), 0.4), (SPEED + OUTLIER, 0.4)],
)
def test_a_counted_rate_is_rounded_though_its_noise_is_twice_that_of_a_rounded_one(speed, step):
    channel = make_channel(counted(speed, step), rate=True)
    assert channel.step == pytest.approx(step, rel=1e-4)
    assert channel.counted
    assert is_rounded(channel)
    assert not make_channel(counted(speed, step)).counted  # of a position it means nothing


@pytest.mark.parametrize("noise", [0.5, 0.6, 1.0, 3.0])
def test_a_rate_whose_noise_dithers_its_rounding_is_neither(noise):
    channel = make_channel(np.round(SPEED + noise * NOISE), rate=True)
    assert channel.step == pytest.approx(1.0, rel=1e-4)
    assert not channel.counted
    assert not is_rounded(channel)


@pytest.mark.parametrize("step", [0.1, 0.4, 1.2])
def test_a_rounded_rate_is_not_counted(step):
    assert not make_channel(np.round(SPEED / step) * step, rate=True).counted


@pytest.mark.parametrize("frequency", [150.0, 175.0, 200.0])
@pytest.mark.parametrize("size", [0.3, 0.45, 0.62])
def test_a_fast_vibration_under_a_rounded_rate_is_no_counter(frequency, size):
    shaken = SPEED + 0.4 * size * np.sin(2.0 * np.pi * frequency * TIME + 0.3)
    assert not make_channel(np.round(shaken / 0.4) * 0.4, rate=True).counted


def test_more_noise_than_counting_makes_is_no_rounding():
    for noise, found in ((0.1, True), (2.0, False)):
        column = counted(SPEED, 1.0) + np.round(noise * NOISE)
        assert make_channel(column, rate=True).counted == found


def test_noise_that_a_filter_weighs_is_as_large_in_each_octave_as_said():
    noise = np.random.default_rng(1).normal(size=100_001)
    for weights, column in (((1.0,), noise), ((1.0, -1.0), np.diff(noise))):
        found = [np.sqrt(np.mean(own**2)) for own in details(column, 3)[0]]
        np.testing.assert_allclose(found, gains(3, weights), rtol=0.02)


@pytest.mark.parametrize("counts", [True, False])
def test_a_right_simulation_is_rounded_to_what_was_read(counts):
    """Its error is then that of the reading, but where the count of a window's start makes it the next one."""
    step = 0.4
    read = counted(SPEED, step) if counts else np.round(SPEED / step) * step
    residuals = (SPEED - read).reshape(20, 250).T  # windows of 250 samples
    share = {
        law: np.mean(np.abs(rounding_error(residuals, step, counted=law) + residuals) < 1e-9 * step)
        for law in (True, False)
    }
    assert share[counts] > 0.9
    assert share[not counts] < 0.8


def test_windows_at_rest_under_equal_readings_tell_nothing_of_the_noise():
    search = gap_search.search_of(numpy_machine.record(seconds=6.0, sensors=("velocity",)))
    modes, windows = search.modes, 40
    level, noise = np.zeros(modes.bands), np.ones(windows)
    c = np.random.default_rng(2).normal(size=(windows, len(modes.gain))) * 0.5**0.5
    assert real_noise(modes, level, [(noise, c)]) == pytest.approx(0.5, rel=0.1)
    resting = np.where(np.arange(windows)[:, None] < 30, 0.0, c)
    assert real_noise(modes, level, [(noise, resting)]) == pytest.approx(0.5, rel=0.15)
    assert real_noise(modes, level, [(noise, 0.0 * c)]) == 1.0  # what is assumed stands
