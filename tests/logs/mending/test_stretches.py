"""A log with breaks is several stretches of one recording: the longest that are alike are kept."""

import dataclasses

import numpy as np
import pytest

from fpjax import FpjaxWarning, read_log

pytestmark = pytest.mark.filterwarnings("ignore::fpjax.errors.FpjaxWarning")

DT = 1e-3


def run(rows, begin=0.0):
    time = begin + DT * np.arange(rows)
    return {"time": time, "torque": np.sin(7 * time), "velocity": np.cos(3 * time), "position": np.sin(3 * time) / 3}


def joined(*parts):
    return {key: np.concatenate([part[key] for part in parts]) for key in parts[0]}


def test_of_a_log_with_a_pause_the_longest_stretch_leads_and_the_other_is_a_log_of_its_own():
    first, second = run(500), run(600, 1.2)
    with pytest.warns(FpjaxWarning, match=r"1 further stretch is kept beside it \(rows 0 to 499\)"):
        log = read_log(joined(first, second), name="run")
    (other,) = log.further
    assert (len(log), len(other)) == (600, 500)
    np.testing.assert_allclose(other.time, first["time"], atol=1e-12)
    np.testing.assert_array_equal(other.velocity, first["velocity"])
    np.testing.assert_array_equal(log.position, second["position"])
    assert other.dt == log.dt == DT
    assert "rows 0 to 499" in other.name
    # a drift counts from the beginning of the recording
    assert (log.since, other.since) == (pytest.approx(1.2), 0.0)


def test_runs_whose_time_starts_anew_have_no_time_in_common():
    log = read_log(joined(run(500), run(600), run(400)))
    assert [len(log), *map(len, log.further)] == [600, 500, 400]
    assert [log.since, *(one.since for one in log.further)] == [0.0, 0.0, 0.0]


def test_a_run_that_has_a_pause_itself_is_cut_too():
    log = read_log(joined(run(900), run(500), run(500, 2.0)))
    assert [len(log), *map(len, log.further)] == [500, 900, 500]


def test_readings_that_are_missing_for_long_part_two_stretches():
    columns = run(1500)
    columns["velocity"][700:760] = np.nan
    log = read_log(columns)
    assert [len(log), *map(len, log.further)] == [740, 700]
    assert np.isfinite(log.velocity).all()


@pytest.mark.parametrize(
    "other",
    [
        pytest.param(run(15, 3.0), id="a few rows"),
        pytest.param(run(500, 3.0) | {"velocity": np.full(500, np.nan)}, id="without a column"),
        pytest.param(run(500, 3.0) | {"time": 3.0 + 5 * DT * np.arange(500)}, id="at another rate"),
    ],
)
def test_a_stretch_that_cannot_stand_beside_the_longest_is_left_out(other):
    log = read_log(joined(run(600), other))
    assert len(log) == 600
    assert log.further == ()


def test_a_log_without_a_break_is_one():
    log = read_log(run(600, 5.0))
    assert (log.further, log.since) == ((), 0.0)


def test_options_hold_for_every_stretch():
    log = read_log(joined(run(600), run(500, 3.0)), take_every=2, torque_scale=2.0)
    (other,) = log.further
    assert (other.dt, len(other)) == (2 * DT, 250)
    np.testing.assert_allclose(other.torque[0], np.sin(21.0) + np.sin(7 * 3.001), rtol=1e-9)
    assert read_log(joined(run(600), run(500, 3.0)), start=2.0).further == ()


@pytest.mark.parametrize("pieces", [16, 40])
def test_no_more_than_sixteen_stretches_are_kept(pieces):
    log = read_log(joined(*(run(100, 2.0 * index) for index in range(pieces))))
    assert len(log.further) == 15


def test_after_a_pause_longer_than_all_that_was_recorded_time_starts_anew():
    log = read_log(joined(run(500), run(600, 3.0)))
    assert (log.since, log.further[0].since) == (0.0, 0.0)


def test_a_position_that_wraps_leaves_no_further_stretch():
    """How many turns of 25 rad, which are no whole revolutions, lie in the pause is not known."""
    parts = [run(900), run(800, 1.5)]
    for part in parts:
        part["position"] = (40.0 * part["time"] + 12.5) % 25.0 - 12.5
        part["velocity"] = np.full(len(part["time"]), 40.0)
    assert read_log(joined(*parts)).further == ()


def test_further_stretches_belong_to_the_columns_that_were_read():
    log = read_log(joined(run(600), run(500, 1.0)))
    assert len(log.further) == 1
    assert dataclasses.replace(log, torque=2.0 * log.torque).further == ()


def test_of_five_thousand_short_runs_a_few_are_looked_at():
    part = run(40)
    log = read_log({key: np.tile(values, 5000) for key, values in part.items()})
    assert len(log) == 40
    assert len(log.further) <= 15
