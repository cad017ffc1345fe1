"""Of several axes and machines in one log one is taken, and said."""

import numpy as np
import pytest

from fpjax import FpjaxWarning, InputError, read_log

pytestmark = pytest.mark.filterwarnings("ignore::fpjax.errors.FpjaxWarning")  # each test asks for its own


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


def test_a_mapped_column_of_an_axis_that_is_not_there_is_answered_with_those_that_are(columns):
    data = {"t": columns["time"], "q": columns["position"]}
    data |= {f"tau.{axis}": columns["torque"] + axis for axis in range(3)}
    spec = "time=t,position=q,torque=tau,axis="
    assert read_log(data, columns=f"{spec}2").torque[0] == columns["torque"][0] + 2
    with pytest.raises(
        InputError, match=r"For torque, .* no column 'tau' of axis 3: there is one for each of the axes 0, 1, 2"
    ):
        read_log(data, columns=f"{spec}3")
    with pytest.raises(InputError, match=r"For torque, .* several columns 'tau' of axis 2: "):
        read_log(data | {"tau_2": columns["torque"]}, columns=f"{spec}2")


def test_an_axis_that_stands_still_is_not_taken(columns):
    data = {"timestamp": columns["time"]}
    for axis in range(3):
        data[f"torque ({axis})"] = columns["torque"] + axis
        data[f"speed ({axis})"] = columns["velocity"] * (axis == 1)
    with pytest.warns(FpjaxWarning, match="axis 1 was taken, since axis 0 hardly moves; choose with --columns axis=2"):
        assert read_log(data).torque[0] == columns["torque"][0] + 1
    with pytest.warns(FpjaxWarning, match="by their names"):
        assert read_log(data, columns="axis=2").torque[0] == columns["torque"][0] + 2


def test_an_axis_without_a_torque_is_not_taken(columns):
    data = {"time": columns["time"], "q_1": columns["position"], "q_2": columns["position"] + 2.0}
    data |= {"dq_2": columns["velocity"], "tau_2": columns["torque"]}
    with pytest.warns(FpjaxWarning, match="axis 2 was taken, since axis 1 has no torque"):
        assert read_log(data).position[0] == columns["position"][0] + 2.0


def several_axes(columns):
    data = {"time": columns["time"]}
    for axis in range(3):
        data |= {f"tau_measured.{axis}": columns["torque"] + axis, f"qd.{axis}": columns["velocity"] + axis}
    return data | {f"tau_command.{axis}": 0.0 * columns["torque"] + axis for axis in range(3)}


def test_the_axis_of_a_column_that_the_user_mapped_is_that_of_all(columns):
    log = read_log(several_axes(columns), columns="torque=tau_measured.2")
    assert log.velocity[0] == columns["velocity"][0] + 2


def test_where_all_of_an_axis_is_mapped_nothing_of_another_is_taken(columns):
    data = {"time": columns["time"]}
    for axis in range(1, 4):
        data |= {f"position_{axis}": columns["position"] + axis, f"current_{axis}": columns["torque"] + axis}
    log = read_log(data, columns="position=position_3,torque=current_3:A")
    assert not any("current_1" in warning for warning in log.warnings)


def test_a_column_may_be_mapped_by_its_name_without_the_chosen_axis(columns):
    log = read_log(several_axes(columns), columns="axis=1,torque=tau_measured:mNm")
    np.testing.assert_allclose(log.torque, 1e-3 * (columns["torque"] + 1))
    assert log.velocity[0] == columns["velocity"][0] + 1
    with pytest.raises(InputError, match="no column 'tau_measured'"):
        read_log(several_axes(columns), columns="torque=tau_measured")


@pytest.mark.parametrize("mark", [".", "/", ":"])
def test_the_torque_of_one_machine_is_never_taken_with_the_motion_of_another(columns, mark):
    data = {"time": columns["time"], f"hip{mark}position": columns["position"] + 1.0}
    data |= {f"knee{mark}{name}": columns[name] for name in ("position", "velocity", "torque")}
    log = read_log(data)
    np.testing.assert_array_equal(log.position, columns["position"])
    data |= {f"hip{mark}{name}": columns[name] + 1.0 for name in ("velocity", "torque")}
    with pytest.warns(FpjaxWarning, match="several machines: hip was taken, and not knee"):
        assert read_log(data).torque[0] == columns["torque"][0] + 1.0
    assert read_log(data, columns=f"torque=knee{mark}torque").position[0] == columns["position"][0]
    still = data | {f"hip{mark}{name}": np.zeros_like(columns["time"]) for name in ("position", "velocity")}
    with pytest.warns(FpjaxWarning, match="knee was taken, and not hip"):
        assert read_log(still).torque[0] == columns["torque"][0]


def test_the_axes_of_a_machine_tool_are_letters(columns):
    data = {"time": columns["time"], "X_ActualVelocity": columns["velocity"], "X_CurrentFeedback": columns["torque"]}
    data |= {"Z_ActualVelocity": -columns["velocity"], "Z_CurrentFeedback": 3.0 * columns["torque"]}
    with pytest.warns(FpjaxWarning, match="2 axes"):
        np.testing.assert_allclose(read_log(data).velocity, columns["velocity"])
    np.testing.assert_allclose(read_log(data, columns="axis=3").torque, 3.0 * columns["torque"])


def test_an_axis_that_only_creeps_is_not_taken(columns):
    data = {"time": columns["time"]}
    for axis in range(2):
        data |= {f"tau_{axis}": columns["torque"] + axis, f"q_{axis}": columns["position"] * (1.0 if axis else 0.02)}
    with pytest.warns(FpjaxWarning, match="axis 1 was taken, since axis 0 hardly moves"):
        read_log(data)


def test_parts_of_a_machine_by_their_own_names(columns):
    data = {"time": columns["time"], "max_torque": columns["torque"] + 9, "max_velocity": columns["velocity"] + 9}
    for place, part in enumerate(("left_hip", "left_knee")):
        data |= {f"{part}_torque": columns["torque"] + place, f"{part}_velocity": columns["velocity"] * (place + 1.0)}
    with pytest.warns(FpjaxWarning, match="several machines: left_hip was taken, and not left_knee"):
        log = read_log(data)
    np.testing.assert_array_equal(log.velocity, columns["velocity"])
    with pytest.raises(InputError, match="no column torque"):  # nothing says that the pitch is what the knee turns
        read_log({"time": columns["time"], "knee_torque": columns["torque"], "pitch_velocity": columns["velocity"]})
