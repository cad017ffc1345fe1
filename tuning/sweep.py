"""Dense sweeps over any named parameters: chunked, bounded in memory, resumable, on this machine or on a cluster."""

import time
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path
from typing import Any, Unpack

import jax
import jax.numpy as jnp
import numpy as np
from jax import lax

from fpjax import ClosedLoop
from fpjax.compiled.batch import chunk_for, cores, map_chunks
from fpjax.compiled.threads import on_threads, settings, under
from fpjax.errors import InputError
from fpjax.output.progress import Stages
from fpjax.parameters import get_parameter

from .axis import Axis
from .parameters import Parameter
from .problem import Problem, References, case_costs, make_problem
from .result import versions
from .setup import Setup, SetupWords, settled
from .sweep_result import SweepResult
from .sweep_store import SweepStore, fingerprint

CHUNK = 4096  # candidates of one chunk: of one file, of one task of a cluster
LARGEST = 10**10  # candidates; more is a slip of a count, not a sweep
CALLS = 32  # of one chunk, at least, where it has so many kernels: more cores than that share no chunk
MOST_KNOWN = 1000  # programs that are remembered as compiled
STEPS_A_SECOND = 1e8  # of one machine, to say how long; an estimate
KERNEL_CASES = 64  # simulations in one kernel (fpjax.compiled.batch)

_compiled_for: set[int] = set()


def sweep(
    loop: ClosedLoop,
    references: References,
    *,
    axes: Sequence[Axis],
    setup: Setup | None = None,
    chunk: int = CHUNK,
    out: str | Path | None = None,
    resume: bool = False,
    scheduler: str | None = None,
    progress: bool = False,
    **words: Unpack[SetupWords],
) -> SweepResult:
    """The cost at every point of a grid over named parameters.

    Args:
        loop: the closed loop; its own friction law is the truth that estimates are judged by.
        references: one, a list, or a dictionary by label; each has its own cost at every point.
        axes: one for each parameter; the first varies slowest.
        setup: how a candidate is judged: step, horizon, solver, objective, plants, noise.
        chunk: candidates in one file; memory grows with it, not with the sweep.
        out: folder for the finished chunks; without it an interrupted sweep is lost.
        resume: go on with what is in `out`; the result is bit-equal to an uninterrupted one, also with another number
            of cores. A damaged chunk is computed again, with a warning.
        scheduler: address of a Dask scheduler ("tcp://host:8786"), extra `cluster`; `out` should then be a folder that
            the workers see too.
        progress: show a bar with an ETA on stderr, where that is a terminal.
        **words: fields of `Setup` (dt, duration, samples, objective, solver, stepping, substeps, plants, noise_seeds,
            aggregate), in place of those of `setup`.

    Returns:
        The grid of costs; a diverged candidate costs infinity.

    Raises:
        InputError: for what cannot be, with what to do.
        KeyboardInterrupt: on Ctrl-C; the chunks finished by then stay in `out`.
    """
    judged = settled(setup, words)
    if judged.dt is None:
        raise InputError("sweep needs dt, the step [s].")
    problem, labels, axes = _prepare(loop, references, axes, judged.words())
    if chunk < 1:
        raise InputError(f"chunk = {chunk} cannot be: give at least 1 candidate.")
    shape = tuple(axis.count for axis in axes)
    total, columns = int(np.prod([int(count) for count in shape], dtype=object)), problem.shape[0]
    if total > LARGEST:
        steps = total * int(np.prod(problem.shape)) * problem.stepper.samples * problem.stepper.substeps
        raise InputError(
            f"The axes make {total:.4g} candidates, more than {LARGEST:.0g}: at an estimated {STEPS_A_SECOND:.0e} steps"
            f" a second they would take about {steps / STEPS_A_SECOND / (365.25 * 86_400):.2g} years; give smaller "
            "counts, or tune with several starts."
        )
    pieces = -(-total // chunk)
    identity = "" if out is None else fingerprint(problem, axes, chunk)
    begin = time.perf_counter()
    with SweepStore(out, identity, total, columns, chunk, problem.dtype, resume=resume) as store:
        _fill(store, problem, axes, total, chunk, pieces, scheduler, progress)
        costs = store.assemble()
    return SweepResult(
        axes=tuple(axes),
        references=labels,
        costs=costs.reshape(*shape, columns),
        objective=type(problem.objective).__name__.lower(),
        simulations=total * int(np.prod(problem.shape)),
        simulated_steps=total * int(np.prod(problem.shape)) * problem.stepper.samples,
        run_seconds=time.perf_counter() - begin,
        versions=versions(),
    )


def _fill(
    store: SweepStore,
    problem: Problem,
    axes: Sequence[Axis],
    total: int,
    chunk: int,
    pieces: int,
    scheduler: str | None,
    progress: bool,
) -> None:
    """Compute what the store has not."""
    there = store.finished()
    finished, missing = len(there), store.missing(there)
    bar = Stages(f"sweep of {total:,} candidates") if progress else None
    if bar is not None:
        bar.begin_at(finished / pieces)
        bar.stage("compiling, then the first chunk")
    try:
        if scheduler is None:
            done = _local(problem, axes, total, chunk, missing)
        else:
            from .cluster import on_cluster

            done = on_cluster(scheduler, problem, axes, total, chunk, missing, store)
        for piece, costs in done:
            if costs is not None:
                store.keep(piece, costs)
            finished += 1
            if bar is not None:
                bar.stage(f"{finished:,} of {pieces:,} chunks", finished / pieces)
    finally:
        if bar is not None:
            bar.end()


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


def _local(
    problem: Problem, axes: Sequence[Axis], total: int, chunk: int, missing: Iterable[int]
) -> Iterator[tuple[int, np.ndarray]]:
    for piece in missing:
        yield piece, evaluate_chunk(problem, axes, piece, chunk, total)


def _reference_costs(values: Any, problem: Problem) -> Any:
    """Costs of one kernel's candidates, shape (candidates, references).

    One reference after the other: candidates side by side are one long vector to XLA, candidates by references are not
    (half the speed with 8 references).
    """

    def of_reference(index: Any) -> Any:
        return jax.vmap(lambda candidate: case_costs(candidate, index, problem)[0])(values)

    costs = lax.map(of_reference, jnp.arange(problem.shape[0]))
    cost = jnp.mean(costs, axis=(2, 3)) if problem.aggregate == "mean" else jnp.max(costs, axis=(2, 3))
    return jnp.where(jnp.isfinite(cost), cost, jnp.inf).T


def _prepare(
    loop: ClosedLoop, references: References, axes: Sequence[Axis], settings: dict[str, Any]
) -> tuple[Problem, tuple[str, ...], tuple[Axis, ...]]:
    axes = tuple(axes)
    if not axes:
        raise InputError("There is nothing to sweep: give at least one Axis, as Axis('observer.gain_1', 1, 1e3, 50).")
    for axis in axes:
        get_parameter(loop, axis.name)
        axis.check()
    # A linear space has no say in a sweep; it only lets a parameter be zero or negative.
    named = [Parameter(axis.name, axis.low, axis.low, axis.low + 1.0, "linear") for axis in axes]
    problem, _, labels = make_problem(loop, references, named, **settings)
    return problem, labels, axes
