"""Files, models and logs that make no sense: one sentence and no traceback."""

import json
import os
import shutil

import jax.numpy as jnp
import numpy as np
import pytest
from cli_case import SERVO, refuse, run

import fpjax
from fpjax.simulation.divergence import in_proportion


def test_an_unwritable_out_is_found_before_anything_is_computed(servo, tmp_path, capsys):
    (tmp_path / "file").write_text("")
    for out in (tmp_path / "file", tmp_path / "file" / "deeper", "/proc/nothing/here"):
        refuse(capsys, "simulate", servo, "--out", out, match="cannot be written")


def test_missing_and_broken_files(servo, tmp_path, capsys):
    refuse(capsys, "simulate", tmp_path / "servoo.toml", match="did you mean 'servo.toml'")
    refuse(capsys, "simulate", tmp_path, match="is a folder")
    refuse(capsys, "inspect", tmp_path / "none.csv", match="does not exist")
    binary = tmp_path / "binary.toml"
    binary.write_bytes(bytes(range(256)))
    refuse(capsys, "simulate", binary, match="cannot be read")


def test_a_home_that_no_shell_has_put_in_is_found(servo, tmp_path, monkeypatch):
    monkeypatch.setenv("HOME", str(tmp_path))
    assert servo.parent == tmp_path
    assert fpjax.load_model("~/servo.toml").dt == fpjax.load_model(servo).dt
    run("simulate", "~/servo.toml", "--duration", "0.01", "--no-plots", "--out=~/made")
    assert (tmp_path / "made" / "run.json").exists()
    with pytest.raises(fpjax.InputError, match=f"{tmp_path}/log.csv does not exist"):
        fpjax.read_log("~/log.csv")
    with pytest.raises(fpjax.InputError, match=r"~nobody-here/log\.csv does not exist"):
        fpjax.read_log("~nobody-here/log.csv")


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="no pipes on this system")
@pytest.mark.timeout(60)
def test_a_model_that_has_no_end_is_refused_and_not_waited_for(tmp_path, capsys):
    os.mkfifo(tmp_path / "servo.toml")
    os.symlink("/dev/zero", tmp_path / "zero.toml")
    for name in ("servo.toml", "zero.toml"):
        refuse(capsys, "simulate", tmp_path / name, match="is a pipe or a device")
    with open(tmp_path / "large.toml", "wb") as file:
        file.truncate(1 << 26)  # a hole: it takes no room
    refuse(capsys, "simulate", tmp_path / "large.toml", match="has 67 MB, but a model has at most 20 MB: is it a log?")


def test_a_bad_model_is_one_sentence(servo, capsys):
    servo.write_text(SERVO.replace("inertia = 10.0", "inertia = -10.0"))
    refuse(capsys, "simulate", servo, match="[plant] inertia must be above zero, got -10 kg m^2")
    servo.write_text(SERVO.replace("inertia = 10.0", "inertai = 10.0"))
    refuse(capsys, "tune", servo, match="[plant] inertai is not known: did you mean 'inertia'")


def test_a_step_past_the_stability_limit_warns_with_the_number(servo, capsys):
    servo.write_text(SERVO.replace("steepness = 100.0", "steepness = 5000.0"))
    assert run("simulate", servo) == 0
    error = capsys.readouterr().err
    assert "warning: steepness x coulomb x dt / inertia = 10 is past rk4's stability limit" in error
    assert "use a step below" in error


def test_gains_at_which_the_loop_blows_up(servo, tmp_path, capsys):
    servo.write_text(SERVO.replace("kp = 150.0", "kp = 150000.0"))
    refuse(capsys, "simulate", servo, "--out", tmp_path / "out", "--no-plots", match="The loop diverges at t =")
    assert (tmp_path / "out" / "simulation.csv").exists()
    assert json.loads((tmp_path / "out" / "run.json").read_text())["status"] == "bad input"
    refuse(capsys, "tune", servo, "--max-simulations", 12, match="Every start diverges")


UNSTABLE_OBSERVER = """
[plant]
type = "two_mass"
motor_inertia = 0.01
load_inertia = 0.02
stiffness = 50.0
damping = 0.02
[friction]
type = "stribeck"
coulomb = 0.2
static = 0.3
stribeck_velocity = 0.1
viscous = 0.02
steepness = 100.0
[controller]
type = "pi"
kp = 0.3
ki = 1.0
limit = 1.0
[observer]
type = "efp"
gain_1 = 0.5
gain_2 = 2.0
high_order = true
[sensor]
step = 0.01
side = "motor"
delay = 0.0015
[actuator]
delay = 0.001
lag = 0.002
[reference]
type = "sine"
amplitude = 2.0
frequency = 1.0
[simulation]
dt = 1e-3
duration = 2.7
stepping = "sampled"
substeps = 8
"""


