"""Logs that once ended a diagnosis in a traceback: each is refused in one sentence, before anything is fitted."""

import numpy as np
import pytest
from model_files import LARGE_BODY
from numpy_machine import swing
from sentences import faults

from fpjax import InputError, Log, diagnose, load_model, read_log
from fpjax.gap.data.checks import about_noise, check

MODEL = (
    LARGE_BODY
    + """
[simulation]
dt = 1e-3
stepping = "sampled"
"""
)
ROWS = 4000
TIME = 1e-3 * np.arange(ROWS)
RANDOM = np.random.default_rng(0)
SWING = swing(ROWS, inertia=10.0, amplitude=0.5, rate=4.0)
STEADY = 0.5 + 1e-3 * RANDOM.normal(size=ROWS)


def log(**changes):
    return {name: values for name, values in (SWING | changes).items() if values is not None}


@pytest.mark.parametrize(
    ("given", "match"),
    [
        (log(torque=0.0 * TIME), "torque is zero throughout"),
        (log(velocity=STEADY, position=0.5 * TIME, torque=21.0 + 0.0 * TIME), "its speed stays at 0.5 rad/s"),
        (log(velocity=STEADY, position=None, torque=21.0 + 0.1 * RANDOM.normal(size=ROWS)), "its speed stays at 0.5"),
        (log(velocity=None, position=0.5 * TIME), "its speed stays at 0.5"),
        (log(velocity=0.0 * TIME, position=0.0 * TIME), "velocity is constant"),
        (log(velocity=0.0 * TIME + 1.0, position=0.0 * TIME + 1.0, torque=0.0 * TIME + 1.0), "is constant"),
        ({name: values[:64] for name, values in log().items()}, "too few"),
        (log(velocity=np.where(TIME < 3.9, np.nan, SWING["velocity"]), position=None), "too few"),
    ],
)
@pytest.mark.filterwarnings("ignore::fpjax.errors.FpjaxWarning")
def test_what_cannot_be_diagnosed_is_refused_in_a_sentence(given, match):
    with pytest.raises(InputError, match=match) as refused:
        diagnose(given, MODEL)
    assert not faults(str(refused.value)), str(refused.value)


def test_runs_at_one_steady_speed_each_are_diagnosed_together():
    """The classical way to measure friction: one run a speed. Each by itself shows nothing."""
    model, friction = load_model(MODEL), {0.5: 21.0, 2.0: 24.0, -1.0: -22.0}

    def steady(speed):
        noise = 1e-3 * RANDOM.normal(size=ROWS)
        return Log(TIME, friction[speed] + 0.1 * noise, speed + noise, speed * TIME, None, 1e-3, f"run at {speed}")

    runs = [steady(speed) for speed in friction]
    check(runs, model)
    with pytest.raises(InputError, match=r"run at 0.5: its speed stays at 0.5 rad/s"):
        check(runs[:1], model)
    with pytest.raises(InputError, match=r"run at 0.5, run at 0.5: their speed stays at 0.5 rad/s"):
        check([steady(0.5), steady(0.5)], model)


def test_equations_without_a_solution_are_a_sentence(monkeypatch):
    def singular(*_):
        raise np.linalg.LinAlgError("Singular matrix")

    monkeypatch.setattr("fpjax.gap.verb.make_search", singular)
    with pytest.raises(InputError, match=r"no model can be fitted to what is recorded \(Singular matrix\)") as refused:
        diagnose(log(), MODEL)
    assert not faults(str(refused.value))


def test_a_log_of_noise_is_said_to_show_nothing():
    made = read_log(log(torque=np.sin(TIME)))
    (sentence,) = about_noise([made], 68.0, "N m")
    assert "hides any missing torque below 68 N m, and the commanded torque is 0.66" in sentence
    assert not faults(sentence)
    assert about_noise([made], 0.1, "N m") == []
    assert about_noise([made], np.nan, "N m") == []
