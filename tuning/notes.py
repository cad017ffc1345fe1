"""What to look at before tuned gains are used: the solver's stability limit, and estimates that cannot converge."""

from collections.abc import Sequence
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from fpjax import AbstractMeasure, AbstractObserver, ClosedLoop, PositionLoop, Signals
from fpjax.analysis.excitation import assess_excitation, error_matrix
from fpjax.errors import InputError
from fpjax.parameters import set_parameters
from fpjax.scan import loop_dtype

from .objective import AbstractObjective
from .problem import Problem, horizon

CLOSE = 0.8  # share of the solver's stability limit from which an optimum is suspected to be the solver's
EULER_LIMIT = 2.0  # of the observer's own step when sampled
WINDOW = 5000  # samples of the motion that are looked at
NAMES = ("coulomb", "viscous", "steepness")


class ObserverRate(AbstractMeasure):
    """Largest s(w).phi(w) / J along a run [1/s]: the fastest that the estimates move, minus the trace of (4.12).

    Attributes:
        observer: whose.
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
    """True values by name, as far as the objective or the plant's friction law tells them."""
    told = getattr(objective, "truths", {})
    found = {name: told.get(name, getattr(loop.plant.friction, name, None)) for name in NAMES}
    return {name: value for name, value in found.items() if value is not None}


def rate_measure(loop: ClosedLoop, objective: AbstractObjective) -> dict[str, AbstractMeasure]:
    """`ObserverRate` by "rate"; nothing where the observer's error dynamics are not known."""
    parameters = truths(loop, objective)
    if not loop.observer.estimated:
        return {}
    try:
        rest = jnp.zeros((), loop_dtype(loop))
        jax.eval_shape(lambda: error_matrix(loop.observer, rest, parameters))
    except (AttributeError, KeyError):
        return {}
    return {"rate": ObserverRate(loop.observer, parameters)}


def notes_of(problem: Problem, gains: dict[str, float], rate: float, tables: Sequence[tuple[str, Any]]) -> list[str]:
    """Sentences on one set of gains.

    Args:
        problem: what was tuned.
        gains: by parameter name.
        rate: the largest `ObserverRate` of all cases [1/s].
        tables: (label, reference [rad/s] (or [rad] for a position loop) of shape (samples,)) of each.
    """
    return [*_stability(problem, rate), *_excitation(problem, gains, tables)]


def _stability(problem: Problem, rate: float) -> list[str]:
    stepper = problem.stepper
    dt = float(np.asarray(stepper.dt))
    limit = EULER_LIMIT if stepper.stepping == "sampled" else stepper.solver.stability_limit
    if not rate * dt >= CLOSE * limit:
        return []
    whose = "the sampled observer's" if stepper.stepping == "sampled" else f"{stepper.solver.name}'s"
    return [
        f"at the solver's stability limit: the observer's largest rate x dt = {rate * dt:.3g}, {whose} limit is "
        f"{limit:.3g}, so the step and not the cost may have stopped the search; re-check with a smaller dt."
    ]


def _excitation(problem: Problem, gains: dict[str, float], tables: Sequence[tuple[str, Any]]) -> list[str]:
    if not problem.loop.observer.estimated:
        return []
    loop = set_parameters(problem.loop, gains)
    parameters = truths(loop, problem.objective)
    said = []
    for label, table in tables:
        every = -(-len(table) // WINDOW)
        dt = float(np.asarray(problem.stepper.dt)) * every
        velocity = np.asarray(table, dtype=float)[::every]
        if isinstance(loop.controller, PositionLoop):
            velocity = np.gradient(velocity, dt)
        try:
            found = assess_excitation(loop.observer, velocity, dt, parameters, duration=float(horizon(problem)))
        except (InputError, AttributeError, KeyError):
            continue  # an observer whose error dynamics are not known
        said += [f"on {label}, {sentence}" for sentence in found.sentences]
    return said
