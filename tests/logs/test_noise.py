"""Rounding step, noise and the origin of a velocity, on columns whose truth is known."""

import numpy as np
import pytest

from fpjax.logs.noise import (
    is_derived,
    noise_level,
    rounding_step,
    velocity_origin,
)

TIME = 1e-3 * np.arange(10_000)
SWING = np.sin(2 * np.pi * TIME) + 0.3 * np.sin(2 * np.pi * 2.7 * TIME)
NOISE = 0.3 * np.random.default_rng(3).normal(size=10_000)
TWELVE_BITS = 2 * np.pi / 4096


def rounded(values, step):
    return np.round(values / step) * step


def with_gaps_filled(values):
    """A reading here and there as interpolation between its neighbours, unevenly, would leave it."""
    here = np.arange(700, len(values) - 1, 900)
    share = np.linspace(0.1, 0.9, len(here))
    filled = values.copy()
    filled[here] = (1 - share) * values[here - 1] + share * (values[here + 1] + 0.8)
    return filled


@pytest.mark.parametrize(
    ("name", "column", "step"),
    [
        ("12 bits", rounded(SWING, TWELVE_BITS), TWELVE_BITS),
        ("12 bits, hardly moving", rounded(0.01 * SWING, TWELVE_BITS), TWELVE_BITS),
        ("three counts", rounded(0.004 * np.sin(2 * TIME), TWELVE_BITS), TWELVE_BITS),
        ("20 bits, 200 samples", rounded(SWING[:2000:10], 2 * np.pi / 2**20), 2 * np.pi / 2**20),
        ("counts", np.round(1e6 * SWING), 1.0),
        ("half a step off zero, as a drive of 12 bits has it", rounded(SWING, 0.0088) + 0.0044, 0.0088),
        ("a rounded noisy rate", rounded(5 * SWING + 0.02 * np.sin(1e5 * TIME**2), 0.022), 0.022),
        ("printed with six digits", np.round(rounded(SWING, TWELVE_BITS), 6), TWELVE_BITS),
        ("single precision", rounded(SWING, TWELVE_BITS).astype(np.float32).astype(float), TWELVE_BITS),
        ("clipped off the grid", np.clip(rounded(5 * SWING, 0.022), -4.001, 4.001), 0.022),
        ("coarse, a few readings interpolated", with_gaps_filled(rounded(5 * SWING + NOISE, 0.8)), 0.8),
        ("large", 1e300 * rounded(SWING, TWELVE_BITS), 1e300 * TWELVE_BITS),
    ],
)
def test_a_rounding_step_is_seen(name, column, step):
    assert rounding_step(column) == pytest.approx(step, rel=1e-4)
    assert noise_level(column) >= 0.999 * step / np.sqrt(12)


@pytest.mark.parametrize(
    ("name", "column"),
    [
        ("smooth", SWING),
        ("noise", np.random.default_rng(0).normal(size=5000)),
        ("a ramp", 1e-3 * TIME),
        ("a triangle", np.abs(TIME % 2 - 1)),
        ("a whole number of samples a lap", np.sin(2 * np.pi * np.arange(10_000) / 100)),
        ("a command of two levels", np.sign(SWING)),
        ("a float's own spacing", SWING.astype(np.float32).astype(float)),
        ("random stairs", np.repeat(np.random.default_rng(1).normal(size=100), 100)),
        ("constant", np.zeros(100)),
        ("a lone 1e200", np.where(np.arange(10_000) == 5000, 1e200, SWING)),
        ("too short", np.arange(5.0)),
    ],
)
def test_what_only_looks_rounded_is_not(name, column):
    assert rounding_step(column) == 0.0
    assert noise_level(column) > 0.0


def test_noise_is_measured_beside_a_motion_and_its_corners():
    noise = np.random.default_rng(2).normal(size=TIME.size)
    for level in (1e-3, 1e-6):
        column = np.abs(SWING) + level * noise
        assert noise_level(column) == pytest.approx(level, rel=0.05)


# ------------------------------------------------------------------ is a velocity only a derivative?


def motion(noise=0.02, seed=0):
    """Rate and angle of a mass with friction under a held torque: (velocity, position)."""
    generator = np.random.default_rng(seed)
    torque = 0.5 * np.sin(2 * np.pi * 1.3 * TIME) + 0.15 * np.sin(2 * np.pi * 3.7 * TIME)
    torque = torque + noise * generator.normal(size=TIME.size)
    velocity, position = np.zeros(TIME.size), np.zeros(TIME.size)
    v = q = 0.0
    for k in range(TIME.size):
        velocity[k], position[k] = v, q
        for _ in range(5):
            a = (torque[k] - 0.1 * np.tanh(200 * v) - 0.01 * v) / 0.01
            q, v = q + 2e-4 * v + 0.5 * a * 4e-8, v + 2e-4 * a
    return velocity, position


