"""`fpjax sweep` and `fpjax tune` as their user meets them: results, resumes, interrupts, refusals."""

import json
import signal
import threading
import time

import numpy as np
import pytest
from cli_case import refuse, run, shell

from fpjax import load_model


def test_sweep_and_its_resume_are_the_same(servo, tmp_path, capsys):
    words = ["sweep", servo, "--axis", "observer.gain_1=10:1e4:6", "--axis", "observer.gain_2=1:100:5", "--chunk", 8]
    assert run(*words, "--out", tmp_path / "a") == 0
    assert "least cost" in capsys.readouterr().out
    whole = np.load(tmp_path / "a" / "sweep.npz")
    assert whole["cost"].shape == (6, 5, 1)
    assert list(whole["axes"]) == ["observer.gain_1", "observer.gain_2", "reference"]
    assert (tmp_path / "a" / "sweep.png").exists()
    assert not (tmp_path / "a" / "chunks").exists()
    capsys.readouterr()
    ran = (tmp_path / "a" / "run.json").read_text()
    assert run(*words, "--out", tmp_path / "a", "--resume", "--no-plots") == 0
    assert "finished before" in capsys.readouterr().err
    assert (tmp_path / "a" / "run.json").read_text() == ran
    assert (tmp_path / "a" / "sweep.png").exists()
    other = [word if "gain_2" not in str(word) else "observer.gain_2=1:100:4" for word in words]
    refuse(capsys, *other, "--out", tmp_path / "a", "--resume", match="holds a finished sweep")
    np.testing.assert_array_equal(np.load(tmp_path / "a" / "sweep.npz")["cost"], whole["cost"])
    # A run of the same command that was stopped before its first chunk is gone on with, as it says.
    (tmp_path / "a" / "run.json").rename(tmp_path / "a" / "run.unfinished")
    assert run(*words, "--out", tmp_path / "a", "--resume", "--no-plots") == 0
    assert "finished before" not in capsys.readouterr().err
    np.testing.assert_array_equal(np.load(tmp_path / "a" / "sweep.npz")["cost"], whole["cost"])


@pytest.mark.parametrize(
    ("number", "code", "word"), [(signal.SIGINT, 130, "interrupted"), (signal.SIGTERM, 143, "terminated")]
)
def test_ctrl_c_and_termination_in_a_sweep_keep_what_is_done(servo, tmp_path, number, code, word):
    axes = ["--axis", "observer.gain_1=10:1e4:200", "--axis", "observer.gain_2=1:100:200", "--chunk", "64"]
    process = shell("sweep", servo, *axes, "--out", tmp_path / "out", "--no-plots", "--no-cache")
    chunks = tmp_path / "out" / "chunks"
    deadline = time.monotonic() + 120
    while time.monotonic() < deadline and len(list(chunks.glob("chunk-*.npy")) if chunks.exists() else []) < 2:
        assert process.poll() is None, process.communicate()
        time.sleep(0.05)
    process.send_signal(number)
    _, error = process.communicate(timeout=60)
    assert process.returncode == code, error
    assert f"{word}: finished chunks are kept" in error
    assert "--resume" in error
    assert "Traceback" not in error
    assert len(list(chunks.glob("chunk-*.npy"))) >= 2
    assert json.loads((tmp_path / "out" / "run.json").read_text())["status"] == "interrupted"
    assert (tmp_path / "out" / "run.unfinished").exists()


def test_an_interrupted_tuning_ends_at_once_and_keeps_the_finished_methods(servo, tmp_path, monkeypatch, capsys):
    import tuning

    tune, released, asked = tuning.tune, threading.Event(), []

    def slow(*arguments, method, **settings):
        if method == "grid":
            return tune(*arguments, method=tuning.GridSearch(iterations=1), **settings)
        asked.append(time.monotonic())  # compiling the first method before took what it took
        threading.Timer(0.1, signal.raise_signal, [signal.SIGINT]).start()
        released.wait(300.0)  # as in a call of the compiler, which hears no signal
        raise AssertionError

    monkeypatch.setattr(tuning, "tune", slow)
    out = tmp_path / "out"
    before = signal.signal(signal.SIGINT, signal.default_int_handler)  # a job in a shell's background ignores it
    try:
        assert run("tune", servo, "--method", "grid", "--method", "lbfgs", "--out", out) == 130
    finally:
        spent = time.monotonic() - asked[0]
        released.set()
        signal.signal(signal.SIGINT, before)
    assert spent < 60.0
    assert "what grid found is kept" in capsys.readouterr().err
    assert [one["method"] for one in json.loads((out / "tune.json").read_text())["results"]] == ["grid"]
    assert (out / "tuned.toml").exists()
    assert json.loads((out / "run.json").read_text())["status"] == "interrupted"
    # Nothing takes the folder for a finished run.
    monkeypatch.setattr("os.getpid", lambda: -1)
    refuse(capsys, "simulate", out / "tuned.toml", match="has not finished")


