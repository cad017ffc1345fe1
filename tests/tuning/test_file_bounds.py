"""[bounds] of a model file in tune: the range of what is tuned, not the choice of it."""

import json

import pytest
from model_files import body

import fpjax as fp
import tuning
from fpjax.cli.command_line import main
from tuning.file_bounds import bounded_parameters

SERVO = (
    body(10.0, 20.0, 5.0)
    + """
[controller]
type = "pi"
{controller}
[observer]
type = "efp"
{observer}
[reference]
type = "sine"
amplitude = 1.0
frequency = 0.5
[simulation]
dt = 2e-3
duration = 1.0
stepping = "sampled"
solver = "exact"
[bounds]
{bounds}
"""
)
OBSERVER = "gain_1 = 100.0\ngain_2 = 100.0"


def text(bounds, observer=OBSERVER, controller="kp = 400.0\nki = 2000.0"):
    return SERVO.format(bounds=bounds, observer=observer, controller=controller)


def ranges(parameters):
    return {one.name: (one.low, one.high) for one in parameters}


def test_the_file_limits_what_is_tuned_and_does_not_choose_it():
    model = fp.load_model(text("observer.gain_1 = [50.0, 150.0]\ncontroller.kp = [100.0, 900.0]"))
    assert ranges(bounded_parameters(model)) == {"observer.gain_1": (50.0, 150.0), "observer.gain_2": (None, None)}
    named = bounded_parameters(model, ["controller.kp", tuning.Parameter("observer.gain_1", 80.0, 70.0, 90.0)])
    assert ranges(named) == {"controller.kp": (100.0, 900.0), "observer.gain_1": (70.0, 90.0)}


def test_without_bounds_nothing_changes():
    model = fp.load_model(text("").replace("[bounds]", ""))
    assert bounded_parameters(model) is None


def test_a_lower_bound_of_zero_is_a_linear_range():
    model = fp.load_model(text("controller.ki = [0.0, 4000.0]"))
    (one,) = bounded_parameters(model, ["controller.ki"])
    assert (one.scale, one.low, one.high) == ("linear", 0.0, 4000.0)


def test_a_gain_that_was_placed_is_moved_into_its_bounds_and_a_written_one_is_refused():
    bounds = "observer.gain_1 = [0.001, 0.002]"
    placed = fp.load_model(text(bounds, observer=""))
    assert bounded_parameters(placed)[0].start == pytest.approx(0.002)
    with pytest.raises(fp.InputError, match="outside its own bounds"):
        bounded_parameters(fp.load_model(text(bounds)))


@pytest.mark.long  # its Jacobian compiles for six seconds
def test_python_and_the_command_line_stay_within(tmp_path):
    """Unbounded, both gains end far beyond: the bound is where they end, and it is said."""
    source = text("observer.gain_1 = [90.0, 110.0]\nobserver.gain_2 = [90.0, 110.0]")
    (tmp_path / "servo.toml").write_text(source)
    out = tmp_path / "tuned"
    words = ["tune", str(tmp_path / "servo.toml"), "--method", "nelder_mead", "--max-simulations", "40", "--no-plots"]
    assert main([*words, "--out", str(out)]) == 0
    (result,) = json.loads((out / "tune.json").read_text())["results"]
    found = tuning.tune(tmp_path / "servo.toml", method="nelder_mead", max_simulations=40)
    for gains in (result["gains"], found.gains):
        assert all(90.0 <= value <= 110.0 for value in gains.values())
    assert result["at_bounds"]
    assert found.at_bounds
