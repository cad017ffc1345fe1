"""The log reader: every format, every unit, every kind of damage."""

import math
import os
import pathlib
import re
import struct
import sys

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from fpjax.errors import FpjaxWarning, InputError
from fpjax.logs import read_log

pytestmark = pytest.mark.filterwarnings("ignore::fpjax.errors.FpjaxWarning")  # each test asks for its own
SAMPLES, DT = 200, 1e-3
EMPS = pathlib.Path(__file__).parents[3] / "shared" / "data" / "emps"


@pytest.fixture
def columns():
    time = DT * np.arange(SAMPLES)
    return {
        "time": time,
        "torque": np.sin(40 * time),
        "velocity": np.cos(30 * time),
        "position": np.sin(30 * time) / 30,
    }


def write_csv(path, columns, separator=","):
    rows = zip(*columns.values(), strict=True)
    lines = [separator.join(columns)] + [separator.join(repr(float(cell)) for cell in row) for row in rows]
    path.write_text("\n".join(lines) + "\n")
    return path


def assert_same(log, columns):
    for name, values in columns.items():
        np.testing.assert_allclose(getattr(log, name), values, rtol=0, atol=1e-12)
    assert log.dt == DT
    assert log.warnings == ()


def test_csv_npz_mat_and_arrays_give_the_same_log(tmp_path, columns):
    from scipy import io

    np.savez(tmp_path / "log.npz", **columns)
    io.savemat(tmp_path / "log.mat", {**columns, "rate": 1000.0})
    io.savemat(tmp_path / "deep.mat", {"run": columns})
    for path in (write_csv(tmp_path / "log.csv", columns), tmp_path / "log.npz", tmp_path / "log.mat"):
        assert_same(read_log(path), columns)
    assert_same(read_log(columns), columns)
    mapping = ",".join(f"{name}=run.{name}" for name in columns)
    assert_same(read_log(tmp_path / "deep.mat", columns=mapping), columns)


def test_parquet(tmp_path, columns):
    pyarrow = pytest.importorskip("pyarrow")
    from pyarrow import parquet

    table = pyarrow.table(columns)
    parquet.write_table(table, tmp_path / "log.parquet")
    assert_same(read_log(tmp_path / "log.parquet"), columns)
    assert_same(read_log(table), columns)


def test_matlab_7_3(tmp_path, columns):
    pytest.importorskip("pymatreader")
    h5py = pytest.importorskip("h5py")
    with h5py.File(tmp_path / "log.mat", "w", userblock_size=512) as file:
        for name, values in columns.items():
            file.create_dataset(name, data=values[None, :]).attrs["MATLAB_class"] = np.bytes_("double")
    header = b"MATLAB 7.3 MAT-file, Platform: GLNXA64, Created on: now HDF5 schema 1.00 ."
    with (tmp_path / "log.mat").open("r+b") as file:
        file.write(header.ljust(124) + b"\x00\x02IM")
    assert_same(read_log(tmp_path / "log.mat"), columns)


def test_mcap_joins_topics_on_the_torques_stamps(tmp_path, columns):
    pytest.importorskip("mcap_ros2")
    from mcap_ros2.writer import Writer

    path = tmp_path / "log.mcap"
    with path.open("wb") as stream:
        writer = Writer(stream)
        command = writer.register_msgdef("std_msgs/Float64", "float64 data")
        rate = writer.register_msgdef("geometry_msgs/Vector3", "float64 x\nfloat64 y\nfloat64 z")
        for row in range(SAMPLES):
            stamp = 1_700_000_000_000_000_000 + 1_000_000 * row
            torque, velocity = columns["torque"][row], columns["velocity"][row]
            writer.write_message("/cmd", command, {"data": torque}, log_time=stamp, publish_time=stamp)
            gyro = {"x": 0.0, "y": 0.0, "z": velocity}
            writer.write_message("/gyro", rate, gyro, log_time=stamp, publish_time=stamp)
        writer.finish()
    with pytest.warns(FpjaxWarning, match="/gyro were interpolated"):
        log = read_log(path, columns="torque=/cmd.data,velocity=/gyro.z:rad/s")
    np.testing.assert_allclose(log.velocity, columns["velocity"], atol=1e-4)
    np.testing.assert_allclose(log.torque, columns["torque"], atol=1e-12)
    assert log.dt == pytest.approx(DT, rel=1e-6)


