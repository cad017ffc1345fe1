"""Dense sweeps over any named parameters: chunked, bounded in memory, resumable, on this machine or on a cluster."""

import time
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path
from typing import Unpack

import numpy as np

from fpjax.blocks.parameters import get_parameter
from fpjax.errors import InputError
from fpjax.output.json_object import JsonObject
from fpjax.output.progress import Stages, drawing
from fpjax.simulation.loop import ClosedLoop

from .cluster import on_cluster
from .parameters import Parameter
from .problem import Problem, References, make_problem
from .result import versions
from .setup import Setup, SetupWords, with_keywords
from .sweep_axis import Axis
from .sweep_chunk import evaluate_chunk
from .sweep_result import SweepResult
from .sweep_store import SweepStore, fingerprint, fingerprints

CHUNK = 4096  # candidates of one chunk, which is one file and one task of a cluster
LARGEST = 10**10  # candidates of a sweep; more is a mistyped count: days to years on one machine
PICTURES = 3.0  # time of the command's pictures and page, as a multiple of the processor time of starting (for the ETA)
STEPS_A_SECOND = 1e8  # simulated steps a second of one core, an estimate for the message on too many candidates


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
        axes: one for each parameter; the first one varies slowest in the order of candidates.
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
        InputError: for invalid input, with what to do.
        KeyboardInterrupt: on Ctrl-C; the chunks finished by then stay in `out`.
    """
    judged = with_keywords(setup, words)
    if judged.dt is None:
        raise InputError("sweep needs dt, the step [s].")
    problem, labels, axes = _prepare(loop, references, axes, judged.words())
    if chunk < 1:
        raise InputError(f"chunk must be at least 1 candidate, got {chunk}.")
    shape = tuple(axis.count for axis in axes)
    # Python integers: the product of mistyped counts overflows int64 and would pass the check below.
    total, columns = int(np.prod([int(count) for count in shape], dtype=object)), problem.shape[0]
    if total > LARGEST:
        steps = total * int(np.prod(problem.shape)) * problem.stepper.samples * problem.stepper.substeps
        raise InputError(
            f"The axes make {total:.4g} candidates, more than {LARGEST:.0g}: at an estimated {STEPS_A_SECOND:.0e} steps"
            f" a second they would take about {steps / STEPS_A_SECOND / (365.25 * 86_400):.2g} years; give smaller "
            "counts, or tune with several starts."
        )
    # Rounded up: the last chunk may be shorter.
    pieces = -(-total // chunk)
    identity = "" if out is None else fingerprint(problem, axes, chunk)
    parts = None if out is None else fingerprints(problem, axes, chunk)
    begin = time.perf_counter()
    with SweepStore(out, identity, total, columns, chunk, problem.dtype, resume=resume, parts=parts) as store:
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
        identity=identity,
    )


def sweep_identity(
    loop: ClosedLoop, references: References, *, axes: Sequence[Axis], setup: Setup | None = None, chunk: int = CHUNK,
    **words: Unpack[SetupWords],
) -> str:  # fmt: skip
    """A hash of everything that the costs of a sweep depend on, as `sweep` keeps it in `SweepResult.identity`.

    Args:
        loop: as of `sweep`, and so are the others.
        references: likewise.
        axes: likewise.
        setup: likewise.
        chunk: likewise.
        **words: likewise.

    Raises:
        InputError: as `sweep` does.
    """
    problem, _, axes = _prepare(loop, references, axes, with_keywords(setup, words).words())
    return fingerprint(problem, axes, chunk)


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
    """Compute the chunks that the store lacks, and keep each as it is finished."""
    there = store.finished()
    finished, missing = len(there), store.missing(there)
    bar = Stages(f"sweep of {total:,} candidates", tail=drawing(PICTURES)) if progress else None
    if bar is not None:
        bar.begin_at(finished / pieces)
        bar.stage("compiling, then the first chunk")
    try:
        if scheduler is None:
            done = _local(problem, axes, total, chunk, missing)
        else:
            done = on_cluster(scheduler, problem, axes, total, chunk, missing, store)
        for piece, costs in done:
            # None: a worker of the cluster has written the chunk itself.
            if costs is not None:
                store.keep(piece, costs)
            finished += 1
            if bar is not None:
                bar.stage(f"{finished:,} of {pieces:,} chunks", finished / pieces)
    finally:
        if bar is not None:
            bar.end()


def _local(
    problem: Problem, axes: Sequence[Axis], total: int, chunk: int, missing: Iterable[int]
) -> Iterator[tuple[int, np.ndarray]]:
    for piece in missing:
        yield piece, evaluate_chunk(problem, axes, piece, chunk, total)


def _prepare(
    loop: ClosedLoop, references: References, axes: Sequence[Axis], settings: JsonObject
) -> tuple[Problem, tuple[str, ...], tuple[Axis, ...]]:
    axes = tuple(axes)
    if not axes:
        raise InputError("There is nothing to sweep: give at least one Axis, as Axis('observer.gain_1', 1, 1e3, 50).")
    for axis in axes:
        get_parameter(loop, axis.name)
        axis.check()
    # `make_problem` wants bounds, which a sweep does not use; a linear scale allows values of zero and below.
    named = [Parameter(axis.name, axis.low, axis.low, axis.low + 1.0, "linear") for axis in axes]
    problem, _, labels = make_problem(
        loop, references, named, largest={axis.name: axis.high for axis in axes}, **settings
    )
    return problem, labels, axes