def test_an_observer_that_diverges_behind_a_limit_of_the_torque_is_told(tmp_path, capsys):
    """Estimates of 1e12 N m under a torque of 1 N m are finite numbers, and a diverged run all the same."""
    path = tmp_path / "servo.toml"
    path.write_text(UNSTABLE_OBSERVER)
    refuse(capsys, "simulate", path, "--no-plots", match="The loop diverges at t = 2.4")
    if shutil.which("cc"):
        refuse(capsys, "export", path, "--c", tmp_path / "c", "--check", match="The sampled loop diverges")
    model = fpjax.load_model(path)
    run = fpjax.simulate(model)
    assert run.diverged
    assert "out of all proportion" in run.message
    assert not fpjax.simulate(model, duration=1.5).diverged


@pytest.mark.parametrize(
    ("signals", "healthy"),
    [
        ({"torque": [0.0, 1.0], "compensation": [0.0, 1e10]}, [True, False]),
        ({"torque": [0.0, 0.0], "compensation": [0.0, 1e10]}, [True, True]),  # nothing to hold it against
        ({"reference": [1e-3, 0.0], "velocity": [1e7, 1.0]}, [False, True]),
        ({"reference": [1e-3, 0.0], "position": [1e7, 1.0]}, True),  # of a velocity loop: it goes on and on
        ({"reference": [0.0, 0.0], "velocity": [1e7, 1.0]}, [True, True]),
        ({"reference": [1e-17, 0.0], "velocity": [1e-3, 2.0]}, [True, False]),  # zero but for rounding
        ({"torque": [1.0, 1.0], "control": [0.0, float("nan")]}, [True, False]),
    ],
)
def test_a_run_is_held_against_its_own_torque_and_reference(signals, healthy):
    found = in_proportion(fpjax.Proportional(1.0), {name: jnp.asarray(values) for name, values in signals.items()})
    assert np.array_equal(found, healthy)


def test_bad_logs_in_every_command_that_takes_one(servo, log, tmp_path, capsys):
    rows = log.read_text().splitlines()
    names = rows[0].split(",")
    still = [",".join("1" if name == "time" else cell for name, cell in zip(names, row.split(","), strict=True))
             for row in rows[1:]]  # fmt: skip
    cases = {
        "no clock": ([rows[0], *still], "time is 1 s in every row"),
        "short": (rows[:9], "is too short: 8 rows"),
        "two": ([",".join(row.split(",")[:2]) for row in rows], "has two columns"),
    }
    bad = tmp_path / "bad.csv"
    for lines, match in cases.values():
        bad.write_text("\n".join(lines) + "\n")
        refuse(capsys, "inspect", bad, match=match)
        refuse(capsys, "estimate", bad, "--model", servo, match=match)
        refuse(capsys, "diagnose", bad, "--model", servo, "--out", tmp_path / "why", match=match)
    refuse(capsys, "simulate", servo, "--log", bad, match="has two columns")


def test_a_period_that_is_not_the_models(servo, log, capsys):
    servo.write_text(SERVO.replace("dt = 1e-3", "dt = 2e-3"))
    refuse(capsys, "simulate", servo, "--log", log, match="[simulation] dt = 0.002 s: write dt = 0.001")


def test_options_without_effect_are_refused(servo, log, capsys):
    refuse(capsys, "simulate", servo, "--log", log, "--duration", 0.1, match="--duration has no effect with --log")
    refuse(capsys, "simulate", servo, "--log", log, "--seed", 1, match="--seed has no effect with --log")
    refuse(capsys, "simulate", servo, "--at", 0.5, match="add --margins, or leave --at out")
    refuse(capsys, "simulate", servo, "--log", log, "--at", 0.5, match="leave it out with --log")
    for words in (["--from", 0.1], ["--from-rest"], ["--strict"], ["--every", 2]):
        refuse(capsys, "simulate", servo, *words, match=f"{words[0]} is about a log, but none is given")
    refuse(capsys, "tune", servo, "--spread", "plant.inertia=0.2,0.5", match="has 2 shares: give one")
    twice = ["--spread", "plant.inertia=0.2", "--spread", "plant.inertia=0.3"]
    refuse(capsys, "tune", servo, *twice, match="--spread gives one name twice")
    refuse(capsys, "tune", servo, "--objective", "thesis", "--after", 0.1, match="--after has no effect on the thesis")
    refuse(capsys, "simulate", servo, *["--set", "plant.inertia=9"] * 2, match="--set plant.inertia is given twice")


def test_a_run_that_no_memory_holds_is_refused_before_it_begins(servo, capsys):
    refuse(capsys, "simulate", servo, "--duration", "1e12", match="record")


def test_log_and_model_in_each_others_place(servo, log, capsys):
    refuse(capsys, "estimate", servo, "--model", log, match="is a log, not a model")
    refuse(capsys, "simulate", log, match="is a log, not a model")
    refuse(capsys, "inspect", servo, match="is a model, not a log")