@pytest.mark.parametrize(
    ("suffix", "module"), [("parquet", "pyarrow.parquet"), ("mcap", "mcap_ros2.decoder"), ("mat", "pymatreader")]
)
def test_a_missing_extra_is_named_with_its_command(tmp_path, monkeypatch, suffix, module):
    monkeypatch.setitem(sys.modules, module, None)
    path = tmp_path / f"log.{suffix}"
    path.write_bytes(b"MATLAB 7.3 MAT-file".ljust(124) + b"\x00\x02IM" + bytes(600))
    with pytest.raises(InputError, match=r'pip install "fpjax\[logs\]"'):
        read_log(path)


@pytest.mark.parametrize(
    ("spec", "name", "factor"),
    [
        ("velocity=w:deg/s", "velocity", math.pi / 180),
        ("velocity=w:°/s", "velocity", math.pi / 180),
        ("velocity=w:rpm", "velocity", math.tau / 60),
        ("velocity=w:rev/s", "velocity", math.tau),
        ("velocity=w*2:deg/s", "velocity", 2 * math.pi / 180),
        ("velocity=w*-1", "velocity", -1.0),
        ("torque=w:mN m,velocity=torque", "torque", 1e-3),
        ("torque=w:Nm,velocity=torque", "torque", 1.0),
        ("torque=w*35.15:N,velocity=torque:mm/s", "torque", 35.15),
        ("position=w:mm", "position", 1e-3),
        ("position=w:deg", "position", math.pi / 180),
        ("position=w:rev", "position", math.tau),
        ("reference=w:rpm", "reference", math.tau / 60),
    ],
)
def test_units(columns, spec, name, factor):
    data = {"time": columns["time"], "torque": columns["torque"], "w": columns["velocity"]}
    log = read_log(data, columns=spec, require=("torque",))
    np.testing.assert_allclose(getattr(log, name), factor * columns["velocity"], rtol=1e-12)


def test_units_in_the_header_and_in_milliseconds(columns):
    data = {
        "Time [ms]": columns["time"] * 1e3,
        "Torque (mN m)": columns["torque"],
        "VELOCITY [rpm]": columns["velocity"],
    }
    log = read_log(data)
    assert log.dt == pytest.approx(DT)
    np.testing.assert_allclose(log.torque, 1e-3 * columns["torque"])


def test_a_torque_label_is_kept(columns):
    log = read_log({**columns, "u": columns["torque"]}, columns="torque=u:V")
    assert log.torque_unit == "V"
    np.testing.assert_array_equal(log.torque, columns["torque"])


def test_linear_is_told_by_the_units(columns):
    data = {"time": columns["time"], "u": columns["torque"], "x": columns["position"]}
    assert read_log(data, columns="torque=u:N,position=x:mm").linear
    with pytest.raises(InputError, match='motion = "linear"'):
        read_log(data, columns="torque=u,position=x:mm", linear=False)
    with pytest.raises(InputError, match="mix rotary and linear"):
        read_log(data, columns="torque=u:N m,position=x:mm")


def test_semicolons_decimal_commas_text_columns_and_comments(tmp_path, columns):
    path = write_csv(tmp_path / "german.csv", columns, ";")
    lines = path.read_text().replace(".", ",").splitlines()
    path.write_text("\n".join([lines[0] + ";note"] + [f"{line};fine" for line in lines[1:]]))
    assert_same(read_log(path), columns)
    commented = write_csv(tmp_path / "commented.csv", columns)
    commented.write_text(f"# made by a drive\n# {commented.read_text()}")
    assert_same(read_log(commented), columns)


def test_a_log_may_lack_a_time_column_where_the_period_is_given(columns):
    del columns["time"]
    log = read_log(columns, dt=0.002)
    assert log.dt == 0.002
    with pytest.raises(InputError, match="control period"):
        read_log(columns, dt=-1.0)


# ---------------------------------------------------------------------- damage


