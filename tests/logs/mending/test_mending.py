"""What is wrong with a log is mended and said, or refused in one sentence; parts of it are taken."""

import re

import numpy as np
import pytest
from log_files import DT, SAMPLES, damaged, write_csv

from fpjax import FpjaxWarning, InputError, read_log
from fpjax.logs.mending.clock import in_order

pytestmark = pytest.mark.filterwarnings("ignore::fpjax.errors.FpjaxWarning")  # each test asks for its own


REFUSED = {
    "constant time": r"time is 1 s in every row",
    "too short": r"too short: 8 rows",
    "two columns": r"has two columns \(time, torque\)",
    "no torque": r"has no column torque",
    "no motion": r"has no column velocity or position",
}


@pytest.mark.parametrize("what", REFUSED)
def test_what_cannot_be_computed_is_one_clear_sentence(tmp_path, columns, what):
    path = write_csv(tmp_path / "log.csv", damaged(columns, what))
    with pytest.raises(InputError, match=REFUSED[what]) as caught:
        read_log(path)
    text = str(caught.value)
    assert "\n" not in text
    assert text.startswith("log.csv")
    assert text.endswith(".")


MENDED = {
    "nan": (r"1 value of velocity that is not a number \(first in row 5\) was filled", SAMPLES),
    "inf": (r"2 values of torque that are not numbers", SAMPLES),
    "nan time": (r"1 rows without a time were dropped", SAMPLES),
    "repeated": (r"time repeats in row 53", SAMPLES),
    "dropped": (r"2 missing samples of 200 were filled", SAMPLES),
    "decreasing": (r"time runs backwards in row 102", 100),
    "clock jump": (r"time jumps by 3\.001 s after row 101 .* --from and --to", 100),
}


@pytest.mark.parametrize("what", MENDED)
def test_what_can_be_mended_is_mended_and_said(tmp_path, columns, what):
    sentence, rows = MENDED[what]
    path = write_csv(tmp_path / "log.csv", damaged(columns, what))
    with pytest.warns(FpjaxWarning, match=sentence):
        log = read_log(path)
    assert len(log) == rows
    assert any(re.search(sentence, each) for each in log.warnings)
    assert all("\n" not in each and each.endswith(".") for each in log.warnings)
    np.testing.assert_allclose(log.velocity, np.cos(30 * log.time), atol=1e-3)
    with pytest.raises(InputError, match=r"\(strict: the log is refused for it\.\)"):
        read_log(path, strict=True)


@pytest.mark.parametrize("rate", [lambda k: 10e-3 + 2e-3 * (k % 2), lambda k: 10e-3 + 2e-3 * ((k * 7919) % 5 < 2)])
def test_true_stamps_of_10_and_12_ms_are_resampled(rate):
    stamps = np.cumsum([rate(k) for k in range(600)])
    motion, torque = np.sin(5 * stamps), np.sign(np.sin(2 * stamps))
    log = read_log({"time": stamps, "torque": torque, "position": motion, "velocity": 5 * np.cos(5 * stamps)})
    assert log.resampled
    assert any("0.01 to 0.012 s apart" in each for each in log.warnings)
    assert 10e-3 <= log.dt <= 12e-3
    np.testing.assert_allclose(log.position, np.sin(5 * log.time), atol=2e-6)
    np.testing.assert_allclose(log.velocity, 5 * np.cos(5 * log.time), atol=1e-5)
    # the impulse stays what it was
    assert np.sum(log.torque) * log.dt == pytest.approx(np.sum(torque[:-1] * np.diff(stamps)), abs=2 * 12e-3)


def test_readings_that_were_only_stamped_late_keep_their_values():
    generator = np.random.default_rng(0)
    true = 5e-3 * np.arange(800)
    data = {
        "time": true + 5e-3 * generator.uniform(-0.2, 0.2, 800),
        "torque": np.sin(true),
        "position": np.sin(9 * true),
    }
    with pytest.warns(FpjaxWarning, match="the readings do not"):
        log = read_log(data)
    assert not log.resampled
    np.testing.assert_array_equal(log.position, data["position"])


def test_a_start_up_gap_is_cut_off(columns):
    columns["time"][0] -= 4 * DT
    with pytest.warns(FpjaxWarning, match=r"time jumps by 0\.005 s after row 0 .* without 1 row"):
        log = read_log(columns)
    assert len(log) == SAMPLES - 1
    np.testing.assert_array_equal(log.torque, columns["torque"][1:])


def test_half_a_period_of_a_clock_that_jumps_is_no_reason_to_refuse(columns):
    log = read_log(damaged(columns, "half a period"))
    assert log.dt == pytest.approx(DT, rel=0.01)
    assert len(log) in (SAMPLES, SAMPLES + 1)


