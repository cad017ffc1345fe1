"""The processor time and memory of a law, estimated from its operations; the size by a cross compiler, if installed.

Cycles of single precision on a Cortex-M4F are those of its technical reference manual (VADD, VMUL 1; VDIV, VSQRT 14),
plus two for each operation's loads and moves. Library functions, and double precision in software, are within a factor
of two of what the usual libraries (newlib, libgcc) take.
"""

import dataclasses
import pathlib
import shutil
import subprocess
from typing import Literal

from .c_code import Code
from .law import Law
from .operations import LIBRARY

MOVES = 2  # cycles per operation for its loads and moves
# Cycles by whether the floating-point unit has this precision: an addition or multiplication, a comparison or
# selection, a division or square root, a function of the library.
_CYCLES = {"hardware": (1, 4, 14, 120), "software": (65, 30, 250, 2500)}
# Bytes of code per operation, and of a constant.
_BYTES = {"hardware": (6, 4), "software": (16, 8)}
_CHOSEN_WORDS = "max min select sign eq ne lt le gt ge and or not xor is_finite"
_CHOSEN = frozenset(_CHOSEN_WORDS.split())
CROSS = "arm-none-eabi-gcc"
CROSS_FLAGS = ("-mcpu=cortex-m4", "-mthumb", "-mfloat-abi=hard", "-mfpu=fpv4-sp-d16", "-std=c99", "-Os")


@dataclasses.dataclass(frozen=True)
class Cost:
    """The cost of a law on a Cortex-M4F.

    Attributes:
        operations: number of operations of one step.
        cycles: cycles of one step, estimated.
        flash: size of code and constants, without the libraries [bytes].
        flash_is: "estimated", or "compiled" by the cross compiler.
        state: size of the state [bytes].
        arithmetic: "hardware" or "software".
    """

    operations: int
    cycles: int
    flash: int
    flash_is: Literal["estimated", "compiled"]
    state: int
    arithmetic: str

    def sentence(self, dt: float) -> str:
        """For the user."""
        share = self.cycles / 168e6 / dt  # 168 MHz is an STM32F4, a common Cortex-M4F of drives
        software = ", double precision in software there" if self.arithmetic == "software" else ""
        return (
            f"{self.operations} operations a step; on a Cortex-M4F about {self.cycles} cycles, {100 * share:.2g} % of "
            f"a period at 168 MHz, and {self.flash} bytes of flash ({self.flash_is}){software}; {self.state} bytes of "
            f"state"
        )


def estimate_cost(law: Law, code: Code, folder: pathlib.Path | None = None) -> Cost:
    """The cost of a law.

    Args:
        law: from `trace_law`.
        code: from `write_c`.
        folder: folder of the code, for the cross compiler; None to estimate the size.
    """
    arithmetic = "hardware" if law.precision == "float" else "software"
    plain, chosen, division, library = _CYCLES[arithmetic]
    cycles = 0
    for operation in law.program.operations:
        name = operation.name
        whole = operation.arguments[0].kind not in ("float32", "float64") and name not in ("select", "convert")
        if whole:  # integer arithmetic takes one cycle, and the same again to be safe
            own = 2
        elif name in ("div", "sqrt"):
            own = division
        elif name in LIBRARY:
            own = library
        else:
            own = chosen if name in _CHOSEN else plain
        cycles += own + MOVES
    count = len(law.program.operations)
    each, number = _BYTES[arithmetic]
    flash = each * count + number * (code.constants + len(law.parameters))
    compiled = None if folder is None else _compiled_bytes(code, folder)
    return Cost(
        count, cycles, flash if compiled is None else compiled, "estimated" if compiled is None else "compiled",
        code.state_bytes, arithmetic,
    )  # fmt: skip


def _compiled_bytes(code: Code, folder: pathlib.Path) -> int | None:
    compiler, size = shutil.which(CROSS), shutil.which("arm-none-eabi-size")
    if compiler is None or size is None:
        return None
    target = folder / f".{code.name}_target.o"
    try:
        made = subprocess.run(
            [compiler, *CROSS_FLAGS, "-c", f"{code.name}_control.c", "-o", target.name],
            cwd=folder, capture_output=True, timeout=60, check=False,
        )  # fmt: skip
        if made.returncode:
            return None
        found = subprocess.run([size, target.name], cwd=folder, capture_output=True, text=True, timeout=60, check=False)
        rows = found.stdout.splitlines()
        return int(rows[1].split()[0]) if len(rows) > 1 else None
    except (OSError, subprocess.TimeoutExpired, ValueError):
        return None
    finally:
        target.unlink(missing_ok=True)
