"""A batch of candidates of any size, in chunks that fit one kernel, on all cores.

A chunk takes about the same time whatever its size up to the vector width, and its memory is bounded. So a million
candidates take as long as their chunks do, one after the other on every core.
"""

import concurrent.futures
import contextlib
import dataclasses
import functools
import os
from collections.abc import Callable, Hashable, Iterator, Sequence
from types import ModuleType
from typing import Any

import jax
import jax.core
import jax.dtypes
import jax.extend.core
import jax.numpy as jnp
import numpy as np
from jax import lax
from jax.core import Tracer
from jax.sharding import Mesh, PartitionSpec
from jaxtyping import PyTree

from ..errors import InputError
from .native import GPUS, native, native_enabled, platform
from .threads import on_threads, settings, under

Device = Any  # jax.Device is a variable to a type checker
# Which of the two modules has `get_opaque_trace_state` depends on jax's version.
_core: ModuleType = jax.extend.core if hasattr(jax.extend.core, "get_opaque_trace_state") else jax.core

# Candidates in one kernel: one chunk keeps its states in the first-level cache and its loops long
# enough that LLVM vectorizes them (docs/performance.md).
CHUNK_FLOAT64 = 64
CHUNK_FLOAT32 = 128
# LLVM turns loops shorter than this into scalar code, except at powers of two. So some numbers of candidates run faster
# when they are padded: by the bytes of a float, pairs (from this number on, pad to this number), as measured.
VECTORIZED_FROM = 48
PADDED = {8: ((6, 8), (28, VECTORIZED_FROM)), 4: ((4, 8), (9, VECTORIZED_FROM))}
# With fewer candidates per core than this, handing work to a thread takes longer than the thread saves.
PER_WORKER = 48