def damaged(columns, what):
    data = {name: values.copy() for name, values in columns.items()}
    if what == "nan":
        data["velocity"][3] = np.nan
    elif what == "inf":
        data["torque"][7:9] = np.inf
    elif what == "nan time":
        data["time"][7] = np.nan
    elif what == "repeated":
        data = {name: np.insert(values, 50, values[50]) for name, values in data.items()}
    elif what == "decreasing":
        data["time"][100:] -= 0.05
    elif what == "clock jump":
        data["time"][100:] += 3.0
    elif what == "dropped":
        data = {name: np.delete(values, [60, 61]) for name, values in data.items()}
    elif what == "irregular":
        data["time"] = data["time"] + 0.35 * DT * np.cos(np.arange(SAMPLES) * 2.4)
    elif what == "half a period":
        data["time"][100:] += 0.6 * DT
    elif what == "constant time":
        data["time"][:] = 1.0
    elif what == "too short":
        data = {name: values[:8] for name, values in data.items()}
    elif what == "two columns":
        data = {name: data[name] for name in ("time", "torque")}
    elif what == "no torque":
        del data["torque"]
    elif what == "no motion":
        del data["velocity"], data["position"]
        data["temperature"] = data["torque"]
    return data


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
    "nan": (r"1 value of velocity that is no number \(first in row 5\) was filled", SAMPLES),
    "inf": (r"2 values of torque that are no number", SAMPLES),
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


# ---------------------------------------------------------------------- parts


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
        ({"start": 2.0, "stop": 1.0}, "--from 2 must be before --to 1"),
        ({"take_every": 0}, "must be a whole number of rows"),
        ({"take_every": 50}, "leaves 4 rows"),
    ],
)
def test_parts_that_leave_nothing(columns, options, sentence):
    with pytest.raises(InputError, match=sentence):
        read_log(columns, **options)


# ---------------------------------------------------------------------- absurd numbers


@pytest.mark.parametrize("value", [1e308, -1e200, 1e150, 1e40])
@pytest.mark.parametrize("name", ["torque", "velocity", "position"])
def test_one_number_that_no_sensor_gives_is_left_out_and_said(columns, name, value):
    columns[name][100] = value
    with pytest.warns(FpjaxWarning, match=f"{name} reads .* in row 100, which no sensor gives"):
        log = read_log(columns)
    assert np.max(np.abs(getattr(log, name))) <= 1.0


def test_a_column_of_absurd_numbers_is_refused(columns):
    with pytest.raises(InputError, match=r"velocity has values of up to 1e\+150 in .* which no machine has"):
        read_log({**columns, "velocity": 1e150 * columns["velocity"]})


# ---------------------------------------------------------------------- names and units


def test_names_that_nobody_knows_are_not_guessed():
    data = {name: np.zeros(30) for name in ("time", "tork", "gyro_z")}
    with pytest.raises(InputError, match="--columns torque=tork"):
        read_log(data)
    with pytest.raises(InputError, match="did you mean 'gyro_z'"):
        read_log(data, columns="torque=tork,velocity=gyro_y")
    with pytest.raises(InputError, match="did you mean 'torque'"):
        read_log(data, columns="torqe=tork")
    with pytest.raises(InputError, match="did you mean 'deg/s'"):
        read_log(data, columns="torque=tork,velocity=gyro_z:degr/s")


TURN = 2 * np.pi
FROM_PEOPLE = {
    "German": ({"Zeit [ms]": 1e3, "Drehmoment (mNm)": 1e3, "Drehzahl [1/min]": 60 / TURN}, "", {}),
    "German without units": ({"Zeit": 1, "Drehmoment": 1, "Drehzahl": 60 / TURN}, "", {}),
    "ODrive": ({"t": 1, "axis0.motor.Iq_setpoint": 1, "axis0.encoder.vel_estimate": 1 / TURN}, "A", {}),
    "UR": ({"timestamp": 1, "target_moment_2": 1, "actual_qd_2": 1, "actual_q_2": None}, "", {}),
    "snake": ({"time_ms": 1e3, "torque_Nm": 1, "velocity_deg_s": 360 / TURN}, "", {}),
    "WPILib": ({"timestamp": 1, "appliedVolts": 1, "rotorVelocity": 1}, "V", {}),
    "French": ({"temps": 1, "couple": 1, "vitesse": 1}, "", {}),
    "measured": ({"time": 1, "Iq": 1, "omega": 1}, "A", {"torque_measured": True}),
    "ROS": ({"stamp": 1, "/joint_states.effort.0": 1, "/joint_states.velocity.0": 1}, "", {"torque_measured": True}),
}


