"""`python -m benchmarks.speed.memory NAME SIZE`: memory that one value adds to a fresh process, as one JSON line."""

import json
import sys

from fpjax.output.json_object import JsonObject

STEPS = 200


def main(name: str, size: int) -> JsonObject:
    """Peak of the resident memory during one value minus that before; Linux only.

    `name` is one of the benchmark's rows.
    """
    import jax

    jax.config.update("jax_enable_x64", True)
    import numpy as np

    from . import measure, servo

    bench = measure.Bench(STEPS, 1, lambda line: None)
    batch, table = servo.candidates(size, 2, np.float64), servo.table(STEPS, np.float64)
    # Writing 5 resets the peak (VmHWM), which is otherwise inherited from the process that started this one.
    with open("/proc/self/clear_refs", "w") as file:
        file.write("5")
    before = _megabytes("VmRSS")
    jax.block_until_ready(bench.value(name, batch, table)())
    package = name if name in bench.versions else "jax"
    return {
        "implementation": name,
        "package": package,
        "dtype": "float64",
        "candidates": size,
        "steps": STEPS,
        "megabytes": _megabytes("VmHWM") - before,
    }


def _megabytes(field: str) -> float:
    with open("/proc/self/status") as file:
        return next(float(line.split()[1]) for line in file if line.startswith(field)) / 1e3


if __name__ == "__main__":
    print(json.dumps(main(sys.argv[1], int(sys.argv[2]))))
