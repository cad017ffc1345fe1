"""Parts of one computation on a pool of threads that is kept, under the jax settings of the calling thread."""

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

# jax's settings belong to a thread, and a new thread starts with the defaults. These, which change numbers or types,
# are copied from the caller.
_SETTINGS: dict[str, Callable[[Any], Any]] = {
    "jax_enable_x64": cast(Any, jax if hasattr(jax, "enable_x64") else jax.experimental).enable_x64,
    "jax_default_matmul_precision": jax.default_matmul_precision,
    "jax_numpy_dtype_promotion": jax.numpy_dtype_promotion,
    "jax_numpy_rank_promotion": jax.numpy_rank_promotion,
    "jax_debug_nans": jax.debug_nans,
}
_free = threading.Lock()  # held while the pool works for one caller


def on_threads(part: Callable[[int], R], count: int, *, first_alone: bool = False) -> list[R]:
    """[part(0), ..., part(count - 1)], computed by the pool's threads and by the calling thread.

    Where the pool already works for another caller, all parts are computed by the calling thread: that caller may be
    waiting for this very call, and two that wait for each other would never end.

    Args:
        part: what to compute, by its number; it should release the interpreter lock.
        count: number of parts, a thread each.
        first_alone: whether part 0 must be done before the others start.
    """
    results = [part(0)] if first_alone else []
    # This thread's own part is number 0: still to do (`here` = 1), or done already by `first_alone` (`here` = 0).
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


def one_blas_thread() -> contextlib.AbstractContextManager[Any]:
    """Within the block, numpy's matrix products take one thread.

    Theirs wait for the next product by spinning, and many small products with other work between them keep a second
    core busy for nothing: a diagnosis took up to 1.8 times the processor time.
    """
    import threadpoolctl

    return threadpoolctl.threadpool_limits(1, user_api="blas")


@functools.lru_cache(maxsize=1)
def _pool() -> concurrent.futures.ThreadPoolExecutor:
    """The pool: threads are started when first needed and kept, for starting one takes as long as 1,000 candidates."""
    return concurrent.futures.ThreadPoolExecutor(max(1, (os.cpu_count() or 2) - 1), "fpjax")


def _forked() -> None:
    """A forked child inherits none of the threads, but would inherit the lock as held: both are made anew."""
    global _free
    _free = threading.Lock()
    _pool.cache_clear()


if hasattr(os, "register_at_fork"):
    os.register_at_fork(after_in_child=_forked)
