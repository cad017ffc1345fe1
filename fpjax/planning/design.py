"""Design: a search for the best motion in a given processor time, by gradients through the simulated loop."""

import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass

import jax
import jax.numpy as jnp
import numpy as np
import optax
from jaxtyping import Array

from .trajectory import Shape
from .trial import ExpectedRun, Trial, Wanted

STARTS = 10  # shapes that are tried before the best of them is improved
IMPROVED = 4  # starts that are improved, the best first, as long as there is time: the search is local
STEPS = 60  # largest number of steps of Adam from a start
RATE = 0.12  # Adam's step size; the parameters of a shape are of order one
PATIENCE = 25  # the search from a start ends after so many steps without an improvement of what it had reached
BETTER = 1e-3  # decrease of the cost, relative, that counts as an improvement
SMALLER, LEAST_SHARE = 0.85, 0.2  # factor by which a motion of too much torque is scaled down, and its smallest size
# [nats] A comparison that no start shows by this much has no slope either. It would be the worst case for every shape
# and leave the search nothing to improve.
UNSEEN = 0.1
# [nats] Likewise, of two effects that no start tells apart by this much: a rest alone tells an unsymmetrical friction
# from a constant torque, and a run is no rest.
ALIKE = 1.0
CALMER = 0.5  # a step that left the finite numbers is shortened by this factor


@dataclass(frozen=True)
class Designed:
    """The result of a design.

    Attributes:
        shape: the best shape.
        share: factor on its motion with which the simulated machine keeps its limits [1].
        seen: the expected run of the best shape, scaled by `share`.
        first: the expected run of the best start.
        evaluations: how many shapes were tried, each with its gradient.
        ended: why it ended: "converged", "time" or "interrupted".
        history: cost of each shape that was tried.
        usual: expected runs of the plain references, as far as they were tried.
        unseen: whether no start shows a comparison: it is left out of the design, shape (comparisons,).
        alike: whether no start tells two effects apart, or none was asked to, shape (comparisons, comparisons).
    """

    shape: Shape
    share: float
    seen: ExpectedRun
    first: ExpectedRun
    evaluations: int
    ended: str
    history: tuple[float, ...]
    usual: Mapping[str, ExpectedRun]
    unseen: np.ndarray
    alike: np.ndarray


