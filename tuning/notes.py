"""Notes on tuned gains: estimates that end off the truth or cannot converge, and the solver's stability limit."""

from collections.abc import Sequence

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from fpjax.analysis.excitation import AT_THE_TRUTH, assess_excitation, error_matrix
from fpjax.blocks.observers import AbstractObserver
from fpjax.blocks.parameters import set_parameters
from fpjax.blocks.signals import Signals
from fpjax.errors import InputError
from fpjax.logs.dynamics.derivative import slope
from fpjax.simulation.loop import ClosedLoop
from fpjax.simulation.metrics import AbstractMeasure
from fpjax.simulation.scan import loop_dtype

from .measures import Fastest, SettledError
from .objective import AbstractObjective
from .problem import Problem, horizon

# Share of the solver's stability limit from which the step, and not the cost, may have stopped the search: faster
# estimates are better until the solver goes unstable, so that such an optimum moves with dt.
CLOSE = 0.8
EULER_LIMIT = 2.0  # |rate| x dt at which forward Euler turns unstable: a sampled observer takes one Euler step a period
AT_REST = (
    "the machine never moves: the torque that the controller asks for stays below the friction that holds it, so no "
    "gain of an observer matters; give larger kp and ki, a larger reference, or a larger torque limit."
)
SETTLED = "settled."  # prefix of an estimate's name: the bare name is that of an objective's measure
LAST_QUARTER = 0.75  # share of the run after which an estimate is taken to have settled
WINDOW = 5000  # most samples of a reference that its excitation is judged by; a longer one is thinned
NAMES = ("coulomb", "viscous", "steepness")


class ObserverRate(AbstractMeasure):
    """Largest s(w).phi(w) / J along a run [1/s]: the fastest rate of the error dynamics.

    The error dynamics are e' = -(1/J) s(w) phi(w)^T e, with s = (g2', g1') and phi = (sign w, w) for the EFP, thesis
    (4.12). The matrix has rank one: its only nonzero eigenvalue is its trace.


    Attributes:
        observer: whose error matrix is taken.
        parameters: true values by name.
    """

    observer: AbstractObserver
    parameters: dict[str, Array]

    def init(self, zero: Array) -> Array:
        """Zero."""
        return zero

    def update(self, total: Array, signals: Signals) -> Array:
        """The larger one."""
        rate = -jnp.trace(error_matrix(self.observer, signals.velocity, self.parameters))
        return jnp.maximum(total, rate)

    def final(self, total: Array, samples: int) -> Array:
        """The largest [1/s]."""
        del samples
        return total


def truths(loop: ClosedLoop, objective: AbstractObjective) -> dict[str, Array]:
    """True values by name: the objective's `truths`, else those of the plant's friction law, where it has them."""
    given = getattr(objective, "truths", {})
    found = {name: given.get(name, getattr(loop.plant.friction, name, None)) for name in NAMES}
    return {name: value for name, value in found.items() if value is not None}


def judging_measures(loop: ClosedLoop, objective: AbstractObjective, horizon: Array) -> dict[str, AbstractMeasure]:
    """Measures that the notes need: "rate", "fastest", and "settled.NAME" for every estimate.

    Args:
        loop: its friction law gives the true values that the objective does not.
        objective: with or without `truths` of its own.
        horizon: time of the last sample [s].
    """
    known = truths(loop, objective)
    settled = {
        f"{SETTLED}{name}": SettledError(name, known[name], LAST_QUARTER * horizon)
        for name in loop.observer.estimated
        if name in known
    }
    return rate_measure(loop, objective) | {"fastest": Fastest()} | settled


def rate_measure(loop: ClosedLoop, objective: AbstractObjective) -> dict[str, AbstractMeasure]:
    """`ObserverRate` under the name "rate"; empty where the observer's error dynamics are not known."""
    parameters = truths(loop, objective)
    if not loop.observer.estimated:
        return {}
    try:
        # Tried in shapes only: an observer of the user's own may have no slopes or regressor, or need an unknown truth.
        rest = jnp.zeros((), loop_dtype(loop))
        jax.eval_shape(lambda: error_matrix(loop.observer, rest, parameters))
    except (AttributeError, KeyError):
        return {}
    return {"rate": ObserverRate(loop.observer, parameters)}


