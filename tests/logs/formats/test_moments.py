"""Stamps that are dates or times of day, in the forms that tools write."""

import re

import numpy as np
import pytest

from fpjax import InputError, read_log
from fpjax.logs.formats.cell_numbers import number

pytestmark = pytest.mark.filterwarnings("ignore::fpjax.errors.FpjaxWarning")


@pytest.mark.parametrize("form", ["2025-11-09T09:27:{:06.3f}Z", "2025-11-09 09:27:{:06.3f}", "09:27:{:06.3f}"])
def test_stamps_that_are_dates_or_times_of_day(tmp_path, form):
    lines = [f"{form.format(0.01 * k)},{k % 7},{k % 5}" for k in range(300)]
    (tmp_path / "log.csv").write_text("\n".join(["timestamp,torque,velocity", *lines]))
    log = read_log(tmp_path / "log.csv")
    assert log.dt == pytest.approx(0.01, rel=1e-6)
    assert log.time.size == 300


FORMS = ["28.11.2026 23:59:{:06.3f}", "28.11.2026 23:59:{:06.3f} ", "11/28/2026 11:59:{:06.3f} PM", "1:59:{:06.3f} am"]


@pytest.mark.parametrize("form", [*FORMS, "23:59:{:06.3f}:"])
@pytest.mark.parametrize("comma", [False, True])
def test_stamps_that_are_german_dates_or_of_a_clock_of_12_hours(tmp_path, form, comma):
    stamps = [form.format(0.01 * k) for k in range(300)]
    if form.endswith(":"):
        stamps = [stamp.rstrip(":").replace(".", ":") for stamp in stamps]
    lines = [f"{stamp};{0.5 * (k % 7)};{k % 5}" for k, stamp in enumerate(stamps)]
    if comma:
        lines = [re.sub(r"\.(\d{3}|\d)(?!\d)", r",\1", line) for line in lines]
    (tmp_path / "log.csv").write_text("\n".join(["timestamp;torque;velocity", *lines]))
    log = read_log(tmp_path / "log.csv")
    assert log.dt == pytest.approx(0.01, rel=1e-6)
    np.testing.assert_allclose(log.torque, 0.5 * (np.arange(300) % 7))


@pytest.mark.parametrize(
    ("cell", "value"),
    [
        ("28.11.2026 23:59:57.250", 1795910397.25),
        ("28.11.2026 23:59:57,250", 1795910397.25),
        ("28.11.2026, 23:59:57.250", 1795910397.25),
        ("11/28/2026, 11:59:57.250\u202fPM", 1795910397.25),
        ("11/28/2026 11:59:57.25 PM", 1795910397.25),
        ("11/28/2026 12:00:01 AM", 1795824001.0),
        ("12:00:01 pm", 43201.0),
        ("23:59:57:250", 86397.25),
        ("28.13.2026 23:59:57", None),
        ("11/28/2026 23:59:57", None),  # day or month first?
        ("13:00:00 PM", None),
    ],
)
def test_moments(cell, value):
    assert number(cell, comma=False) == number(cell, comma=True) == value


def test_a_part_of_dated_rows_that_is_none_says_where_they_are(tmp_path):
    lines = [f"28.11.2026 23:00:{0.01 * k:06.3f},{k % 7},{k % 5}" for k in range(300)]
    (tmp_path / "log.csv").write_text("\n".join(["timestamp,torque,velocity", *lines]))
    with pytest.raises(InputError, match=r"leave 0 rows.* from 1795906800 to 1795906802\.99 s since 1970, in UTC"):
        read_log(tmp_path / "log.csv", start=1.0, stop=2.0)
    assert len(read_log(tmp_path / "log.csv", start=1795906801.0)) == 200


@pytest.mark.parametrize("lost", [0, 5])
def test_times_of_day_go_on_after_midnight(tmp_path, lost):
    seconds = [(86398.0 + 0.01 * k) % 86400.0 for k in range(400) if not 200 <= k < 200 + lost]
    stamps = [f"{int(at // 3600):02d}:{int(at // 60) % 60:02d}:{at % 60:06.3f}" for at in seconds]
    rows = [f"{stamp},{k % 7},{k % 5}" for k, stamp in enumerate(stamps)]
    (tmp_path / "log.csv").write_text("\n".join(["timestamp,torque,velocity", *rows]))
    log = read_log(tmp_path / "log.csv")
    assert (len(log), log.time[0], len(log.further)) == (400, 86398.0, 0)
    assert any("pass midnight after row 201" in each for each in log.warnings)


@pytest.mark.parametrize("first", [4000.0, 86000.0])
def test_a_time_that_starts_anew_is_no_midnight(first):
    time = np.concatenate([first + 0.01 * np.arange(300), 0.01 * np.arange(200)])
    log = read_log({"time": time, "torque": np.sin(time), "velocity": np.cos(7 * time)})
    assert len(log) == 300
    assert any("runs backwards" in each for each in log.warnings)


def test_words_in_the_time_column_are_one_sentence(tmp_path):
    (tmp_path / "log.csv").write_text("timestamp,torque,velocity\n" + "soon,1,2\n" * 50)
    with pytest.raises(InputError, match="no column time"):
        read_log(tmp_path / "log.csv")
