"""`fpjax sweep --tuned`: the paths of a tuning of the same model, and nobody else's."""

import hashlib
import json

import cli_case
import pytest

from fpjax.cli import main

SERVO = cli_case.SERVO.replace("duration = 1.0", "duration = 0.2")
AXES = ["--axis", "observer.gain_1=10:1e4:4", "--axis", "observer.gain_2=1:100:3"]
PATH = {"observer.gain_1": [20.0, 300.0], "observer.gain_2": [2.0, 30.0]}


@pytest.fixture
def servo(tmp_path):
    path = tmp_path / "servo.toml"
    path.write_text(SERVO)
    return path


@pytest.fixture
def tuned(tmp_path, servo):
    """What `fpjax tune --out` leaves, as far as a sweep reads it."""

    def leave(model=servo, **changed):
        folder = tmp_path / "tuned"
        folder.mkdir(exist_ok=True)
        result = {"method": "adam", "objective": "estimation", "references": ["sine"], "path": PATH} | changed
        (folder / "tune.json").write_text(json.dumps({"best": "adam", "results": [result]}))
        inputs = [{"role": "model", "sha256": hashlib.sha256(model.read_bytes()).hexdigest()}]
        (folder / "run.json").write_text(json.dumps({"status": "completed", "inputs": inputs}))
        return folder

    return leave


def sweep(servo, tuned, out):
    return main(["sweep", str(servo), *AXES, "--tuned", str(tuned), "--out", str(out), "--no-cache"])


def test_the_path_is_drawn(servo, tuned, tmp_path, capsys):
    assert sweep(servo, tuned(), tmp_path / "grid") == 0
    page = (tmp_path / "grid" / "sweep.html").read_text()
    assert '"name": "adam"' in page
    assert "[[20.0, 2.0], [300.0, 30.0]]" in page
    assert "another model" not in capsys.readouterr().err
    run = json.loads((tmp_path / "grid" / "run.json").read_text())
    assert {"sweep.png", "sweep.html"} <= set(run["outputs"])


@pytest.mark.parametrize(
    ("changed", "words"),
    [
        ({"objective": "tracking"}, "minimised the tracking cost"),
        ({"references": ["chirp"]}, "on chirp"),
        ({"path": {"controller.kp": [1.0]}}, "sweep the parameters that were tuned"),
        ({"path": None}, "holds no paths"),
    ],
)
def test_another_problem_is_refused_in_one_sentence(servo, tuned, tmp_path, capsys, changed, words):
    assert sweep(servo, tuned(**changed), tmp_path / "grid") == 2
    said = capsys.readouterr().err.strip()
    assert words in said
    assert "Traceback" not in said


def test_a_folder_without_a_tuning_is_refused(servo, tmp_path, capsys):
    assert sweep(servo, tmp_path, tmp_path / "grid") == 2
    assert "has no run.json" in capsys.readouterr().err
