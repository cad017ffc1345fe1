"""`fpjax diagnose` as its user meets it."""

import dataclasses
import functools
import json

import numpy as np
import pytest
from cli_case import NOMINAL

from fpjax import InputError, diagnose, improve, load_model, plan, read_log
from fpjax.cli import main
from fpjax.gap import EFFECTS, Estimate
from fpjax.gap.data.checks import check
from fpjax.gap.report.digits import show_estimate
from fpjax.output.folder_names import folder_names

TWO = 'type = "two_mass"\nmotor_inertia = 1.0\nload_inertia = 9.0\nstiffness = 1000.0\ndamping = 1.0'


@pytest.mark.slow
def test_the_cause_is_found_and_its_model_runs(made, tmp_path, capsys):
    out = tmp_path / "why"
    words = ["diagnose", str(made / "log.csv"), "--model", str(made / "nominal.toml"), "--out", str(out), "--no-cache"]
    assert main(words) == 0
    assert "Explained by constant_torque" in capsys.readouterr().out
    found = json.loads((out / "diagnosis.json").read_text())
    assert found["verdict"] == "explained"
    assert found["causes"] == ["constant_torque"]
    (torque,) = (entry["parameters"]["torque"] for entry in found["ranking"] if entry["effect"] == "constant_torque")
    assert torque["value"] == pytest.approx(2.0, rel=0.02)
    assert (out / "report.html").stat().st_size > 50_000
    record = json.loads((out / "run.json").read_text())
    assert [entry["role"] for entry in record["inputs"]] == ["model", "log"]
    assert load_model(out / "corrected.toml").nominal["inertia"] == pytest.approx(10.0, rel=0.01)
    assert main(["simulate", str(out / "corrected.toml"), "--no-cache"]) == 0


@pytest.fixture
def few(monkeypatch):
    """Two effects to fit: what is told does not depend on the vocabulary, and all of it compiles for 20 s."""
    named = tuple(effect for effect in EFFECTS if effect.name in ("constant_torque", "stribeck"))
    assert len(named) == 2
    monkeypatch.setattr("fpjax.gap.diagnose", functools.partial(diagnose, effects=named))


def refuse(capsys, *words, match):
    assert main([*map(str, words), "--no-cache"]) == 2
    error = capsys.readouterr().err
    sentences = [line for line in error.splitlines() if not line.startswith(("note:", "warning:"))]
    assert len(sentences) == 1, error
    assert match in sentences[0], error


@pytest.mark.parametrize(
    ("change", "match"),
    [
        (lambda time, torque, velocity: (velocity, torque), "exchanged"),
        (lambda time, torque, velocity: (-torque, velocity), "sign"),
    ],
)
def test_a_log_that_is_not_what_it_says_is_warned_of(made, change, match):
    time, torque, velocity = np.loadtxt(made / "log.csv", delimiter=",", skiprows=1).T
    torque, velocity = change(time, torque, velocity)
    log = read_log({"time": time, "torque": torque, "velocity": velocity})
    model = load_model(made / "nominal.toml")
    assert any(match in sentence for sentence in check([log], model).warnings())
    assert any(match in sentence for sentence in check([log], model).contradictions())


def test_a_column_that_is_not_fitted_contradicts_nothing():
    time = np.arange(0.0, 4.0, 1e-3)
    position = np.sin(3.0 * time) + 0.2 * np.sin(17.0 * time)
    velocity, acceleration = np.gradient(position, 1e-3), np.gradient(np.gradient(position, 1e-3), 1e-3)
    torque = 10.0 * acceleration + 5.0 * np.sign(velocity)
    model = load_model(NOMINAL)
    log = read_log({"time": time, "torque": torque, "velocity": 57.3 * velocity, "position": position})
    assert check([log], model).contradictions()
    assert not check([log], model).contradictions(rate=False)
    turns = dataclasses.replace(log, velocity=velocity, position=position / (2.0 * np.pi))
    assert check([turns], model).contradictions(rate=False)
    # Off by less than a model may be, but the velocity fits the model and the position does not.
    geared = dataclasses.replace(log, velocity=velocity, position=position / 3.0)
    assert check([geared], model).contradictions(rate=False)
    other = np.cumsum(np.random.default_rng(0).standard_normal(time.size)) * 1e-3
    assert check([dataclasses.replace(log, velocity=velocity, position=other)], model).contradictions(rate=False)