@pytest.mark.parametrize("kind", FROM_PEOPLE)
def test_names_that_drives_and_people_use_are_guessed_and_said(columns, kind):
    names, label, fields = FROM_PEOPLE[kind]
    parts = [columns["time"], columns["torque"], columns["velocity"], columns["position"]]
    data = {name: part * (scale or 1.0) for (name, scale), part in zip(names.items(), parts, strict=False)}
    with pytest.warns(FpjaxWarning, match="taken by their names"):
        log = read_log(data)
    assert log.dt == pytest.approx(DT)
    np.testing.assert_allclose(log.torque, columns["torque"], rtol=1e-9)
    np.testing.assert_allclose(log.velocity, columns["velocity"], rtol=1e-9)
    assert log.torque_unit == (label or "N m")
    for name, value in fields.items():
        assert getattr(log, name) == value


def test_one_of_several_axes_is_taken_and_said(columns):
    data = {"timestamp": columns["time"]}
    for axis in range(3):
        data[f"target_moment_{axis}"] = columns["torque"] + axis
        data[f"actual_qd_{axis}"] = columns["velocity"] + axis
    with pytest.warns(FpjaxWarning, match=r"3 axes \(0 to 2\): axis 0 was taken; choose with --columns axis=1"):
        assert read_log(data).torque[0] == columns["torque"][0]
    with pytest.warns(FpjaxWarning, match="by their names"):
        assert read_log(data, columns="axis=2").torque[0] == columns["torque"][0] + 2
    with pytest.raises(InputError, match="no such axis: its axes are 0, 1, 2"):
        read_log(data, columns="axis=7")


@pytest.mark.parametrize(
    ("spec", "name", "factor", "label"),
    [
        ("torque=x:A", "torque", 1.0, "A"),
        ("torque=x:mA", "torque", 1e-3, "A"),
        ("torque=x:A*0.12", "torque", 0.12, "N m"),
        ("torque=x:mA*0.12", "torque", 0.12e-3, "N m"),
        ("torque=x:A*120 mNm/A", "torque", 0.12, "N m"),
        ("torque=x:PWM*0.02", "torque", 0.02, "N m"),
        ("torque=x:counts*0.001", "torque", 1e-3, "N m"),
        ("torque=x:counts", "torque", 1.0, "counts"),
        ("torque=x:Nm*50", "torque", 50.0, "N m"),
        ("position=x:counts/4096", "position", TURN / 4096, "N m"),
        ("position=x:counts*0.001", "position", 1e-3, "N m"),
        ("position=x:counts*0.1 deg", "position", 0.1 * TURN / 360, "N m"),
        ("position=x:rev/6", "position", TURN / 6, "N m"),
        ("position=x:turns", "position", TURN, "N m"),
        ("velocity=x:counts/s/4096", "velocity", TURN / 4096, "N m"),
        ("velocity=x:U/min", "velocity", TURN / 60, "N m"),
        ("velocity=x:rpm/50", "velocity", TURN / 3000, "N m"),
    ],
)
def test_scales(columns, spec, name, factor, label):
    data = {**columns, "x": 1000.0 * columns["velocity"] + 0.5}
    log = read_log(data, columns=spec, linear=False)
    np.testing.assert_allclose(getattr(log, name), factor * data["x"], rtol=1e-12)
    assert log.torque_unit == label


@pytest.mark.parametrize(
    ("spec", "sentence"),
    [
        ("position=x:counts", r"how large is a count\? .*position=x:counts/4096"),
        ("torque=x:A*0", "is not a number other than zero"),
        ("torque=x:A*12 kg", "the scale's unit is not a torque"),
        ("torque=Load (raw)", "Unit 'raw' of column torque is not known"),
        ("velocity=x:Nm", "is a torque, which column velocity"),
    ],
)
def test_scales_that_say_too_little_are_refused(columns, spec, sentence):
    data = {**columns, "x": columns["velocity"], "Load (raw)": columns["torque"]}
    with pytest.raises(InputError, match=sentence):
        read_log(data, columns=spec)


def test_a_unit_in_the_header_holds_for_a_mapped_column_too(columns):
    data = {"time": columns["time"], "velocity": columns["velocity"], "M (mNm)": 1e3 * columns["torque"]}
    for spec in ("torque=M (mNm)", "torque=M", "torque=M (mNm):mNm"):
        np.testing.assert_allclose(read_log(data, columns=spec).torque, columns["torque"], rtol=1e-12)
    # what the user writes comes first
    np.testing.assert_allclose(read_log(data, columns="torque=M (mNm):Nm").torque, 1e3 * columns["torque"], rtol=1e-12)


