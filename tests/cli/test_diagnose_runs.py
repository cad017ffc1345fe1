"""Runs of `fpjax diagnose`: several logs, interrupts, what is kept and what is left out."""

import dataclasses
import json
import signal
import sys
import threading
import time
from pathlib import Path

import pytest
from cli_case import NOMINAL

from fpjax import InputError
from fpjax.cli import main


@pytest.fixture(autouse=True)
def heard():
    """Interrupts are heard, also by a run in the background of a shell, which ignores them."""
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    yield
    signal.signal(signal.SIGINT, before)


@pytest.fixture
def three(made, tmp_path):
    """Three logs, two of them of one name."""
    lines = (made / "log.csv").read_text().splitlines()
    for name, rows in (("run.csv", 900), ("run.txt", 1000), ("last.csv", 1100)):
        (tmp_path / name).write_text("\n".join(lines[:rows]) + "\n")
    return [str(tmp_path / name) for name in ("run.csv", "run.txt", "last.csv")]


@pytest.fixture
def quick(monkeypatch):
    """A diagnosis that takes no time: which logs it was asked for; the n-th call can be made to do something first."""
    from report_cases import bare

    asked, before = [], {}

    def diagnose(logs, model, **_):
        asked.append([log.name for log in logs])
        before.pop(len(asked), lambda: None)()
        return dataclasses.replace(bare(), model=NOMINAL, warnings=tuple(log.name for log in logs))

    monkeypatch.setattr("fpjax.gap.diagnose", diagnose)
    return asked, before


def interrupt():
    """Ctrl-C while the diagnosis is in a call that hears no signal."""
    released = threading.Event()
    threading.Timer(0.1, signal.raise_signal, [signal.SIGINT]).start()
    released.wait(120.0)


def test_each_goes_on_where_it_was_interrupted(made, three, quick, tmp_path, capsys):
    asked, before = quick
    before[2] = interrupt
    out = tmp_path / "why"
    words = ["diagnose", *three, "--each", "--model", str(made / "nominal.toml"), "--out", str(out), "--no-report"]
    begin = time.monotonic()
    assert main([*words, "--no-cache"]) == 130
    assert time.monotonic() - begin < 60.0
    error = capsys.readouterr().err
    assert f"interrupted: 1 of 3 logs are diagnosed in {out}; add --resume to the same command to go on" in error
    assert (out / "run.unfinished").exists()
    assert json.loads((out / "run.json").read_text())["status"] == "interrupted"
    assert main([*words, "--resume", "--no-cache"]) == 0
    said = capsys.readouterr()
    assert "run.csv was diagnosed before" in said.err
    assert f"run.txt, in {out / 'run-2'}:" in said.out
    assert f"last.csv, in {out / 'last'}:" in said.out
    assert asked == [["run.csv"], ["run.txt"], ["run.txt"], ["last.csv"]]
    assert not (out / "run.unfinished").exists()
    record = json.loads((out / "run.json").read_text())
    for name, log in (("run-1", "run.csv"), ("run-2", "run.txt"), ("last", "last.csv")):
        assert json.loads((out / name / "diagnosis.json").read_text())["warnings"] == [log]
        assert f"{name}/diagnosis.json" in record["outputs"]
    # Nothing is left to do, until a log, the model or an option is another one.
    assert main([*words, "--resume", "--no-cache"]) == 0
    assert len(asked) == 4
    Path(three[1]).write_text("\n".join(Path(three[1]).read_text().splitlines()[:-50]) + "\n")
    assert main([*words, "--resume", "--no-cache"]) == 0
    assert asked[4:] == [["run.txt"]]
    assert main([*words, "--resume", "--every", "2", "--no-cache"]) == 0
    assert len(asked) == 8
    # A diagnosis that was damaged since is made again.
    (out / "last" / "diagnosis.json").write_text("{")
    (out / "run-2" / "finished.json").unlink()
    assert main([*words, "--resume", "--every", "2", "--no-cache"]) == 0
    assert asked[8:] == [["run.txt"], ["last.csv"]]


