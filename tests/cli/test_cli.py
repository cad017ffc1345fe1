"""The command line as its user meets it: outputs, exit codes, one sentence and no traceback."""

import json
import os
import pathlib
import signal
import subprocess
import sys
import threading
import time

import numpy as np
import pytest

import fpjax
from fpjax.cli.command_line import COMMANDS, main
from fpjax.logs import read_log
from fpjax.model_file import load_model

REPO = pathlib.Path(__file__).parents[2]
EMPS = REPO.parent / "shared" / "data" / "emps" / "DATA_EMPS.mat"
SERVO = """
[plant]
type = "one_mass"
inertia = 10.0
[friction]
type = "coulomb_viscous"
coulomb = 20.0
viscous = 2.0
steepness = 100.0
[controller]
type = "pi"
kp = 150.0
ki = 200.0
[observer]
type = "efp"
gain_1 = 298.0
gain_2 = 72.6
[reference]
type = "sine"
amplitude = 1.0
frequency = 4.0
[simulation]
dt = 1e-3
duration = 1.0
stepping = "sampled"
"""


@pytest.fixture
def servo(tmp_path):
    path = tmp_path / "servo.toml"
    path.write_text(SERVO)
    return path


@pytest.fixture
def log(tmp_path, servo, capsys):
    assert main(["simulate", str(servo), "--out", str(tmp_path / "made"), "--no-plots", "--no-cache"]) == 0
    capsys.readouterr()
    return tmp_path / "made" / "simulation.csv"


def run(*words):
    return main([str(word) for word in words] + ["--no-cache"])


def refuse(capsys, *words, match, code=2):
    """The command ends with one sentence on stderr that says `match`, and no traceback."""
    try:
        got = run(*words)
    except SystemExit as exit:
        got = exit.code
    assert got == code
    error = capsys.readouterr().err
    sentences = [line for line in error.splitlines() if not line.startswith(("note:", "warning:"))]
    assert len(sentences) == 1, error
    assert match in sentences[0], error
    assert "Traceback" not in error
    return sentences[0]


def shell(*words, **options):
    environment = {**os.environ, "PYTHONPATH": str(REPO), "PYTHONDONTWRITEBYTECODE": "1"}
    command = [sys.executable, "-m", "fpjax", *map(str, words)]
    # Where the tests run in the background of a script, interrupts are ignored, and a child would inherit that.
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    try:
        return subprocess.Popen(
            command, env=environment, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, **options
        )
    finally:
        signal.signal(signal.SIGINT, before)


# ------------------------------------------------------------------------------------------------ help


def test_help_imports_no_jax_and_is_quick():
    code = "import sys, fpjax.cli as m\ntry:\n m.main(['--help'])\nexcept SystemExit: pass\n"
    code += "print(sorted({'jax', 'numpy', 'scipy', 'matplotlib'} & set(sys.modules)))"
    best = 1e9
    for _ in range(3):
        begin = time.perf_counter()
        done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, cwd=REPO, check=True)
        best = min(best, time.perf_counter() - begin)
    assert done.stdout.splitlines()[-1] == "[]"
    for name in COMMANDS:
        assert f"  {name}" in done.stdout
    bare = 1e9
    for _ in range(3):
        begin = time.perf_counter()
        subprocess.run([sys.executable, "-c", "import argparse"], check=True)
        bare = min(bare, time.perf_counter() - begin)
    assert best < bare + 0.15  # what the machine itself takes for Python is not ours


@pytest.mark.parametrize("command", COMMANDS)
def test_every_command_has_its_help(command, capsys):
    with pytest.raises(SystemExit) as exit:
        main([command, "--help"])
    assert exit.value.code == 0
    text = capsys.readouterr().out
    assert "--out" in text
    assert f"fpjax {command}" in text


def test_version(capsys):
    with pytest.raises(SystemExit):
        main(["--version"])
    from fpjax._version import __version__

    assert capsys.readouterr().out.strip() == f"fpjax {__version__}"


def test_what_is_mistyped_is_one_sentence(capsys):
    for words, match in (
        (["simulate"], "required: MODEL"),
        (["tune", "servo.toml", "--method", "magic"], "magic"),
        (["sweep", "servo.toml"], "--out"),
    ):
        with pytest.raises(SystemExit) as exit:
            main(words)
        assert exit.value.code == 2
        error = capsys.readouterr().err
        assert match in error
        assert error.count("\n") == 1
    refuse(capsys, "simulat", "servo.toml", match="there is no command 'simulat': did you mean 'simulate'?")
    assert main([]) == 0
    assert "a first hour" in capsys.readouterr().out


# -------------------------------------------------------------------------------------------- simulate


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
    direct = fpjax.simulate(
        model.loop, model.reference, dt=1e-3, duration=1.0, stepping="sampled", record=("velocity", "torque"),
        measures={"rms": fpjax.RootMeanSquare()},
    )  # fmt: skip
    assert measures["tracking error, rms"]["value"] == pytest.approx(float(direct.measures["rms"]), rel=1e-12)
    log = read_log(out / "simulation.csv")
    assert log.dt == 1e-3
    np.testing.assert_allclose(log.velocity, direct.signals["velocity"], atol=1e-9)
    np.testing.assert_allclose(log.torque, direct.signals["torque"], atol=1e-7)


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


