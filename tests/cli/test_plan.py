"""`fpjax plan` is interrupted: at once where there is nothing to keep, else with the best run so far."""

import json
import signal
import threading
import time
from types import SimpleNamespace

import pytest
from model_files import SMALL_SERVO

from fpjax.cli.command_line import main


@pytest.fixture
def servo(tmp_path):
    path = tmp_path / "servo.toml"
    path.write_text(SMALL_SERVO)
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    yield str(path)
    signal.signal(signal.SIGINT, before)


def interrupted(servo, out, monkeypatch, design, number=signal.SIGINT):
    """(exit code, seconds until it ended) of a plan that is interrupted after a tenth of a second."""
    begun = []

    def plan(model, *, progress, **options):
        del model, options
        begun.append(time.perf_counter())
        threading.Timer(0.1, signal.raise_signal, [number]).start()
        return design(progress)

    monkeypatch.setattr("fpjax.plan", plan)
    code = main(["plan", "--model", servo, "--out", str(out), "--no-plots"])
    return code, time.perf_counter() - begun[0]


def test_an_interrupt_within_the_compiler_is_heard_at_once(servo, tmp_path, monkeypatch, capsys):
    done = threading.Event()

    def compiling(progress):
        progress("compiling the trial", 0.0)
        done.wait(30.0)  # one call that hears nothing

    code, seconds = interrupted(servo, tmp_path / "out", monkeypatch, compiling)
    done.set()
    assert code == 130
    assert seconds < 10.0
    assert "no run was found yet" in capsys.readouterr().err
    assert json.loads((tmp_path / "out" / "run.json").read_text())["status"] == "interrupted"


@pytest.mark.parametrize(("number", "wanted"), [(signal.SIGINT, 130), (signal.SIGTERM, 143)])
def test_an_interrupt_of_the_search_keeps_the_best_run_so_far(servo, tmp_path, monkeypatch, number, wanted):
    class Best(SimpleNamespace):
        def write_reference(self, path):
            path.write_text("time,reference\n")

        def to_dict(self):
            return {"ended": self.ended}

    def searching(progress):
        try:
            for _ in range(600):
                progress("trying starts", 0.1)
                time.sleep(0.05)
        except KeyboardInterrupt:
            progress("writing it down", 1.0)  # the stages after the search are heard out
            return Best(ended="interrupted", notes=())
        return Best(ended="converged", notes=())

    code, seconds = interrupted(servo, tmp_path / "out", monkeypatch, searching, number)
    assert code == wanted
    assert seconds < 10.0
    assert json.loads((tmp_path / "out" / "plan.json").read_text())["ended"] == "interrupted"
    assert (tmp_path / "out" / "reference.csv").exists()


def test_a_second_interrupt_of_a_plan_ends_at_once(servo, tmp_path, monkeypatch, capsys):
    released = threading.Event()

    def searching(progress):
        progress("trying starts", 0.1)
        threading.Timer(0.5, signal.raise_signal, [signal.SIGINT]).start()
        released.wait(30.0)  # hears nothing
        return None

    code, seconds = interrupted(servo, tmp_path / "out", monkeypatch, searching)
    released.set()
    assert code == 130
    assert seconds < 10.0
    error = capsys.readouterr().err
    assert "ending with the best run so far" in error
    assert "no run was kept" in error
