"""`export_c`: a model's control law as C files in a folder, and on request checked against the simulation."""

import dataclasses
import os
import pathlib
import re
import unicodedata

import numpy as np

from ..blocks.observers import NoObserver
from ..blocks.references import AbstractReference, Sine
from ..errors import InputError
from ..model_file import Model
from ..model_file.as_model import needed_model
from ..output.paths import expanded
from ..output.runfile import made_folder, write_whole
from ..simulation.precision import double_precision
from .c_code import Code, unit_of, write_c
from .c_test import EMBEDDED, test_program, vector_file, vector_header
from .check import Checked, check_c, failures, find_compiler
from .cost import Cost, estimate_cost
from .law import Law, Precision, trace_law
from .vectors import make_vectors

CHECKED_FOR = 10.0  # [s]: length of the compared run; the error bound in single precision grows with it
MOST_SAMPLES = 100_001  # of the compared run: 10 s at 10 kHz


@dataclasses.dataclass(frozen=True)
class ExportedC:
    """The result of `export_c`.

    Attributes:
        law: the control law, its program and its names.
        code: the texts of the header and the source.
        files: their names, in `folder`.
        folder: where they are.
        cost: cycles and flash.
        checked: the result of the comparison with the simulation; None without `check`.
        bounds: by output, the bound on the difference from `fpjax.simulate`, the largest along the compared run [the
            output's unit].
        notes: sentences for the user.
    """

    law: Law
    code: Code
    files: tuple[str, ...]
    folder: pathlib.Path
    cost: Cost
    checked: Checked | None
    bounds: dict[str, float]
    notes: tuple[str, ...]


def export_c(
    model: Model | str | os.PathLike[str],
    folder: str | os.PathLike[str],
    *,
    precision: Precision = "double",
    name: str | None = None,
    check: bool = False,
    duration: float = CHECKED_FOR,
) -> ExportedC:
    """Write the control law of a model as C99: controller, observer and compensation, as the sampled loop runs them.

    Args:
        model: a `Model`, or a servo.toml.
        folder: where NAME_control.h, NAME_control.c, NAME_test.c and its vectors go; made if missing.
        precision: "double" or "float".
        name: prefix of files and symbols; None for the model file's own name.
        check: compile with the machine's C compiler and compare with the simulation sample by sample.
        duration: of the compared run [s].

    Returns:
        An `ExportedC`.

    Raises:
        InputError: for a controller that is unknown, a law that cannot be written in C, a loop that diverges, or a
            folder that cannot be written; with `check` also without a compiler, and where the C code does not agree
            with the simulation.
    """
    model = needed_model(model, "export_c")
    model.needed_controller()
    # the law is traced first: it refuses what cannot be written in C before a file is made
    notes = _notes(model)
    law = trace_law(model.loop, model.dt, precision)
    code = write_c(law, name or _word(model), model.units, model.path.name if model.path else "a model")
    folder = made_folder(expanded(folder))
    files = _write(folder, {f"{code.name}_control.h": code.header, f"{code.name}_control.c": code.source})
    without: InputError | None = None
    if check:
        try:
            find_compiler()
        except InputError as error:  # without one there is no check, but everything else is written
            without, check = error, False
    reference, said = _reference(model)
    notes += said
    samples = _samples(model.dt, duration, notes) if check else EMBEDDED
    vectors = make_vectors(
        law, reference, samples=samples, solver=model.solver, substeps=model.substeps, loop=model.loop
    )
    texts = {
        f"{code.name}_test.c": test_program(law, code),
        f"{code.name}_vectors.h": vector_header(law, code, vectors),
    }
    files += _write(folder, texts)
    if without is not None:
        raise without
    checked = None
    if check:
        files += _write(folder, {f"{code.name}_vectors.bin": vector_file(vectors)})
        checked = check_c(law, code, folder)
        wrong = failures(checked, {output: unit_of(output, model.units) for output in law.outputs})
        if wrong:
            raise InputError(
                f"{code.name}_control.c does not agree with the simulation: {'; '.join(wrong)}. Please report it with "
                "the model."
            )
    most = vectors.bounds.max(axis=0)
    # an output that is always zero has the last place of the smallest normal number in the vectors: no bound to tell
    most = np.where(most < np.finfo(law.dtype).tiny, 0.0, most)
    bounds = dict(zip(law.outputs, map(float, most), strict=True))
    # a bound needs finite slopes along the run, which sign(w) does not have where the velocity changes its sign
    unbounded = [output for output, bound in bounds.items() if not bound < float("inf")]
    if check and unbounded:
        notes.append(
            f"There is no error bound for the run of {', '.join(unbounded)} (a slope of the law is infinite along it): "
            f"every single step is checked, but the difference over the run is only reported."
        )
    cost = estimate_cost(law, code, folder)
    return ExportedC(law, code, tuple(files), folder, cost, checked, bounds, tuple(notes))


def _samples(dt: float, duration: float, notes: list[str]) -> int:
    if not dt <= duration < float("inf"):
        raise InputError(f"duration must be at least one period of dt = {dt:g} s and finite, got {duration:g} s.")
    samples = round(duration / dt) + 1
    if samples > MOST_SAMPLES:
        notes.append(f"The check runs {MOST_SAMPLES * dt:.3g} s and not {duration:g} s: {MOST_SAMPLES} periods.")
    return min(samples, MOST_SAMPLES)


def _write(folder: pathlib.Path, texts: dict[str, str] | dict[str, bytes]) -> list[str]:
    for name, text in texts.items():
        write_whole(folder / name, text)
    return list(texts)


def _word(model: Model) -> str:
    # C99 leaves other letters in identifiers to the compiler: an accent is dropped, anything else becomes _
    plain = unicodedata.normalize("NFKD", model.path.stem) if model.path else "servo"
    stem = re.sub(r"[^A-Za-z0-9_]", "_", "".join(letter for letter in plain if not unicodedata.combining(letter)))
    return stem if re.match(r"[A-Za-z_]", stem) else f"servo_{stem}"


def _notes(model: Model) -> list[str]:
    notes = []
    if model.stepping == "continuous":
        notes.append(
            f"The model steps continuously, but the C code is the sampled law with a period of dt = {model.dt:g} s "
            f'([simulation] stepping = "sampled" simulates it): it may need other gains.'
        )
    if isinstance(model.loop.observer, NoObserver):
        notes.append("The model has no [observer]: the C code is the controller alone, without friction compensation.")
    return notes


def _reference(model: Model) -> tuple[AbstractReference, list[str]]:
    if model.reference is not None:
        return model.reference, []
    with double_precision():
        return Sine(1.0, 1.0), ["The model has no [reference]: the test vectors follow a sine of 1 at 1 Hz."]