def map_chunks(
    fn: Callable[..., PyTree],
    arguments: PyTree,
    shared: tuple[PyTree, ...] = (),
    *,
    chunk: int | None = None,
    batched: bool = False,
    devices: Sequence[Device] | None = None,
    workers: int | None = None,
) -> PyTree:
    """`vmap(fn)` over a leading axis, chunk by chunk in one kernel each, on all cores.

    Inside a jit, grad or vmap it is one `lax.map` on one device. It is compiled once for each `fn` and shape, so
    pass the same function object again, not a new lambda.

    Args:
        fn: `fn(candidate, *shared)` -> pytree of arrays for one candidate; if `batched`, for a whole chunk, with the
            leading axis in and out.
        arguments: the candidates, a pytree with leading axis B on every leaf.
        shared: what all candidates share (tables, logs), passed on as it is.
        chunk: candidates in one kernel; by default at most 64 (float64) or 128 (float32).
        batched: see `fn`.
        devices: used by `shard_map` where there are several; by default all local ones.
        workers: on a single CPU device, threads that share the work; by default one a core.

    Returns:
        The results of `fn`, with leading axis B.

    Raises:
        InputError: where the leaves have no common leading axis.
    """
    size, width = _size_and_width(arguments)
    if _traced(arguments, shared):
        # Within a trace there are no values to give to threads: one loop, on the device of the outer program.
        chunk = chunk or _chunk_on(platform(), size, width)
        count = -(-size // chunk)
        blocks = jax.tree.map(lambda leaf: _blocks(jnp, leaf, count, chunk), arguments)
        return _first(_chunked(fn, batched)(blocks, shared), size)

    where = tuple(jax.local_devices() if devices is None else devices)
    workers = 1 if size < 2 * PER_WORKER else workers or cores()
    plan = _plan(fn, batched, size, width, chunk, where, workers, native_enabled())
    with contextlib.nullcontext() if devices is None else jax.default_device(where[0]):
        if plan.single:
            return plan.run(arguments, shared)
        # Cut and padded by numpy, which compiles nothing; jax would compile a slice for every new batch size.
        blocks = jax.tree.map(lambda leaf: _blocks(*_here(leaf), plan.count, plan.chunk), arguments)
        if plan.threads == 1:
            return _first(plan.run(blocks, shared), size)
        return _threaded(plan, blocks, shared, where[0], size)


def iterate_chunks(
    fn: Callable[..., PyTree],
    arguments: PyTree,
    shared: tuple[PyTree, ...] = (),
    *,
    size: int = 16384,
    start: int = 0,
    chunk: int | None = None,
    batched: bool = False,
    devices: Sequence[Device] | None = None,
    workers: int | None = None,
) -> Iterator[tuple[slice, PyTree]]:
    """`map_chunks` in pieces of `size` candidates: yields (slice of the batch, its result).

    For sweeps that take minutes: between two pieces the caller draws its progress bar, writes its file, is
    interrupted. Every piece has the same shape (the last is padded), so nothing recompiles and a candidate's result
    does not depend on where a run was resumed.

    Args:
        fn: see `map_chunks`, as `arguments`, `shared`, `chunk`, `batched`, `devices` and `workers`.
        arguments: the candidates.
        shared: what all candidates share.
        size: candidates of a piece.
        start: the first candidate still to do, a multiple of `size`.
        chunk: candidates in one kernel.
        batched: whether `fn` takes a whole chunk.
        devices: devices that share the work.
        workers: threads that share the work.

    Yields:
        (slice of the batch, the results of its candidates as numpy arrays).

    Raises:
        InputError: where the leaves have no common leading axis, or `start` is not a multiple of `size`.
    """
    total = batch_size(arguments)
    if size < 1 or start % size:
        raise InputError(
            f"size={size}, start={start}: pieces hold at least one candidate and a run resumes at "
            "a multiple of the piece."
        )
    for first in range(start, total, size):
        piece = slice(first, min(first + size, total))
        taken = jax.tree.map(lambda leaf, piece=piece: np.asarray(leaf)[piece], arguments)
        if total > size:  # a batch that fits one piece keeps its own shape: padding it would only cost time
            taken = jax.tree.map(lambda leaf: _padded(np, leaf, size), taken)
        result = map_chunks(fn, taken, shared, chunk=chunk, batched=batched, devices=devices, workers=workers)
        number = piece.stop - piece.start
        yield piece, jax.tree.map(lambda leaf, number=number: np.asarray(leaf)[:number], result)


def batch_size(arguments: PyTree) -> int:
    """The number of candidates.

    Raises:
        InputError: where the leaves do not agree on one.
    """
    return _size_and_width(arguments)[0]


def chunk_for(arguments: PyTree, size: int) -> int:
    """How many candidates go into one kernel, for `size` candidates of this precision."""
    return _chunk_for(size, _size_and_width(arguments)[1])


def _traced(*arguments: PyTree) -> bool:
    """Whether a trace is going on: without tracers among the arguments it may still have some in the function."""
    return _core.get_opaque_trace_state() != _no_trace() or any(
        isinstance(leaf, Tracer) for leaf in jax.tree.leaves(arguments)
    )


@functools.lru_cache(maxsize=1)
def _no_trace() -> object:
    """jax's state outside every trace: that of a fresh thread, because the first call may stand within a trace."""
    with concurrent.futures.ThreadPoolExecutor(1) as fresh:
        return fresh.submit(_core.get_opaque_trace_state).result()


def _size_and_width(arguments: PyTree) -> tuple[int, int]:
    """(the number of candidates, the bytes of their widest number: 8 or 4)."""
    sizes, width = set(), 4
    for leaf in jax.tree.leaves(arguments):
        leaf = leaf if hasattr(leaf, "dtype") else jax.eval_shape(jnp.asarray, leaf)
        sizes.add(leaf.shape[:1])
        if leaf.dtype.itemsize >= 8:
            width = 8
    if len(sizes) != 1 or () in sizes or (0,) in sizes:
        shapes = [np.shape(leaf) for leaf in jax.tree.leaves(arguments)]
        raise InputError(
            f"A batch needs one leading axis of candidates on every array, not shapes {shapes}: "
            "broadcast what all candidates share, or pass it as shared."
        )
    return sizes.pop()[0], width


def _chunk_for(size: int, width: int) -> int:
    full = CHUNK_FLOAT64 if width == 8 else CHUNK_FLOAT32
    if size >= full:
        count = -(-size // full)
        # The candidates are spread evenly over the chunks, so that the last is not nearly empty; in multiples of 8, the
        # doubles of one 512-bit register. From nine chunks on an empty last one costs little, and full ones share a
        # compiled program between batch sizes.
        even = -(-size // (8 * count)) * 8
        return full if count > 8 else min(full, max(VECTORIZED_FROM, even))
    return next((to for start, to in PADDED[width] if start <= size <= to), size)


def _chunk_on(kind: str, share: int, width: int) -> int:
    """Candidates in one chunk, for a device that computes `share` candidates: the only place here that knows of GPUs.

    On a GPU every turn of the scan launches its kernels over the whole chunk: the more candidates in one chunk, the
    fewer launches (docs/performance.md). A kernel that holds all steps would be chosen here.
    """
    return share if kind in GPUS else _chunk_for(share, width)


def cores() -> int:
    """The cores that this process may use."""
    count = getattr(os, "sched_getaffinity", None)
    return len(count(0)) if count else os.cpu_count() or 1


def _chunked(fn: Callable[..., PyTree], batched: bool, single: bool = False) -> Callable[..., PyTree]:
    def run(blocks: PyTree, shared: tuple[PyTree, ...]) -> PyTree:
        # The kernel is asked for around one chunk, inside the loop over chunks: its states then stay in the
        # first-level cache.
        whole = fn if batched else jax.vmap(fn, in_axes=(0, *(None for _ in shared)))
        kernel = native(whole)
        if single:
            return kernel(blocks, *shared)
        if jax.tree.leaves(blocks)[0].shape[0] == 1:  # no loop around a single chunk
            return kernel(jax.tree.map(lambda leaf: leaf[0], blocks), *shared)
        result = lax.map(lambda block: kernel(block, *shared), blocks)
        return jax.tree.map(lambda leaf: leaf.reshape(-1, *leaf.shape[2:]), result)

    return run


@dataclasses.dataclass(frozen=True)
class _Plan:
    """How a batch of one size runs.

    Attributes:
        run: the jitted loop over chunks.
        seen: the shapes that `run` was compiled for.
        chunk: candidates in one kernel.
        count: chunks of the whole batch, the same number for each device or thread.
        threads: threads that share the chunks.
        single: whether the batch is one chunk as it stands.
    """

    run: Callable[..., PyTree]
    seen: set[Hashable]
    chunk: int
    count: int
    threads: int
    single: bool


@functools.lru_cache(maxsize=64)
def _plan(
    fn: Callable[..., PyTree],
    batched: bool,
    size: int,
    width: int,
    chunk: int | None,
    where: tuple[Device, ...],
    workers: int,
    enabled: bool,
) -> _Plan:
    """How a batch of this size runs. Cached, because deciding it anew takes about as long as running a short batch."""
    if not where:
        raise InputError("devices=() leaves nothing to compute on: give at least one, or None.")
    if size < len(where) * PER_WORKER:
        where = where[:1]
    # Several devices share the work by `shard_map`; threads are only for the usual case of one CPU device.
    on_cpu, threads = where[0].platform == "cpu", 1
    if len(where) == 1 and on_cpu:
        threads = max(1, min(workers, size // PER_WORKER))
    parts = max(len(where), threads)
    chunk = chunk or _chunk_on(where[0].platform, -(-size // parts), width)
    single = parts == 1 and chunk == size
    several = where if len(where) > 1 else None
    run, seen = _compiled(fn, batched, on_cpu and chunk >= VECTORIZED_FROM, enabled, several, single)
    # The number of chunks is rounded up to a multiple of the threads or devices: each gets the same shape, one
    # program.
    return _Plan(run, seen, chunk, -(-size // (chunk * parts)) * parts, threads, single)


@functools.lru_cache(maxsize=64)
def _compiled(
    fn: Callable[..., PyTree],
    batched: bool,
    wide: bool,
    enabled: bool,
    devices: tuple[Device, ...] | None,
    single: bool,
) -> tuple[Callable[..., PyTree], set[Hashable]]:
    """(the jitted loop over chunks, the shapes that it was compiled for).

    `enabled` is only there so that a switched `native` traces anew.
    """
    del enabled
    run = _chunked(fn, batched, single)
    if devices is not None:
        mesh = Mesh(np.array(devices), ("candidates",))
        split, whole = PartitionSpec("candidates"), PartitionSpec()
        # Unchecked: a loop's initial state is a constant until the first step mixes the candidate in, which the check
        # of what varies over devices takes for an error.
        run = jax.shard_map(run, mesh=mesh, in_specs=(split, whole), out_specs=split, check_vma=False)
    # 512-bit vectors: 15-50 % faster on long loops, slower on short ones.
    options = {"xla_cpu_prefer_vector_width": "512"} if wide else None
    return jax.jit(run, compiler_options=options), set()


def _threaded(plan: _Plan, blocks: PyTree, shared: tuple[PyTree, ...], device: Device, size: int) -> PyTree:
    """The chunks, shared by threads: each runs an equal part of them.

    XLA releases the interpreter lock while it computes, so threads are enough. A second CPU device for `shard_map` can
    only be asked for before jax starts.
    """
    each, own = plan.count // plan.threads, settings()

    def part(number: int) -> PyTree:
        taken = jax.tree.map(lambda leaf: leaf[number * each : (number + 1) * each], blocks)
        with under(own), jax.default_device(device):
            return jax.block_until_ready(plan.run(taken, shared))

    leaves = jax.tree.leaves((blocks, shared))
    known = (plan.threads, own, *((np.shape(leaf), getattr(leaf, "dtype", type(leaf))) for leaf in leaves))
    results = on_threads(part, plan.threads, first_alone=known not in plan.seen)  # or each would compile the same
    plan.seen.add(known)

    def joined(*parts: PyTree) -> PyTree:
        numpy = _here(parts[0])[0]
        return jnp.asarray(numpy.concatenate([_here(each)[1] for each in parts])[:size])

    return jax.tree.map(joined, *results)


def _here(leaf: PyTree) -> tuple[PyTree, PyTree]:
    """(numpy or jax.numpy, the leaf as an array of it): jax.numpy for random keys, which numpy cannot hold."""
    dtype = getattr(leaf, "dtype", None)
    if dtype is not None and jnp.issubdtype(dtype, jax.dtypes.extended):
        return jnp, leaf
    return np, np.asarray(leaf)


def _blocks(numpy: ModuleType, leaf: PyTree, count: int, chunk: int) -> PyTree:
    """A leaf of shape (B, ...) as (count, chunk, ...)."""
    return _padded(numpy, leaf, count * chunk).reshape(count, chunk, *leaf.shape[1:])


def _padded(numpy: ModuleType, leaf: PyTree, size: int) -> PyTree:
    """The leaf with its last candidate repeated up to `size`: padding computes nothing new and cannot diverge alone."""
    missing = size - leaf.shape[0]
    if missing == 0:
        return leaf
    return numpy.concatenate([leaf, numpy.broadcast_to(leaf[-1:], (missing, *leaf.shape[1:]))])


def _first(result: PyTree, size: int) -> PyTree:
    return jax.tree.map(lambda leaf: leaf if leaf.shape[0] == size else leaf[:size], result)