def test_a_measured_torque_beside_the_command_tells_its_lag():
    generator = np.random.default_rng(1)
    time = 1e-3 * np.arange(6000)
    command = np.convolve(generator.normal(size=6000), np.ones(5) / 5, "same") + np.sin(9 * time)
    current = np.interp(time - 2.4e-3, time, command) / 0.12
    data = {"time": time, "tau_cmd": command, "Iq": np.round(current, 2), "velocity": np.cos(9 * time)}
    with pytest.warns(FpjaxWarning, match="follows the commanded one by"):
        log = read_log(data, columns="torque=tau_cmd,torque_measured=Iq:A*0.12")
    assert log.torque_lag == pytest.approx(2.4e-3, abs=2e-4)
    assert not log.torque_measured
    np.testing.assert_allclose(log.extra["torque_measured"], 0.12 * data["Iq"])


def test_a_rounded_torque_is_noted(columns):
    columns["torque"] = 0.1 * np.round(columns["torque"] / 0.1)
    with pytest.warns(FpjaxWarning, match=r"torque is rounded to steps of 0\.1"):
        log = read_log(columns)
    assert log.torque_step == pytest.approx(0.1)


# ---------------------------------------------------------------------- layouts of text


def text_of(columns, separator, header=True, comma=False, preamble=""):
    rows = zip(*columns.values(), strict=True)
    lines = [separator.join(columns)] if header else []
    for row in rows:
        cells = [f"{float(cell):.9f}" for cell in row]
        lines.append(separator.join(cell.replace(".", ",") if comma else cell for cell in cells))
    return preamble + "\n".join(lines) + "\n"


LAYOUTS = {
    "commas": {"separator": ","},
    "semicolons": {"separator": ";"},
    "tabs": {"separator": "\t"},
    "spaces": {"separator": "  "},
    "semicolons, decimal comma": {"separator": ";", "comma": True},
    "tabs, decimal comma": {"separator": "\t", "comma": True},
    "spaces, decimal comma": {"separator": " ", "comma": True},
    "preamble": {"separator": ";", "comma": True, "preamble": "Projekt;Achse 3\nDatum;1,5\n\n"},
}


@pytest.mark.parametrize("encoding", ["utf-8", "utf-8-sig", "utf-16", "utf-16-le", "latin-1"])
@pytest.mark.parametrize("layout", LAYOUTS)
def test_layouts_and_encodings(tmp_path, columns, layout, encoding):
    path = tmp_path / "log.csv"
    path.write_bytes(text_of(columns, **LAYOUTS[layout]).encode(encoding))
    log = read_log(path)
    for name, values in columns.items():
        np.testing.assert_allclose(getattr(log, name), values, atol=1e-9)


@pytest.mark.parametrize("layout", LAYOUTS)
def test_without_a_header_columns_are_named_by_their_places(tmp_path, columns, layout):
    path = tmp_path / "log.txt"
    path.write_text(text_of(columns, **{**LAYOUTS[layout], "preamble": ""}, header=False))
    with pytest.warns(FpjaxWarning, match="no header: its columns are 1, 2, 3, 4"):
        log = read_log(path, columns="time=1,torque=2,velocity=3,position=4")
    np.testing.assert_allclose(log.velocity, columns["velocity"], atol=1e-9)
    with pytest.raises(InputError, match=r"named by their places: 1 from 0 to 0\.199, .*--columns time=1"):
        read_log(path)


def test_a_row_of_units_under_the_header(tmp_path, columns):
    columns["time"] = 1e3 * columns["time"]
    lines = text_of(columns, ";").splitlines()
    (tmp_path / "log.csv").write_text("\n".join([lines[0], "ms;mNm;1/min;grad", *lines[1:]]))
    log = read_log(tmp_path / "log.csv")
    assert log.dt == pytest.approx(DT)
    np.testing.assert_allclose(log.torque, 1e-3 * columns["torque"], atol=1e-9)
    np.testing.assert_allclose(log.position, TURN / 360 * columns["position"], atol=1e-9)


def test_a_name_that_comes_twice_and_broken_rows_are_said(tmp_path, columns):
    lines = text_of({**columns, "more": columns["torque"]}, ",").splitlines()
    lines[0] = "time,torque,velocity,position,torque"
    lines[7] = "1,2"
    (tmp_path / "log.csv").write_text("\n".join(lines))
    log = read_log(tmp_path / "log.csv")
    assert len(log) == SAMPLES
    assert "names column 'torque' 2 times" in log.warnings[0]
    assert "1 of 200 rows were dropped (row 8 has 2 cells where the header has 5)" in log.warnings[1]


