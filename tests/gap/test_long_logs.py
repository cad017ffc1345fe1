"""Logs that are too long to be simulated as a whole: which windows are, and what is said of it."""

import numpy as np
import pytest

from fpjax.gap.data.record import MOST, about_windows, make_records
from fpjax.logs import Log

DT = 1e-3


def log(samples, moving=lambda time: np.ones_like(time), seed=0):
    """A swinging inertia of 0.05 kg m^2 without friction, at rest where `moving` is zero."""
    time = DT * np.arange(samples)
    speed = 3.0 * np.sin(2.0 * np.pi * 1.3 * time) * moving(time)
    random = np.random.default_rng(seed)
    torque = 0.05 * np.gradient(speed, DT)
    return Log(time, torque, speed + 1e-3 * random.normal(size=samples), None, None, DT, f"{samples} rows")


def shares(record, begin, end):
    """Share of the windows that begin between two times [s]."""
    return float(np.mean((record.time[record.starts] >= begin) & (record.time[record.starts] < end)))


def test_a_log_that_fits_is_taken_as_a_whole_without_a_word():
    (record,) = make_records([log(40_000)], [], 0.05)
    assert len(record.starts) * record.samples > 40_000 - 2 * record.samples
    assert about_windows([record]) == []


def test_windows_are_spread_evenly_over_a_long_log_and_it_is_said():
    (record,) = make_records([log(480_000)], [], 0.05)
    used = len(record.starts) * record.samples
    assert 0.9 * MOST < used < 1.1 * MOST
    assert not np.any(np.diff(record.starts) < record.samples)
    for tenth in range(10):
        assert shares(record, 48.0 * tenth, 48.0 * (tenth + 1)) == pytest.approx(0.1, abs=0.02)
    pairs = record.starts[: len(record.starts) // 2 * 2].reshape(-1, 2)
    assert np.all(np.diff(pairs, axis=1) == record.samples)
    (sentence,) = about_windows([record])
    assert f"480000 rows is long: of its 480000 samples {used} are simulated" in sentence
    assert "--from and --to" in sentence
    assert len(sentence) < 300


def test_rest_is_left_out():
    """An hour of logging in which the machine works for five minutes."""
    (record,) = make_records([log(480_000, lambda time: (time > 300.0) & (time < 340.0))], [], 0.05)
    assert shares(record, 299.0, 341.0) == 1.0
    assert len(record.starts) * record.samples > 0.9 * 40_000
    assert 0 < np.sum(record.withheld) < 0.5 * len(record.starts)


def test_logs_share_what_is_simulated_by_their_lengths():
    records = make_records([log(200_000), log(100_000, seed=1)], [], 0.05)
    used = [len(record.starts) * record.samples for record in records]
    assert 0.9 * MOST < sum(used) < 1.1 * MOST
    assert used[0] == pytest.approx(2.0 * used[1], rel=0.1)
    assert len(about_windows(records)) == 2


def test_a_log_without_any_motion_still_has_windows():
    still = log(100_000, lambda time: 0.0 * time)
    (record,) = make_records([still], [], 0.05)
    assert len(record.starts) * record.samples > 0.5 * MOST
