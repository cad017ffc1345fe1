"""`python -m benchmarks speed --out DIR`: fpjax against a C++ loop and its peers, with the goals' table."""

import argparse
import json
import pathlib
import shlex
import sys
import time

from fpjax import InputError
from fpjax.output.json_object import JsonObject
from fpjax.output.runfile import write_whole

PARTS = ("values", "flat", "gradients", "growth", "scaling", "memory", "functions", "first_call", "gpu")
SIZES = (1, 5, 64, 1024, 16384, 131072)
FLAT = (1024, 16384, 131072, 1_000_000)


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """The options of the benchmark."""
    parser.add_argument("--out", required=True, metavar="DIR", help="folder for speed.json, speed.txt and speed.png")
    parser.add_argument("--quick", action="store_true", help="small sizes, once: whether it works, not how fast")
    parser.add_argument("--only", nargs="+", choices=PARTS, default=PARTS, help="parts to measure (default: all)")
    parser.add_argument("--sizes", nargs="+", type=int, default=None, metavar="B", help=f"batches (default {SIZES})")
    parser.add_argument("--repeats", type=int, default=3, help="interleaved samples of each row (default 3)")


def run(arguments: argparse.Namespace) -> int:
    """Measure everything, write speed.json, speed.txt and speed.png, print the tables."""
    if arguments.repeats < 1:
        raise InputError(f"--repeats must be at least 1, got {arguments.repeats}.")
    if arguments.sizes is not None and min(arguments.sizes) < 1:
        raise InputError(f"--sizes must be whole numbers of at least 1 candidate, got {arguments.sizes}.")
    out = pathlib.Path(arguments.out)
    try:
        out.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise InputError(
            f"--out must be a folder that can be made, got {out} ({error.strerror}): give another."
        ) from error

    import jax

    jax.config.update("jax_enable_x64", True)
    jax.config.update("jax_platforms", "cpu")  # the rows are of the processor; the GPU has a process of its own
    import numpy as np

    from . import functions, goals, measure, picture, processes, timing
    from .report import rows_table

    started = time.time()
    steps, repeats = (200, 1) if arguments.quick else (5000, arguments.repeats)
    sizes = tuple(arguments.sizes or ((1, 5, 64) if arguments.quick else SIZES))
    only = arguments.only
    bench = measure.Bench(steps, repeats, lambda line: print(line, file=sys.stderr, flush=True))
    results: JsonObject = {
        "command": shlex.join(["python", "-m", "benchmarks", *sys.argv[1:]]),
        "machine": measure.machine(),
        "versions": bench.versions,
        "steps": steps,
        "repeats": repeats,
        "values": [],
        "flat": [],
        "gradients": [],
        "growth": {"horizon": [], "gains": []},
        "scaling": [],
        "memory": [],
        "functions": [],
        "gpu": {},
        "skipped": bench.skipped,
        "calls": [],
    }
    # In processes of their own, before this one has started jax on a core.
    results["first_call"] = processes.first_calls(bench.repeats) if "first_call" in only else {}
    several = (256,) if arguments.quick else tuple(size for size in sizes if size >= 1024)
    for size in several if "scaling" in only else ():
        results["scaling"] += processes.scaling(size, bench.steps, bench.repeats)
    if "gpu" in only:
        results["gpu"] = processes.on_gpu(bench.steps, bench.repeats, arguments.sizes, arguments.quick)
    # Bound to one core, so that threads of XLA do not help one implementation and not another; scaling is apart.
    with timing.one_core() as results["on_one_core"]:
        for dtype in (np.float64, np.float32):
            for size in sizes if "values" in only else ():
                results["values"] += bench.value_rows(dtype, size)
                results["calls"].append(bench.call_row(dtype, size))
            if "flat" in only:
                results["flat"] += bench.flat(dtype, (64, 128) if arguments.quick else FLAT)
            for size in (1, 5, 64) if "functions" in only else ():
                results["functions"] += functions.function_rows(dtype, size, steps, repeats)
            # Plain gradients of larger batches take minutes and gigabytes (docs/performance.md).
            small = [size for size in sizes if size <= (1024 if dtype is np.float64 else 64)]
            for size in small if "gradients" in only else ():
                for gains in (2,) if arguments.quick else (2, 5, 10):
                    results["gradients"] += bench.gradient_rows(dtype, size, gains, with_plain=size <= 64)
        if "growth" in only and not arguments.quick:
            results["growth"] = bench.growth(np.float64)
    if "memory" in only:
        results["memory"] = processes.memory(bench, 1024 if arguments.quick else 131072)
    results["peak_memory_megabytes"] = measure.peak_memory()
    results["goals"] = goals.goals(results)
    results["seconds"] = time.time() - started

    text = "\n\n".join([rows_table(results), goals.table(results["goals"])])
    if arguments.quick:
        text += "\n--quick: 200 steps are mostly overhead; these figures say that it works, not how fast it is"
    write_whole(out / "speed.json", json.dumps(results, indent=1) + "\n")
    write_whole(out / "speed.txt", text + "\n")
    picture.draw(results, out / "speed.png")
    print(text)
    return 0
