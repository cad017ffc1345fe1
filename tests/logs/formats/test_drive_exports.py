"""Files as drives, controllers and recorders export them: small ones of the same layout, of one known motion."""

import json

import numpy as np
import pytest
from log_files import DT, SAMPLES, TURN

from fpjax import FpjaxWarning, InputError, read_log
from fpjax.logs.formats.cell_numbers import has_decimal_comma, number
from fpjax.logs.formats.csv_layout import sampling_period
from fpjax.logs.mending.clock import since_1970

pytestmark = pytest.mark.filterwarnings("ignore::fpjax.errors.FpjaxWarning")  # each test asks for its own
RPM, DEGREES = 60 / TURN, 360 / TURN


def holds(log, columns, *, atol=1e-4):
    """That the log is the motion which was written, to the digits of its text."""
    assert log.dt == pytest.approx(DT, rel=1e-6)
    for name in ("torque", "velocity", "position"):
        if getattr(log, name) is not None:
            np.testing.assert_allclose(getattr(log, name), columns[name][-log.samples :], atol=atol)


def rows(*parts, separator=";", comma=False, ending="\n"):
    lines = [separator.join(f"{value:.7g}" for value in row) for row in zip(*parts, strict=True)]
    return ending.join(line.replace(".", ",") if comma else line for line in lines) + ending


# ------------------------------------------------------------------------------------- a time for every signal


def beside(columns, *, shared=False, separator=";", comma=True):
    """As TwinCAT Scope exports: keys above the times, what they say of a signal above its values."""
    signals = {
        "Axis 1.ActVelo": ("rpm (Rotation)", columns["velocity"] * RPM),
        "Axis 1.SetTorque": ("mNm", columns["torque"] * 1e3),
        "Axis 1.ActPos": ("deg (Angle)", columns["position"] * DEGREES),
    }

    def line(key, cells):
        parts = [key, *cells] if shared else [each for cell in cells for each in (key, cell)]
        return separator.join(parts) + "\n"

    head = (
        line("Name", signals) + line("SampleTime[ms]", ["1"] * 3) + line("Unit", [unit for unit, _ in signals.values()])
    )
    ms = 1e3 * columns["time"]
    parts = [values for _, values in signals.values()]
    parts = [ms, *parts] if shared else [each for values in parts for each in (ms, values)]
    body = rows(*parts, separator=separator, comma=comma)
    return f"Name{separator}scope\nStarttime of export{separator}132959733843760000\n\n" + head + "\n" + body + "EOF\n"


@pytest.mark.parametrize("options", [{}, {"shared": True}, {"separator": "\t", "comma": False}], ids=str)
def test_signals_side_by_side_with_their_times(tmp_path, columns, options):
    (tmp_path / "scope.csv").write_text(beside(columns, **options))
    with pytest.warns(FpjaxWarning, match="'Axis 1.SetTorque' as torque in mNm"):
        log = read_log(tmp_path / "scope.csv")
    holds(log, columns)
    assert not any("interpolated" in warning for warning in log.warnings)


def test_a_signal_at_half_the_rate_ends_its_cells_early(tmp_path, columns):
    ms, slow = 1e3 * columns["time"], slice(None, None, 2)
    lines = ["Channel name,Torque,Channel name,velocity", "Interval,1,Interval,2", "Unit,Nm,Unit,rad/s"]
    for k in range(SAMPLES):
        line = f"{ms[k] / 1e3:.6f},{columns['torque'][k]:.6f}"
        if k < SAMPLES // 2:
            line += f",{ms[slow][k] / 1e3:.6f},{columns['velocity'][slow][k]:.6f}"
        lines.append(line)
    (tmp_path / "log.csv").write_text("\n".join(lines))
    with pytest.warns(FpjaxWarning, match="interpolated onto the stamps of Torque"):
        log = read_log(tmp_path / "log.csv")
    holds(log, columns, atol=1e-2)  # at most one period is held


