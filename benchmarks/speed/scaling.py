"""`python -m benchmarks.speed.scaling SIZE STEPS REPEATS`: a batch on one core and on all of them, as one JSON line."""

import json
import sys

from jaxtyping import PyTree

from fpjax.output.json_object import JsonObject


def main(size: int, steps: int, repeats: int) -> list[JsonObject]:
    """One batch by `map_chunks`: shared by threads where this process has one device, by its devices where it has more.

    Whether it has more is decided before jax starts, by the environment of this process.
    """
    import jax

    jax.config.update("jax_enable_x64", True)
    import jax.numpy as jnp
    import numpy as np

    from fpjax.compiled.batch import PER_WORKER, cores, map_chunks

    from . import measure, servo, timing

    bench = measure.Bench(steps, repeats, lambda line: None)
    steps = measure.steps_for(size, steps)
    cost, shared = servo.library(steps, np.float64)
    batch = {name: jnp.asarray(value) for name, value in servo.candidates(size, 2, np.float64).items()}
    devices = jax.local_devices()
    by_devices = len(devices) > 1

    def call(count: int) -> PyTree:
        words: dict[str, PyTree] = {"devices": devices[:count], "workers": 1} if by_devices else {"workers": count}
        return map_chunks(cost, batch, shared, **words)

    # Only counts that occur: `map_chunks` does not share small batches over workers.
    most = size // PER_WORKER
    counts = sorted({1, (len(devices) if len(devices) <= most else 1) if by_devices else max(1, min(cores(), most))})
    results = {count: np.asarray(call(count)) for count in counts}
    times = timing.interleaved({str(count): lambda count=count: call(count) for count in counts}, repeats)
    return [
        bench.row("fpjax", "value", np.float64, size, 2, steps, times[str(count)])
        | {
            "workers": count,
            "by": "devices" if by_devices else "threads",
            "clock_steps_per_second": size * steps / times[str(count)].seconds,
            "speedup": times["1"].seconds / times[str(count)].seconds,
            "relative_error": float(np.max(np.abs(results[count] / results[1] - 1.0))),
        }
        for count in counts
    ]


if __name__ == "__main__":
    print(json.dumps(main(*map(int, sys.argv[1:]))))