def notes_of(
    problem: Problem,
    gains: dict[str, float],
    rate: float,
    fastest: float,
    off: dict[str, float],
    tables: Sequence[tuple[str, Array]],
    draws: int = 0,
) -> list[str]:
    """Sentences on one set of gains.

    Args:
        problem: what was tuned.
        gains: by parameter name.
        rate: the largest `ObserverRate` of all cases [1/s].
        fastest: the largest |w| of all cases [rad/s].
        off: by estimate, the `SettledError` of largest magnitude over all cases, with its sign [1].
        tables: (label, reference [rad/s] (or [rad] for a position loop) of shape (samples,)) of each.
        draws: number of noise draws that `off` is the worst of; 0 where the problem has its own noise, or none.
    """
    if fastest == 0.0:
        return [AT_REST]
    return [
        *_accuracy(off, _noise_clause(problem, draws)),
        *_stability(problem, rate),
        *_excitation(problem, gains, off, tables),
    ]


def _noise_clause(problem: Problem, draws: int) -> str:
    """The words for the noise under which the runs were judged; "" for none."""
    if not draws and any(bool(np.any(np.asarray(table))) for table in problem.noise):
        draws = problem.seeds
    if draws > 1:
        return f", in the worst of {draws} draws of the sensor's noise"
    return ", under one draw of the sensor's noise" if draws else ""


def _accuracy(off: dict[str, float], noise: str = "") -> list[str]:
    wrong = [
        f"{name} {100.0 * value:+.3g} %" if np.isfinite(value) else f"{name} without bound"
        for name, value in off.items()
        if not abs(value) <= AT_THE_TRUTH
    ]
    if not wrong:
        return []
    return [
        f"with these gains the estimates end off the truth, by the mean of the last quarter{noise}: "
        f"{', '.join(wrong)}. Gains alone may not mend it: simulate longer (duration), let the reference change its "
        f"amplitude or frequency, or count later (Estimation(start=...), --after)."
    ]


def _stability(problem: Problem, rate: float) -> list[str]:
    stepper = problem.stepper
    dt = float(np.asarray(stepper.dt))
    limit = EULER_LIMIT if stepper.stepping == "sampled" else stepper.solver.stability_limit
    # `not >=`: a rate that is NaN makes no note.
    if not rate * dt >= CLOSE * limit:
        return []
    whose = "the sampled observer's" if stepper.stepping == "sampled" else f"{stepper.solver.name}'s"
    return [
        f"at the solver's stability limit: the observer's largest rate x dt = {rate * dt:.3g}, {whose} limit is "
        f"{limit:.3g}, so the step and not the cost may have stopped the search; re-check with a smaller dt."
    ]


def _excitation(
    problem: Problem, gains: dict[str, float], off: dict[str, float], tables: Sequence[tuple[str, Array]]
) -> list[str]:
    if not problem.loop.observer.estimated:
        return []
    loop = set_parameters(problem.loop, gains)
    parameters = truths(loop, problem.objective)
    said = []
    for label, table in tables:
        # Excitation is a property of the shape of the reference: 5,000 samples of it show as much as a million.
        every = -(-len(table) // WINDOW)
        dt = float(np.asarray(problem.stepper.dt)) * every
        velocity = np.asarray(table, dtype=float)[::every]
        # The observer sees the velocity: that of a position reference is its slope.
        if loop.controller.follows_position:
            velocity = slope(velocity, dt)
        try:
            found = assess_excitation(loop.observer, velocity, dt, parameters, duration=float(horizon(problem)))
        except (InputError, AttributeError, KeyError):
            continue  # an observer whose error dynamics are not known
        said += [f"on {label}, {sentence}" for sentence in found.sentences_of(off)]
    return said