@pytest.mark.parametrize(
    ("axis", "match"),
    [
        ("observer.gain_1=10:1:5", "the range from 10 to 1 is empty"),
        ("observer.gain_1=0:10:5", "must be above zero on a log scale"),
        ("observer.gain_1=1:10:0", "leaves nothing to sweep"),
        ("observer.gain_1=1:inf:5", "is not NAME=LOW:HIGH:COUNT"),
        ("observer.gain_1=1:10", "is not NAME=LOW:HIGH:COUNT"),
        ("observer.gain_1=1:10:2.5", "is not NAME=LOW:HIGH:COUNT"),
        ("observer.gain_1=1:10:5:cubic", "scale = 'cubic' is not known"),
        ("observer.gain_3=1:10:5", "did you mean 'observer.gain_"),
        ("nothing", "is not NAME=LOW:HIGH:COUNT"),
    ],
)
def test_absurd_sweep_ranges(servo, tmp_path, capsys, axis, match):
    refuse(capsys, "sweep", servo, "--axis", axis, "--out", tmp_path / "out", match=match)


def test_nothing_to_sweep(servo, tmp_path, capsys):
    refuse(capsys, "sweep", servo, "--out", tmp_path / "out", match="give at least one --axis")


@pytest.mark.long
def test_tune_by_two_methods_writes_a_model_that_runs_better(servo, tmp_path, capsys):
    out = tmp_path / "out"
    words = ["--method", "levenberg_marquardt", "--method", "grid", "--max-simulations", 40]
    assert run("tune", servo, *words, "--out", out) == 0
    assert "levenberg_marquardt" in capsys.readouterr().out
    results = json.loads((out / "tune.json").read_text())["results"]
    assert [result["method"] for result in results] == ["levenberg_marquardt", "grid"]
    assert all(result["cost"] < result["start_cost"] for result in results)
    best = min(results, key=lambda result: result["cost"])
    tuned = load_model(out / "tuned.toml")
    assert float(tuned.loop.observer.gain_1) == best["gains"]["observer.gain_1"]
    assert "# tuned from 298" in (out / "tuned.toml").read_text()
    assert (out / "tune.png").stat().st_size > 10_000


@pytest.mark.parametrize(("method", "least"), [("levenberg_marquardt", 3), ("grid", 4), ("nelder_mead", 1)])
def test_a_budget_below_one_iteration_is_no_divergence(servo, capsys, method, least):
    words = ["tune", servo, "--method", method, "--max-simulations"]
    for budget in (0, least - 1):
        match = f"max_simulations = {budget} ends before the first iteration, which needs {least} simulations"
        refuse(capsys, *words, budget, match=match)


def test_what_a_method_found_is_kept_where_the_next_cannot_begin(servo, tmp_path, capsys):
    words = ["tune", servo, "--method", "levenberg_marquardt", "--method", "grid", "--max-simulations", 3, "--no-plots"]
    refuse(capsys, *words, "--out", tmp_path / "out", match="What levenberg_marquardt found is kept in")
    assert "gain" in (tmp_path / "out" / "tuned.toml").read_text()


def test_tune_refuses_what_cannot_be(servo, tmp_path, capsys):
    refuse(capsys, "tune", servo, "--parameter", "observer.gain_1=5:1:10", match="starts outside its range")
    refuse(capsys, "tune", servo, "--parameter", "observer.gain_1=a:b:c", match="is not NAME=LOW:START:HIGH")
    refuse(capsys, "tune", servo, "--parameter", "observer.gain", match="did you mean")
    refuse(capsys, "tune", servo, "--references", "sine,cosine", match="'cosine' is not known")
    refuse(capsys, "tune", servo, "--plants", "plant.inertia", match="is not NAME=A,B")
    refuse(capsys, "tune", servo, "--after", "5", match="must lie within the run")
    refuse(capsys, "tune", servo, "--starts", "0", match="starts must be at least 1, got 0")
