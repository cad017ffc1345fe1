"""What every test of a command starts from."""

import shutil

import pytest
from cli_case import NOMINAL, SERVO, run


@pytest.fixture
def servo(tmp_path):
    """A servo.toml."""
    path = tmp_path / "servo.toml"
    path.write_text(SERVO)
    return path


@pytest.fixture(scope="session")
def simulated(tmp_path_factory):
    """What `fpjax simulate` of it leaves, simulated once."""
    folder = tmp_path_factory.mktemp("simulated")
    (folder / "servo.toml").write_text(SERVO)
    assert run("simulate", folder / "servo.toml", "--out", folder / "made", "--no-plots") == 0
    return folder / "made"


@pytest.fixture
def log(tmp_path, simulated, capsys):
    """The simulated log, a copy of each test's own."""
    capsys.readouterr()
    return shutil.copytree(simulated, tmp_path / "made") / "simulation.csv"


@pytest.fixture(scope="session")
def made(tmp_path_factory):
    """A folder with nominal.toml and a log whose truth has a constant torque of 2 N m besides."""
    folder = tmp_path_factory.mktemp("diagnose")
    (folder / "nominal.toml").write_text(NOMINAL)
    truth = NOMINAL.replace("viscous = 2.0", "viscous = 2.0\noffset = -2.0") + "[sensor]\nnoise = 1e-3\n"
    (folder / "truth.toml").write_text(truth)
    words = ["simulate", str(folder / "truth.toml"), "--out", str(folder / "made"), "--no-plots"]
    assert run(*words) == 0
    rows = [line.split(",")[:3] for line in (folder / "made" / "simulation.csv").read_text().splitlines()]
    assert rows[0] == ["time", "torque", "velocity"]
    (folder / "log.csv").write_text("\n".join(",".join(row) for row in rows) + "\n")
    return folder
