"""`fpjax simulate` as its user meets it: a log that reads back, traces, replays."""

import json

import numpy as np
import pytest
from cli_case import REPO, SERVO, refuse, run
from public_records import EMPS, needs_emps

import fpjax as fp
from fpjax import load_model, read_log
from fpjax.cli.measures import settling_time
from fpjax.gap.answer.tracking import made_torque
from fpjax.gap.data.record import make_records


def test_simulate_leaves_a_log_that_reads_back(servo, tmp_path, capsys):
    out = tmp_path / "out"
    assert run("simulate", servo, "--out", out) == 0
    printed = capsys.readouterr().out
    assert "tracking error, rms" in printed
    assert {entry.name for entry in out.iterdir()} == {
        "simulation.csv", "simulation.json", "simulation.png", "run.json"
    }  # fmt: skip
    measures = json.loads((out / "simulation.json").read_text())["measures"]
    model = load_model(servo)
    direct = fp.simulate(
        model.loop, model.reference, dt=1e-3, duration=1.0, stepping="sampled", record=("velocity", "torque"),
        measures={"rms": fp.RootMeanSquare()},
    )  # fmt: skip
    assert measures["tracking error, rms"]["value"] == pytest.approx(float(direct.measures["rms"]), rel=1e-12)
    log = read_log(out / "simulation.csv")
    assert log.dt == 1e-3
    np.testing.assert_allclose(log.velocity, direct.signals["velocity"], atol=1e-9)
    np.testing.assert_allclose(log.torque, direct.signals["torque"], atol=1e-7)