def test_a_position_that_alone_goes_the_other_way_is_named_and_not_the_torque():
    time, position = _moved()
    velocity, torque = _driven(position)
    log = read_log({"time": time, "torque": torque, "velocity": velocity, "position": -position})
    for rate in (True, False):
        (said,) = check([log], load_model(NOMINAL)).contradictions(rate=rate)
        assert "--columns position=position*-1" in said
        assert "torque=" not in said
    turned = dataclasses.replace(log, velocity=-velocity, position=position)
    assert "--columns velocity=velocity*-1" in check([turned], load_model(NOMINAL)).contradictions()[0]
    assert not check([turned], load_model(NOMINAL)).contradictions(rate=False)


def test_what_the_model_knows_of_its_gain_and_of_two_masses_is_no_contradiction():
    time = np.arange(0.0, 4.0, 1e-3)
    velocity = 3.0 * np.cos(3.0 * time) + 3.4 * np.cos(17.0 * time)
    torque = 10.0 * np.gradient(velocity, 1e-3) + 5.0 * np.sign(velocity)
    model, geared = load_model(NOMINAL), load_model(NOMINAL + "[actuator]\ngain = 0.1\n")
    amperes = read_log({"time": time, "torque": torque / 0.1, "velocity": velocity})
    assert check([amperes], model).contradictions()
    assert not check([amperes], geared).contradictions()
    two = NOMINAL.replace('type = "one_mass"\ninertia = 10.0', TWO)
    fast = read_log({"time": time, "torque": 0.1 * torque, "velocity": velocity})
    assert not check([fast], load_model(two)).contradictions()


@pytest.mark.parametrize("stepping", ["sampled", "continuous"])
@pytest.mark.parametrize(("unit", "size"), [("ms", 1e3), ("us", 1e6), ("s", 1e-3)])
def test_a_time_a_thousand_times_off_the_models_period_is_a_contradiction(stepping, unit, size):
    time, position = _moved()
    _, torque = _driven(position)
    text = NOMINAL if stepping == "sampled" else NOMINAL.split("stepping =")[0]
    checked = check([read_log({"time": size * time, "torque": torque, "position": position})], load_model(text))
    for rate in (True, False):
        (said,) = checked.contradictions(rate=rate)
        assert f"--columns time=NAME:{unit}" in said
    assert sum("its rows are" in sentence for sentence in checked.warnings()) == 1
    assert not any("write dt" in sentence for sentence in checked.warnings())


def test_an_honest_clock_beside_another_period_contradicts_nothing():
    time, position = _moved()
    _, torque = _driven(position)
    # In the very seconds of the log the velocity is the position's rate; no multiple of a unit; the step of a solver.
    slow = {"time": 1e3 * time, "torque": torque, "position": position, "velocity": np.gradient(position, 1.0)}
    for columns, text in (
        (slow, NOMINAL),
        ({"time": 3e2 * time, "torque": torque, "position": position}, NOMINAL),
        ({"time": 1e2 * time, "torque": torque, "position": position}, NOMINAL.replace("1e-3", "1e-4")),
    ):
        model = load_model(text.split("stepping =")[0])
        ((_, found),) = check([read_log(columns)], model).noticed
        assert "time" not in [one.kind for one in found]


def _moved():
    time = np.arange(0.0, 4.0, 1e-3)
    return time, np.sin(3.0 * time) + 0.2 * np.sin(17.0 * time)


