"""What every test of a command starts from."""

import shutil

import pytest
from cli_case import SERVO, run


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