def test_stamps_coarser_than_the_rows_are_spread():
    true = 0.5e-3 * np.arange(2000)
    log = read_log({"time": np.floor(true * 1e3) / 1e3, "torque": np.sin(true), "velocity": np.cos(9 * true)})
    assert log.dt == pytest.approx(0.5e-3, rel=1e-3)
    assert len(log) == 2000
    assert "coarser than its rows" in log.warnings[0]


@pytest.mark.parametrize("first", [1795800.0, 1795799.2, 1795798.9])
def test_two_or_three_different_stamps_tell_no_period(first):
    true = first + 1e-3 * np.arange(2000)
    data = {"time": np.floor(true), "torque": np.sin(true), "velocity": np.cos(9 * true)}
    with pytest.raises(InputError, match=r"only [23] different values in 2000 rows .* with --rate") as caught:
        read_log(data)
    assert str(caught.value).endswith(".")
    log = read_log(data, dt=1e-3)
    assert len(log) == 2000
    assert log.dt == 1e-3
    np.testing.assert_array_equal(log.velocity, data["velocity"])


def test_a_known_period_leaves_a_pause_between_coarse_stamps():
    stamps = np.repeat([0.0, 1.0, 60.0, 61.0], 100)
    data = {"time": stamps, "torque": np.sin(9.0 * np.arange(400)), "velocity": np.cos(7.0 * np.arange(400))}
    log = read_log(data, dt=0.01)
    assert len(log) == 200
    assert any("time jumps by 58.01 s after row 199" in each for each in log.warnings)


def test_what_is_noticed_and_not_changed_is_not_refused_by_strict(columns):
    columns["torque"][7::67] = 9999.0
    log = read_log(columns, strict=True)
    assert any("mark for no reading" in each for each in log.warnings)


@pytest.mark.parametrize("marks", [(-9999.0, 32767.0), (-9999.0, -9998.0), (-999.0, 32767.0)])
def test_no_mark_for_no_reading_hides_behind_another(columns, marks):
    for place, mark in enumerate(marks):
        columns["velocity"][7 + 2 * place :: 67] = mark
    said = " ".join(read_log(columns).warnings)
    assert all(f"{mark:.6g}" in said for mark in marks)
    assert "mark for no reading" in said


def test_two_limits_of_a_signal_are_no_marks(columns):
    columns["torque"] = np.clip(5.0 * columns["torque"], -1.0, 1.2)
    assert not any("mark for no reading" in each for each in read_log(columns).warnings)


def test_a_few_seconds_of_stamps_of_whole_seconds_tell_the_period_where_they_agree():
    true = 0.5 + 1e-3 * np.arange(3800)
    log = read_log({"time": np.floor(true), "torque": np.sin(true), "velocity": np.cos(9 * true)})
    assert log.dt == pytest.approx(1e-3, rel=1e-3)


def test_spread_stamps_do_not_run_backwards():
    stamps = np.concatenate([np.zeros(60), np.repeat(np.arange(1.0, 10.0), 10)])
    time = in_order(stamps, "log", 1, []).time
    assert (np.diff(time) > 0).all()


@pytest.mark.parametrize("since", [46354.5, 740316.5])
def test_stamps_in_days_are_asked_about(columns, since):
    data = columns | {"time": since + columns["time"] / 86400}
    with pytest.warns(FpjaxWarning, match=r"do they count days\? Then say so with --columns time=NAME\*86400\.$"):
        read_log(data)
    log = read_log(data, columns={"time": "time*86400"})
    assert log.dt == pytest.approx(DT, rel=1e-3)
    assert not any("days" in each for each in log.warnings)


def test_days_of_a_fast_drive_are_refused_with_their_unit(columns):
    with pytest.raises(InputError, match=r"--columns time=NAME\*86400 for days\.$"):
        read_log(columns | {"time": 46354.5 + columns["time"] / 50 / 86400})


@pytest.mark.parametrize("since", [0.0, 46354.5, 1.7e9])
def test_stamps_in_seconds_are_no_days(columns, since):
    log = read_log(columns | {"time": since + columns["time"]})
    assert not any("days" in each for each in log.warnings)


def test_rows_that_came_late_are_put_in_order(columns):
    order = np.arange(SAMPLES)
    order[50:52] = [51, 50]
    log = read_log({name: values[order] for name, values in columns.items()})
    np.testing.assert_allclose(log.velocity, columns["velocity"])
    assert "came late" in log.warnings[0]


def test_small_jitter_keeps_the_values_and_warns(columns):
    jitter = 0.1 * DT * np.sin(np.arange(SAMPLES) * 1.7)
    with pytest.warns(FpjaxWarning, match="jitter by up to 10 %"):
        log = read_log({**columns, "time": columns["time"] + jitter})
    np.testing.assert_array_equal(log.torque, columns["torque"])
    np.testing.assert_allclose(log.time, columns["time"], atol=2e-6)


