"""How a command ends that meets a defect, a full memory, an interrupt, a reader that has enough; and its progress."""

import gc
import json
import os
import pathlib
import re
import signal
import subprocess
import sys
import time

import pytest
from cli_case import REPO, refuse, run, shell

from fpjax.cli import command_line


def test_a_defect_is_said_without_a_traceback(servo, monkeypatch, capsys):
    monkeypatch.setattr("fpjax.cli.simulate.open_model", lambda *_: 1 / 0)
    refuse(capsys, "simulate", servo, match="defect of fpjax (ZeroDivisionError", code=1)


@pytest.mark.parametrize("error", [MemoryError(), RuntimeError("RESOURCE_EXHAUSTED: Out of memory.")])
def test_a_full_memory_is_one_sentence(servo, monkeypatch, capsys, error):
    def full(*_):
        raise error

    monkeypatch.setattr("fpjax.cli.simulate.open_model", full)
    refuse(capsys, "simulate", servo, match="out of memory: use fewer candidates")


def test_ctrl_c_is_130(servo, monkeypatch, capsys):
    def interrupt(*_):
        raise KeyboardInterrupt

    monkeypatch.setattr("fpjax.cli.simulate.open_model", interrupt)
    refuse(capsys, "simulate", servo, match="interrupted", code=130)


def test_a_reader_that_has_enough_is_no_error(servo):
    process = shell("simulate", servo, "--no-cache")
    process.stdout.close()
    error = process.stderr.read()
    assert process.wait(timeout=120) == 0
    assert "Traceback" not in error


def test_a_reader_that_has_enough_stops_no_file(log, tmp_path):
    out = tmp_path / "look"
    process = shell("inspect", log, "--no-plots", "--out", out)
    process.stdout.close()
    process.stderr.close()
    assert process.wait(timeout=120) == 0
    assert sorted(each.name for each in out.iterdir()) == ["inspection.json", "run.json", "servo.toml"]
    assert json.loads((out / "run.json").read_text())["status"] == "completed"


@pytest.mark.parametrize(
    ("number", "usual"), [(signal.SIGTERM, signal.SIG_DFL), (signal.SIGINT, signal.default_int_handler)]
)
def test_a_signal_within_a_callback_of_the_collector_is_not_lost(number, usual):
    """Python drops an exception that is raised there."""
    armed = []

    def callback(phase, info):
        del info
        if phase == "start" and armed:
            armed.clear()
            signal.raise_signal(number)

    before = signal.signal(number, usual)
    gc.callbacks.append(callback)
    try:
        with command_line._terminable():
            armed.append(True)
            gc.collect()
            with pytest.raises(KeyboardInterrupt):
                time.sleep(10.0)
    finally:
        gc.callbacks.remove(callback)
        signal.signal(number, before)


def test_an_edited_model_is_kept_beside_a_new_one(log, tmp_path, capsys):
    assert run("inspect", log, "--no-plots", "--out", tmp_path) == 0
    made = (tmp_path / "servo.toml").read_text()
    assert run("inspect", log, "--no-plots", "--out", tmp_path) == 0
    assert not (tmp_path / "servo.before.toml").exists()
    for name in ("servo.before.toml", "servo.before-2.toml"):
        (tmp_path / "servo.toml").write_text(f"# mine, {name}")
        assert run("inspect", log, "--no-plots", "--out", tmp_path) == 0
        assert f"kept as {name}" in capsys.readouterr().err
        assert (tmp_path / name).read_text() == f"# mine, {name}"
        assert (tmp_path / "servo.toml").read_text() == made
    # Nor does it pass for the model of a log of which none is made.
    still = tmp_path / "still.csv"
    still.write_text("time,torque,velocity\n" + "".join(f"{0.001 * k},{0.1 * (k % 7)},0\n" for k in range(200)))
    assert run("inspect", still, "--no-plots", "--out", tmp_path) == 0
    assert "kept as servo.before-3.toml" in capsys.readouterr().err
    assert not (tmp_path / "servo.toml").exists()
    refuse(capsys, "inspect", log, "--out", "", match="empty text")


@pytest.mark.skipif(not pathlib.Path("/dev/full").exists(), reason="no full device on this system")
@pytest.mark.parametrize("help_only", [True, False])
def test_an_output_that_cannot_be_written_is_one_sentence_and_the_files_are_whole(servo, tmp_path, help_only):
    words = ["simulate", "--help"] if help_only else ["simulate", servo, "--no-plots", "--out", tmp_path / "out"]
    with open("/dev/full", "w") as full:
        process = shell(*words, stdout=full)
    error = process.stderr.read()
    assert process.wait(timeout=120) == 2
    (said,) = [line for line in error.splitlines() if not line.startswith("note:")]
    assert said.startswith("fpjax: standard output could not be written (No space left on device)")
    assert help_only or json.loads((tmp_path / "out" / "run.json").read_text())["status"] == "completed"


def test_a_seed_that_no_generator_takes_is_refused_by_every_command(servo, log, tmp_path, capsys):
    words = {"simulate": [servo], "tune": [servo], "plan": [servo, "--out", tmp_path / "next"]}
    words["improve"] = [log, "--model", servo, "--out", tmp_path / "better"]
    for command, rest in words.items():
        for number in (2**63, -1):
            refuse(capsys, command, *rest, "--seed", number, match=f"from 0 to 9223372036854775807, got '{number}'")


def test_help_that_nobody_reads_is_no_error():
    process = shell("inspect", "--help")
    process.stdout.close()
    assert process.stderr.read() == ""
    assert process.wait(timeout=120) == 0


