"""`fpjax improve` as it is typed: what it writes, how it goes on, what it refuses."""

import json
import types

import improve_case as case
import numpy as np
import pytest

from fpjax.cli import improve, main
from fpjax.output.runfile import MARK, RunFile


def write(folder, *, more="", reference=True, controller=True):
    log = case.log()
    columns = {"time": log.time, "torque": log.torque, "velocity": log.velocity, "position": log.position}
    if reference:
        columns["reference"] = log.reference
    rows = np.stack(list(columns.values()), axis=1)
    np.savetxt(folder / "run.csv", rows, delimiter=",", header=",".join(columns), comments="", fmt="%.10g")
    text = case.text(more)
    if not controller:
        text = text.replace('type = "pi"\nkp = 1.5\nki = 8.0', 'type = "unknown"')
    (folder / "servo.toml").write_text(text)
    return ["improve", str(folder / "run.csv"), "--model", str(folder / "servo.toml"), "--out", str(folder / "out")]


def diagnosed():
    """What `diagnose` returns, as far as improve looks at it."""
    known = case.known()
    content = {
        "verdict": "explained", "causes": ["coulomb_error"], "gap": {"after": 0.0}, "model": known.model,
        "provenance": {"inputs": []}, "tracking": {"measured": 1.0}, "learned": [],
    }  # fmt: skip
    return types.SimpleNamespace(
        posterior=known.posterior, verdict=known.verdict, causes=known.causes,
        gap=types.SimpleNamespace(before=0.1, after=0.0),
        learned=(), tracking=object(), model=known.model, learned_model="", model_missing="",
        ranking=(), contradiction="", to_dict=lambda: content,
    )  # fmt: skip


@pytest.mark.parametrize(
    ("words", "options", "said"),
    [
        ([], {"controller": False}, "[controller] is unknown"),
        (["--free", "controller"], {"reference": False}, "has no reference"),
        ([], {}, "Nothing may change"),
        (["--free", "controller.kp=9"], {}, "NAME=LOW:HIGH"),
        (["--free", "controller", "--diagnosis", "nowhere"], {}, "holds no diagnosis.json"),
        ([], {"more": "[bounds]\ncontroller.kp = [3.0, 5.0]\n"}, "outside its own bounds"),
    ],
)
def test_what_cannot_be_is_one_sentence_and_exit_code_2(tmp_path, capsys, words, options, said):
    assert main([*write(tmp_path, **options), *words]) == 2
    complaint = capsys.readouterr().err
    assert said in complaint
    assert "Traceback" not in complaint
    assert complaint.strip().count("\n") <= 2
    assert not (tmp_path / "out" / "improve.json").exists()


def test_another_runs_diagnosis_does_not_stay_beside_the_new_gains(tmp_path):
    out, own = tmp_path / "out", ("diagnosis.json", "corrected.toml", "posterior.npz", "diagnosed.json")
    out.mkdir()
    found = types.SimpleNamespace(notes=(), to_dict=dict, model="[simulation]\n[reference]\n")

    def written(given):
        for name in own:
            (out / name).write_text("of an earlier run")
        record = RunFile(out, ["fpjax", "improve"])
        improve._write(found, case.log(), record, types.SimpleNamespace(diagnosis=given, no_report=True))
        return {path.name for path in out.iterdir()} - {MARK}

    assert written(str(tmp_path / "other")) == {"improve.json", "tuned.toml"}
    # its own diagnosis, made in this run or given by its folder, stays
    assert set(own) < written(None)
    assert set(own) < written(str(out))


@pytest.mark.long
def test_an_interrupt_keeps_the_diagnosis_and_the_same_command_goes_on(tmp_path, monkeypatch, capsys):
    from fpjax.improvement import verb

    case.few(monkeypatch)
    words = [*write(tmp_path), "--free", "controller", "--free", "feedforward"]
    real, out = verb.search, tmp_path / "out"

    def interrupted(*_, **__):
        raise KeyboardInterrupt

    monkeypatch.setattr(verb, "diagnose", lambda *_, **__: diagnosed())
    monkeypatch.setattr(verb, "search", interrupted)
    assert main(words) == 130
    assert "the diagnosis is kept" in capsys.readouterr().err
    assert (out / "run.unfinished").exists()

    def never(*_, **__):
        raise AssertionError("diagnosed again")

    monkeypatch.setattr(verb, "diagnose", never)
    monkeypatch.setattr(verb, "search", real)
    assert main(words) == 0
    said = capsys.readouterr()
    assert "finished before" in said.err
    assert "Change these gains" in said.out
    content = json.loads((out / "improve.json").read_text())
    assert content["decision"] == "change"
    assert {"improve.html", "improve.png", "tuned.toml", "diagnosis.json"} <= {path.name for path in out.iterdir()}
    run = json.loads((out / "run.json").read_text())
    assert run["status"] == "completed"
    assert {"diagnosis.json", "posterior.npz", "tuned.toml"} <= set(run["outputs"])
    # The search is finished too: a third run only judges and writes.
    monkeypatch.setattr(verb, "search", never)
    assert main(words) == 0
    capsys.readouterr()
    assert main(["simulate", str(out / "tuned.toml"), "--no-plots"]) == 0
    assert "tracking error" in capsys.readouterr().out
    code = tmp_path / "code"
    assert main(["export", str(out / "tuned.toml"), "--c", str(code), "--check"]) == 0
