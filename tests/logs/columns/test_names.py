"""Names and units that drives and people use are guessed and said; scales turn readings into SI."""

import warnings

import numpy as np
import pytest
from log_files import DT, TURN

from fpjax import FpjaxWarning, InputError, read_log
from fpjax.logs.columns.names import guess
from fpjax.logs.log import asks_for_a_position

pytestmark = pytest.mark.filterwarnings("ignore::fpjax.errors.FpjaxWarning")  # each test asks for its own


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


FROM_PEOPLE = {
    "German": ({"Zeit [ms]": 1e3, "Drehmoment (mNm)": 1e3, "Drehzahl [1/min]": 60 / TURN}, "", {}),
    "German without units": ({"Zeit": 1, "Drehmoment": 1, "Drehzahl": 60 / TURN}, "", {}),
    "ODrive": ({"t": 1, "axis0.motor.Iq_setpoint": 1, "axis0.encoder.vel_estimate": 1 / TURN}, "A", {}),
    "UR": ({"timestamp": 1, "target_moment_2": 1, "actual_qd_2": 1, "actual_q_2": None}, "", {}),
    "snake": ({"time_ms": 1e3, "torque_Nm": 1, "velocity_deg_s": 360 / TURN}, "", {}),
    "WPILib": ({"timestamp": 1, "appliedVolts": 1, "rotorVelocity": 1}, "V", {}),
    "French": ({"temps": 1, "couple": 1, "vitesse": 1}, "", {}),
    "measured": ({"time": 1, "Iq": 1, "omega": 1}, "A", {"torque_measured": True}),
    "ODrive by number": (
        {"time": 1, "ODrive 2 Current": 1, "ODrive 2 Velocity": 1 / TURN},
        "A",
        {"torque_measured": True},
    ),
    "Dynamixel in LabVIEW": ({"t": 1, "DXL_PWM": 1, "DXL_Velocity": 1, "θ(t)": None}, "PWM", {}),
    "T-Motor": ({"pi_time": 1, "output_torque": 1, "output_velocity": 1}, "", {"torque_measured": True}),
    "machine tool": (
        {"time": 1, "X_CurrentFeedback": 1, "X_ActualVelocity": 1, "X_ActualPosition": None},
        "A",
        {"torque_measured": True},
    ),
    "Damiao": (
        {"time": 1, "torque_feedback": 1, "velocity": 1, "position": None, "command": None},
        "",
        {"torque_measured": True},
    ),
    "dynamometer": (
        {"time [s]": 1, "a1 torque cmd [Nm]": 1, "a1 velocity [rad/s]": 1, "a1 position [rad]": None},
        "",
        {},
    ),
    "cylinder": ({"time": 1, "force_desired": 1, "velocity": 1, "position_radians": None}, "", {}),
    "KUKA": ({"t": 1, "act_torque": 1, "act_vel": 1, "act_pos": None}, "", {"torque_measured": True}),
    "Mitsubishi": ({"ms": 1e3, "Torque": 1, "Servo motor speed": 60 / TURN}, "", {}),
    "textbook": ({"t": 1, "tau_m": 1, "omega_m": 1, "theta_m": None}, "", {"torque_measured": True, "linear": False}),
    "Isaac": (
        {"time": 1, "tau_est_0": 1, "joint_vel_0": 1, "joint_pos_0": None, "joint_pos_target_0": None},
        "",
        {"torque_measured": True},
    ),
    "ROS in a table": (
        {"t": 1, "- arm_1_joint_effort": 1, "- arm_1_joint_velocity": 1, "- arm_1_joint_position": None},
        "",
        {"torque_measured": True},
    ),
    "ROS": ({"stamp": 1, "/joint_states.effort.0": 1, "/joint_states.velocity.0": 1}, "", {"torque_measured": True}),
    # names made of known words
    "Copley": ({"Time (sec)": 1, "Commanded Current (A)": 1, "Actual Motor Velocity (rpm)": 60 / TURN}, "A", {}),
    "German drive": (
        {"Zeit [ms]": 1e3, "Drehmomentsollwert [Nm]": 1, "Drehzahlistwert geglättet [1/min]": 60 / TURN},
        "",
        {"torque_measured": False},
    ),
    "CANopen": (
        {"Time[ms]": 1e3, "Torque actual value (6077h)": 1, "0x606C Velocity actual value": 1},
        "",
        {"torque_measured": True},
    ),
    "Kollmorgen": ({"Time (ms)": 1e3, "IL.CMD (Arms)": 1, "VL.FB (rpm)": 60 / TURN}, "Arms", {}),
    "milli in camel case": ({"t_us": 1e6, "tau_mNm": 1e3, "vel_rpm": 60 / TURN}, "", {}),
    "per cent": ({"time_ms": 1e3, "torque_percent": 1, "speed_rpm": 60 / TURN}, "%", {}),
    "axes of a Sinumerik": ({"time": 1, "TORQUE|1": 1, "VELOCITY|1": 1}, "", {}),
    "AdvantageKit": (
        {"Timestamp": 1, "Arm/CurrentAmps": 1, "Arm/VelocityRadPerSec": 1},
        "A",
        {"torque_measured": True},
    ),
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


def test_a_letter_behind_a_symbol_is_an_index_and_no_unit(columns):
    data = {"time": columns["time"], "u_a": columns["torque"], "theta_m": columns["position"]}
    with pytest.raises(InputError, match="no column torque"):  # the armature's voltage, the actual control, or amperes
        read_log(data)
    data["u_v"] = data.pop("u_a")
    log = read_log(data)
    assert (log.torque_unit, log.linear) == ("V", False)
    assert read_log({**data, "position_m": columns["position"]}, columns="position=position_m:m").linear


def test_a_column_with_a_clock_of_its_own_is_told(columns):
    data = {"Scope1.time": columns["time"], "Scope1.angle": columns["position"], "Scope2.time": columns["time"].copy()}
    data["Scope2.torque"] = columns["torque"]
    with warnings.catch_warnings(record=True) as said:
        warnings.simplefilter("always")
        read_log(data)
    assert not any("one clock" in str(each.message) for each in said)
    data["Scope2.time"] = 2.0 * columns["time"]
    with pytest.warns(
        FpjaxWarning,
        match=r"'Scope2.torque' was recorded at the times 'Scope2.time', which are up to .* off 'Scope1.time'",
    ):
        read_log(data)


def test_a_command_may_come_from_elsewhere(columns):
    data = {"time": columns["time"], "/cmd.torque": columns["torque"], "/state.effort": columns["torque"] + 1.0}
    data |= {"/state.position": columns["position"], "/odom.velocity": columns["velocity"] + 9.0}
    data["/state.velocity"] = columns["velocity"]
    log = read_log(data)
    assert log.torque[0] == columns["torque"][0]
    assert log.velocity[0] == columns["velocity"][0]


def test_a_number_in_brackets_is_an_axis_and_no_unit(columns):
    data = {"time": columns["time"], "torque": columns["torque"], "speed (5)": columns["velocity"]}
    np.testing.assert_array_equal(read_log(data).velocity, columns["velocity"])


@pytest.mark.parametrize("code", ["two's complement", "sign bit"])
def test_signed_words_that_were_read_as_unsigned_are_made_signed_and_said(columns, code):
    meant = np.round(500.0 * columns["torque"] / np.abs(columns["torque"]).max())
    read = np.where(meant < 0, meant + 65536.0 if code == "two's complement" else 32768.0 - meant, meant)
    with pytest.warns(FpjaxWarning, match="'load' holds signed 16-bit numbers that were read as unsigned"):
        log = read_log({**{k: columns[k] for k in ("time", "velocity")}, "load": read})
    np.testing.assert_array_equal(log.torque, meant)


def test_a_counter_that_runs_through_its_range_is_left_alone(columns):
    counter = np.round(np.linspace(0.0, 65535.0, columns["time"].size))
    log = read_log({**{k: columns[k] for k in ("time", "torque", "velocity")}, "position": counter})
    np.testing.assert_array_equal(log.position, counter)


def test_a_hint_goes_by_the_words_of_a_name(columns):
    data = {
        "time": columns["time"],
        "pi_timer": columns["time"],
        "tork": columns["torque"],
        "my_velocity_raw": columns["velocity"],
    }
    with pytest.raises(InputError, match=r"--columns torque=tork,velocity=my_velocity_raw \(guessed"):
        read_log(data)


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


def test_a_factor_makes_up_for_a_header_whose_brackets_hold_no_unit(columns):
    data = {"step (8Hz)": 125.0 * columns["time"], "torque": columns["torque"], "velocity": columns["velocity"]}
    log = read_log(data, columns="time=step (8Hz)*0.008")
    np.testing.assert_allclose(log.time, columns["time"], atol=1e-12)
    with pytest.raises(InputError, match="Unit '8Hz' of column time is not known"):
        read_log(data, columns="time=step (8Hz)")


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


def test_a_slow_torque_under_noise_is_not_called_unlike_its_command():
    """At 30 ms a sample the changes are noise, while the levels leave no doubt that the columns belong together."""
    generator = np.random.default_rng(1)
    time = 0.03 * np.arange(2000)
    data = {"time": time, "tau_command": np.sin(time), "velocity": np.cos(time)}
    data["tau_measured"] = data["tau_command"] + 0.2 * generator.normal(size=time.size)
    with pytest.warns(FpjaxWarning, match="how late it is its noise hides"):
        log = read_log(data)
    assert log.torque_lag is None
    np.testing.assert_array_equal(log.torque, data["tau_command"])
    data["tau_measured"] = generator.normal(size=time.size)
    with pytest.warns(FpjaxWarning, match="unlike the commanded one at any lag"):
        read_log(data)


def test_a_command_of_something_is_a_torque_only_where_no_other_column_is(columns):
    data = {"time": columns["time"], "command": columns["torque"], "velocity": columns["velocity"]}
    np.testing.assert_array_equal(read_log(data).torque, columns["torque"])
    log = read_log({**data, "current": 2.0 * columns["torque"]})
    np.testing.assert_array_equal(log.torque, 2.0 * columns["torque"])


def test_a_set_point_that_never_changes_gives_way_to_one_that_does(columns):
    data = {**columns, "position_cmd": np.zeros_like(columns["time"]), "velocity_cmd": columns["velocity"]}
    np.testing.assert_array_equal(read_log(data).reference, columns["velocity"])
    data["velocity_cmd"] = np.ones_like(columns["time"])
    assert not np.any(read_log(data).reference)


def test_volts_of_an_encoder_are_no_position(columns):
    data = {"time": columns["time"], "torque": columns["torque"], "encoder_V": columns["position"]}
    with pytest.raises(InputError, match="has no column velocity or position"):
        read_log(data)
    log = read_log({**data, "speed": columns["velocity"]})
    assert log.position is None


@pytest.mark.parametrize(("level", "kind"), [(1.0, "velocity"), (40.0, "position")])
def test_a_constant_reference_is_of_the_motion_whose_level_it_has(level, kind):
    time = 1e-3 * np.arange(2000)
    swing = 0.3 * np.sin(50.0 * time)
    motion = {"velocity": 1.0 + swing, "position": 40.0 + time, "reference": np.full(time.size, level)}
    log = read_log({"time": time, "torque": swing, **motion})
    assert asks_for_a_position(log) == (kind == "position")


def test_a_rounded_torque_is_noted(columns):
    columns["torque"] = 0.1 * np.round(columns["torque"] / 0.1)
    with pytest.warns(FpjaxWarning, match=r"torque is rounded to steps of 0\.1"):
        log = read_log(columns)
    assert log.torque_step == pytest.approx(0.1)


def test_a_log_without_stamps_is_told_of_the_rate(columns):
    data = {"torque": columns["torque"], "velocity": columns["velocity"]}
    with pytest.raises(InputError, match="--rate"):
        read_log(data)
    assert read_log(data, dt=DT).dt == DT


def test_a_torque_that_was_computed_from_the_current_was_not_commanded(columns):
    data = {"time": columns["time"], "velocity": columns["velocity"], "torque": columns["torque"]}
    data["current"] = columns["torque"] / 1.314
    with pytest.warns(FpjaxWarning, match="1.314 times 'current' in every row"):
        log = read_log(data)
    assert log.torque_measured
    assert log.torque_unit == "N m"
    data["current"] = data["current"] + 1e-3 * np.random.default_rng(1).standard_normal(data["current"].size)
    assert not read_log(data).torque_measured


def test_a_measured_torque_that_stands_for_the_command_has_none_beside_it(columns):
    data = {
        "time": columns["time"], "tau_measured": columns["torque"], "velocity": columns["velocity"],
        "tau_feedback": 0.5 * columns["torque"],
    }  # fmt: skip
    log = read_log(data, columns="torque=tau_measured")
    assert log.torque_measured
    assert "torque_measured" not in log.extra
    assert not any("tau_feedback" in sentence for sentence in log.warnings)


def test_two_letters_are_like_no_word(columns):
    data = {"Im1": columns["torque"], "Iz1": columns["time"], "velocity": columns["velocity"]}
    with pytest.raises(InputError, match="no column time") as told:
        read_log(data)
    assert "time=Im1" not in str(told.value)


@pytest.mark.parametrize(
    "name", ["velocity_error", "max speed", "torque limit", "speed_scaling", "TORQUE_FFW", "wheel speed"]
)
def test_one_unknown_word_and_nothing_is_known(name):
    assert guess([name], {}) == {}


def test_a_torque_without_a_unit_beside_rpm_is_said(columns):
    data = {
        "time": columns["time"],
        "Torque": 40 * columns["torque"],
        "Servo motor speed": columns["velocity"] * 60 / TURN,
    }
    with pytest.warns(
        FpjaxWarning, match="'Torque' has no unit and was read in N m, beside 'Servo motor speed' in rpm"
    ):
        read_log(data)
    log = read_log(data, columns="torque=Torque:%*0.025")
    np.testing.assert_allclose(log.torque, columns["torque"])
    assert not any("no unit" in warning for warning in log.warnings)


def test_a_position_of_unknown_counts_is_left_out_where_there_is_a_velocity(columns):
    data = {"time": columns["time"], "torque": columns["torque"], "velocity": columns["velocity"]}
    with pytest.warns(FpjaxWarning, match="'position .pulse.' was left out as position: .*how large is a count"):
        assert read_log({**data, "position (pulse)": columns["position"] * 1e4}).position is None
    del data["velocity"]
    with pytest.raises(InputError, match="how large is a count"):
        read_log({**data, "position (pulse)": columns["position"] * 1e4})
    with pytest.raises(InputError, match="how large is a count"):  # what the user maps is meant
        read_log({**data, "velocity": columns["velocity"], "enc": columns["position"]}, columns="position=enc:counts")


def test_the_topic_of_a_single_value_is_its_name(columns):
    names = (
        "__time",
        "/effort_controller/commands/data[0]",
        "/joint_states/hinge/position",
        "/joint_states/hinge/effort",
    )
    parts = (columns["time"], columns["torque"], columns["position"], 0.0 * columns["torque"])
    log = read_log(dict(zip(names, parts, strict=True)))
    np.testing.assert_array_equal(log.torque, columns["torque"])
    assert not log.torque_measured
