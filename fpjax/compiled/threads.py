"""Parts of one computation on threads that stay, under the jax settings of the thread that asks for them."""

import concurrent.futures
import contextlib
import contextvars
import functools
import os
import threading
from collections.abc import Callable, Iterator
from typing import Any, TypeVar, cast

import jax
import jax.experimental

R = TypeVar("R")

# A thread has settings of its own, which start as jax's defaults: those of the caller that change numbers or types.
_SETTINGS: dict[str, Callable[[Any], Any]] = {
    "jax_enable_x64": cast(Any, jax if hasattr(jax, "enable_x64") else jax.experimental).enable_x64,
    "jax_default_matmul_precision": jax.default_matmul_precision,
    "jax_numpy_dtype_promotion": jax.numpy_dtype_promotion,
    "jax_numpy_rank_promotion": jax.numpy_rank_promotion,
    "jax_debug_nans": jax.debug_nans,
}
_free = threading.Lock()


def on_threads(part: Callable[[int], R], count: int, *, first_alone: bool = False) -> list[R]:
    """[part(0), ..., part(count - 1)], this thread's own among them.

    Where the threads work for another caller, who may be waiting for this one, all parts are computed here.

    Args:
        part: what to compute, by its number; it should release the interpreter.
        count: number of parts, a thread each.
        first_alone: whether part 0 must be done before the others start.
    """
    results = [part(0)] if first_alone else []
    left, here = range(len(results), count), 1 - len(results)
    if count < 2 or not _free.acquire(blocking=False):
        return results + [part(number) for number in left]
    running: list[concurrent.futures.Future[R]] = []
    try:
        pool = _pool()
        running += [pool.submit(contextvars.copy_context().run, part, number) for number in left[here:]]
        results += [part(number) for number in left[:here]]
        return results + [other.result() for other in running]
    finally:  # where one part fails none is left running
        for other in running:
            other.cancel()
        concurrent.futures.wait(running)
        _free.release()


def settings() -> tuple[Any, ...]:
    """This thread's jax settings, for `under`."""
    return tuple(getattr(jax.config, name) for name in _SETTINGS)


@contextlib.contextmanager
def under(values: tuple[Any, ...]) -> Iterator[None]:
    """Within the block, jax's settings in this thread are these."""
    with contextlib.ExitStack() as stack:
        for (name, setting), value in zip(_SETTINGS.items(), values, strict=True):
            if getattr(jax.config, name) != value:
                stack.enter_context(setting(value))
        yield


@functools.lru_cache(maxsize=1)
def _pool() -> concurrent.futures.ThreadPoolExecutor:
    """Threads that stay, started as they are needed: to start one takes as long as a thousand candidates."""
    return concurrent.futures.ThreadPoolExecutor(max(1, (os.cpu_count() or 2) - 1), "fpjax")


def _forked() -> None:
    """A forked process has none of these threads."""
    global _free
    _free = threading.Lock()
    _pool.cache_clear()


if hasattr(os, "register_at_fork"):
    os.register_at_fork(after_in_child=_forked)