@pytest.fixture(scope="module")
def moved():
    return motion()


def derivatives(position):
    from scipy.signal import butter, lfilter, savgol_filter

    rate = np.diff(position, prepend=position[0]) / 1e-3
    low = np.exp(-2 * np.pi * 50 * 1e-3)
    smooth = lfilter([1 - low], [1, -low], rate)
    return {
        "difference": rate,
        "central": np.gradient(position, 1e-3),
        "first order": smooth,
        "second order": lfilter(*butter(2, 0.1), rate),
        "Savitzky-Golay": savgol_filter(position, 11, 2, 1, 1e-3),
        "filtered and rounded": rounded(smooth, 0.01 * np.std(smooth)),
        "in rpm and turned round": -9.549 * smooth,
    }


@pytest.mark.parametrize("bits", [pytest.param(12, marks=pytest.mark.long), 14])
def test_a_derived_velocity_is_known_however_it_was_filtered(moved, bits):
    position = rounded(moved[1], 2 * np.pi / 2**bits)
    for name, velocity in derivatives(position).items():
        assert is_derived(velocity, position), name
    assert velocity_origin(derivatives(position)["difference"], position).left < 1e-9


@pytest.mark.parametrize("bits", [14, 20, *(pytest.param(bits, marks=pytest.mark.long) for bits in (12, 17, 24))])
def test_a_rate_sensor_is_not_a_derivative(moved, bits):
    from scipy.signal import lfilter

    velocity, position = moved[0], rounded(moved[1], 2 * np.pi / 2**bits)
    noise = np.std(velocity) * np.random.default_rng(4).normal(size=velocity.size)
    low = np.exp(-2 * np.pi * 50 * 1e-3)
    sensors = {
        "perfect": velocity,
        "quiet": velocity + 1e-4 * noise,
        "noisy": velocity + 1e-2 * noise,
        "rounded": rounded(velocity + 1e-4 * noise, 0.01 * np.std(velocity)),
        "slow": lfilter([1 - low], [1, -low], velocity + 1e-3 * noise),
    }
    for name, reading in sensors.items():
        assert not is_derived(reading, position), name


@pytest.mark.parametrize(("bits", "step"), [(18, 0.003), (20, 0.001)])
def test_a_derivative_whose_noise_is_below_its_own_rounding_is_known_by_what_it_lacks(moved, bits, step):
    """Of a derivative nothing is left but its rounding; of a sensor as coarse, the encoder's noise too."""
    from scipy.signal import lfilter

    position, low = rounded(moved[1], 2 * np.pi / 2**bits), np.exp(-2 * np.pi * 50 * 1e-3)
    derived, sensed = (
        lfilter([1 - low], [1, -low], rate) for rate in (np.diff(position, prepend=position[0]) / 1e-3, moved[0])
    )
    step *= np.std(sensed)
    origin = velocity_origin(rounded(derived, step), position)
    assert origin.passed < 0.7 * origin.left
    assert origin.derived
    assert not is_derived(rounded(sensed, step), position)


def test_columns_that_say_nothing_are_not_called_derived():
    assert not is_derived(np.zeros(1000), np.zeros(1000))
    assert not is_derived(np.ones(10), np.arange(10.0))


def test_a_machine_that_mostly_rests_has_the_noise_of_its_reading_where_it_moves():
    time = np.arange(4000) * 5e-3
    angle = np.where(time < 4.0, 0.8 * np.sin(3.0 * time) ** 2, 0.8 * np.sin(12.0) ** 2)
    step = 3e-3
    read = step * np.round(angle / step)
    polled = np.interp(time + 2e-4 * np.sin(9.0 * time), time, read)  # resampled: between two readings, on no grid
    polled[time > 4.1] = read[-1]
    assert step / np.sqrt(12.0) / 3.0 < noise_level(polled) < step


def test_repeated_readings_do_not_hide_the_noise():
    """Most differences of a drive that repeats its readings are nothing but the rounding of the arithmetic."""
    rng = np.random.default_rng(2)
    jumps = np.where(rng.random(20_000) < 0.1, rng.normal(size=20_000), 0.0)
    assert noise_level(jumps + 1e-16 * rng.normal(size=20_000)) > 0.05
    spikes = np.where(rng.random(10_000) < 0.01, 1.0, 0.0)
    assert noise_level(SWING + spikes) < 1e-6  # a smooth motion repeats nothing, whatever is beside it
