"""`python -m benchmarks.speed.sharded SIZE STEPS REPEATS`: `map_chunks` over several devices, as one JSON line."""

import json
import sys
from typing import Any


def main(size: int, steps: int, repeats: int) -> list[dict[str, Any]]:
    """The same batch on one of this process' devices and on all of them, where its candidates are enough."""
    import jax

    jax.config.update("jax_enable_x64", True)
    import jax.numpy as jnp
    import numpy as np

    from fpjax.batch import map_chunks

    from . import measure, servo, timing

    bench = measure.Bench(steps, repeats, lambda line: None)
    steps = measure.steps_for(size, steps)
    cost, shared = servo.library(steps, np.float64)
    batch = {name: jnp.asarray(value) for name, value in servo.candidates(size, 2, np.float64).items()}
    devices = jax.local_devices()
    calls = {
        str(count): lambda count=count: map_chunks(cost, batch, shared, devices=devices[:count], workers=1)
        for count in sorted({1, len(devices)})
    }
    results = {name: np.asarray(call()) for name, call in calls.items()}
    times = timing.interleaved(calls, repeats)
    return [
        bench.row("fpjax", "value", np.float64, size, 2, steps, spent)
        | {
            "workers": int(name),
            "by": "devices",
            "clock_steps_per_second": size * steps / spent.seconds,
            "speedup": times["1"].seconds / spent.seconds,
            "relative_error": float(np.max(np.abs(results[name] / results["1"] - 1.0))),
        }
        for name, spent in times.items()
    ]


if __name__ == "__main__":
    print(json.dumps(main(*map(int, sys.argv[1:]))))
