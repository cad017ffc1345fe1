"""How far: intervals cover, the noise floor is the noise, and noise alone is told from structure."""

import pathlib

import numpy as np
import pytest

from fpjax.gap.measure import (
    NoiseFloor,
    block_length,
    correlation_time,
    lap_length,
    measure_gap,
    noise_floor,
    rms_interval,
    share_closed,
    sure_gain,
)
from fpjax.gap.structure import left_over, randomised, repeats

EMPS = pathlib.Path(__file__).parents[3] / "shared" / "data" / "emps"


def coloured(random, count, correlation):
    noise = random.standard_normal(count)
    values = np.empty(count)
    values[0] = noise[0]
    for k in range(1, count):
        values[k] = correlation * values[k - 1] + np.sqrt(1 - correlation**2) * noise[k]
    return values


@pytest.mark.parametrize("correlation", [0.0, 0.9])
def test_intervals_of_the_rms_cover_nine_in_ten(correlation):
    random = np.random.default_rng(0)
    hits = 0
    for trial in range(150):
        low, high = rms_interval(coloured(random, 1500, correlation), seed=trial, draws=200)
        hits += low <= 1.0 <= high
    assert 0.83 <= hits / 150 <= 0.96


def test_blocks_are_longer_where_neighbours_are_alike():
    random = np.random.default_rng(1)
    white, slow = (block_length(coloured(random, 4000, c)) for c in (0.0, 0.95))
    assert white <= 8
    assert slow >= 8 * white


def test_the_gap_and_what_is_closed():
    random = np.random.default_rng(2)
    noise = 0.1 * random.standard_normal(6000)
    gap = measure_gap(noise + np.sin(0.01 * np.arange(6000)), noise, NoiseFloor(0.1, (0.099, 0.101), "sensor"),
                      signal="velocity", unit="rad/s")  # fmt: skip
    assert gap.closed == pytest.approx(1.0, abs=0.01)
    assert gap.before_interval[0] < gap.before < gap.before_interval[1]
    assert gap.after_interval[0] < 0.1 < gap.after_interval[1]
    assert gap.closed_interval[0] > 0.98


def test_nothing_to_close_is_nothing_closed():
    assert share_closed(0.1, 0.1, 0.1) == 0.0
    assert share_closed(0.1, 0.2, 0.1) == 0.0
    assert share_closed(1.0, 2.0, 0.1) < 0.0


def test_nothing_simulated_is_not_a_number():
    gap = measure_gap(
        np.full(10, np.nan), np.full(10, np.nan), NoiseFloor(0.1, (0.1, 0.1), "sensor"), signal="velocity", unit="rad/s"
    )
    assert np.isnan(gap.before)


@pytest.mark.parametrize("noise", [1e-4, 1e-2])
def test_the_floor_is_the_sensors_noise(noise):
    random = np.random.default_rng(3)
    motion = np.sin(2 * np.pi * 1e-3 * np.arange(8000))
    floor = noise_floor(motion + noise * random.standard_normal(8000))
    assert floor.source == "sensor"
    assert floor.value == pytest.approx(noise, rel=0.05)


def test_the_floor_of_a_rounded_sensor_is_its_rounding():
    step = 0.01
    motion = step * np.round(np.sin(2 * np.pi * 1e-3 * np.arange(8000)) / step)
    floor = noise_floor(motion)
    assert floor.source == "rounding"
    left = np.sqrt(np.mean((motion - np.sin(2 * np.pi * 1e-3 * np.arange(8000))) ** 2))
    assert floor.value == pytest.approx(left, rel=0.02)
    assert floor.interval[0] <= floor.value <= floor.interval[1]


def test_what_does_not_repeat_from_lap_to_lap_counts_as_noise():
    random = np.random.default_rng(4)
    reference = np.tile(np.sin(2 * np.pi * np.arange(1000) / 1000), 6)
    repeating = np.tile(0.3 * np.sin(6 * np.pi * np.arange(1000) / 1000), 6)
    wander = 0.05 * coloured(random, 6000, 0.95)
    sensor = 1e-3 * random.standard_normal(6000)
    floor = noise_floor(reference + repeating + wander + sensor, repeating + wander + sensor, reference)
    assert floor.source == "repeats"
    assert floor.value == pytest.approx(0.05, rel=0.15)