def test_signals_one_below_the_other(tmp_path, columns):
    """As CODESYS exports a trace."""
    text = "[key]; [value]\nVersion; 0x03050000\nEveryNCycles; 1\n"
    for place, (name, values) in enumerate({"Axis.fActVelocity": "velocity", "Axis.fSetTorque": "torque"}.items()):
        text += f"{place}.Variable; {name}\n{place}.GraphType; 1\n{place}.Data; \n"
        text += "".join(f"; {1e3 * t:.6g}; {v:.7g}\n" for t, v in zip(columns["time"], columns[values], strict=True))
    (tmp_path / "trace.csv").write_text(text)
    log = read_log(tmp_path / "trace.csv", columns="velocity=Axis.fActVelocity,torque=Axis.fSetTorque")
    holds(log, columns)


@pytest.mark.parametrize(
    "text",
    [
        "Name;velocity;Name;torque\nSampleTime[ms];1;SampleTime[ms];1\n\n",
        "Name;velocity;Name;torque\n0;1;0;2\n",
        "Name;velocity;Name;torque\n;;;\na;b;c;d\n",
        "[key]; [value]\n0.Variable; a\n0.Data;\n1.Variable; b\n",
    ],
)
def test_signals_without_values_are_one_sentence(tmp_path, text):
    (tmp_path / "log.csv").write_text(text)
    with pytest.raises(InputError, match="names signals and holds no values of them"):
        read_log(tmp_path / "log.csv")


def test_what_a_signal_did_not_record_is_not_made_up(tmp_path, columns):
    """A velocity that was switched on later is not constant before."""
    half = SAMPLES // 2
    lines = ["Name,velocity,Name,torque", "SampleTime[ms],1,SampleTime[ms],1"]
    for k in range(SAMPLES):
        late = f"{1e3 * columns['time'][half + k]:.6g},{columns['velocity'][half + k]:.7g}" if k < half else ","
        lines.append(f"{late},{1e3 * columns['time'][k]:.6g},{columns['torque'][k]:.7g}")
    (tmp_path / "log.csv").write_text("\n".join(lines))
    with pytest.warns(FpjaxWarning, match="nothing was read in"):
        log = read_log(tmp_path / "log.csv")
    assert log.samples <= half + 1
    holds(log, columns, atol=1e-2)


# ------------------------------------------------------------------------------------- heads of other recorders

LABVIEW = """LabVIEW Measurement\t
Writer_Version\t2
Separator\tTab
Decimal_Separator\t{point}
X_Columns\t{times}
***End_of_Header***\t
\t
"""
SEGMENT = """Channels\t3\t\t\t
Samples\t200\t200\t200\t
Y_Unit_Label\tN.m\tRPM\tdeg\t
X0\t0{point}0E+0\t0{point}0E+0\t0{point}0E+0\t
Delta_X\t0{point}001\t0{point}001\t0{point}001\t
***End_of_Header***\t\t\t\t
X_Value\tTorque\tSpeed\tAngle\tComment
"""


@pytest.mark.parametrize(("times", "point"), [("No", ","), ("One", ".")])
def test_labview_with_and_without_times_and_a_heading_for_every_segment(tmp_path, columns, times, point):
    parts = [columns["torque"], columns["velocity"] * RPM, columns["position"] * DEGREES]
    body = rows(columns["time"], *parts, separator="\t", comma=point == ",").splitlines()
    if times == "No":
        body = [line[line.index("\t") :] for line in body]
    segment = SEGMENT.format(point=point)
    text = LABVIEW.format(point=point, times=times) + segment + "\n".join(body[:120]) + "\n\n" + segment
    (tmp_path / "log.lvm").write_text(text + "\n".join(body[120:]) + "\n")
    holds(read_log(tmp_path / "log.lvm"), columns)


def test_names_beside_the_numbers_and_a_period_in_the_head(tmp_path, columns):
    """As LinuxCNC's halscope writes."""
    lines = ["Sampling period is 1000000 nSec ", ""]
    for u, w in zip(columns["torque"], columns["velocity"], strict=True):
        lines.append(
            f"pid.x.output {u:+.9f} joint.0.motor-vel-fb {w:+.9f} ".replace(".", ",").replace("pid,x,", "pid.x.")
        )
    (tmp_path / "halscope.log").write_text("\n".join(lines).replace("joint,0,", "joint.0."))
    with pytest.warns(FpjaxWarning, match="no time column: its head tells a row every 0.001 s"):
        log = read_log(tmp_path / "halscope.log", columns="torque=pid.x.output:V")
    np.testing.assert_allclose(log.velocity, columns["velocity"], atol=1e-8)
    assert (log.dt, log.torque_unit) == (DT, "V")
    assert read_log(tmp_path / "halscope.log", columns="torque=pid.x.output:V", dt=2e-3).dt == 2e-3


