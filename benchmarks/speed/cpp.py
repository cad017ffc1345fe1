"""The C++ loop, built on the spot with g++ for this very processor."""

import ctypes
import pathlib
import shutil
import subprocess
import tempfile
from collections.abc import Callable

import numpy as np
from jaxtyping import PyTree

from . import servo

FLAGS = ("-O3", "-march=native", "-mprefer-vector-width=512", "-ffast-math", "-fopenmp-simd", "-std=c++17", "-fPIC")
# Lanes side by side in one call: how many candidates the compiler vectorises over.
WIDTHS = (1, 2, 4, 5, 8, 16, 32, 64)


def build() -> PyTree | str:
    """The loaded library, or a sentence that says why there is none."""
    compiler = shutil.which("g++")
    if compiler is None:
        return "no g++ on this machine"
    source = pathlib.Path(__file__).with_name("loop.cpp")
    folder = tempfile.mkdtemp(prefix="fpjax-speed-")
    try:
        compiled, target = pathlib.Path(folder) / "loop.o", pathlib.Path(folder) / "loop.so"
        flags = list(FLAGS)
        # An older g++ refuses the vector width; without the flag it still compiles.
        for attempt in (flags, [flag for flag in flags if not flag.startswith("-mprefer")]):
            done = subprocess.run(
                [compiler, *attempt, "-c", str(source), "-o", str(compiled)], capture_output=True, text=True
            )
            # Linked without -ffast-math: with it, loading the library would flush subnormal numbers in all of Python.
            if done.returncode == 0:
                done = subprocess.run(
                    [compiler, "-shared", str(compiled), "-o", str(target)], capture_output=True, text=True
                )
            if done.returncode == 0:
                return ctypes.CDLL(str(target))
        return "g++ failed: " + (done.stderr.strip().splitlines() or ["no message"])[0]
    finally:
        shutil.rmtree(folder, ignore_errors=True)


def version() -> str:
    """The compiler's name and version."""
    done = subprocess.run(["g++", "-dumpfullversion"], capture_output=True, text=True)
    return "g++ " + done.stdout.strip()


def runner(
    library: PyTree, candidates: dict[str, PyTree], reference: PyTree, width: int, library_tanh: bool = False
) -> Callable[[], PyTree]:
    """A call that runs all candidates, `width` of them in the lanes at once, on one core."""
    dtype = reference.dtype
    size = len(next(iter(candidates.values())))
    values = np.stack([np.broadcast_to(v, (size,)) for v in servo.complete(candidates, dtype).values()])
    values, reference = np.ascontiguousarray(values, dtype), np.ascontiguousarray(reference)
    cost = np.empty(size, dtype)
    number = ctypes.c_double if dtype == np.float64 else ctypes.c_float
    function = getattr(library, f"run_{dtype}")
    pointers = [ctypes.c_void_p(array.ctypes.data) for array in (reference, values, cost)]

    def call() -> PyTree:
        code = function(
            ctypes.c_int64(library_tanh),
            ctypes.c_int64(width),
            ctypes.c_int64(size),
            ctypes.c_int64(len(reference)),
            pointers[0],
            pointers[1],
            number(servo.DT),
            pointers[2],
        )
        assert code == 0, f"width {width} does not divide {size}"
        return cost

    # The pointers are addresses only: this keeps the arrays alive as long as the call.
    call.keeps = (values, reference)  # type: ignore[attr-defined]
    return call


def widths(size: int) -> list[int]:
    """The lane counts that divide the batch; the benchmark takes the fastest."""
    return [width for width in WIDTHS if size % width == 0 and (width <= 8 or size >= width)]
