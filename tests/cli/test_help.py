"""The command line says what it can do: help, versions, words that are mistyped."""

import os
import subprocess
import sys

import pytest
from cli_case import REPO, refuse

from fpjax.cli.command_line import COMMANDS, main


def processor_time(code):
    """The least processor time [s] of three runs of a Python program, and what the last of them printed."""
    best, printed = 1e9, ""
    for _ in range(3):
        begin = os.times()
        done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, cwd=REPO, check=True)
        end = os.times()
        best = min(best, end.children_user + end.children_system - begin.children_user - begin.children_system)
        printed = done.stdout
    return best, printed


def test_help_imports_no_jax_and_is_quick():
    code = "import sys, fpjax.cli as m\ntry:\n m.main(['--help'])\nexcept SystemExit: pass\n"
    code += "print(sorted({'jax', 'numpy', 'scipy', 'matplotlib'} & set(sys.modules)))"
    spent, printed = processor_time(code)
    assert printed.splitlines()[-1] == "[]"
    for name in COMMANDS:
        assert f"  {name}" in printed
    # What the machine itself takes for Python is not ours, nor what other programs take of its time.
    assert spent < processor_time("import argparse")[0] + 0.15


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


def test_the_documentation_names_every_option():
    from fpjax.cli.command_line import make_parser

    text = (REPO / "docs" / "cli.md").read_text()
    for name in COMMANDS:
        assert f"`fpjax {name}" in text
        parser = make_parser(name)._subparsers._group_actions[0].choices[name]
        for option in (word for action in parser._actions for word in action.option_strings if word.startswith("--")):
            assert option in text or option == "--help", f"{name} {option}"
