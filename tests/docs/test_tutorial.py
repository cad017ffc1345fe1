"""The tutorial's commands and the README's Python do what the pages say, in their order."""

import ast
import inspect
import pathlib
import re
import shlex
import shutil

import pytest

import fpjax as fp
from fpjax.cli import main

ROOT = pathlib.Path(__file__).parents[2]
README = (ROOT / "README.md").read_text()
PAGE = (ROOT / "docs" / "tutorial.md").read_text()
COMMANDS = re.findall(r"^\$ fpjax (.*)$", PAGE, flags=re.MULTILINE)


@pytest.mark.long
@pytest.mark.filterwarnings("default")
def test_commands_in_order(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    shutil.copy(ROOT / "examples" / "gimbal.toml", tmp_path)
    assert len(COMMANDS) == 6
    for command in COMMANDS:
        code = main(shlex.split(command))
        printed = capsys.readouterr()
        assert code == 0, f"fpjax {command}: {printed.err}"
        out = tmp_path / shlex.split(command)[-1]
        assert (out / "run.json").exists()
        assert list(out.glob("*.png")), f"fpjax {command} leaves a picture"
    assert "no_gap" in (tmp_path / "why" / "diagnosis.json").read_text()
    assert (tmp_path / "why" / "report.html").exists()


@pytest.mark.filterwarnings("default")
def test_readme_python_runs_as_printed():
    block, of_files = re.findall(r"^```python\n(.*?)^```", README, flags=re.MULTILINE | re.DOTALL)
    names: dict = {}
    exec(compile(block, "README.md", "exec"), names)
    # The second one is the commands above in Python; they run for a minute, so it is only bound to their signatures.
    for call in (node for node in ast.walk(ast.parse(of_files)) if isinstance(node, ast.Call)):
        keywords = {keyword.arg: None for keyword in call.keywords}
        inspect.signature(getattr(fp, call.func.attr)).bind(*call.args, **keywords)
    assert not names["run"].diverged
    assert not names["result"].diverged
    assert "@" not in re.sub(r"```.*?```", "", README, flags=re.DOTALL)  # no placeholder left
