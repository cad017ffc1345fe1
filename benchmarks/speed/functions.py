"""Elementary functions of the package against XLA's own: the same loop with either, timed interleaved."""

from collections.abc import Callable

import jax
import jax.numpy as jnp
import numpy as np
from jax.typing import DTypeLike
from jaxtyping import PyTree

from fpjax.compiled import elementary, hyperbolic
from fpjax.compiled.batch import VECTORIZED_FROM
from fpjax.compiled.native import native
from fpjax.output.json_object import JsonObject

from . import timing

# (ours, XLA's), of a state between -1 and 1: an angle of some turns, a positive number.
PAIRS: dict[str, tuple[Callable[[PyTree], PyTree], Callable[[PyTree], PyTree]]] = {
    "tanh": (lambda x: hyperbolic.tanh(5.0 * x), lambda x: jnp.tanh(5.0 * x)),
    "sin": (lambda x: elementary.sin(50.0 * x), lambda x: jnp.sin(50.0 * x)),
    "sin + cos": (lambda x: sum(elementary.sincos(50.0 * x)), lambda x: jnp.sin(50.0 * x) + jnp.cos(50.0 * x)),
    "log": (lambda x: elementary.log(x + 2.0), lambda x: jnp.log(x + 2.0)),
}


def function_rows(dtype: DTypeLike, size: int, steps: int, repeats: int) -> list[JsonObject]:
    """One row for each function: time of one evaluation without the loop around it [ns], ours and XLA's.

    Args:
        dtype: float64 or float32.
        size: states side by side.
        steps: of the loop.
        repeats: samples at least.
    """
    start = jnp.asarray(np.linspace(-1.0, 1.0, size), dtype)

    def loop(function: Callable[[PyTree], PyTree]) -> Callable[[], PyTree]:
        def run(start: PyTree) -> PyTree:
            # A contraction; the start is added so that the states do not all run into one value.
            step = lambda x, _: (0.5 * x + 0.2 * function(x) + 0.1 * start, None)  # noqa: E731
            return jax.lax.scan(step, start, None, length=steps)[0]

        options = {"xla_cpu_prefer_vector_width": "512"} if size >= VECTORIZED_FROM else None
        compiled = jax.jit(native(run), compiler_options=options)
        return lambda: compiled(start)

    calls = {"empty": loop(lambda x: x)}
    # In float32 our log is XLA's too.
    pairs = {name: pair for name, pair in PAIRS.items() if name != "log" or start.dtype == np.float64}
    for name, (mine, theirs) in pairs.items():
        calls |= {f"{name}, fpjax": loop(mine), f"{name}, XLA": loop(theirs)}
    times = timing.interleaved(calls, repeats)
    spent = {name: found.processor_seconds for name, found in times.items()}
    each = {name: (seconds - spent["empty"]) / (steps * size) * 1e9 for name, seconds in spent.items()}
    return [
        {
            "function": name,
            "dtype": np.dtype(dtype).name,
            "candidates": size,
            "ns": each[f"{name}, fpjax"],
            "ns_of_xla": each[f"{name}, XLA"],
        }
        for name in pairs
    ]
