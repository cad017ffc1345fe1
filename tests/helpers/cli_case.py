"""A small model for the command line's tests, and how they call a command: within the process, and beside it."""

import os
import pathlib
import signal
import subprocess
import sys

from model_files import LARGE_BODY, LARGE_LOOP

from fpjax.cli.command_line import main

REPO = pathlib.Path(__file__).parents[2]
SERVO = (
    LARGE_BODY
    + "steepness = 100.0"
    + LARGE_LOOP
    + """
[reference]
type = "sine"
amplitude = 1.0
frequency = 4.0
[simulation]
dt = 1e-3
duration = 1.0
stepping = "sampled"
"""
)

NOMINAL = (
    LARGE_BODY
    + """
steepness = 2000.0
[controller]
type = "pi"
kp = 150.0
ki = 800.0
[reference]
type = "multisine"
amplitudes = [0.6, 0.3]
frequencies = [0.6, 1.7]
[simulation]
dt = 1e-3
duration = 4.0
stepping = "sampled"
substeps = 10
"""
)


def run(*words):
    """The exit code of a command, run within this process."""
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


def shell(*words, stdout=subprocess.PIPE, **options):
    """The command as a process of its own."""
    environment = {**os.environ, "PYTHONPATH": str(REPO), "PYTHONDONTWRITEBYTECODE": "1"}
    command = [sys.executable, "-m", "fpjax", *map(str, words)]
    # Where the tests run in the background of a script, interrupts are ignored, and a child would inherit that.
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    try:
        return subprocess.Popen(command, env=environment, stdout=stdout, stderr=subprocess.PIPE, text=True, **options)
    finally:
        signal.signal(signal.SIGINT, before)