def test_laps():
    time = np.arange(5000) * 1e-3
    assert lap_length(np.sin(2 * np.pi * time)) == 1000
    assert lap_length(np.sin(2 * np.pi * time) + np.sin(2 * np.pi * 1.5 * time)) == 2000
    assert lap_length(time) == 0
    assert lap_length(np.ones(100)) == 0
    assert lap_length(np.random.default_rng(0).standard_normal(1000)) == 0


@pytest.mark.skipif(not EMPS.exists(), reason="the EMPS records are not bundled")
def test_the_laps_of_a_real_axis():
    from scipy.io import loadmat

    reference = loadmat(EMPS / "DATA_EMPS.mat")["qg"].ravel()
    assert lap_length(reference) == pytest.approx(6240, abs=30)


def motion_of(count):
    speed = np.sin(2 * np.pi * np.arange(count) / 900) + 0.4 * np.sin(2 * np.pi * np.arange(count) / 370)
    return np.stack([speed, np.sign(speed), np.gradient(speed)])


def test_noise_alone_is_called_noise():
    random = np.random.default_rng(5)
    window = np.arange(4000) // 250
    called = [
        left_over(0.1 * random.standard_normal(4000), 0.1, motion_of(4000), window, draws=300, seed=s).noise_alone(0.01)
        for s in range(40)
    ]
    assert np.mean(called) >= 0.95


@pytest.mark.parametrize("kind", ["coloured", "follows", "larger"])
def test_each_kind_of_structure_is_seen(kind):
    random = np.random.default_rng(6)
    noise = random.standard_normal(4000)
    added = {
        "coloured": 0.6 * coloured(random, 4000, 0.98),
        "follows": 0.25 * motion_of(4000)[1],
        "larger": 0.7 * random.standard_normal(4000),
    }[kind]
    found = left_over(noise + added, 1.0, motion_of(4000), np.arange(4000) // 250, draws=300)
    assert getattr(found, kind) < 0.01
    assert not found.noise_alone(0.03)


def test_rounding_is_no_structure():
    """A slow signal rounded to a step leaves a coloured residual, and still there is nothing to explain."""
    random = np.random.default_rng(7)
    slow = 3.0 * np.sin(2 * np.pi * np.arange(4000) / 900)
    step, beyond = 0.2, 0.01
    read = step * np.round((slow + beyond * random.standard_normal(4000)) / step)
    noise = float(np.hypot(step / np.sqrt(12.0), beyond))
    window = np.arange(4000) // 250
    found = left_over(read - slow, noise, motion_of(4000), window, predicted=slow, step=step, draws=200)
    assert found.coloured > 0.02
    assert (
        left_over(read - slow, noise, motion_of(4000), window, draws=200).coloured < 0.01
    )  # which is why it must know the step


def test_a_residual_that_comes_back_every_lap_repeats():
    random = np.random.default_rng(8)
    wave = np.tile(coloured(random, 500, 0.9), 8)
    found, chance = repeats(wave + random.standard_normal(4000), 500, draws=200)
    assert found > 0.3
    assert chance < 0.01
    assert repeats(random.standard_normal(4000), 500, draws=200)[1] > 0.01


def test_a_randomised_copy_keeps_the_spectrum():
    values = np.random.default_rng(9).standard_normal(501)
    copy = randomised(values, np.random.default_rng(1))
    np.testing.assert_allclose(np.abs(np.fft.rfft(copy))[1:-1], np.abs(np.fft.rfft(values))[1:-1], rtol=1e-9)
    assert not np.allclose(copy, values)


def test_white_noise_has_as_many_independent_samples_as_samples():
    random = np.random.default_rng(4)
    for count, stretches in ((250, 40), (1000, 12), (64, 100)):
        assert correlation_time(random.standard_normal((count, stretches))) == 1.0


def test_a_first_order_process_has_the_correlation_time_of_the_books():
    random = np.random.default_rng(5)
    rows = np.stack([coloured(random, 1000, 0.9) for _ in range(40)], axis=1)
    assert correlation_time(rows) == pytest.approx((1 + 0.9) / (1 - 0.9), rel=0.15)


def test_a_gain_is_sure_if_most_windows_have_it():
    random = np.random.default_rng(6)
    before = 10.0 + random.standard_normal(24)
    assert sure_gain(before, before - 1.0 - 0.5 * random.standard_normal(24))
    assert not sure_gain(before, before + 0.01 * random.standard_normal(24) + 0.1)
    luck = np.zeros(24)
    luck[7] = 30.0  # one window decides nothing
    assert not sure_gain(before, before - luck)
    assert not sure_gain(before[:1], before[:1] - 1.0)
