"""A sweep on Dask distributed: one task and one file a chunk (extra `cluster`).

If a worker is killed, another one computes its current chunk again. If the driver is killed, the chunks then running
are lost; the finished ones are in the folder, and `resume=True` computes the missing ones, bit-equal.
"""

import functools
import itertools
import pickle
import uuid
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path
from typing import Any

import jax
import numpy as np

from fpjax.errors import InputError

from .problem import Problem
from .sweep_axis import Axis
from .sweep_chunk import evaluate_chunk
from .sweep_store import SweepStore, is_folder_of, write_chunk

RETRIES = 10  # failures of one chunk (a worker that died, memory) before the sweep fails
TIMEOUT = "10s"  # of the connection to the scheduler
# Chunks submitted ahead, as a multiple of the workers' threads: enough that no worker waits for the driver, and few
# enough that a sweep of millions of chunks does not fill the scheduler.
AHEAD = 4


def on_cluster(
    address: str,
    problem: Problem,
    axes: Sequence[Axis],
    total: int,
    chunk: int,
    missing: Iterable[int],
    store: SweepStore,
) -> Iterator[tuple[int, np.ndarray | None]]:
    """Chunks as they finish: (number, costs), or (number, None) where the worker has written the file itself.

    Args:
        address: of the scheduler.
        problem: from `make_problem`.
        axes: of the grid.
        total: candidates.
        chunk: candidates in a chunk.
        missing: numbers of the chunks to compute.
        store: of the finished chunks; a worker that sees its folder writes there itself.

    Raises:
        InputError: where `distributed` is not installed or the scheduler does not answer.
    """
    try:
        import distributed
    except ImportError as error:
        raise InputError("scheduler=... needs Dask distributed: install fpjax[cluster].") from error
    try:
        client = distributed.Client(address, timeout=TIMEOUT, set_as_default=False)
    except (OSError, ValueError, TimeoutError) as error:
        raise InputError(
            f"No Dask scheduler answers at {address!r} ({type(error).__name__}): start one with `dask scheduler` and "
            "workers with `dask worker ADDRESS`, or leave scheduler out."
        ) from error
    folder = None if store.folder is None else str(store.folder.resolve())
    # numpy arrays, not tied to the driver's devices. x64 is a setting of the process, so it is sent along.
    payload = pickle.dumps(
        (jax.tree.map(np.asarray, problem), tuple(axes), chunk, total, bool(jax.config.jax_enable_x64))
    )
    run = uuid.uuid4().hex  # in the tasks' keys: two sweeps on one scheduler must not get each other's chunks
    with client:
        waiting = iter(missing)
        counts: Any = client.nthreads()
        threads = max(1, sum(counts.values()))

        def submit(piece: int) -> Any:
            # pure=False: a chunk whose file was lost must be computed again, not returned from the cluster's memory.
            name = f"chunk-{piece}-{run}"
            return client.submit(
                _compute, payload, piece, folder, store.identity, pure=False, retries=RETRIES, key=name
            )

        first = [submit(piece) for piece in itertools.islice(waiting, AHEAD * threads)]
        running = distributed.as_completed(first, loop=client.loop)
        for future in running:
            piece, costs = future.result()
            following = next(waiting, None)
            if following is not None:
                running.add(submit(following))
            yield piece, costs


def _compute(payload: bytes, piece: int, folder: str | None, identity: str) -> tuple[int, np.ndarray | None]:
    """On a worker: compute one chunk, and write it if the worker sees the folder of the sweep."""
    problem, axes, chunk, total = _unpacked(payload)
    # One thread: Dask runs as many tasks on a worker as it has threads.
    costs = evaluate_chunk(problem, axes, piece, chunk, total, workers=1)
    if folder is not None and is_folder_of(Path(folder), identity):
        write_chunk(Path(folder), identity, piece, costs)
        return piece, None
    return piece, costs


@functools.lru_cache(maxsize=2)
def _unpacked(payload: bytes) -> Any:
    """(problem, axes, chunk, total) of a payload; cached, as every task of a sweep brings the same one."""
    problem, axes, chunk, total, double = pickle.loads(payload)
    if double and not jax.config.jax_enable_x64:  # the worker process serves this sweep only
        jax.config.update("jax_enable_x64", True)
    return jax.tree.map(jax.numpy.asarray, problem), axes, chunk, total
