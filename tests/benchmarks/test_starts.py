"""`python -m benchmarks starts`: its machines, its table, its bad input."""

import json

import numpy as np
import pytest

from benchmarks.__main__ import main
from benchmarks.starts import command, machines
from fpjax.gap.data.record import make_records
from fpjax.gap.data.setting import make_setting
from fpjax.gap.effects.vocabulary import on_rate_sensor


@pytest.fixture(scope="module")
def drawn():
    return machines.draw("constant_torque", 0, 0)


def test_a_machine_lacks_its_effect_in_the_model_and_has_it_in_the_log(drawn):
    again = machines.draw("constant_torque", 0, 0)
    np.testing.assert_array_equal(drawn.log.torque, again.log.torque)
    assert not np.array_equal(drawn.log.torque, machines.draw("constant_torque", 0, 1).log.torque)
    assert drawn.values["torque"] != 0.0
    for number in ("inertia", "coulomb", "viscous"):
        assert drawn.values[number] == drawn.model.nominal[number]
    # What pushes is in what the loop has to give: the mean torque, over whole periods of nothing in particular.
    free = machines._log(drawn.model, drawn.model.loop, 1)
    assert np.mean(free.torque - drawn.log.torque) == pytest.approx(drawn.values["torque"], rel=0.2)


def test_every_effect_that_has_starts_has_true_values_within_its_bounds(drawn):
    setting = make_setting(make_records([drawn.log], [], drawn.model.nominal["inertia"]), drawn.model)
    random = machines._Random(np.random.default_rng(0))
    for effect in machines.BY_NAME.values():
        own = {p.name: p for p in (*effect.parameters, *effect.fixed) if p.name not in ("coulomb", "viscous")}
        for _ in range(20):
            values = machines._values(effect.name, setting, random)
            assert values.keys() == own.keys()
            for name, value in values.items():
                assert own[name].low(setting) <= value <= own[name].high(setting), (effect.name, name)
            assert any(value != own[name].neutral(setting) for name, value in values.items())


def test_an_error_of_the_rate_sensor_is_drawn_without_an_encoder_beside_it(drawn):
    assert drawn.log.position is not None
    late = machines.draw("velocity_lag", 0, 0)
    assert on_rate_sensor(late.effect)
    assert late.log.position is None
    assert late.log.velocity is not None


def test_the_table_counts_what_is_found():
    behind = {"stribeck": (0.1, -3.0, 10.0), "backlash": (10.1, 500.0)}
    rows = [
        {"effect": name, "number": n, "behind": value, "gains": 100.0, "cpu_s": 1.0}
        for name, values in behind.items()
        for n, value in enumerate(values)
    ]
    lines = [line.split() for line in command.table(rows)]
    assert lines[1] == ["stribeck", "3", "of", "3", "0.1", "10.0"]
    assert lines[2] == ["backlash", "0", "of", "2", "500.0", "500.0"]
    assert lines[3][:4] == ["all", "3", "of", "5"]
    assert "ANOTHER END" in command._line(rows[3])
    assert "found" in command._line(rows[2])


def test_a_run_that_diverged_comes_back_from_its_file():
    row = {"effect": "stribeck", "behind": np.inf, "gains": 1.0}
    kept = json.loads(json.dumps(command._written(row), allow_nan=False))
    assert kept["behind"] is None
    assert command._read(kept) == row


@pytest.mark.parametrize(
    ("words", "sentence"),
    [
        (["--machines", "0"], "--machines 0 must be at least 1"),
        (["--seed", "-1"], "--seed -1 not below zero"),
        (["--effects", "backlash,play"], "--effects: play is not one that starts are made for: choose of stribeck, "),
        (["--resume"], "holds no interrupted run"),
    ],
)
def test_bad_input_is_one_sentence(words, sentence, tmp_path, capsys):
    assert main(["starts", "--out", str(tmp_path), *words]) == 2
    assert sentence in capsys.readouterr().err


@pytest.mark.long
def test_a_run_is_resumed_and_written(tmp_path, monkeypatch, capsys):
    made = []

    def judged(drawn, tick=None):
        made.append(drawn.effect.name)
        if len(made) == 2:
            raise KeyboardInterrupt
        return {"behind": 1.0, "gains": 50.0, "truth": drawn.values, "cpu_s": 0.0}

    monkeypatch.setattr(command, "judge", judged)
    words = ["starts", "--out", str(tmp_path), "--effects", "constant_torque,unbalance", "--machines", "1"]
    assert main(words) == 130
    assert main([*words, "--resume"]) == 0
    assert made == ["constant_torque", "unbalance", "unbalance"]
    assert [row["effect"] for row in json.loads((tmp_path / "starts.json").read_text())["machines"]] == made[:2]
    assert "2 of 2" in capsys.readouterr().out


@pytest.mark.long
def test_a_constant_torque_is_found_from_its_own_starts(drawn):
    row = command.judge(drawn)
    assert row["behind"] < command.NEAR
    assert row["gains"] > 100.0
    assert row["found"]["torque"] == pytest.approx(drawn.values["torque"], rel=0.02)
