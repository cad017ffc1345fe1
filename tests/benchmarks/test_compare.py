"""`python -m benchmarks compare`: its JSON, its pictures, its arithmetic."""

import json
import types

import pytest

from benchmarks.__main__ import main
from benchmarks.compare.goals import goals


@pytest.fixture(scope="module")
def compared(tmp_path_factory):
    """(exit code, folder) of a quick run."""
    folder = tmp_path_factory.mktemp("compare")
    return main(["compare", "--quick", "--out", str(folder)]), folder


@pytest.mark.long
def test_quick_run_writes_the_rows_the_goals_and_the_pictures(compared):
    code, folder = compared
    assert code == 0
    content = json.loads((folder / "compare.json").read_text())
    rows = content["rows"]
    methods = {"algorithm_1", "algorithm_1_repaired", "levenberg_marquardt", "lbfgs", "adam", "nelder_mead"}
    assert {row["method"] for row in rows} == methods | {"dense_sweep"}
    assert {row["reference"] for row in rows} == {"sine", "chirp", "joint"}
    assert {row["objective"] for row in rows} == {"estimation", "thesis"}
    assert len(rows) == 7 * 3 * 2
    assert len(content["goals"]) == 2 * 3 * 2 * 3
    assert {one["method"] for one in content["goals"] if one["headline"]} == {"levenberg_marquardt"}
    run = json.loads((folder / "run.json").read_text())
    assert run["status"] == "completed"
    assert set(run["outputs"]) == {"compare_efp_estimation.png", "compare_efp_thesis.png", "compare.json"}
    assert {"efp_estimation", "efp_thesis", "total"} <= set(run["seconds"])
    assert run["versions"]["jax"] == rows[0]["versions"]["jax"]
    for name in ("compare_efp_estimation.png", "compare_efp_thesis.png"):
        assert (folder / name).read_bytes().startswith(b"\x89PNG")


@pytest.mark.long
def test_every_contestant_has_the_same_start_and_keeps_its_budget(compared):
    rows = json.loads((compared[1] / "compare.json").read_text())["rows"]
    for row in rows:
        if row["method"] == "dense_sweep":
            continue
        budget = 24 * (2 if row["reference"] == "joint" else 1)
        assert 0 < row["simulations"] <= budget
        assert row["simulated_steps"] == 1001 * row["simulations"]
        assert row["history"][-1] == [row["simulations"], row["cost"]]
        assert {"jax", "fpjax", "numpy", "python"} <= set(row["versions"])
        same = [
            other["start_cost"]
            for other in rows
            if (other["objective"], other["reference"]) == (row["objective"], row["reference"])
            and other["method"] != "dense_sweep"
        ]
        assert max(same) - min(same) <= 1e-9 * max(same)
    joint = next(row for row in rows if row["method"] == "lbfgs" and row["reference"] == "joint")
    # Two references, two gains in forward mode.
    assert joint["history"][0][0] == 2 * 3


def row(method, cost, history):
    used = next(number for number, reached in history if reached <= cost)
    gains = {"gain_2": 1.0, "gain_1": 2.0}
    return {
        "observer": "efp",
        "objective": "estimation",
        "reference": "sine",
        "method": method,
        "cost": cost,
        "history": history,
        "simulations_to_best": used,
        "gains": gains,
        "message": "reason",
    }


@pytest.mark.parametrize(
    ("reached", "at", "fifth", "percent"), [(0.9, 20, True, True), (0.9, 21, False, True), (1.0, 20, True, False)]
)
def test_goals_are_computed_from_the_rows(reached, at, fifth, percent):
    rows = [
        row("dense_sweep", 0.895, [(100, 0.895)]),
        row("algorithm_1", 1.0, [(4, 3.0), (100, 1.0), (120, 1.0)]),
        row("levenberg_marquardt", reached, [(3, 3.0), (at, reached)]),
        row("lbfgs", 2.0, [(3, 2.0)]),
        row("adam", 2.0, [(3, 2.0)]),
    ]
    verdicts = {(one["method"], "fifth" in one["goal"]): one for one in goals(rows)}
    steps, minimum = (verdicts["levenberg_marquardt", fifths] for fifths in (True, False))
    assert steps["ratio"] == at / 100
    assert steps["headline"]
    assert minimum["headline"]
    assert (steps["met"], minimum["met"]) == (fifth, percent)
    assert bool(steps["why_not"]) != fifth
    assert bool(minimum["why_not"]) != percent


def test_each_method_has_its_own_verdict():
    """The default misses where another one arrives: the headline says missed."""
    rows = [
        row("dense_sweep", 0.895, [(100, 0.895)]),
        row("algorithm_1", 1.0, [(100, 1.0)]),
        row("levenberg_marquardt", 2.0, [(3, 2.0)]),
        row("lbfgs", 0.9, [(9, 0.9)]),
        row("adam", 0.95, [(50, 0.95)]),
    ]
    verdicts = {(one["method"], "fifth" in one["goal"]): one for one in goals(rows)}
    assert len(verdicts) == 6
    assert [verdicts[name, True]["met"] for name in ("levenberg_marquardt", "lbfgs", "adam")] == [False, True, False]
    assert [verdicts[name, False]["met"] for name in ("levenberg_marquardt", "lbfgs", "adam")] == [False, True, False]
    assert verdicts["adam", True]["ratio"] == 0.5
    assert [one["headline"] for one in goals(rows)] == [True, True, False, False, False, False]


