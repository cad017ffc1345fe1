"""Logs that are too long to be simulated as a whole: which windows are, and what is said of it."""

import numpy as np
import pytest
from numpy_machine import swing
from sentences import faults

from fpjax import Log
from fpjax.gap.data.record import EDGE, LEAD, MOST, about_stretches, in_one_piece, joints, make_records

DT = 1e-3


def log(samples, moving=lambda time: np.ones_like(time), seed=0):
    """A swinging inertia of 0.05 kg m^2 without friction, at rest where `moving` is zero."""
    table = swing(samples, DT, inertia=0.05, amplitude=3.0, rate=2.0 * np.pi * 1.3, noise=0.0)
    works = moving(table["time"])
    velocity = works * table["velocity"] + 1e-3 * np.random.default_rng(seed).normal(size=samples)
    return Log(table["time"], works * table["torque"], velocity, None, None, DT, f"{samples} rows")


def share(record, begin, end):
    """Share of the windows that begin between two times [s]."""
    return float(np.mean((record.time[record.starts] >= begin) & (record.time[record.starts] < end)))


def test_a_log_that_fits_is_taken_as_a_whole_without_a_word():
    (record,) = make_records([log(40_000)], [], 0.05)
    assert len(record.time) == record.recorded == 40_000
    assert len(record.starts) * record.samples > 40_000 - 2 * record.samples
    assert about_stretches([record]) == []
    assert in_one_piece(record) is record


def test_a_long_log_is_held_by_stretches_spread_over_it_and_it_is_said():
    given = log(480_000)
    (record,) = make_records([given], [], 0.05)
    assert record.recorded == 480_000
    assert 0.9 * MOST < len(record.starts) * record.samples < 1.1 * MOST
    assert len(record.time) < 1.2 * MOST  # and with it everything that is computed from it
    for fifth in range(5):
        assert share(record, 96.0 * fifth, 96.0 * (fifth + 1)) > 0.1
    edges = joints(record)
    for start in record.starts:  # each window with its past lies within one stretch
        assert np.any((edges[:-1] + LEAD <= start) & (start + record.samples + EDGE <= edges[1:]))
    where = np.searchsorted(given.time, record.time - 0.5 * DT)
    np.testing.assert_array_equal(record.torque, given.torque[where])
    np.testing.assert_array_equal(record.velocity.values, given.velocity[where])
    assert len(record.speed) == len(record.angle) == len(record.acceleration) == len(record.time)
    (sentence,) = about_stretches([record])
    assert f"is long: of its 480000 samples {len(record.time)} are simulated" in sentence
    assert "--from and --to" in sentence
    assert not faults(sentence)


def test_one_piece_of_it_runs_from_sample_to_sample():
    (record,) = make_records([log(480_000)], [], 0.05)
    piece = in_one_piece(record)
    assert np.all(np.diff(piece.time) < 1.5 * DT)
    assert len(piece.starts) == len(piece.withheld) == len(piece.runs) > 0
    assert piece.withheld.any()
    assert piece.starts[-1] + piece.samples <= len(piece.time) == len(piece.velocity.values)


def test_rest_is_left_out():
    """An hour of logging in which the machine works for some minutes."""
    (record,) = make_records([log(480_000, lambda time: (time > 300.0) & (time < 370.0))], [], 0.05)
    assert share(record, 299.0, 371.0) > 0.95
    assert len(record.starts) * record.samples > 0.9 * MOST
    assert 0 < np.sum(record.withheld) < 0.5 * len(record.starts)


def test_logs_share_what_is_simulated_by_their_lengths():
    records = make_records([log(200_000), log(100_000, seed=1)], [], 0.05)
    used = [len(record.starts) * record.samples for record in records]
    assert 0.9 * MOST < sum(used) < 1.1 * MOST
    assert used[0] == pytest.approx(2.0 * used[1], rel=0.2)
    assert len(about_stretches(records)) == 2


def test_many_short_logs_lose_pairs_of_windows():
    records = make_records([log(4_000, seed=seed) for seed in range(24)], [], 0.05)
    assert 0.4 * MOST < sum(len(record.starts) * record.samples for record in records) < 1.1 * MOST
    assert all(len(record.time) == record.recorded for record in records)


def test_a_log_without_any_motion_still_has_windows():
    (record,) = make_records([log(100_000, lambda time: 0.0 * time)], [], 0.05)
    assert len(record.starts) * record.samples > 0.5 * MOST


def test_of_a_short_log_beside_a_long_one_enough_windows_are_kept():
    """It had none: a share of its few pairs of windows is less than one pair."""
    long, short = make_records([log(300_000), log(4_000)], [], 0.05)
    assert len(short.starts) >= 3
    assert 0 < np.sum(short.withheld) < len(short.starts)
    assert len(long.starts) * long.samples < 1.1 * MOST