def design(
    trial: Trial,
    wanted: np.ndarray,
    *,
    seconds: float,
    seed: int,
    progress: Callable[[str, float], None],
    usual: Mapping[str, Array] | None = None,
) -> Designed | None:
    """Improve the best of some starts until the time is spent; after an interrupt the best so far is returned.

    Args:
        trial: computes the expected evidence of a shape.
        wanted: weight of every comparison, shape (comparisons,).
        seconds: processor time of the search, after the first start, which takes the compilation [s].
        seed: of the random starts.
        progress: called with (stage, share done [1]).
        usual: plain references (a sine, a sweep) to compare the plan with.

    Returns:
        The design; None where every start diverged.

    Raises:
        KeyboardInterrupt: where no start had been tried before an interrupt.
    """
    begun = time.process_time()
    count = len(wanted)
    weights = Wanted(jnp.asarray(wanted, float), jnp.ones((count, count), bool))
    # The trial is compiled for references, not for shapes, so that the same program also serves the plain references.
    # The gradient by the shape follows by the chain rule (`pull`).
    evaluate, refer = jax.jit(jax.value_and_grad(trial.cost, has_aux=True)), jax.jit(trial.reference)
    pull = jax.jit(lambda shape, slope: jax.vjp(trial.reference, shape)[1](slope)[0])
    best: tuple[float, Shape, ExpectedRun] | None = None
    first_best = best  # by what every comparison is worth at first
    # The largest evidence of any start for each comparison, and between the effects of two [nats].
    shown, told = np.zeros(count), np.zeros((count, count))
    first: ExpectedRun | None = None
    history, beside = list[float](), dict[str, ExpectedRun]()
    unseen, alike = np.zeros(count, bool), np.zeros((count, count), bool)
    ready = list[tuple[float, Shape, Shape]]()  # starts with their costs and slopes
    ended = "converged"

    def spent() -> float:
        return (time.process_time() - begun) / seconds

    def tried(shape: Shape) -> tuple[float, ExpectedRun, Shape]:
        # `weights` is read at the time of the call: comparisons that no start shows get weight zero after the starts.
        (cost, seen), slope = jax.block_until_ready(evaluate(refer(shape), weights))
        history.append(float(cost))
        return float(cost), seen, pull(shape, slope)

    def kept_within(reference: Array, seen: ExpectedRun) -> tuple[float, ExpectedRun]:
        # The largest share of the reference with which the simulated machine keeps its limits, and its expected run.
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
            if not number:
                # Compiling takes its time whatever is asked for: counted, it left some searches no second start.
                begun = time.process_time()
            progress("trying starts", min(0.1 + 0.2 * number / len(starts), 1.0))
            if np.isfinite(cost):
                shown = np.fmax(shown, np.asarray(seen.nats))
                told = told if seen.apart is None else np.fmax(told, np.asarray(seen.apart))
                ready.append((cost, start, slopes))
                best = (cost, start, seen) if best is None or cost < best[0] else best
            if spent() > 0.8 and best is not None:
                break
        if best is None:
            return None
        unseen = shown < UNSEEN
        within = np.where(unseen, 0.0, wanted)
        alike = (told < ALIKE) | ~np.isfinite(told)
        if within.any() and not (np.array_equal(within, wanted) and not (told < ALIKE).any()):
            # Without this the worst comparison is one that no motion within the limits can improve, and the search
            # stands still.
            weights, first_best, best = Wanted(jnp.asarray(within, float), jnp.asarray(~alike)), best, None
            again, ready = ready, []
            for _, start, _ in again:
                progress("trying starts", 0.3)
                cost, seen, slopes = tried(start)
                if np.isfinite(cost):
                    ready.append((cost, start, slopes))
                    best = (cost, start, seen) if best is None or cost < best[0] else best
            assert best is not None
        first = best[2]
        optimiser = optax.adam(RATE)
        for begun_at in sorted(ready, key=lambda one: one[0])[:IMPROVED]:
            reached, slope = begun_at[:2], begun_at[2]
            shape, state, stale = reached[1], optimiser.init(reached[1]), 0
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
                    # Back towards the best shape, with Adam's averages forgotten: they led here. `slope` is not finite
                    # either, so the next step is zeros but for what `_finite` keeps.
                    shape, state = _between(shape, reached[1]), optimiser.init(reached[1])
                    continue
                stale = 0 if cost < reached[0] - BETTER * abs(reached[0]) else stale + 1
                reached = (cost, shape) if cost < reached[0] else reached
                if cost < best[0]:
                    best = (cost, shape, seen)
                if stale >= PATIENCE:
                    break
        for name, reference in (usual or {}).items():
            progress("improving by gradients", 1.0)
            beside[name] = kept_within(reference, evaluate(reference, weights)[0][1])[1]
    except KeyboardInterrupt:
        best = first_best if best is None else best
        if best is None:
            raise
        ended = "interrupted"
    share, seen = kept_within(refer(best[1]), best[2])
    start = best[2] if first is None else first
    return Designed(best[1], share, seen, start, len(history), ended, tuple(history), beside, unseen, alike)


def _finite(slope: Shape) -> Shape:
    """The gradient scaled to a length of at most one, zero where it is not finite (at a stick-slip event)."""
    clean = Shape(*(jnp.where(jnp.isfinite(part), part, 0.0) for part in slope))
    size = jnp.sqrt(sum(jnp.sum(part**2) for part in clean))
    return Shape(*(part / jnp.maximum(size, 1.0) for part in clean))


def _between(shape: Shape, best: Shape) -> Shape:
    """A shape on the way back from `shape` to `best`."""
    return Shape(*(b + CALMER * (a - b) for a, b in zip(shape, best, strict=True)))
