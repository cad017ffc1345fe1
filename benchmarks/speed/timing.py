"""Interleaved timing: one sample of every implementation in turn, so that other load affects all of them alike."""

import contextlib
import dataclasses
import os
import pathlib
import statistics
import time
from collections.abc import Callable, Iterator

from jaxtyping import PyTree


@dataclasses.dataclass(frozen=True)
class Timing:
    """Medians of one call.

    Attributes:
        seconds: by the clock.
        processor_seconds: processor time of this process: for work on one core the time on an idle machine, and far
            steadier than the clock on a shared one.
    """

    seconds: float
    processor_seconds: float


@contextlib.contextmanager
def one_core() -> Iterator[bool]:
    """Bind all threads of this process to one core within the block; yields whether that was possible.

    To be entered before jax starts: XLA then has one thread in its pool.
    """
    if not hasattr(os, "sched_setaffinity") or not os.path.isdir("/proc/self/task"):
        yield False
        return
    allowed = os.sched_getaffinity(0)
    _bind({max(allowed)})
    try:
        yield True
    finally:
        _bind(allowed)


def _bind(cores: set[int]) -> None:
    for thread in pathlib.Path("/proc/self/task").iterdir():
        with contextlib.suppress(ProcessLookupError):  # the thread has ended meanwhile
            os.sched_setaffinity(int(thread.name), cores)


def _wait(result: PyTree) -> PyTree:
    import jax

    return jax.block_until_ready(result)


def timed(call: Callable[[], PyTree]) -> tuple[float, PyTree]:
    """(seconds of one call, its result, waited for)."""
    start = time.perf_counter()
    result = _wait(call())
    return time.perf_counter() - start, result


def interleaved(
    calls: dict[str, Callable[[], object]], repeats: int, at_least: float = 0.005, budget: float = 2.0
) -> dict[str, Timing]:
    """The timing of each call by name; every call is made twice before it is timed.

    A short call is repeated until `at_least` seconds have passed, and the mean of these counts as one sample: a few
    milliseconds, so that other work on the machine falls between samples. There are `repeats` rounds at least, and up
    to 40 while `budget` seconds last.
    """
    loops, spent = {}, 0.0
    for name, call in calls.items():
        timed(call)
        once, _ = timed(call)
        loops[name] = max(1, min(200, round(at_least / max(once, 1e-9))))
        spent += loops[name] * once
    samples: dict[str, list[tuple[float, float]]] = {name: [] for name in calls}
    for _ in range(max(repeats, min(40, int(budget / spent)))):
        for name, call in calls.items():
            start, processor = time.perf_counter(), time.process_time()
            for _ in range(loops[name]):
                _wait(call())
            clock, processor = time.perf_counter() - start, time.process_time() - processor
            samples[name].append((clock / loops[name], processor / loops[name]))
    return {name: Timing(*map(statistics.median, zip(*samples[name], strict=True))) for name in calls}