def test_json_in_every_shape(tmp_path, columns):
    import json

    lists = {name: values.tolist() for name, values in columns.items()}
    rows = [dict(zip(lists, row, strict=True)) for row in zip(*lists.values(), strict=True)]
    shapes = {
        "columns.json": lists,
        "rows.json": rows,
        "entries.json": {"mass": 1.0, "motor": "mx106", "entries": rows},
        "pandas.json": {name: dict(enumerate(values)) for name, values in lists.items()},
        "run.json": {"run": lists},
    }
    for name, content in shapes.items():
        (tmp_path / name).write_text(json.dumps(content))
        mapping = {key: f"run.{key}" for key in columns} if name == "run.json" else None
        assert_same(read_log(tmp_path / name, columns=mapping), columns)
    (tmp_path / "rows.jsonl").write_text("\n".join(json.dumps(row) for row in rows))
    assert_same(read_log(tmp_path / "rows.jsonl"), columns)


def wpilog(columns, cut=0):
    """A WPILOG file as the specification has it: entries started by control records, stamps in microseconds."""

    def record(entry, stamp, payload):
        return bytes([0b1111111]) + struct.pack("<IIQ", entry, len(payload), stamp) + payload

    def text(word):
        return struct.pack("<I", len(word)) + word.encode()

    found = b"WPILOG" + struct.pack("<HI", 0x0100, 5) + b"extra"
    for number, name in enumerate(columns, start=1):
        start = b"\x00" + struct.pack("<I", number) + text(name) + text("double") + text("")
        found += record(0, 0, start)
    found += record(0, 0, b"\x00" + struct.pack("<I", 99) + text("console") + text("string") + text(""))
    for row in range(SAMPLES):
        for number, values in enumerate(columns.values(), start=1):
            found += record(number, 1000 * row, struct.pack("<d", values[row]))
        found += record(99, 1000 * row, b"hello")
    return found[: len(found) - cut]


def test_wpilog(tmp_path, columns):
    del columns["time"]
    (tmp_path / "log.wpilog").write_bytes(wpilog(columns))
    with pytest.warns(FpjaxWarning, match="interpolated onto the stamps of torque"):
        log = read_log(tmp_path / "log.wpilog")
    np.testing.assert_allclose(log.velocity, columns["velocity"], atol=1e-12)
    assert log.dt == pytest.approx(DT)
    (tmp_path / "cut.wpilog").write_bytes(wpilog(columns, cut=3))
    with pytest.warns(FpjaxWarning, match="cut short in its last record"):
        read_log(tmp_path / "cut.wpilog")


# ---------------------------------------------------------------------- files that are no files


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="no pipes on this system")
def test_a_pipe_and_a_device_are_refused_and_not_waited_for(tmp_path):
    os.mkfifo(tmp_path / "log.csv")
    with pytest.raises(InputError, match="is a pipe or a device"):
        read_log(tmp_path / "log.csv")
    (tmp_path / "link.csv").symlink_to("/dev/zero")
    with pytest.raises(InputError, match="is a pipe or a device"):
        read_log(tmp_path / "link.csv")


def test_twenty_thousand_columns_are_read_at_once(tmp_path):
    import time

    names = ["time", "torque", "velocity", *(f"c{index}" for index in range(20_000))]
    row = ",".join(["{}"] * 3 + ["0"] * 20_000)
    rows = [row.format(1e-3 * k, np.sin(k), np.cos(k)) for k in range(30)]
    (tmp_path / "log.csv").write_text("\n".join([",".join(names), *rows]))
    begin = time.process_time()
    assert len(read_log(tmp_path / "log.csv")) == 30
    assert time.process_time() - begin < 2.5


