"""The costs of one chunk of a sweep: the same to the last bit on any number of cores and on any worker of a cluster."""

from collections.abc import Sequence

import jax
import jax.numpy as jnp
import numpy as np
from jax import lax
from jaxtyping import Array

from fpjax.compiled.batch import chunk_for, cores, map_chunks
from fpjax.compiled.threads import on_threads, settings, under

from .problem import Problem, case_costs
from .sweep_axis import Axis

CALLS = 32  # calls that a chunk is split into, where it has as many kernels: at most 32 cores work at one chunk
MOST_KNOWN = 1000  # compiled programs that `_compiled_for` remembers, so that it does not grow without bound
KERNEL_CASES = 64  # simulations in one kernel (fpjax.compiled.batch)

# Hashes of the shapes that were compiled in this process.
_compiled_for: set[int] = set()


def candidates(axes: Sequence[Axis], first: int, size: int) -> np.ndarray:
    """Candidates `first` to `first + size` of the grid, shape (size, axes); beyond the end the last one is repeated."""
    total = int(np.prod([int(axis.count) for axis in axes], dtype=object))
    index = np.minimum(np.arange(first, first + size, dtype=np.int64), total - 1)
    places = np.unravel_index(index, tuple(axis.count for axis in axes))
    return np.stack([axis.values[place] for axis, place in zip(axes, places, strict=True)], axis=1)


def evaluate_chunk(
    problem: Problem, axes: Sequence[Axis], piece: int, chunk: int, total: int, workers: int | None = None
) -> np.ndarray:
    """Costs of one chunk, shape (candidates, references); all chunks are padded to one size, and nothing recompiles.

    The costs are the same to the last bit on any number of cores and devices of one kind.

    Args:
        problem: from `make_problem`.
        axes: of the grid.
        piece: which chunk.
        chunk: candidates in a chunk.
        total: candidates of the sweep.
        workers: number of threads; None for one for each core.
    """
    size = min(chunk, total)
    values = candidates(axes, piece * chunk, size).astype(problem.dtype)
    _, plants, seeds = problem.shape
    if jax.default_backend() != "cpu":
        costs = map_chunks(_reference_costs, values, (problem,), batched=True, workers=workers)
    else:
        kernel = chunk_for(values, size)
        # A candidate is plants x seeds simulations side by side: the kernel holds fewer candidates accordingly.
        if plants * seeds > 1:
            kernel = max(1, min(kernel, size, KERNEL_CASES // (plants * seeds)))
        costs = _kernel_by_kernel(values, problem, kernel, workers or cores())
    return np.asarray(costs)[: min(total, (piece + 1) * chunk) - piece * chunk]


def _kernel_by_kernel(values: np.ndarray, problem: Problem, kernel: int, workers: int) -> np.ndarray:
    """Costs of candidates by calls of one program, whose shape does not depend on the number of cores.

    `map_chunks` would compile a loop over each core's share: with another number of cores it is another program, whose
    results differ in the last bits, so that a resumed sweep was not bit-equal to an uninterrupted one.
    """
    # A whole number of kernels for each call, of which there are about CALLS; the last block is padded with copies.
    block_size = kernel * max(1, len(values) // (kernel * CALLS))
    count = -(-len(values) // block_size)
    missing = count * block_size - len(values)
    padded = np.concatenate([values, np.broadcast_to(values[-1:], (missing, values.shape[1]))])
    threads, own = min(workers, count), settings()
    device = jax.local_devices()[:1]
    results: list[np.ndarray] = [values] * count

    def part(number: int) -> None:
        # jax settings (x64, matrix precision) are those of a thread: the workers get the caller's.
        with under(own):
            # Thread `number` takes every threads-th block: all of them have about the same work.
            for place in range(number, count, threads):
                block = padded[place * block_size : (place + 1) * block_size]
                one = map_chunks(
                    _reference_costs, block, (problem,), chunk=kernel, batched=True, devices=device, workers=1
                )
                results[place] = np.asarray(one)

    leaves = [(leaf.shape, leaf.dtype) for leaf in jax.tree.leaves(problem) if isinstance(leaf, jax.Array)]
    known = hash((block_size, own, jax.tree.structure(problem), tuple(leaves)))
    # The first call of a new program runs alone: threads side by side would each compile it.
    on_threads(part, threads, first_alone=known not in _compiled_for)
    if len(_compiled_for) >= MOST_KNOWN:
        _compiled_for.clear()
    _compiled_for.add(known)
    return np.concatenate(results)


def _reference_costs(values: Array, problem: Problem) -> Array:
    """Costs of one kernel's candidates, shape (candidates, references).

    One reference after the other: XLA vectorises over the candidates as one long axis, which a second axis of
    references breaks up. Measured with 8 references: 1.6 to 2.1 times as fast as both axes at once.
    """

    def of_reference(index: Array) -> Array:
        return jax.vmap(lambda candidate: case_costs(candidate, index, problem)[0])(values)

    costs = lax.map(of_reference, jnp.arange(problem.shape[0]))
    cost = jnp.mean(costs, axis=(2, 3)) if problem.aggregate == "mean" else jnp.max(costs, axis=(2, 3))
    return jnp.where(jnp.isfinite(cost), cost, jnp.inf).T