def test_where_the_gradient_does_not_arrive_the_goal_says_where_it_ended():
    rows = [
        row("dense_sweep", 0.5, [(100, 0.5)]),
        row("algorithm_1", 1.0, [(4, 1.0)]),
        *(row(name, 2.0, [(3, 2.0)]) for name in ("levenberg_marquardt", "lbfgs", "adam")),
    ]
    steps, minimum, *_ = goals(rows)
    assert steps["ratio"] is None
    assert not steps["met"]
    assert "did not get below" in steps["why_not"]
    assert "the sweep's minimum is at (1, 2)" in minimum["why_not"]


def test_an_interrupted_comparison_keeps_its_finished_parts_and_goes_on(tmp_path, monkeypatch, capsys):
    from benchmarks.compare import race as module

    raced = []

    def race(case, objective, references, settings, share):
        if objective == "thesis" and not raced.count("interrupted"):
            raced.append("interrupted")
            raise KeyboardInterrupt
        raced.append(objective)
        names = ("dense_sweep", "algorithm_1", "levenberg_marquardt", "lbfgs", "adam")
        common = {"start_cost": 3.0, "simulations": 9, "run_seconds": 0.1, "compile_seconds": 0.2}
        return [{**row(name, 1.0, [(9, 1.0)]), **common, "objective": objective} for name in names]

    monkeypatch.setattr(module, "race", race)
    begin = ["compare", "--quick", "--out", str(tmp_path)]
    assert main(begin) == 130
    content = json.loads((tmp_path / "compare.json").read_text())
    assert {one["objective"] for one in content["rows"]} == {"estimation"}
    assert json.loads((tmp_path / "run.json").read_text())["status"] == "interrupted"
    assert main([*begin, "--resume", "--points", "9"]) == 2
    assert "was begun with" in capsys.readouterr().err
    assert main([*begin, "--resume"]) == 0
    assert raced == ["estimation", "interrupted", "thesis"]
    content = json.loads((tmp_path / "compare.json").read_text())
    assert [one["objective"] for one in content["rows"]] == ["estimation"] * 5 + ["thesis"] * 5
    assert main(["compare", "--quick", "--out", str(tmp_path / "none"), "--resume"]) == 2
    assert "no interrupted run" in capsys.readouterr().err


@pytest.mark.parametrize("option", [["--budget", "3"], ["--points", "1"]])
def test_absurd_options_end_with_one_sentence(option, tmp_path, capsys):
    assert main(["compare", "--quick", "--out", str(tmp_path), *option]) == 2
    assert option[0] in capsys.readouterr().err


def test_an_unwritable_folder_ends_with_one_sentence(tmp_path, capsys):
    (tmp_path / "file").write_text("")
    assert main(["compare", "--quick", "--out", str(tmp_path / "file" / "out")]) == 2
    said = capsys.readouterr().err.strip()
    assert "cannot be written" in said
    assert said.count("\n") == 0


def test_algorithm_1_is_raced_as_printed_without_bounds(monkeypatch):
    """Bounds stop its way: with them it ended at five times the cost on the constant and the square reference."""
    from benchmarks.compare import race
    from benchmarks.compare.cases import all_cases, references

    given = {}

    class EnoughError(Exception):
        pass

    def tune(*_, parameters, method, **__):
        given[type(method).__name__] = [(one.name, one.start, one.low, one.high) for one in parameters]
        if len(given) == 6:
            raise EnoughError
        gains = {"observer.gain_2": 1.0, "observer.gain_1": 1.0}
        empty = dict.fromkeys(("standing", "standing_cost", "cost", "start_cost", "simulations", "simulated_steps",
                               "run_seconds", "compile_seconds", "message", "identifiability", "versions"))  # fmt: skip
        return types.SimpleNamespace(**(empty | {"gains": gains, "history": [(1, 1.0)], "cost": 1.0}))

    monkeypatch.setattr(race.tuning, "tune", tune)
    monkeypatch.setattr(race, "_sweep_rows", lambda *_: [])
    case = all_cases()[0]
    with pytest.raises(EnoughError):
        race.race(case, "estimation", references(0.5), race.Settings(), lambda _: None)
    bounded = [(one.name, one.start, one.low, one.high) for one in case.parameters]
    assert all(None not in one for one in bounded)
    for method, parameters in given.items():
        wanted = [(name, start, None, None) for name, start, _, _ in bounded] if method == "GridSearch" else bounded
        assert parameters == wanted, method
