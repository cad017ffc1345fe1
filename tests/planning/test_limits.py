"""The limits of a plan: given, read from a log, chosen with a note, or refused."""

import numpy as np
import pytest
from plan_case import servo

from fpjax import InputError, dump_model, load_model, read_log
from fpjax.planning.limits import make_limits


def given(**values):
    return {name: values.get(name) for name in ("speed", "acceleration", "torque", "travel", "duration")}


def test_what_was_given_is_kept_and_what_was_chosen_is_said():
    notes = []
    limits = make_limits(servo(), None, given(speed=5.0, torque=3.0), notes)
    assert (limits.speed, limits.torque) == (5.0, 3.0)
    # 90 % of the torque, less Coulomb and viscous friction at the top speed, over the inertia
    assert limits.acceleration == pytest.approx((0.9 * 3.0 - 0.5 - 0.04 * 5.0) / 0.05)
    said = " ".join(notes)
    assert all(f"--{name} is not given" in said for name in ("acceleration", "travel", "duration"))
    assert "--speed is not given" not in said


def test_a_log_says_how_far_the_machine_went():
    time = np.arange(2000) * 1e-3
    motion = 0.2 * np.sin(2 * np.pi * time)
    rate = 0.2 * 2 * np.pi * np.cos(2 * np.pi * time)
    log = read_log({"time": time, "torque": np.sign(rate), "velocity": rate, "position": motion})
    limits = make_limits(servo("both"), log, given(), [])
    assert limits.travel == pytest.approx(0.4, rel=0.02)
    assert limits.speed == pytest.approx(0.4 * np.pi, rel=0.02)
    assert limits.torque == pytest.approx(1.2)
    assert limits.duration == pytest.approx(512 * 4e-3)  # the shortest that can be diagnosed at that rate


@pytest.mark.parametrize(
    ("values", "words"),
    [
        (given(torque=0.4), "cannot move within its limits"),
        (given(torque=0.52), "cannot move within its limits"),
        (given(speed=-1.0), "--speed must be a number above zero"),
        (given(duration=0.5), "too short for a diagnosis"),
        (given(duration=1e9), "simulates a small part only: give at most"),
        (given(speed=50.0, travel=1e-3, acceleration=1.0), "contradict each other"),
    ],
)
def test_limits_that_cannot_be_are_one_sentence(values, words):
    with pytest.raises(InputError, match=words) as error:
        make_limits(servo(), None, values, [])
    assert "\n" not in str(error.value)


def test_a_speed_that_travel_and_acceleration_do_not_allow_is_lowered():
    notes = []
    limits = make_limits(servo(), None, given(speed=5.0, torque=3.0, travel=0.1, acceleration=10.0), notes)
    assert limits.speed == pytest.approx(1.0)
    assert any("at most" in note for note in notes)


def test_the_models_own_torque_limit_holds():
    model = servo(gains="kp = 4.0\nki = 40.0\nlimit = 2.0")
    assert make_limits(model, None, given(torque=9.0), []).torque == 2.0
    assert make_limits(model, None, given(), []).torque == 2.0


def test_the_limits_of_the_file_hold_and_an_option_may_only_be_tighter(tmp_path):
    path = tmp_path / "servo.toml"
    plain = servo()
    path.write_text(plain.text + "[limits]\nspeed = 4.0\ntravel = 3.0\n")
    model, notes = load_model(path), []
    assert load_model(dump_model(model)).limits == model.limits == {"speed": 4.0, "travel": 3.0}
    limits = make_limits(model, None, given(speed=9.0, torque=3.0), notes)
    assert (limits.speed, limits.travel) == (4.0, 3.0)
    said = " ".join(notes)
    assert "--speed 9 is above [limits] speed of the model: 4 rad/s is used" in said
    assert "--travel is not given: 3 rad is used, as [limits] of the model" in said
    assert make_limits(model, None, given(travel=1.0, torque=3.0), []).travel == 1.0
    with pytest.raises(InputError, match=r"\[limits\] speeed is not known: did you mean 'speed'"):
        load_model(plain.text + "[limits]\nspeeed = 4.0\n")
    with pytest.raises(InputError, match=r"\[limits\] travel must be above zero, got 0 rad"):
        load_model(plain.text + "[limits]\ntravel = 0.0\n")