def test_from_to_and_every(columns):
    log = read_log(columns, start=0.05, stop=0.1499)
    np.testing.assert_array_equal(log.torque, columns["torque"][50:150])
    assert log.time[0] == pytest.approx(0.05)
    with pytest.warns(FpjaxWarning, match="one row was made of every 4"):
        log = read_log(columns, take_every=4)
    assert log.dt == pytest.approx(4 * DT)
    np.testing.assert_array_equal(log.position, columns["position"][::4])
    np.testing.assert_allclose(log.torque, columns["torque"].reshape(-1, 4).mean(axis=1))


@pytest.mark.parametrize(
    ("options", "sentence"),
    [
        ({"start": 5.0, "stop": 6.0}, "leave 0 rows.*it runs from 0 to 0.199 s"),
        ({"start": 0.0, "stop": 0.0101}, "leave 11 rows"),
        ({"start": 2.0, "stop": 1.0}, "--from 2 must be before --to 1"),
        ({"take_every": 0}, "must be a whole number of rows"),
        ({"take_every": 50}, "leaves 4 rows"),
    ],
)
def test_parts_that_leave_nothing(columns, options, sentence):
    with pytest.raises(InputError, match=sentence):
        read_log(columns, **options)


@pytest.mark.parametrize("value", [1e308, -1e200, 1e150, 1e40])
@pytest.mark.parametrize("name", ["torque", "velocity", "position"])
def test_one_number_that_no_sensor_gives_is_left_out_and_said(columns, name, value):
    columns[name][100] = value
    with pytest.warns(FpjaxWarning, match=f"{name} reads .* in row 100, which no sensor gives"):
        log = read_log(columns)
    assert np.max(np.abs(getattr(log, name))) <= 1.0


@pytest.mark.parametrize("name", ["torque", "velocity", "position"])
@pytest.mark.parametrize("mark", [-9999.0, 999.0, 32767.0])
def test_a_number_that_marks_what_was_not_read_is_said(columns, name, mark):
    columns[name][7::67] = mark
    with pytest.warns(FpjaxWarning, match=rf"{name} is {mark:g} \(in SI units\) in 3 rows \(first in row 7\)"):
        log = read_log(columns)
    np.testing.assert_array_equal(getattr(log, name)[7::67], mark)


def test_a_saturated_sensor_two_far_readings_and_steps_mark_nothing(columns):
    saturated, twice, steps = ({key: each.copy() for key, each in columns.items()} for _ in range(3))
    saturated["velocity"] = np.clip(saturated["velocity"], -0.5, 0.5)
    twice["velocity"][[50, 90]] = 999.0
    steps["torque"] = np.where(np.arange(SAMPLES) % 50 < 5, 20.0, np.sign(steps["torque"]))
    for data in (saturated, twice, steps):
        assert not any("no reading" in each for each in read_log(data).warnings)


def test_a_column_of_absurd_numbers_is_refused(columns):
    with pytest.raises(InputError, match=r"velocity has values of up to 1e\+150 in .* which no machine has"):
        read_log({**columns, "velocity": 1e150 * columns["velocity"]})


def test_stamps_of_a_polled_device_are_not_made_finer_than_they_came():
    """Rows 1 to 60 ms apart with no clock behind them: the grid has their median step."""
    rng = np.random.default_rng(3)
    steps = np.where(rng.random(2000) < 0.2, rng.uniform(0.001, 0.006, 2000), rng.uniform(0.028, 0.06, 2000))
    time = np.cumsum(steps)
    log = read_log({"time": time, "torque": np.cos(time), "velocity": np.sin(time)})
    assert 0.9 * np.median(steps) < log.dt < 1.1 * np.median(steps)
    np.testing.assert_allclose(log.velocity, np.sin(log.time), atol=2e-3)


def test_a_command_that_comes_only_when_it_changes_is_held():
    """A table of several topics, as PlotJuggler exports them: no row holds both a command and a motion."""
    time = 1e-3 * np.arange(3000)
    command = np.where(time < 1.0, 0.5, np.where(time < 2.0, -0.5, 0.25))
    alone = np.isin(np.arange(time.size), (0, 1000, 2000))
    log = read_log(
        {
            "time": time,
            "torque": np.where(alone, command, np.nan),
            "velocity": np.where(alone, np.nan, np.sin(5.0 * time)),
        }
    )
    assert any("torque has 3 rows of its own" in each for each in log.warnings)
    assert log.samples > 2990
    np.testing.assert_allclose(log.torque, command[np.round(log.time / log.dt).astype(int)], atol=1e-12)


def test_rows_of_other_topics_are_no_lost_samples():
    time = 1e-3 * np.arange(3000)
    own = np.arange(time.size) % 2 == 0
    log = read_log(
        {
            "time": time + np.where(own, 0.0, -3e-4),
            "torque": np.where(own, np.cos(5.0 * time), np.nan),
            "velocity": np.where(own, np.sin(5.0 * time), np.nan),
        }
    )
    assert any("1500 of 3000 rows hold none of the columns" in each for each in log.warnings)
    assert (log.samples, log.dt, log.resampled) == (1500, 2e-3, False)
