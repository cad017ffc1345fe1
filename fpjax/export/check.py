"""Compilation of a law's C code with this machine's compiler, and a run of its test program."""

import dataclasses
import os
import pathlib
import re
import shlex
import shutil
import subprocess

from ..errors import InputError
from .c_code import Code
from .law import Law
from .vectors import ULPS

# no -ffast-math and no contraction to fused multiply-adds (-std=c99 implies -ffp-contract=off in gcc): both would
# round differently from the simulation
FLAGS = ("-std=c99", "-Wall", "-Wextra", "-Werror", "-O2")


@dataclasses.dataclass(frozen=True)
class Checked:
    """The results of the test program.

    Attributes:
        compiler: the first line of the compiler's --version.
        rows: samples compared.
        steps: by output and state, the largest difference of one step [units in the last place].
        runs: by output, the largest difference of the whole run, in the output's unit.
        bounds: by output, the largest ratio of a difference of the run to its bound [1].
        nearest: by output, where that ratio is: (the difference there, in the output's unit; the sample, from 0).
        nanoseconds: of one step on this machine.
        passed: whether every step and the run are within what is allowed.
        text_bytes: code and constants as compiled for this machine, -Os; None where `size` is missing.
    """

    compiler: str
    rows: int
    steps: dict[str, float]
    runs: dict[str, float]
    bounds: dict[str, float]
    nearest: dict[str, tuple[float, int]]
    nanoseconds: float
    passed: bool
    text_bytes: int | None


def find_compiler() -> list[str]:
    """The C compiler and its flags: CC of the environment, or else cc, gcc or clang.

    Raises:
        InputError: where there is none, or not the one that CC names.
    """
    given = os.environ.get("CC", "").strip()
    try:
        words = shlex.split(given)
    except ValueError:  # a quotation mark without its pair
        words = [given]
    if words:
        found = shutil.which(words[0])
        if found:
            return [found, *words[1:]]
        raise InputError(
            f"--check compiles with the variable CC, but CC = {given!r} names no program here: the C code is "
            "written, but not checked; set CC to a compiler, with its flags if it needs any, or unset it."
        )
    for name in ("cc", "gcc", "clang"):
        found = shutil.which(name)
        if found:
            return [found]
    raise InputError(
        "--check needs a C compiler, and none was found (the variable CC, cc, gcc, clang): the C code is written, but "
        "not checked; install a compiler (apt install gcc) and run the command again."
    )


def check_c(law: Law, code: Code, folder: pathlib.Path) -> Checked:
    """Compile and run the code and the test program in a folder.

    Args:
        law: the law that the code was written from.
        code: from `write_c`, written to the folder with its test program and vectors.
        folder: where they are.

    Raises:
        InputError: without a compiler, or where it rejects the code.
    """
    compiler, name = find_compiler(), code.name
    program = folder / f"{name}_test"
    sources = [f"{name}_control.c", f"{name}_test.c"]
    # -Werror: a warning in generated code is an error of the generator
    made = _run([*compiler, *FLAGS, *sources, "-o", program.name, "-lm"], folder)
    if made.returncode:
        lines = [line for line in made.stderr.splitlines() if "error" in line] or made.stderr.splitlines() or ["?"]
        raise InputError(
            f"{pathlib.Path(compiler[0]).name} rejects {name}_control.c ({lines[0].strip()}): please report it with "
            f"the model."
        )
    try:
        ran = _run([str(program.resolve()), f"{name}_vectors.bin"], folder)
    finally:
        # the folder keeps sources and vectors only: the user compiles for the drive
        program.unlink(missing_ok=True)
    steps, runs, bounds, nearest = {}, {}, {}, {}
    for line in ran.stdout.splitlines():
        match = re.match(r"(\w+) step (\S+)(?: run (\S+) of bound (\S+) by (\S+) in row (\d+))?$", line)
        if match:
            steps[match[1]] = float(match[2])
            if match[3]:
                runs[match[1]], bounds[match[1]] = float(match[3]), float(match[4])
                nearest[match[1]] = float(match[5]), int(match[6])
    measured = re.search(r"^rows (\d+) nanoseconds (\S+)", ran.stdout, flags=re.MULTILINE)
    if measured is None or set(law.outputs) - set(steps):
        raise InputError(
            f"The test program of {name} ended with code {ran.returncode}: please report it with the model."
        )
    version = _run([*compiler, "--version"], folder).stdout.splitlines() or compiler
    return Checked(
        version[0].strip(), int(measured[1]), steps, runs, bounds, nearest, float(measured[2]), ran.returncode == 0,
        _text_bytes(compiler, name, folder),
    )  # fmt: skip


def failures(checked: Checked, units: dict[str, str]) -> list[str]:
    """A phrase for each output or state that is outside its limits.

    Args:
        checked: from `check_c`.
        units: of every output, by its name.
    """
    found = [f"{name} by {ulps:.3g} ulp a step (allowed {ULPS:g})" for name, ulps in checked.steps.items()
             if not ulps <= ULPS]  # fmt: skip
    for name, ratio in checked.bounds.items():
        if not ratio <= 1.0:
            apart, sample = checked.nearest[name]
            found.append(f"{name} by {apart:.3g} {units[name]} in the run's sample {sample} ({ratio:.3g} of its bound)")
    return found


def _text_bytes(compiler: list[str], name: str, folder: pathlib.Path) -> int | None:
    tool, compiled = shutil.which("size"), folder / f".{name}_size.o"
    if tool is None:
        return None
    try:
        if _run([*compiler, "-std=c99", "-Os", "-c", f"{name}_control.c", "-o", compiled.name], folder).returncode:
            return None
        rows = _run([tool, compiled.name], folder).stdout.splitlines()
        return int(rows[1].split()[0]) if len(rows) > 1 else None
    finally:
        compiled.unlink(missing_ok=True)


def _run(command: list[str], folder: pathlib.Path) -> subprocess.CompletedProcess[str]:
    try:
        return subprocess.run(command, cwd=folder, capture_output=True, text=True, timeout=300, check=False)
    except (OSError, subprocess.TimeoutExpired) as error:
        raise InputError(f"{pathlib.Path(command[0]).name} cannot be run ({error}): see --check.") from error