def test_the_head_of_an_oscilloscope_is_no_table(tmp_path, columns):
    head = "Model,MSO44\n\nHorizontal Units,s,,\nHorizontal Scale,0.04,,\nRecord Length,200,,\nProbe Attenuation,1,1,\n"
    body = rows(columns["time"], columns["torque"], columns["velocity"], separator=",")
    (tmp_path / "scope.csv").write_text(head + "Vertical Units,V,V,\n,,,\nLabels,a,b\nTIME,CH1,CH2\n" + body)
    log = read_log(tmp_path / "scope.csv", columns="torque=CH1,velocity=CH2:rad/s")
    holds(log, columns)
    assert log.torque_unit == "V"


def test_stamps_of_the_serial_monitor_are_taken_off(tmp_path, columns):
    lines = ["12:01:02.003 -> Booting...", "12:01:03.003 -> t_us\ttorque_mNm\tvel_rpm"]
    for k, (t, u, w) in enumerate(zip(columns["time"], columns["torque"], columns["velocity"], strict=True)):
        lines.append(f"12:01:{4 + t + 1e-2 * (k % 3):06.3f} -> {round(1e6 * t)}\t{1e3 * u:.4f}\t{RPM * w:.4f}")
        lines += ["12:01:05.000 -> WARN: undervoltage"] * (k == 150)
    (tmp_path / "log.txt").write_text("\n".join(lines))
    with pytest.warns(FpjaxWarning, match="1 of 201 rows were dropped"):
        holds(read_log(tmp_path / "log.txt"), columns)


def test_empty_columns_are_none_and_rows_of_json_may_have_any_suffix(tmp_path, columns):
    """As Dynamixel Wizard fills its table, and as a logger on a bicycle writes."""
    text = "Graph,3,,,,,,MIN,MAX\n-1,321,MX,Torque,#0000ff,0,,-10,8\nTime[ms],Torque,Velocity,,,,,,\n"
    body = rows(1e3 * columns["time"], columns["torque"], columns["velocity"], separator=",", ending=",,,,,,\n")
    (tmp_path / "log.csv").write_text(text + body)
    log = read_log(tmp_path / "log.csv")
    holds(log, columns)
    assert log.extra == {}
    names = ("time", "torque", "velocity")
    lines = [json.dumps({name: columns[name][k] for name in names}) for k in range(SAMPLES)]
    (tmp_path / "LOG.TXT").write_text("\n".join(lines))
    holds(read_log(tmp_path / "LOG.TXT"), columns)


def test_a_table_on_its_side_is_one_sentence(tmp_path, columns):
    (tmp_path / "log.txt").write_text(rows(*np.array([columns["time"], columns["torque"], columns["velocity"]]).T))
    with pytest.raises(InputError, match="200 cells a line and 3 lines of them: a log has a line for each sample"):
        read_log(tmp_path / "log.txt")


# ------------------------------------------------------------------------------------- numbers


@pytest.mark.parametrize(
    ("cell", "comma", "value"),
    [
        ("1.234,5", True, 1234.5),
        ("1,234.5", True, 1234.5),
        ("1,234.5", False, 1234.5),
        ("1,234,567", False, 1234567.0),
        ("1'234.5", False, 1234.5),
        ("12 345,6", True, 12345.6),
        ("1,234", True, 1.234),
        ("0,123", True, 0.123),
        ("0,123", False, None),
        ("1,5,3", True, None),
    ],
)
def test_separators_of_thousands_and_decimals(cell, comma, value):
    assert number(cell, comma=comma) == value


def german(columns, torque):
    """A table with decimal commas and the cells of its torque."""
    cells = zip(columns["time"], torque, columns["velocity"], strict=True)
    lines = [f"{time:.3f};{{}};{speed:.6f}".replace(".", ",").format(each) for time, each, speed in cells]
    return "Zeit [s];Drehmoment [mNm];Geschwindigkeit [rad/s]\n" + "\n".join(lines)