def test_a_noisy_estimate_is_told_by_its_mean_and_scatter(tmp_path):
    """One noisy last sample is no estimate: the mean of the last quarter is told, as `tune` judges it."""
    path = tmp_path / "noisy.toml"
    path.write_text(SERVO + "[sensor]\nnoise = 0.02\n")
    out = tmp_path / "out"
    assert run("simulate", path, "--duration", 8, "--out", out, "--no-plots") == 0
    measures = json.loads((out / "simulation.json").read_text())["measures"]
    coulomb = read_signal(out / "simulation.csv", "estimates.coulomb")
    quarter = coulomb[-(len(coulomb) // 4) :]
    assert measures["coulomb, mean of the last quarter"]["value"] == pytest.approx(np.mean(quarter), rel=1e-6)
    assert measures["coulomb, scatter about it"]["value"] == pytest.approx(np.std(quarter), rel=1e-6)
    assert measures["coulomb, scatter about it"]["value"] > 0.0


def test_settling_is_judged_on_the_mean_and_not_on_a_noisy_sample():
    time = np.arange(10_000) * 1e-3
    clean = 20.0 * (1.0 - np.exp(-time))  # within 5 % from 3 s on
    noisy = clean + 2.0 * np.random.default_rng(0).standard_normal(len(time))
    assert settling_time(time, clean, 20.0) == pytest.approx(-np.log(0.05), abs=0.05)
    assert settling_time(time, noisy, 20.0) == pytest.approx(-np.log(0.05), abs=0.3)
    assert settling_time(time, clean, 25.0) == np.inf
    assert settling_time(time, np.full(len(time), 20.5), 20.0) == 0.0


@pytest.mark.parametrize("duration", [4.0, 20.0, 60.0])
@pytest.mark.parametrize("noise", [0.0, 0.03, 0.3])
def test_settling_does_not_depend_on_the_length_of_the_run(duration, noise):
    time = np.arange(0.0, duration, 1e-3)
    for seed in range(5):
        random = np.random.default_rng(seed).standard_normal(len(time))
        estimate = 20.0 * (1.0 - np.exp(-time / 0.1) + noise * random)
        # What is averaged over, half of which the time is uncertain by: (5 scatter / 1 %)^2 samples.
        allowed = 0.05 + 0.5e-3 * (5.0 * noise / 0.01) ** 2 * 2.0
        assert settling_time(time, estimate, 20.0) == pytest.approx(
            -0.1 * np.log(0.05), abs=min(allowed, 0.04 * duration)
        )


def test_an_estimate_that_swings_out_of_the_band_has_not_settled_before():
    time = np.arange(0.0, 20.0, 1e-3)
    slow = 20.0 * (1.0 + 0.5 * np.sin(2.0 * np.pi * time / 8.0))
    assert settling_time(time, slow, 20.0) > 15.0


def test_margins_are_refused_before_a_run_whose_load_turns_with_the_position(tmp_path, capsys):
    path = tmp_path / "turning.toml"
    path.write_text(SERVO + '[load]\ntype = "unbalance"\namplitude = 2.0\n')
    refuse(
        capsys, "simulate", path, "--margins", "--out", tmp_path / "out", match="no steady motion at any speed but zero"
    )
    assert [each.name for each in (tmp_path / "out").iterdir()] == ["run.json"]


def test_a_run_without_a_steady_motion_is_whole_and_says_so(servo, tmp_path, monkeypatch, capsys):
    def never(*_, **__):
        raise fp.InputError("The loop does not settle at 1 rad/s.")

    monkeypatch.setattr(fp.ClosedLoop, "linearise", never)
    words = ["simulate", servo, "--margins", "--no-plots", "--out", tmp_path / "out"]
    refuse(capsys, *words, match="there are no margins: The loop does not settle")
    written = sorted(each.name for each in (tmp_path / "out").iterdir())
    assert written == ["run.json", "simulation.csv", "simulation.json"]
    assert run("inspect", tmp_path / "out" / "simulation.csv") == 0


def read_signal(path, name):
    with path.open() as file:
        header = next(line for line in file if not line.startswith("#")).strip().split(",")
        column = next(i for i, word in enumerate(header) if word.split(" ")[0] == name)
        return np.loadtxt(file, delimiter=",", usecols=column)


def test_run_json_traces_a_figure(servo, tmp_path):
    import hashlib

    out = tmp_path / "out"
    assert run("simulate", servo, "--out", out, "--seed", 7, "--no-plots") == 0
    record = json.loads((out / "run.json").read_text())
    assert record["command"][:2] == ["fpjax", "simulate"]
    assert record["inputs"][0]["sha256"] == hashlib.sha256(SERVO.encode()).hexdigest()
    assert record["seeds"] == {"sensor noise": 7}
    assert {"fpjax", "jax", "numpy", "python", "backend"} <= set(record["versions"])
    assert record["seconds"]["total"] > 0
    assert record["status"] == "completed"


def test_set_and_duration_change_the_run(servo, tmp_path, capsys):
    assert run("simulate", servo, "--set", "plant.friction.coulomb=0.001", "--duration", 0.1) == 0
    assert "101 samples" in capsys.readouterr().out
    refuse(capsys, "simulate", servo, "--set", "plant.inertai=1", match="did you mean 'plant.inertia'")
    refuse(capsys, "simulate", servo, "--set", "plant.inertia", match="is not NAME=NUMBER")
    for number in ("1_0", "inf", "nan", "١"):
        refuse(capsys, "simulate", servo, "--set", f"plant.inertia={number}", match="is not NAME=NUMBER")
    refuse(capsys, "simulate", servo, "--set", "plant.inertia=1e39", match="too large")
    refuse(capsys, "simulate", servo, "--duration", "1_0", match="invalid number value: '1_0'")
    refuse(capsys, "tune", servo, "--starts", "1_0", match="invalid whole number value: '1_0'")
    refuse(
        capsys,
        "simulate",
        servo,
        "--set",
        "plant.inertia=-3",
        match="inertia must be finite and above zero, got -3 kg m^2",
    )
    refuse(capsys, "simulate", servo, "--duration", "-1", match="got -1 s")


def test_set_takes_the_words_of_the_file(servo, tmp_path, capsys):
    forward = "[feedforward]\ninertia = 10.0\ncoulomb = 1.0\nspeed = 0.02\n[reference]"
    servo.write_text(servo.read_text().replace("[reference]", forward))
    changes = {"feedforward.coulomb": 0.5, "feedforward.lag": 0.01, "controller.kp": 200.0}
    words = [word for name, value in changes.items() for word in ("--set", f"{name}={value}")]
    assert run("simulate", servo, *words, "--no-plots", "--out", tmp_path / "set") == 0
    model = servo.read_text().replace("coulomb = 1.0\nspeed", "coulomb = 0.5\nlag = 0.01\nspeed")
    servo.write_text(model.replace("kp = 150.0", "kp = 200.0"))
    assert run("simulate", servo, "--no-plots", "--out", tmp_path / "file") == 0
    capsys.readouterr()
    same = [(tmp_path / name / "simulation.csv").read_bytes() for name in ("set", "file")]
    assert same[0] == same[1]
    twice = ["--set", "controller.kp=1", "--set", "controller.controller.kp=2"]
    refuse(capsys, "simulate", servo, *twice, match="are one number, controller.controller.kp: give one of them")
    refuse(capsys, "simulate", servo, *words[:2], *words[:2], match="--set feedforward.coulomb is given twice")


def test_a_name_that_is_not_known_is_told_no_other_blocks_number(servo, capsys):
    refuse(capsys, "simulate", servo, "--set", "feedforward.coulomb=1", match="is not known: Known: plant.")
    servo.write_text(
        servo.read_text() + "[actuator]\ncogging_amplitude = 1.0\ncogging_periods = 7.0\n[sensor]\nbias = 0.0\n"
    )
    assert "..." not in refuse(capsys, "simulate", servo, "--set", "sensor.nothing=1", match="Known: sensor.")


def test_an_observer_that_keeps_its_own_inertia_is_told(servo, capsys):
    assert run("simulate", servo, "--set", "plant.inertia=20") == 0
    kept = "the observer keeps its own inertia, 10 kg m^2"
    error = capsys.readouterr().err
    assert kept in error
    assert "--set observer.inertia=20" in error
    assert run("simulate", servo, "--set", "plant.inertia=20", "--set", "observer.inertia=20") == 0
    assert kept not in capsys.readouterr().err


def test_a_replay_of_the_models_own_log_is_exact(servo, log, tmp_path, capsys):
    out = tmp_path / "again"
    assert run("simulate", servo, "--log", log, "--out", out) == 0
    found = json.loads((out / "replay.json").read_text())
    assert found["errors"]["velocity"]["relative"] < 1e-6
    assert found["errors"]["torque"]["relative"] < 1e-6
    assert (out / "replay.png").stat().st_size > 10_000
    assert run("simulate", servo, "--log", log, "--set", "plant.friction.coulomb=25") == 0
    assert "velocity" in capsys.readouterr().out


POSITION = """
[units]
reference = "position"
sensors = "position"
[plant]
type = "one_mass"
inertia = 0.02
[friction]
type = "coulomb_viscous"
coulomb = 0.3
viscous = 0.05
[controller]
type = "position_cascade"
kp = 20.0
kv = 1.0
[feedforward]
velocity = 1.0
inertia = 0.02
coulomb = 0.3
viscous = 0.05
speed = 0.1
[reference]
type = "sine"
amplitude = 1.0
frequency = 1.0
[simulation]
dt = 1e-3
duration = 0.5
stepping = "sampled"
solver = "exact"
"""


def test_a_position_table_does_not_stop_within_its_last_period(tmp_path):
    """A reference held after its last row would be a stop from full speed: 128 N m of feed-forward, 0.6 before."""
    path, out, again, followed = (tmp_path / name for name in ("servo.toml", "out", "again", "followed"))
    path.write_text(POSITION)
    assert run("simulate", path, "--out", out, "--no-plots") == 0
    log = out / "simulation.csv"
    assert run("simulate", path, "--log", log, "--out", again, "--no-plots") == 0
    assert json.loads((again / "replay.json").read_text())["errors"]["torque"]["relative"] < 1e-4
    record = make_records([read_log(log)], [], 0.05)[0]
    assert made_torque(load_model(path), record)[0] < 1e-3
    recorded = POSITION.replace('"sine"\namplitude = 1.0\nfrequency = 1.0', f'"recorded"\nfile = "{log}"')
    path.write_text(recorded)
    assert run("simulate", path, "--out", followed, "--no-plots") == 0
    torque = read_signal(followed / "simulation.csv", "torque")
    np.testing.assert_allclose(torque, read_signal(log, "torque"), atol=1e-3)
    # beyond the recording's end the machine is to stop, as the model says
    assert run("simulate", path, "--out", followed, "--no-plots", "--duration", 0.51) == 0
    assert np.abs(read_signal(followed / "simulation.csv", "torque")).max() > 10.0


@needs_emps
def test_emps_replay(tmp_path, capsys):
    example = REPO / "examples" / "emps.toml"
    words = ["simulate", example, "--log", EMPS, "--columns", "emps", "--no-plots"]
    assert run(*words, "--out", tmp_path) == 0
    errors = json.loads((tmp_path / "replay.json").read_text())["errors"]
    assert errors["torque"]["relative"] < 0.055
    assert errors["position"]["rms"] < 2e-6
    rest = [*words, "--from-rest", "--out", tmp_path / "rest"]
    assert run(*rest) == 0
    slow = json.loads((tmp_path / "rest" / "replay.json").read_text())["errors"]
    # The record starts in motion: a start at rest costs the first tenths of a second.
    assert errors["torque"]["relative"] < slow["torque"]["relative"] < 0.055
    assert slow["position"]["rms"] == pytest.approx(1.77e-6, abs=0.05e-6)
    refuse(capsys, "simulate", example, "--log", EMPS, match="torque is in V, but the model's in N")
