"""Design: the best motion found in a given processor time, by gradients through the simulated loop."""

import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass

import jax
import jax.numpy as jnp
import numpy as np
import optax
from jaxtyping import Array

from .trajectory import Shape
from .trial import ExpectedRun, Trial

STARTS = 10  # shapes that are tried before the best of them is improved
STEPS = 60  # of Adam at most
RATE = 0.12  # of Adam: the numbers are of order one
PATIENCE = 25  # steps without a better one, after which it ends
BETTER = 1e-3  # of the cost, to count as better
SMALLER, LEAST_SHARE = 0.85, 0.2  # a motion that needs too much torque is made smaller by this, until it is this small
UNSEEN = 0.1  # nats: what no start shows by so much has no slope either, and would be all that the worst case sees
CALMER = 0.5  # of the rate, where a step left the finite numbers


@dataclass(frozen=True)
class Designed:
    """Where a design ended.

    Attributes:
        shape: the best one.
        share: of its motion that keeps the limits as simulated [1].
        seen: what it brings.
        first: what the best start brought.
        evaluations: shapes that were tried, each with its gradient.
        ended: why: "converged", "time" or "interrupted".
        history: cost of each.
        usual: what the runs that need no plan would bring, as far as they were tried.
    """

    shape: Shape
    share: float
    seen: ExpectedRun
    first: ExpectedRun
    evaluations: int
    ended: str
    history: tuple[float, ...]
    usual: Mapping[str, ExpectedRun]


def design(
    trial: Trial,
    wanted: np.ndarray,
    *,
    seconds: float,
    seed: int,
    progress: Callable[[str, float], None],
    usual: Mapping[str, Array] | None = None,
) -> Designed | None:
    """Improve the best of some starts until the time is spent; an interrupt keeps the best so far.

    Args:
        trial: what a shape brings.
        wanted: weight of every comparison.
        seconds: of processor time for all of it, compiling included.
        seed: of the random starts.
        progress: told (stage, share done [1]).
        usual: references of runs that need no plan, to be held against it.

    Returns:
        None where every start diverged.

    Raises:
        KeyboardInterrupt: where nothing was found yet.
    """
    begun = time.process_time()
    weights = jnp.asarray(wanted, float)
    # The trial is compiled for any reference: what makes references of shapes stands outside it.
    evaluate, refer = jax.jit(jax.value_and_grad(trial.cost, has_aux=True)), jax.jit(trial.reference)
    pull = jax.jit(lambda shape, slope: jax.vjp(trial.reference, shape)[1](slope)[0])
    best: tuple[float, Shape, ExpectedRun] | None = None
    shown = np.zeros(np.shape(wanted))  # the most that any start brings of each comparison [nats]
    first: ExpectedRun | None = None
    history, beside = list[float](), dict[str, ExpectedRun]()
    slope: Shape | None = None
    ended = "converged"

    def spent() -> float:
        return (time.process_time() - begun) / seconds

    def tried(shape: Shape) -> tuple[float, ExpectedRun, Shape]:
        # The weights as they are now: what no start shows is left out after the starts.
        (cost, seen), slope = jax.block_until_ready(evaluate(refer(shape), weights))
        history.append(float(cost))
        return float(cost), seen, pull(shape, slope)

    def kept_within(reference: Array, seen: ExpectedRun) -> tuple[float, ExpectedRun]:
        # As large a share of it as the simulated machine's limits allow, and what that brings.
        share = 1.0
        while trial.beyond(seen) and share > LEAST_SHARE:
            share *= SMALLER
            (_, seen), _ = evaluate(share * reference, weights)
        return share, seen

    try:
        progress("compiling the trial", 0.0)
        starts = trial.course.starts(seed, STARTS)
        for number, start in enumerate(starts):
            cost, seen, slopes = tried(start)
            progress("trying starts", min(0.1 + 0.2 * number / len(starts), 1.0))
            if np.isfinite(cost):
                shown = np.fmax(shown, np.asarray(seen.nats))
            if np.isfinite(cost) and (best is None or cost < best[0]):
                best, slope = (cost, start, seen), slopes
            if spent() > 0.8 and best is not None:
                break
        if best is None or slope is None:
            return None
        within = np.where(shown < UNSEEN, 0.0, wanted)
        if within.any() and not np.array_equal(within, wanted):
            # Else the worst case is one that no motion within the limits can mend, and nothing is improved at all.
            weights, best = jnp.asarray(within, float), None
            for start in starts[: len(history)]:
                cost, seen, slopes = tried(start)
                if np.isfinite(cost) and (best is None or cost < best[0]):
                    best, slope = (cost, start, seen), slopes
            assert best is not None
        first = best[2]
        optimiser = optax.adam(RATE)
        shape, state, stale = best[1], optimiser.init(best[1]), 0
        for _ in range(STEPS):
            if spent() > 1.0:
                ended = "time"
                break
            progress("improving by gradients", min(0.3 + 0.7 * spent(), 1.0))
            with jax.numpy_dtype_promotion("standard"):  # optax mixes integers and floats of its own
                moves, state = optimiser.update(_finite(slope), state)
                shape = Shape(*optax.apply_updates(shape, moves))  # pyright: ignore[reportGeneralTypeIssues]
            cost, seen, slope = tried(shape)
            if not np.isfinite(cost):
                shape, state = _between(shape, best[1]), optimiser.init(best[1])
                continue
            stale = 0 if cost < best[0] - BETTER * abs(best[0]) else stale + 1
            if cost < best[0]:
                best = (cost, shape, seen)
            if stale >= PATIENCE:
                break
        for name, reference in (usual or {}).items():
            beside[name] = kept_within(reference, evaluate(reference, weights)[0][1])[1]
    except KeyboardInterrupt:
        if best is None:
            raise
        ended = "interrupted"
    share, seen = kept_within(refer(best[1]), best[2])
    start = best[2] if first is None else first
    return Designed(best[1], share, seen, start, len(history), ended, tuple(history), beside)


def _finite(slope: Shape) -> Shape:
    """A gradient of length at most one, zero where it is no number: a stick-slip event has no slope."""
    clean = Shape(*(jnp.where(jnp.isfinite(part), part, 0.0) for part in slope))
    size = jnp.sqrt(sum(jnp.sum(part**2) for part in clean))
    return Shape(*(part / jnp.maximum(size, 1.0) for part in clean))


def _between(shape: Shape, best: Shape) -> Shape:
    return Shape(*(b + CALMER * (a - b) for a, b in zip(shape, best, strict=True)))
