"""`python -m benchmarks.speed.gpu STEPS REPEATS SIZE...`: a batch on the GPU and on all cores, as one JSON line."""

import json
import sys
from collections.abc import Callable
from typing import Any

import numpy as np
from jax.typing import DTypeLike
from jaxtyping import PyTree

from fpjax.output.json_object import JsonObject

SIZES = (1, 64, 1024, 16384, 131072, 1_000_000)
# What is timed: (name, number of gains, whether with the gradient).
KINDS = (("value", 2, False), ("gradient, 2 gains", 2, True), ("gradient, 10 gains", 10, True))


def main(steps: int, repeats: int, sizes: tuple[int, ...]) -> JsonObject:
    """{"device", "platform", "rows"}, or {"why": a sentence} where jax sees no GPU."""
    import jax

    jax.config.update("jax_enable_x64", True)
    try:
        gpu = jax.devices("gpu")[0]
    except RuntimeError:
        return {"why": "jax sees no GPU on this machine"}
    made = []
    for dtype in (np.float64, np.float32):
        for kind in KINDS:
            for size in sizes:
                made.append(row(gpu, jax.devices("cpu")[0], *kind, dtype, size, steps, repeats))
                print(json.dumps(made[-1]), file=sys.stderr, flush=True)  # minutes: a run that is cut short told these
    return {"device": gpu.device_kind, "platform": gpu.client.platform_version, "rows": made}


def row(
    gpu: Any, cpu: Any, what: str, gains: int, slopes: bool, dtype: DTypeLike, size: int, steps: int, repeats: int
) -> JsonObject:
    """One batch by `map_chunks` on both devices: seconds by the clock, results left where they were computed."""
    from . import measure, timing

    steps = measure.steps_for(size, steps)
    calls = {name: _call(where, gains, slopes, dtype, size, steps) for name, where in (("gpu", gpu), ("cpu", cpu))}
    error = _difference(*(call() for call in calls.values()))
    times = timing.interleaved(calls, repeats, budget=0.3)
    made = {
        "what": what,
        "dtype": np.dtype(dtype).name,
        "candidates": size,
        "steps": steps,
        "seconds": times["gpu"].seconds,
        "cpu_seconds": times["cpu"].seconds,
        "steps_per_second": size * steps / times["gpu"].seconds,
        "cpu_steps_per_second": size * steps / times["cpu"].seconds,
        "relative_error": error,
    }
    if not error <= measure.AGREE[made["dtype"]]:
        made["disagrees"] = True
    return made


def crossover(rows: list[JsonObject]) -> int | None:
    """The least measured batch from which on the GPU is faster; None where the largest is not."""
    found = None
    for one in sorted(rows, key=lambda row: row["candidates"], reverse=True):
        if one["seconds"] >= one["cpu_seconds"]:
            break
        found = one["candidates"]
    return found


def _call(device: Any, gains: int, slopes: bool, dtype: DTypeLike, size: int, steps: int) -> Callable[[], PyTree]:
    import jax

    from fpjax.compiled.batch import map_chunks
    from fpjax.compiled.gradients import value_and_gradient

    from . import servo

    with jax.default_device(device):
        cost, shared = servo.library(steps, dtype)
    shared = jax.device_put(shared, device)
    arrays = jax.device_put(servo.candidates(size, gains, dtype), device)

    def whole(candidates: PyTree, *shared: PyTree) -> PyTree:
        return jax.vmap(cost, in_axes=(0, None))(candidates, *shared)

    function = value_and_gradient(whole, batched=True) if slopes else whole
    return lambda: map_chunks(function, arrays, shared, batched=True, devices=[device])


def _difference(mine: PyTree, other: PyTree) -> float:
    """The largest relative difference; of slopes against the largest, by shares of the gains: some pass through 0."""
    if not isinstance(mine, tuple):
        return float(np.max(np.abs(np.asarray(mine) / np.asarray(other) - 1.0)))
    from . import servo

    a, b = ({n: np.asarray(s) * (servo.NOMINAL[n] or 1.0) for n, s in each[1].items()} for each in (mine, other))
    slopes = max(np.max(np.abs(a[n] - b[n])) for n in a) / max(np.max(np.abs(b[n])) for n in b)
    return max(_difference(mine[0], other[0]), float(slopes))


if __name__ == "__main__":
    print(json.dumps(main(int(sys.argv[1]), int(sys.argv[2]), tuple(map(int, sys.argv[3:])))))
