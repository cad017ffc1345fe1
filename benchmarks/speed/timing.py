"""Interleaved timing: every implementation once, then again, so that a busy machine is busy for all of them."""

import statistics
import time
from collections.abc import Callable
from typing import Any


def _wait(result: Any) -> Any:
    import jax

    return jax.block_until_ready(result)


def timed(call: Callable[[], Any]) -> tuple[float, Any]:
    """(seconds of one call, its result, waited for)."""
    start = time.perf_counter()
    result = _wait(call())
    return time.perf_counter() - start, result


def interleaved(
    calls: dict[str, Callable[[], Any]], repeats: int, at_least: float = 0.02
) -> dict[str, tuple[float, float]]:
    """(median seconds of a call, seconds of the first call) by name.

    A short call is repeated until `at_least` seconds have passed, and the mean of these counts as one sample.
    """
    first, loops = {}, {}
    for name, call in calls.items():
        first[name], _ = timed(call)
        once, _ = timed(call)
        loops[name] = max(1, min(200, round(at_least / max(once, 1e-9))))
    samples: dict[str, list[float]] = {name: [] for name in calls}
    for _ in range(repeats):
        for name, call in calls.items():
            start = time.perf_counter()
            for _ in range(loops[name]):
                _wait(call())
            samples[name].append((time.perf_counter() - start) / loops[name])
    return {name: (statistics.median(samples[name]), first[name]) for name in calls}
