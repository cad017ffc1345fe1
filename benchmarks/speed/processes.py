"""Measurements that need a fresh process: first calls, memory, and numbers of devices, set before jax starts."""

import json
import os
import statistics
import subprocess
import sys
import tempfile
import time
from typing import Any

from fpjax.compiled.batch import cores
from fpjax.output.json_object import JsonObject

from . import cpp, gpu


def first_calls(repeats: int) -> dict[str, float]:
    """Median seconds of fresh processes: without a compilation cache, with a filled one, and of `fpjax --help`."""
    found: dict[str, list[float]] = {}
    with tempfile.TemporaryDirectory() as cache:
        _run("first_call", cache)  # fills it
        for _ in range(repeats):
            for suffix, extra in (("", []), (", warm cache", [cache])):
                for name, spent in (_run("first_call", *extra) or {}).items():
                    found.setdefault(name + suffix, []).append(spent)
            start = time.perf_counter()
            done = subprocess.run([sys.executable, "-m", "fpjax", "--help"], capture_output=True, check=False)
            if done.returncode == 0:
                found.setdefault("fpjax --help", []).append(time.perf_counter() - start)
    return {name: statistics.median(samples) for name, samples in found.items()}


def scaling(size: int, steps: int, repeats: int) -> list[JsonObject]:
    """Rows of one batch on one core and on all: by threads, and by as many devices as there are cores."""
    rows = []
    for count in (1, cores()):
        flag = f"--xla_force_host_platform_device_count={count}"
        flags = {"XLA_FLAGS": f"{os.environ.get('XLA_FLAGS', '')} {flag}".strip()}
        rows += _run("scaling", str(size), str(steps), str(repeats), environment=flags) or []
    return rows


def on_gpu(steps: int, repeats: int, sizes: list[int] | None, quick: bool) -> JsonObject:
    """The GPU against all cores; {"why": a sentence} where there is none."""
    chosen = sizes or ((1, 64) if quick else gpu.SIZES)
    return _run("gpu", str(steps), str(repeats), *map(str, chosen), platforms=None) or {"why": "its process failed"}


def memory(bench: Any, size: int) -> list[JsonObject]:
    """Rows of what one value of `size` candidates, 200 steps, adds to the resident memory of a fresh process."""
    if not os.path.exists("/proc/self/clear_refs"):
        bench.skipped.append({"implementation": "memory", "why": "this system does not report a process' peak"})
        return []
    names = (["C++"] if bench.cpp is not None else []) + [*bench.peers, "vmap(lax.scan)", "fpjax"]
    rows = [_run("memory", name, str(size)) for name in names]
    return [
        row | {"version": cpp.version() if row["implementation"] == "C++" else bench.versions.get(row["package"], "")}
        for row in rows
        if row is not None
    ]


def _run(module: str, *words: str, environment: dict[str, str] | None = None, platforms: str | None = "cpu") -> Any:
    """What `python -m benchmarks.speed.MODULE WORDS` prints last, as JSON; None where it fails.

    Its jax sees `platforms` alone; None for those of the surroundings, and what it says meanwhile is shown.
    """
    command = [sys.executable, "-m", f"benchmarks.speed.{module}", *words]
    surroundings = os.environ | (environment or {})
    if platforms is not None:
        surroundings["JAX_PLATFORMS"] = platforms
    errors = None if platforms is None else subprocess.PIPE
    done = subprocess.run(command, stdout=subprocess.PIPE, stderr=errors, text=True, check=False, env=surroundings)
    if done.returncode != 0:
        said = (done.stderr or "").strip() or "no word"
        print(f"{' '.join(command[2:])} failed: {said.splitlines()[-1]}", file=sys.stderr)
        return None
    return json.loads(done.stdout.splitlines()[-1])
