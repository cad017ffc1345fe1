"""`fpjax estimate` and `fpjax inspect` as their user meets them, and what they suspect of a log."""

import json
import subprocess
import sys

import numpy as np
import pytest
from cli_case import REPO, SERVO, refuse, run
from public_records import EMPS, needs_emps

from fpjax import load_model, read_log


def test_estimate_on_a_simulated_log(servo, log, tmp_path, capsys):
    out = tmp_path / "friction"
    assert run("estimate", log, "--model", servo, "--out", out) == 0
    found = json.loads((out / "estimate.json").read_text())
    assert found["least_squares"]["coulomb"] == pytest.approx(20.0, rel=0.05)
    assert (out / "estimate.png").exists()
    traces = read_log(out / "estimate.csv", require=("velocity",))
    assert set(traces.extra) == {"coulomb", "viscous"}
    bare = servo.with_name("bare.toml")
    bare.write_text(SERVO[: SERVO.index("[controller]")] + "[simulation]\ndt = 1e-3\n")
    capsys.readouterr()
    assert run("estimate", log, "--model", bare) == 0
    assert "an EFP with gain_1" in capsys.readouterr().err


@needs_emps
def test_emps_friction_within_five_per_cent(tmp_path, capsys):
    """Gains follow from inertia and speed, never from this record's torque."""
    example = REPO / "examples" / "emps.toml"
    words = ["--columns", "emps", "--model", example, "--average", 6.24, "--out", tmp_path, "--no-plots"]
    assert run("estimate", EMPS, *words) == 0
    found = json.loads((tmp_path / "estimate.json").read_text())["estimates"]
    assert found["coulomb"] == pytest.approx(20.39, rel=0.05)
    assert found["viscous"] == pytest.approx(203.5, rel=0.05)


def test_inspect_finds_the_nominal_and_starts_a_model(log, tmp_path, capsys):
    out = tmp_path / "look"
    assert run("inspect", log, "--out", out) == 0
    printed = capsys.readouterr().out
    assert "1000 Hz" in printed
    assert "can this log show" in printed
    model = load_model(out / "servo.toml")
    assert model.dt == 1e-3
    assert model.nominal["inertia"] == pytest.approx(10.0, rel=0.02)
    assert model.nominal["coulomb"] == pytest.approx(20.0, rel=0.05)
    assert not model.controller_known
    assert json.loads((out / "inspection.json").read_text())["rate"] == pytest.approx(1000.0)
    assert (out / "inspection.png").stat().st_size > 10_000
    refuse(capsys, "simulate", out / "servo.toml", match="enough to estimate and diagnose")


def test_inspect_says_why_it_starts_no_model(tmp_path, capsys):
    """An arm that is moved slowly: what its torque holds, weight and other joints, says nothing of an inertia."""
    time = 0.02 * np.arange(1500)
    rng = np.random.default_rng(3)
    columns = {
        "time": time,
        "torque": 5.0 * np.sin(0.31 * time) + rng.normal(size=time.size),
        "velocity": 0.3 * np.sin(0.9 * time),
        "position": -0.3 / 0.9 * np.cos(0.9 * time),
    }
    path, out = tmp_path / "slow.csv", tmp_path / "look"
    np.savetxt(path, np.column_stack(list(columns.values())), delimiter=",", header=",".join(columns), comments="")
    assert run("inspect", path, "--no-plots", "--out", out) == 0
    printed = capsys.readouterr().out
    assert "no servo.toml was written: the fitted inertia" in printed
    assert "is not told from zero" in printed
    assert not (out / "servo.toml").exists()


def test_inspect_needs_no_jax(log):
    code = f"import sys; from fpjax.cli import main; main(['inspect', {str(log)!r}, '--no-plots']); "
    code += "print(sorted({'jax', 'scipy'} & set(sys.modules)))"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, cwd=REPO, check=True)
    assert done.stdout.splitlines()[-1] == "[]"


def test_suspicions_are_named(servo, log, tmp_path, capsys):
    rows = [row.split(",") for row in log.read_text().splitlines()]
    names, data = rows[0], np.array(rows[1:], float)
    where = {name: place for place, name in enumerate(names)}

    def inspect(**changes):
        table = {name: data[:, where[name]] for name in ("time", "torque", "velocity", "position", "reference")}
        table |= changes
        path = tmp_path / "odd.csv"
        lines = [",".join(table)] + [",".join(map(repr, map(float, row))) for row in zip(*table.values(), strict=True)]
        path.write_text("\n".join(lines))
        assert run("inspect", path) == 0
        return capsys.readouterr().err

    velocity, torque = data[:, where["velocity"]], data[:, where["torque"]]
    assert inspect() == ""
    assert "looks like deg/s: 57.3 x" in inspect(velocity=np.degrees(velocity))
    assert "opposite sign" in inspect(velocity=-velocity)
    assert "accelerates against the torque" in inspect(torque=-torque)
    assert "look exchanged" in inspect(torque=velocity, velocity=torque)
    assert "torque is constant" in inspect(torque=np.ones_like(torque))
    forward = np.abs(velocity) + 0.1
    position = np.cumsum(forward) * 1e-3
    assert "one direction only" in inspect(velocity=forward, position=position)


def test_a_model_far_off_is_suspected(servo, log, capsys):
    servo.write_text(SERVO.replace("inertia = 10.0", "inertia = 100.0"))
    assert run("estimate", log, "--model", servo) == 0
    assert "the model has 100" in capsys.readouterr().err


def test_the_observer_that_estimate_chooses_is_not_led_astray_by_noise(tmp_path):
    """A small motor with a noisy gyro: an observer by sign() learns 19 % too little Coulomb friction."""
    dt, inertia, coulomb, viscous = 1e-3, 3e-5, 2e-3, 2e-5
    random, time_ = np.random.default_rng(1), np.arange(8000) * dt
    reference = 6.0 * np.sin(2.0 * np.pi * 0.8 * time_) + 4.0 * np.sin(2.0 * np.pi * 2.3 * time_ + 1.0)
    speed, integral, rows = 0.0, 0.0, []
    for now, wanted in zip(time_, reference, strict=True):
        measured = speed + 0.02 * random.standard_normal()
        integral += 0.1 * (wanted - measured) * dt
        torque = 4e-3 * (wanted - measured) + integral
        rows.append(f"{now:.4f};{1e3 * torque:.4f};{measured * 30.0 / np.pi:.3f}".replace(".", ","))
        for _ in range(20):
            if speed == 0.0 and abs(torque) <= coulomb:
                continue
            sign = np.sign(speed) if speed else np.sign(torque)
            moved = speed + dt / 20 * (torque - coulomb * sign - viscous * speed) / inertia
            speed = 0.0 if speed * moved < 0.0 else moved
    log, model = tmp_path / "messung.csv", tmp_path / "motor.toml"
    log.write_text("Zeit;Drehmoment (mNm);Drehzahl (rpm)\n" + "\n".join(rows) + "\n")
    model.write_text(
        '[plant]\ntype = "one_mass"\ninertia = 3e-5\n[friction]\ntype = "coulomb_viscous"\ncoulomb = 2e-3\n'
        'viscous = 2e-5\n[controller]\ntype = "unknown"\n[simulation]\ndt = 1e-3\nstepping = "sampled"\n'
    )
    assert run("estimate", log, "--model", model, "--passes", 3, "--out", tmp_path / "out", "--no-plots") == 0
    found = json.loads((tmp_path / "out" / "estimate.json").read_text())["estimates"]
    assert found["coulomb"] == pytest.approx(coulomb, rel=0.03)
    assert found["viscous"] == pytest.approx(viscous, rel=0.2)