@pytest.mark.parametrize(
    ("name", "content", "match"),
    [
        ("log.csv", b"", "is empty"),
        ("log.csv", b"time,torque,velocity\n", "a header and no rows"),
        ("log.csv", b"0,1,2\n1,2,3\n", "has no header"),
        ("log.json", b"{", "is no JSON"),
        ("log.json", b"[1, 2]", "no column time"),
        ("log.wpilog", bytes(range(256)) * 4, "is no WPILOG"),
        ("log.csv", b"time,torque,velocity\n" + b"0,1,x\n" * 30, "holds 'x' in row 2"),
        ("log.csv", bytes(range(256)) * 4, "is not text"),
        ("log.mat", bytes(range(256)) * 4, "is no .mat file"),
        ("log.npz", bytes(range(256)) * 4, "is no archive"),
        ("log.parquet", bytes(range(256)) * 4, "is no Parquet file|needs pyarrow"),
        ("log.mcap", bytes(range(256)) * 4, "is no MCAP|needs mcap"),
        ("log.xlsx", b"PK", "kind that is not read"),
    ],
)
def test_broken_files(tmp_path, name, content, match):
    (tmp_path / name).write_bytes(content)
    with pytest.raises(InputError, match=match) as caught:
        read_log(tmp_path / name)
    assert "\n" not in str(caught.value)


def test_a_missing_file_names_its_neighbour(tmp_path, columns):
    write_csv(tmp_path / "run_1.csv", columns)
    with pytest.raises(InputError, match=r"did you mean 'run_1\.csv'"):
        read_log(tmp_path / "run1.csv")
    with pytest.raises(InputError, match="is a folder"):
        read_log(tmp_path)
    with pytest.raises(InputError, match="cannot be made of int"):
        read_log(3)


@pytest.mark.skipif(not EMPS.exists(), reason="the EMPS records are not here")
def test_emps():
    log = read_log(EMPS / "DATA_EMPS_PULSES.mat", columns="emps")
    assert log.linear
    assert log.dt == 1e-3
    assert list(log.columns()) == ["time", "torque", "position", "reference"]
    assert list(log.extra) == ["pulses_N"]
    assert np.abs(log.torque).max() == pytest.approx(317.556, abs=1e-3)


# ------------------------------------------------------------- nothing else escapes


def outcome(source, **options):
    """The log, or None after one sentence; any other exception fails the test."""
    try:
        return read_log(source, **options)
    except InputError as error:
        sentence = str(error)
    assert "\n" not in sentence
    return None


QUIET = settings(deadline=None, max_examples=150, suppress_health_check=[HealthCheck.function_scoped_fixture])


@QUIET
@given(st.binary(max_size=400), st.sampled_from(["csv", "npz", "mat", "txt", "parquet", "mcap", "json", "wpilog"]))
def test_any_bytes_give_a_log_or_an_input_error(tmp_path, content, suffix):
    path = tmp_path / f"fuzz.{suffix}"
    path.write_bytes(content)
    with pytest.raises(InputError):
        read_log(path)


@QUIET
@given(st.text(alphabet="time,torquevlcy0123456789.-+e;\t\n\"'#nai[] ", max_size=600))
def test_any_text_gives_a_log_or_an_input_error(tmp_path, content):
    path = tmp_path / "fuzz.csv"
    path.write_text("time,torque,velocity\n" + content)
    outcome(path, repair=True)


@QUIET
@given(
    hnp.arrays(np.float64, st.tuples(st.integers(20, 40), st.just(3)), elements=st.floats(allow_nan=True, width=32)),
    st.booleans(),
)
def test_any_numbers_give_a_finite_uniform_log_or_an_input_error(values, repair):
    data = dict(zip(("time", "torque", "velocity"), values.T, strict=True))
    log = outcome(data, repair=repair)
    if log is None:
        return
    assert np.all(np.isfinite(log.torque))
    np.testing.assert_allclose(np.diff(log.time), log.dt, rtol=1e-3)


@QUIET
@given(st.text(max_size=40))
def test_any_columns_text_gives_a_log_or_an_input_error(spec):
    time = DT * np.arange(30)
    outcome({"time": time, "torque": time, "velocity": time}, columns=spec)


@QUIET
@given(
    st.floats(1e-5, 1.0), st.integers(20, 200), st.floats(-1e3, 1e6), st.floats(0, 0.2),
    st.randoms(use_true_random=False),
)  # fmt: skip
def test_a_period_is_recovered_from_jittering_stamps(dt, rows, start, jitter, random):
    stamps = start + dt * np.arange(rows) + np.array([random.uniform(-1, 1) * jitter * dt for _ in range(rows)])
    if np.spacing(start) > 0.01 * dt:
        return
    log = read_log({"time": stamps, "torque": stamps * 0.0, "velocity": stamps * 0.0})
    assert len(log) == rows
    assert log.dt == pytest.approx(dt, rel=0.4 / rows)