def _driven(position):
    velocity = np.gradient(position, 1e-3)
    return velocity, 10.0 * np.gradient(velocity, 1e-3) + 5.0 * np.sign(velocity)


@pytest.mark.long
def test_of_a_torque_in_another_unit_no_cause_is_told_and_no_gains_are_tuned(made, few, tmp_path, capsys):
    log = np.loadtxt(made / "log.csv", delimiter=",", skiprows=1) * [1.0, 1e3, 1.0]
    np.savetxt(tmp_path / "milli.csv", log, delimiter=",", header="time,torque,velocity", comments="")
    out, model = tmp_path / "why", made / "nominal.toml"
    words = ["diagnose", tmp_path / "milli.csv", "--model", model, "--out", out, "--no-cache"]
    assert main([*map(str, words)]) == 0
    answer, page = json.loads((out / "diagnosis.json").read_text()), (out / "report.html").read_text()
    assert (answer["verdict"], answer["causes"]) == ("unexplained", [])
    assert "may not belong to this log" in answer["contradiction"]
    assert answer["contradiction"] in capsys.readouterr().out
    assert "no cause is told, since a unit, a sign, a column or the model cannot be right" in page
    for verb in ("improve", "plan"):
        given = [tmp_path / "milli.csv", "--reference", "model", "--free", "controller"] if verb == "improve" else []
        words = [verb, *given, "--model", model, "--diagnosis", out, "--out", tmp_path / verb]
        refuse(capsys, *words, match="until this is settled")


def test_such_a_log_is_refused_before_it_is_diagnosed(made, monkeypatch):
    log = np.loadtxt(made / "log.csv", delimiter=",", skiprows=1) * [1.0, 1e3, 1.0]
    given = read_log(dict(zip(("time", "torque", "velocity"), log.T, strict=True)))
    model = load_model(made / "nominal.toml")
    for module in ("improvement", "planning"):
        monkeypatch.setattr(f"fpjax.{module}.verb.diagnose", None)
    with pytest.raises(InputError, match=r"No gains are tuned on this log until this is settled: .* may not belong"):
        improve(given, model, reference="model", free=("controller",))
    with pytest.raises(InputError, match=r"No run is planned from this log until this is settled: .* may not belong"):
        plan(model, log=given)


def test_what_was_noticed_is_told_where_no_model_can_be_fitted(made, few, tmp_path, capsys):
    """A time in milliseconds."""
    log = np.loadtxt(made / "log.csv", delimiter=",", skiprows=1) * [1e3, 1.0, 1.0]
    np.savetxt(tmp_path / "slow.csv", log, delimiter=",", header="time,torque,velocity", comments="")
    words = ["diagnose", tmp_path / "slow.csv", "--model", made / "nominal.toml", "--out", tmp_path / "why"]
    code = main([*map(str, words), "--no-cache"])
    told = capsys.readouterr()
    assert "its time is in ms and was read in s" in (told.err if code else told.out)


def test_a_log_in_which_nothing_moves_is_refused(made, tmp_path, capsys):
    time, torque, velocity = np.loadtxt(made / "log.csv", delimiter=",", skiprows=1).T
    table = np.column_stack([time, torque, 0.0 * velocity])
    np.savetxt(tmp_path / "odd.csv", table, delimiter=",", header="time,torque,velocity", comments="")
    words = ["diagnose", tmp_path / "odd.csv", "--model", made / "nominal.toml", "--out", tmp_path / "why"]
    refuse(capsys, *words, match="")
    assert not (tmp_path / "why" / "diagnosis.json").exists()


def test_folders_of_separate_machines_have_names_of_their_own():
    assert folder_names(["a.csv", "b.csv", "a.mat"]) == ["a-1", "b", "a-2"]


def test_an_estimate_of_nothing_has_digits():
    assert show_estimate(Estimate(0.0, 0.0, 0.0, "rad"))[0] == "0"