def test_points_between_thousands_where_commas_are_decimals(tmp_path, columns):
    whole = np.round(2e6 * columns["torque"])
    (tmp_path / "log.csv").write_text(german(columns, [f"{each:,.0f}".replace(",", ".") for each in whole]))
    log = read_log(tmp_path / "log.csv")
    np.testing.assert_allclose(log.torque, 1e-3 * whole)
    assert not any("point" in each for each in log.warnings)


def test_thousands_that_first_come_below_the_head(tmp_path):
    time, whole = 1e-3 * np.arange(900), np.arange(500, 1400)
    columns = {"time": time, "velocity": np.sin(time)}
    (tmp_path / "log.csv").write_text(german(columns, [f"{each:,.0f}".replace(",", ".") for each in whole]))
    np.testing.assert_allclose(read_log(tmp_path / "log.csv").torque, 1e-3 * whole)


def test_three_decimals_in_every_cell_are_decimals(tmp_path, columns):
    (tmp_path / "log.csv").write_text(german(columns, ["1.234", "12.345"] * (SAMPLES // 2)))
    with pytest.warns(FpjaxWarning, match=r"\[mNm\] has decimal points: .* 1\.234 was read as a decimal there"):
        log = read_log(tmp_path / "log.csv")
    assert set(log.torque) == {1.234e-3, 12.345e-3}


@pytest.mark.parametrize("last", ["0.345", "1.2346", "1234", "-.5", "1.5e1"])
@pytest.mark.parametrize("rows", [300, 900])
def test_decimal_points_in_one_column_of_a_file_of_decimal_commas(tmp_path, last, rows):
    time = 1e-3 * np.arange(rows)
    columns = {"time": time, "velocity": np.sin(time)}
    (tmp_path / "log.csv").write_text(german(columns, ["1.234", "12.345"] * (rows // 2 - 1) + ["1.234", last]))
    with pytest.warns(FpjaxWarning, match="mixes both, and 1.234 was read as a decimal there"):
        log = read_log(tmp_path / "log.csv")
    np.testing.assert_allclose(log.torque[-2:], [1.234e-3, 1e-3 * float(last)])


def test_the_cells_together_tell_what_a_comma_is():
    assert has_decimal_comma(["1,5", "2,25"], ";")
    assert has_decimal_comma(["1,5", "2,25"], ",")  # quoted
    assert has_decimal_comma(["1,234", "-2,345"], ";")  # nothing speaks for thousands
    assert not has_decimal_comma(["1,234", "999"], ",")  # but here cells are separated by what decimals are not
    assert has_decimal_comma(["1,234", "0,345"], ";")
    assert has_decimal_comma(["2024-05-01T10:00:00.123", "150,123", "2.1"], ";")  # a stamp and a version
    assert not has_decimal_comma(["1,234.5"], ";")
    assert not has_decimal_comma(["1,234,567"], ";")
    assert not has_decimal_comma(["1234", "0.5"], ";")


def test_a_word_in_a_row_of_numbers_costs_no_row(tmp_path, columns):
    lines, size = ["id,time,velocity,torque"], len(columns["time"])
    for i, (t, w, u) in enumerate(zip(columns["time"], columns["velocity"], columns["torque"], strict=True)):
        lines.append(f"{i if i < size // 2 else f'B{i}'},{t:.4f},{w:.6f},{u:.6f}")
    (tmp_path / "log.csv").write_text("\n".join(lines))
    log = read_log(tmp_path / "log.csv")
    assert log.samples == size
    holds(log, columns)


def test_a_word_where_a_stamp_is_missing_is_no_header(tmp_path, columns):
    lines = ["time,velocity,torque"]
    for i, (t, w, u) in enumerate(zip(columns["time"], columns["velocity"], columns["torque"], strict=True)):
        lines.append(f"{'sync' if i % 3 == 0 else f'{t:.4f}'},{w:.6f},{u:.6f}")
    (tmp_path / "log.csv").write_text("\n".join(lines))
    assert read_log(tmp_path / "log.csv").dt == pytest.approx(DT, rel=0.6)  # no refusal for a header that is none


def test_an_object_of_json_may_stand_above_a_table(tmp_path, columns):
    head = '{"meta": "run 3", "rate": 1000}\ntime,velocity,torque\n'
    body = rows(columns["time"], columns["velocity"], columns["torque"], separator=",")
    (tmp_path / "log.txt").write_text(head + body)
    holds(read_log(tmp_path / "log.txt"), columns)


def test_a_column_without_numbers_is_said(tmp_path, columns):
    lines = ["time,velocity,torque,reference"]
    for t, w, u in zip(columns["time"], columns["velocity"], columns["torque"], strict=True):
        lines.append(f"{t:.4f},{w:.6f},{u:.6f},nan")
    (tmp_path / "log.csv").write_text("\n".join(lines))
    log = read_log(tmp_path / "log.csv")
    assert any("reference holds no numbers" in warning for warning in log.warnings)


def test_lost_samples_are_no_rows_of_other_topics(tmp_path, columns):
    lost = np.random.default_rng(1).random(len(columns["time"])) < 0.4
    lines = ["time,velocity,torque"]
    for t, w, u, gone in zip(columns["time"], columns["velocity"], columns["torque"], lost, strict=True):
        lines.append(f"{t:.4f},," if gone else f"{t:.4f},{w:.6f},{u:.6f}")
    (tmp_path / "log.csv").write_text("\n".join(lines))
    log = read_log(tmp_path / "log.csv")
    assert log.dt == pytest.approx(DT, rel=1e-6)
    assert not any("other topics" in warning for warning in log.warnings)


def test_quoted_thousands_are_no_decimals(tmp_path, columns):
    lines = ["time_us,torque_mNm,velocity"]
    for t, u, w in zip(columns["time"], columns["torque"], columns["velocity"], strict=True):
        lines.append(f'"{round(1e6 * t):,}","{1e5 * u:,.1f}",{w:.6f}')
    (tmp_path / "log.csv").write_text("\n".join(lines))
    log = read_log(tmp_path / "log.csv", torque_scale=0.01)
    holds(log, columns)


@pytest.mark.parametrize(
    ("line", "period"),
    [
        ("Sampling time interval(ms),0.667", 0.667e-3),
        ("Delta_X,0.000977,0.000977", 0.977e-3),
        ("Sample Interval,1.0E-3,", 1e-3),
        ("Sample rate: 1000 Hz", 1e-3),
        ("Sampling Frequency (kHz),8", 1.25e-4),
        ("Abtastzeit,0.125 ms", 1.25e-4),
        ("Sample rate,1,000", None),  # a thousand or one
        ("Sampling interval: 2", None),  # of what?
        ("Sample time: 1000", None),
        ("Samples,8192", None),
        ("Sampling Frequency (lines),8", None),
        ("Number of sampling data,1024", None),
    ],
)
def test_periods_in_a_head(line, period):
    assert sampling_period(line.split(",")) == (pytest.approx(period) if period else None)


# ------------------------------------------------------------------------------------- stamps


@pytest.mark.parametrize(("unit", "size"), [("ms", 1e3), ("us", 1e6), ("ns", 1e9)])
def test_stamps_since_1970_have_the_unit_of_their_size(tmp_path, columns, unit, size):
    stamps = [f"{round(1.7e9 * size + size * t)}" for t in columns["time"]]
    table = zip(stamps, columns["torque"], columns["velocity"], strict=True)
    (tmp_path / "log.csv").write_text(
        "%time,torque,velocity\n" + "\n".join(f"{t},{u:.17g},{w:.17g}" for t, u, w in table)
    )
    with pytest.warns(FpjaxWarning, match=f"count {unit} since 1970"):
        log = read_log(tmp_path / "log.csv")
    assert log.dt == pytest.approx(DT, rel=1e-6)
    part = read_log(tmp_path / "log.csv", start=1.7e9 + 0.05, stop=1.7e9 + 0.15)
    assert part.samples == pytest.approx(101, abs=1)


def test_nanoseconds_since_a_start_are_not_milliseconds_since_1970(columns):
    data = {"timestamp": 1.7e12 + 1e9 * columns["time"], "torque": columns["torque"], "velocity": columns["velocity"]}
    with pytest.raises(InputError, match="check the unit of time"):
        read_log(data)
    assert read_log(data, columns="time=timestamp:ns").dt == pytest.approx(DT)


def test_microseconds_after_days_of_running_are_not_since_1970():
    assert since_1970(1.2e12 + 1e3 * np.arange(100.0)) == ""
    assert since_1970(1.7e12 + 1e1 * np.arange(100.0)) == "ms"
