"""Every example runs, in a process of its own, and leaves the pictures that it says it leaves."""

import os
import pathlib
import subprocess
import sys

import pytest

ROOT = pathlib.Path(__file__).parents[2]
LONG = {"02_tune", "05_diagnose", "06_own_effect"}  # ten seconds and more
# What tests/tuning/test_slow_mode.py and tests/analysis/test_emps.py run as well.
SLOW = {"04_tune_for_estimation", "emps_estimate"}
MARKS = dict.fromkeys(LONG, pytest.mark.long) | dict.fromkeys(SLOW, pytest.mark.slow)
EXAMPLES = [
    pytest.param(path, id=path.stem, marks=MARKS.get(path.stem, ()))
    for path in sorted((ROOT / "examples").glob("*.py"))
]


@pytest.mark.parametrize("example", EXAMPLES)
def test_example_runs(example, tmp_path):
    environment = {**os.environ, "PYTHONPATH": str(ROOT), "MPLBACKEND": "Agg"}
    done = subprocess.run(
        [sys.executable, str(example), "--out", str(tmp_path)],
        capture_output=True,
        text=True,
        env=environment,
        timeout=300,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    assert done.stdout.strip(), "an example prints what it found"
    assert list(tmp_path.glob("*.png")), "an example leaves a picture"
