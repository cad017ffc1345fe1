"""The costs of one chunk of a sweep: the same to the last bit on any number of cores and on any worker of a cluster."""

from collections.abc import Sequence

import jax
import jax.numpy as jnp
import numpy as np
from jax import lax
from jaxtyping import Array

from fpjax.compiled.batch import chunk_for, cores, map_chunks
from fpjax.compiled.threads import on_threads, settings, under

from .axis import Axis
from .problem import Problem, case_costs

CALLS = 32  # of one chunk, at least, where it has so many kernels: more cores than that share no chunk
MOST_KNOWN = 1000  # programs that are remembered as compiled
KERNEL_CASES = 64  # simulations in one kernel (fpjax.compiled.batch)

_compiled_for: set[int] = set()


def candidates(axes: Sequence[Axis], first: int, size: int) -> np.ndarray:
    """Candidates `first` to `first + size` of the grid, shape (size, axes); past the end the last one is repeated."""
    total = int(np.prod([int(axis.count) for axis in axes], dtype=object))
    index = np.minimum(np.arange(first, first + size, dtype=np.int64), total - 1)
    places = np.unravel_index(index, tuple(axis.count for axis in axes))
    return np.stack([axis.values[place] for axis, place in zip(axes, places, strict=True)], axis=1)


def evaluate_chunk(
    problem: Problem, axes: Sequence[Axis], piece: int, chunk: int, total: int, workers: int | None = None
) -> np.ndarray:
    """Costs of one chunk, shape (candidates, references); every chunk has the same shape inside, so nothing recompiles.

    The costs are the same to the last bit on any number of cores and devices of one kind.

    Args:
        problem: from `make_problem`.
        axes: of the grid.
        piece: which chunk.
        chunk: candidates in a chunk.
        total: candidates of the sweep.
        workers: threads; None for one a core.
    """
    size = min(chunk, total)
    values = candidates(axes, piece * chunk, size).astype(problem.dtype)
    _, plants, seeds = problem.shape
    if jax.default_backend() != "cpu":
        costs = map_chunks(_reference_costs, values, (problem,), batched=True, workers=workers)
    else:
        kernel = chunk_for(values, size)
        if plants * seeds > 1:
            kernel = max(1, min(kernel, size, KERNEL_CASES // (plants * seeds)))
        costs = _kernel_by_kernel(values, problem, kernel, workers or cores())
    return np.asarray(costs)[: min(total, (piece + 1) * chunk) - piece * chunk]


def _kernel_by_kernel(values: np.ndarray, problem: Problem, kernel: int, workers: int) -> np.ndarray:
    """Costs of candidates by calls of one program, whose shape does not follow the number of cores.

    A loop over the kernels of each core, as `map_chunks` compiles it, is another program for another number of cores,
    and its last bits are others.
    """
    block_size = kernel * max(1, len(values) // (kernel * CALLS))
    count = -(-len(values) // block_size)
    missing = count * block_size - len(values)
    padded = np.concatenate([values, np.broadcast_to(values[-1:], (missing, values.shape[1]))])
    threads, own = min(workers, count), settings()
    device = jax.local_devices()[:1]
    results: list[np.ndarray] = [values] * count

    def part(number: int) -> None:
        with under(own):
            for place in range(number, count, threads):
                block = padded[place * block_size : (place + 1) * block_size]
                one = map_chunks(
                    _reference_costs, block, (problem,), chunk=kernel, batched=True, devices=device, workers=1
                )
                results[place] = np.asarray(one)

    leaves = [(leaf.shape, leaf.dtype) for leaf in jax.tree.leaves(problem) if isinstance(leaf, jax.Array)]
    known = hash((block_size, own, jax.tree.structure(problem), tuple(leaves)))
    on_threads(part, threads, first_alone=known not in _compiled_for)  # or each thread would compile the same
    if len(_compiled_for) >= MOST_KNOWN:
        _compiled_for.clear()
    _compiled_for.add(known)
    return np.concatenate(results)


def _reference_costs(values: Array, problem: Problem) -> Array:
    """Costs of one kernel's candidates, shape (candidates, references).

    One reference after the other: candidates side by side are one long vector to XLA, candidates by references are not
    (half the speed with 8 references).
    """

    def of_reference(index: Array) -> Array:
        return jax.vmap(lambda candidate: case_costs(candidate, index, problem)[0])(values)

    costs = lax.map(of_reference, jnp.arange(problem.shape[0]))
    cost = jnp.mean(costs, axis=(2, 3)) if problem.aggregate == "mean" else jnp.max(costs, axis=(2, 3))
    return jnp.where(jnp.isfinite(cost), cost, jnp.inf).T
