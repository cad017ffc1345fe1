"""The log reader: every format, every unit, every kind of damage."""

import math
import pathlib
import sys

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from fpjax.errors import FpjaxWarning, InputError
from fpjax.logs import read_log

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


DAMAGE = {
    "nan": r"velocity is NaN in 1 of 200 rows \(first in row 5\)",
    "inf": r"torque is infinite in 2 of 200 rows",
    "nan time": r"time is NaN in 1 of 200 rows",
    "repeated": r"time repeats in row 53",
    "decreasing": r"time runs backwards in row 102",
    "clock jump": r"time jumps by 3.001 s after row 101",
    "dropped": r"2 samples are missing in 1 place",
    "irregular": r"time is irregular",
    "half a period": r"1 sample is missing in 1 place \(first after row 101",
    "constant time": r"time repeats in 199 rows",
    "too short": r"too short: 8 rows",
    "two columns": r"has two columns \(time, torque\)",
    "no torque": r"has no column torque",
    "no motion": r"has no column velocity or position",
}


@pytest.mark.parametrize("what", DAMAGE)
def test_damage_is_one_clear_sentence(tmp_path, columns, what):
    path = write_csv(tmp_path / "log.csv", damaged(columns, what))
    with pytest.raises(InputError, match=DAMAGE[what]) as caught:
        read_log(path)
    text = str(caught.value)
    assert "\n" not in text
    assert text.startswith("log.csv")
    assert text.endswith(".")


@pytest.mark.parametrize("what", ["nan", "repeated", "dropped"])
def test_repair_restores_a_log_and_says_so(columns, what):
    with pytest.warns(FpjaxWarning, match=r"filled|dropped"):
        log = read_log(damaged(columns, what), repair=True)
    assert len(log) == SAMPLES
    assert len(log.warnings) == 1
    np.testing.assert_allclose(log.velocity, columns["velocity"], atol=1e-3)


def test_repair_does_not_invent_what_nobody_knows(columns):
    with pytest.raises(InputError, match="jumps by"):
        read_log(damaged(columns, "clock jump"), repair=True)
    columns["velocity"][50:80] = np.nan
    with pytest.raises(InputError, match="NaN in 30"):
        read_log(columns, repair=True)


def test_small_jitter_keeps_the_values_and_warns(columns):
    jitter = 0.1 * DT * np.sin(np.arange(SAMPLES) * 1.7)
    with pytest.warns(FpjaxWarning, match="jitter by up to 10 %"):
        log = read_log({**columns, "time": columns["time"] + jitter})
    np.testing.assert_array_equal(log.torque, columns["torque"])
    np.testing.assert_allclose(log.time, columns["time"], atol=2e-6)


def test_names_that_come_near_are_offered():
    data = {name: np.zeros(30) for name in ("t", "tau", "gyro_z")}
    with pytest.raises(InputError, match="--columns time=t,torque=tau,velocity=gyro_z"):
        read_log(data)
    with pytest.raises(InputError, match="did you mean 'gyro_z'"):
        read_log(data, columns="velocity=gyro_y")
    with pytest.raises(InputError, match="did you mean 'torque'"):
        read_log(data, columns="torqe=tau")
    with pytest.raises(InputError, match="did you mean 'deg/s'"):
        read_log(data, columns="time=t,torque=tau,velocity=gyro_z:degr/s")


@pytest.mark.parametrize(
    ("name", "content", "match"),
    [
        ("log.csv", b"", "is empty"),
        ("log.csv", b"time,torque,velocity\n", "a header and no rows"),
        ("log.csv", b"0,1,2\n1,2,3\n", "has no header"),
        ("log.csv", b"time,torque,torque\n0,1,2\n", "names column 'torque' twice"),
        ("log.csv", b"time,torque,velocity\n0,1\n1,2,3\n", "row 2 has 2 cells where the header has 3"),
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
@given(st.binary(max_size=400), st.sampled_from(["csv", "npz", "mat", "txt", "parquet", "mcap"]))
@pytest.mark.filterwarnings("ignore")
def test_any_bytes_give_a_log_or_an_input_error(tmp_path, content, suffix):
    path = tmp_path / f"fuzz.{suffix}"
    path.write_bytes(content)
    with pytest.raises(InputError):
        read_log(path)


@QUIET
@given(st.text(alphabet="time,torquevlcy0123456789.-+e;\t\n\"'#nai[] ", max_size=600))
@pytest.mark.filterwarnings("ignore")
def test_any_text_gives_a_log_or_an_input_error(tmp_path, content):
    path = tmp_path / "fuzz.csv"
    path.write_text("time,torque,velocity\n" + content)
    outcome(path, repair=True)


@QUIET
@given(
    hnp.arrays(np.float64, st.tuples(st.integers(20, 40), st.just(3)), elements=st.floats(allow_nan=True, width=32)),
    st.booleans(),
)
@pytest.mark.filterwarnings("ignore")
def test_any_numbers_give_a_finite_uniform_log_or_an_input_error(values, repair):
    data = dict(zip(("time", "torque", "velocity"), values.T, strict=True))
    log = outcome(data, repair=repair)
    if log is None:
        return
    assert np.all(np.isfinite(log.torque))
    np.testing.assert_allclose(np.diff(log.time), log.dt, rtol=1e-3)


@QUIET
@given(st.text(max_size=40))
@pytest.mark.filterwarnings("ignore")
def test_any_columns_text_gives_a_log_or_an_input_error(spec):
    time = DT * np.arange(30)
    outcome({"time": time, "torque": time, "velocity": time}, columns=spec)


@QUIET
@given(
    st.floats(1e-5, 1.0), st.integers(20, 200), st.floats(-1e3, 1e6), st.floats(0, 0.2),
    st.randoms(use_true_random=False),
)  # fmt: skip
@pytest.mark.filterwarnings("ignore")
def test_a_period_is_recovered_from_jittering_stamps(dt, rows, start, jitter, random):
    stamps = start + dt * np.arange(rows) + np.array([random.uniform(-1, 1) * jitter * dt for _ in range(rows)])
    if np.spacing(start) > 0.01 * dt:
        return
    log = read_log({"time": stamps, "torque": stamps * 0.0, "velocity": stamps * 0.0})
    assert len(log) == rows
    assert log.dt == pytest.approx(dt, rel=0.4 / rows)