@pytest.mark.long  # a sweep that is long enough to tell its time left
def test_progress_is_shown_on_a_terminal_only(servo, tmp_path):
    pty = pytest.importorskip("pty")
    axes = ["--axis", "observer.gain_1=10:1e4:400", "--axis", "observer.gain_2=1:100:400", "--chunk", "256"]
    words = ["sweep", str(servo), *axes, "--out", str(tmp_path / "out"), "--no-plots", "--no-cache"]
    ours, theirs = pty.openpty()
    environment = {**os.environ, "PYTHONPATH": str(REPO)}
    process = subprocess.Popen(
        [sys.executable, "-m", "fpjax", *words], env=environment, stdout=subprocess.PIPE, stderr=theirs, text=True
    )
    os.close(theirs)
    shown = b""
    while True:
        try:
            piece = os.read(ours, 4096)
        except OSError:
            break
        if not piece:
            break
        shown += piece
    os.close(ours)
    printed, _ = process.communicate(timeout=60)
    assert process.returncode == 0
    assert b"s left" in shown
    assert "s left" not in printed


def test_time_left_is_told_between_bounds_where_it_is_not_known(monkeypatch):
    """A second round of causes may come or not: both are told, and the round's own pace once it runs."""
    from fpjax.gap import stage_costs as of_gap
    from fpjax.output import progress
    from fpjax.output.stages import StageClock

    clock = [0.0]
    monkeypatch.setattr(progress.time, "monotonic", lambda: clock[0])
    bar = progress.Stages("diagnose")
    work = {name: cost[1] for name, cost in of_gap.COSTS.items()}
    shares = []
    inner = bar.stage
    monkeypatch.setattr(bar, "stage", lambda name, share: (shares.append(float(share)), inner(name, share)))
    told = StageClock(bar.stage, of_gap.COSTS)
    told("looking")
    clock[0] += 10.0 * work["looking"]  # 10 s a unit of work
    told("effects alone")
    clock[0] += 5.0
    told("effects alone", 0.5)
    line = bar._line(clock[0])
    least, most = (float(word) for word in re.search(r", (\d+) to (\d+) s left|$", line).groups(default="nan"))
    assert least < 5.0 + 10.0 * (work["effects together (2)"]) < most or "at most" in line
    clock[0] += 5.0
    told("simpler causes")  # one cause was enough
    rest = 10.0 * sum(work[name] for name in list(work)[list(work).index("simpler causes") :])
    assert re.search(r"about \d s left|at most \d s left", bar._line(clock[0])), bar._line(clock[0])
    clock[0] += rest
    told.done()
    assert shares == sorted(shares)
    assert shares[-1] == 1.0


def test_the_share_of_several_works_is_between_bounds_too():
    from fpjax.output.work_done import WorkDone, part_of

    one = WorkDone(1.0, 1.0, 3.0)
    assert float(one) == 0.25
    assert part_of(one, 0, 1) is one
    assert part_of(0.5, 1, 3) == 0.5
    several = part_of(one, 1, 3)
    assert several.done == pytest.approx(1.0 + 1.0 / 3.0)
    assert several.least == pytest.approx(1.0 / 3.0 + 0.5)
    assert several.most == pytest.approx(1.0 + 1.5)


def test_stages_name_what_is_under_way(monkeypatch):
    import io

    from fpjax.output import progress

    class Terminal(io.StringIO):
        def isatty(self):
            return True

    monkeypatch.setattr(progress, "FIRST_SHOWN", 0.0)
    monkeypatch.setattr(progress, "REDRAWN", 0.01)
    screen = Terminal()
    monkeypatch.setattr(sys, "stderr", screen)
    with progress.Stages("diagnose", 3) as stages:
        stages.stage("fit", 0.5)
        time.sleep(0.2)
    assert "diagnose 1/3: fit" in screen.getvalue()
    assert "s left" in screen.getvalue()
    clock = [0.0]
    monkeypatch.setattr(progress.time, "monotonic", lambda: clock[0])
    resumed = progress.Stages("sweep")
    resumed.begin_at(0.5)
    clock[0] = 10.0
    resumed.stage("chunks", 0.75)
    # Half of what was left is done after 10 s: 10 s more, not 10 / 3.
    assert "about 10 s left" in resumed._line(10.0)
    resumed.end()
    clock[0] = 0.0
    compiled = progress.Stages("tune")
    compiled.stage("compiling")
    for now, share in ((30.0, 0.1), (40.0, 0.3)):  # 30 s of compiling, then a tenth of the whole every 5 s
        clock[0] = now
        compiled.stage("steps", share)
    assert "about 35 s left" in compiled._line(40.0)
    assert "about 25 s left" in compiled._line(50.0)  # no report since: it counts down
    compiled.end()
    # A first share that compiling is in says nothing of the pace.
    first = progress.Stages("sweep")
    first.stage("compiling, then the first chunk")
    clock[0] += 30.0
    first.stage("1 of 6 chunks", 1 / 6)
    assert "left" not in first._line(30.0)
    clock[0] += 2.0
    first.stage("2 of 6 chunks", 2 / 6)
    assert "about 8 s left" in first._line(32.0)
    first.end()
    # Another part of the same work goes on with its pace; what follows it counts too.
    further = progress.Stages("sweep", after=first, tail=3.0)
    clock[0] += 2.0
    further.stage("3 of 6 chunks", 3 / 6)
    assert "34 s, about 9 s left" in further._line(34.0)
    further.end()
    monkeypatch.undo()
    quiet = io.StringIO()
    monkeypatch.setattr(sys, "stderr", quiet)
    with progress.Stages("diagnose") as stages:
        stages.stage("fit")
        time.sleep(0.05)
    assert quiet.getvalue() == ""
