"""`python -m benchmarks.speed.first_call [CACHE]`: time until a fresh process has results, as JSON."""

import json
import sys
import time

START = time.perf_counter()


def main(cache: str | None) -> dict[str, float]:
    """Seconds of the import, of XLA's start with the inputs, of the first value and of the first gradient.

    Both are compiled for the first time.
    """
    import jax

    jax.config.update("jax_enable_x64", True)
    import jax.numpy as jnp
    import numpy as np

    from fpjax.compiled.gradients import value_and_gradient
    from fpjax.compiled.native import enable_compilation_cache, native

    from . import servo

    if cache is not None:
        enable_compilation_cache(cache)
    imported = time.perf_counter()
    cost, shared = servo.library(servo.STEPS, np.float64)
    batch = {name: jnp.asarray(value) for name, value in servo.candidates(1, 2, np.float64).items()}
    run = jax.jit(native(jax.vmap(cost, in_axes=(0, None))))
    gradient = jax.jit(native(value_and_gradient(lambda c, i: cost(c, i))))
    ready = time.perf_counter()
    jax.block_until_ready(run(batch, *shared))
    valued = time.perf_counter()
    one = {name: value[0] for name, value in batch.items()}
    sliced = time.perf_counter()
    jax.block_until_ready(gradient(one, *shared))
    done = time.perf_counter()
    return {
        "import": imported - START,
        "start of XLA, inputs": ready - imported,
        "value": valued - ready,
        "gradient": done - sliced,
    }


if __name__ == "__main__":
    print(json.dumps(main(sys.argv[1] if len(sys.argv) > 1 else None)))