def test_each_leaves_out_the_logs_that_cannot_be_diagnosed(made, three, quick, tmp_path, capsys):
    asked, before = quick

    def refuse():
        raise InputError("run.txt has no motion: record one with some.")

    before[2] = before[4] = before[5] = refuse
    out, short = tmp_path / "why", tmp_path / "short.csv"
    short.write_text("time,torque,velocity\n0,1,2\n0.001,1,2\n")
    options = ["--each", "--model", str(made / "nominal.toml"), "--out", str(out), "--no-report", "--no-cache"]
    words = ["diagnose", str(short), *three, *options]
    assert main(words) == 2
    error = capsys.readouterr().err
    assert "2 of 4 logs cannot be diagnosed. short.csv is too short" in error
    assert "run.txt has no motion" in error
    # What is finished is whole, and is not made again.
    assert not (out / "run.unfinished").exists()
    assert asked == [["run.csv"], ["run.txt"], ["last.csv"]]
    assert main([*words, "--resume"]) == 2
    assert asked[3:] == [["run.txt"]]
    # A mistake that all logs share takes no earlier result away.
    assert main(["diagnose", str(short), str(short), *options]) == 2
    assert "None of 2 logs can be diagnosed" in capsys.readouterr().err
    assert (out / "run-1" / "diagnosis.json").exists()
    # What can no longer be diagnosed leaves none that would pass for its own.
    Path(three[0]).write_text(short.read_text())
    assert main([*words, "--resume"]) == 2
    assert not (out / "run-1" / "diagnosis.json").exists()
    assert not (out / "run-1" / "finished.json").exists()
    assert (out / "last" / "diagnosis.json").exists()


def test_an_interrupted_diagnosis_leaves_a_marked_folder_and_says_how_to_go_on(made, quick, tmp_path, capsys):
    asked, before = quick
    before[1] = before[3] = interrupt
    out = tmp_path / "why"
    words = ["diagnose", str(made / "log.csv"), "--model", str(made / "nominal.toml"), "--out", str(out), "--no-report"]
    assert main([*words, "--no-cache"]) == 130
    error = capsys.readouterr().err
    assert f"what is fitted so far is kept in {out}, and the same command goes on from there" in error
    assert (out / "run.unfinished").exists()
    assert not (out / "diagnosis.json").exists()
    assert main([*words, "--no-cache"]) == 0
    assert not (out / "run.unfinished").exists()
    # One that was finished stays so: the interrupted one had written nothing over it.
    assert main([*words, "--no-cache"]) == 130
    assert f"{out / 'diagnosis.json'} is the earlier one" in capsys.readouterr().err
    assert not (out / "run.unfinished").exists()
    assert len(asked) == 3


def test_the_time_left_is_that_of_all_logs(made, three, quick, tmp_path, monkeypatch):
    found, told = sys.modules["fpjax.gap"].diagnose, []

    def diagnose(logs, model, *, progress, **words):
        for share in (0.1, 0.5, 1.0):
            progress("effects", share)
        return found(logs, model, **words)

    monkeypatch.setattr("fpjax.gap.diagnose", diagnose)
    monkeypatch.setattr("fpjax.cli.diagnose.Stages.stage", lambda self, *words: told.append(words))
    words = ["diagnose", *three, "--each", "--model", str(made / "nominal.toml"), "--no-report", "--no-cache"]
    assert main([*words, "--out", str(tmp_path / "why")]) == 0
    of_logs = [words for words in told if words[0].startswith("log ")]
    assert [name for name, _ in of_logs[::3]] == [f"log {place} of 3, effects" for place in (1, 2, 3)]
    shares = [share for _, share in of_logs]
    assert shares == sorted(shares)
    assert shares[4] == pytest.approx(1.5 / 3)
    assert shares[-1] == 1.0


def test_what_the_reader_says_is_said_once(made, quick, tmp_path, capsys, monkeypatch):
    found = sys.modules["fpjax.gap"].diagnose
    monkeypatch.setattr(
        "fpjax.gap.diagnose",
        lambda logs, model, **words: dataclasses.replace(
            found(logs, model, **words), warnings=(*logs[0].warnings, "new")
        ),
    )
    text = (made / "log.csv").read_text().replace("time,torque,velocity", "Zeit,Drehmoment,velocity")
    (tmp_path / "log.csv").write_text(text)
    words = ["diagnose", str(tmp_path / "log.csv"), "--model", str(made / "nominal.toml"), "--no-report", "--no-cache"]
    assert main([*words, "--out", str(tmp_path / "why")]) == 0
    shown = capsys.readouterr()
    assert (shown.out + shown.err).count("taken by their names") == 1
    assert shown.out.count("warning: new") == 1
    assert "taken by their names" in json.loads((tmp_path / "why" / "diagnosis.json").read_text())["warnings"][0]


@pytest.mark.parametrize("name", ["...csv", "..csv"])
def test_a_log_of_any_name_stays_within_out(made, quick, tmp_path, name):
    (tmp_path / name).write_bytes((made / "log.csv").read_bytes())
    out = tmp_path / "sub" / "inner"
    words = ["diagnose", str(tmp_path / name), "--each", "--model", str(made / "nominal.toml"), "--out", str(out)]
    assert main([*words, "--no-report", "--no-cache"]) == 0
    assert {path.name for path in (tmp_path / "sub").iterdir()} == {"inner"}
    assert len(list(out.glob("*/diagnosis.json"))) == 1
    assert sorted(path.name for path in tmp_path.iterdir()) == sorted([name, "sub"])