def test_a_replay_of_the_models_own_log_is_exact(servo, log, tmp_path, capsys):
    out = tmp_path / "again"
    assert run("simulate", servo, "--log", log, "--out", out) == 0
    found = json.loads((out / "replay.json").read_text())
    assert found["errors"]["velocity"]["relative"] < 1e-6
    assert found["errors"]["torque"]["relative"] < 1e-6
    assert (out / "replay.png").stat().st_size > 10_000
    assert run("simulate", servo, "--log", log, "--set", "plant.friction.coulomb=25") == 0
    assert "velocity" in capsys.readouterr().out


@pytest.mark.skipif(not EMPS.exists(), reason="the EMPS records are not here")
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
    refuse(capsys, "simulate", example, "--log", EMPS, match="torque is in V and the model's in N")


# ---------------------------------------------------------------------------------------- sweep and tune


def test_sweep_and_its_resume_are_the_same(servo, tmp_path, capsys):
    words = ["sweep", servo, "--axis", "observer.gain_1=10:1e4:6", "--axis", "observer.gain_2=1:100:5", "--chunk", 8]
    assert run(*words, "--out", tmp_path / "a") == 0
    assert "least cost" in capsys.readouterr().out
    whole = np.load(tmp_path / "a" / "sweep.npz")
    assert whole["cost"].shape == (6, 5, 1)
    assert list(whole["axes"]) == ["observer.gain_1", "observer.gain_2", "reference"]
    assert (tmp_path / "a" / "sweep.png").exists()
    assert not (tmp_path / "a" / "chunks").exists()
    assert run(*words, "--out", tmp_path / "a", "--resume", "--no-plots") == 0
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


def test_tune_refuses_what_cannot_be(servo, tmp_path, capsys):
    refuse(capsys, "tune", servo, "--parameter", "observer.gain_1=5:1:10", match="starts outside its range")
    refuse(capsys, "tune", servo, "--parameter", "observer.gain_1=a:b:c", match="is not NAME=LOW:START:HIGH")
    refuse(capsys, "tune", servo, "--parameter", "observer.gain", match="did you mean")
    refuse(capsys, "tune", servo, "--references", "sine,cosine", match="'cosine' is not known")
    refuse(capsys, "tune", servo, "--plants", "plant.inertia", match="is not NAME=A,B")
    refuse(capsys, "tune", servo, "--after", "5", match="must lie within the run")
    refuse(capsys, "tune", servo, "--starts", "0", match="starts must be at least 1, got 0")


# -------------------------------------------------------------------------------- estimate and inspect


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


@pytest.mark.skipif(not EMPS.exists(), reason="the EMPS records are not here")
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


def test_inspect_needs_no_jax(log):
    code = f"import sys; from fpjax.cli import main; main(['inspect', {str(log)!r}, '--no-plots']); "
    code += "print(sorted({'jax', 'scipy'} & set(sys.modules)))"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, cwd=REPO, check=True)
    assert done.stdout.splitlines()[-1] == "[]"


# ------------------------------------------------------------------------------------------- bad input


def test_an_unwritable_out_is_found_before_anything_is_computed(servo, tmp_path, capsys):
    (tmp_path / "file").write_text("")
    for out in (tmp_path / "file", tmp_path / "file" / "deeper", "/proc/nothing/here"):
        refuse(capsys, "simulate", servo, "--out", out, match="cannot be written")


def test_missing_and_broken_files(servo, tmp_path, capsys):
    refuse(capsys, "simulate", tmp_path / "servoo.toml", match="did you mean 'servo.toml'")
    refuse(capsys, "simulate", tmp_path, match="is a folder")
    refuse(capsys, "inspect", tmp_path / "none.csv", match="does not exist")
    binary = tmp_path / "binary.toml"
    binary.write_bytes(bytes(range(256)))
    refuse(capsys, "simulate", binary, match="cannot be read")


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="no pipes on this system")
@pytest.mark.timeout(60)
def test_a_model_that_has_no_end_is_refused_and_not_waited_for(tmp_path, capsys):
    os.mkfifo(tmp_path / "servo.toml")
    os.symlink("/dev/zero", tmp_path / "zero.toml")
    for name in ("servo.toml", "zero.toml"):
        refuse(capsys, "simulate", tmp_path / name, match="is a pipe or a device")
    with open(tmp_path / "large.toml", "wb") as file:
        file.truncate(1 << 26)  # a hole: it takes no room
    refuse(capsys, "simulate", tmp_path / "large.toml", match="has 67 MB, and a model at most 20: is it a log?")


def test_a_bad_model_is_one_sentence(servo, capsys):
    servo.write_text(SERVO.replace("inertia = 10.0", "inertia = -10.0"))
    refuse(capsys, "simulate", servo, match="[plant] inertia must be above zero, got -10 kg m^2")
    servo.write_text(SERVO.replace("inertia = 10.0", "inertai = 10.0"))
    refuse(capsys, "tune", servo, match="[plant] inertai is not known: did you mean 'inertia'")


def test_a_step_past_the_stability_limit_warns_with_the_number(servo, capsys):
    servo.write_text(SERVO.replace("steepness = 100.0", "steepness = 5000.0"))
    assert run("simulate", servo) == 0
    error = capsys.readouterr().err
    assert "warning: steepness x coulomb x dt / inertia = 10 is past rk4's stability limit" in error
    assert "use a step below" in error


def test_gains_at_which_the_loop_blows_up(servo, tmp_path, capsys):
    servo.write_text(SERVO.replace("kp = 150.0", "kp = 150000.0"))
    refuse(capsys, "simulate", servo, "--out", tmp_path / "out", "--no-plots", match="The loop blows up at t =")
    assert (tmp_path / "out" / "simulation.csv").exists()
    assert json.loads((tmp_path / "out" / "run.json").read_text())["status"] == "bad input"
    refuse(capsys, "tune", servo, "--max-simulations", 12, match="Every start blows up")


def test_bad_logs_in_every_command_that_takes_one(servo, log, tmp_path, capsys):
    rows = log.read_text().splitlines()
    names = rows[0].split(",")
    still = [",".join("1" if name == "time" else cell for name, cell in zip(names, row.split(","), strict=True))
             for row in rows[1:]]  # fmt: skip
    cases = {
        "no clock": ([rows[0], *still], "time is 1 s in every row"),
        "short": (rows[:9], "is too short: 8 rows"),
        "two": ([",".join(row.split(",")[:2]) for row in rows], "has two columns"),
    }
    bad = tmp_path / "bad.csv"
    for lines, match in cases.values():
        bad.write_text("\n".join(lines) + "\n")
        refuse(capsys, "inspect", bad, match=match)
        refuse(capsys, "estimate", bad, "--model", servo, match=match)
        refuse(capsys, "diagnose", bad, "--model", servo, "--out", tmp_path / "why", match=match)
    refuse(capsys, "simulate", servo, "--log", bad, match="has two columns")


def test_a_period_that_is_not_the_models(servo, log, capsys):
    servo.write_text(SERVO.replace("dt = 1e-3", "dt = 2e-3"))
    refuse(capsys, "simulate", servo, "--log", log, match="[simulation] dt = 0.002 s: write dt = 0.001")


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


def test_a_defect_is_said_without_a_traceback(servo, monkeypatch, capsys):
    monkeypatch.setattr("fpjax.cli.simulate.open_model", lambda *_: 1 / 0)
    refuse(capsys, "simulate", servo, match="defect of fpjax (ZeroDivisionError", code=1)


@pytest.mark.parametrize("error", [MemoryError(), RuntimeError("RESOURCE_EXHAUSTED: Out of memory.")])
def test_a_full_memory_is_one_sentence(servo, monkeypatch, capsys, error):
    def full(*_):
        raise error

    monkeypatch.setattr("fpjax.cli.simulate.open_model", full)
    refuse(capsys, "simulate", servo, match="the memory is full: use fewer candidates")


def test_a_run_that_no_memory_holds_is_refused_before_it_begins(servo, capsys):
    refuse(capsys, "simulate", servo, "--duration", "1e12", match="record")


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


def test_the_documentation_names_every_option():
    from fpjax.cli.command_line import make_parser

    text = (REPO / "docs" / "cli.md").read_text()
    for name in COMMANDS:
        assert f"`fpjax {name}" in text
        parser = make_parser(name)._subparsers._group_actions[0].choices[name]
        for option in (word for action in parser._actions for word in action.option_strings if word.startswith("--")):
            assert option in text or option == "--help", f"{name} {option}"


def test_log_and_model_in_each_others_place(servo, log, capsys):
    refuse(capsys, "estimate", servo, "--model", log, match="is a log, not a model")
    refuse(capsys, "simulate", log, match="is a log, not a model")
    refuse(capsys, "inspect", servo, match="is a model, not a log")


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
    resumed = progress.Stages("sweep")
    resumed.begin_at(0.5)
    resumed.stage("chunks", 0.75)
    # Half of what was left is done after 10 s: 10 s more, not 10 / 3.
    assert "about 10 s left" in resumed._line(10.0)
    resumed.end()
    clock = [0.0]
    monkeypatch.setattr(progress.time, "monotonic", lambda: clock[0])
    compiled = progress.Stages("tune")
    for now, share in ((30.0, 0.1), (40.0, 0.3)):  # 30 s of compiling, then a tenth of the whole every 5 s
        clock[0] = now
        compiled.stage("steps", share)
    assert "about 35 s left" in compiled._line(40.0)
    assert "about 25 s left" in compiled._line(50.0)  # no report since: it counts down
    compiled.end()
    monkeypatch.undo()
    quiet = io.StringIO()
    monkeypatch.setattr(sys, "stderr", quiet)
    with progress.Stages("diagnose") as stages:
        stages.stage("fit")
        time.sleep(0.05)
    assert quiet.getvalue() == ""


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
