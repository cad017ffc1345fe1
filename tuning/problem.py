"""A tuning problem as one pytree of arrays, and the cost of a set of gains: mean or worst over all cases.

A case is one simulation: one reference, one true plant, one noise seed. Arrays over cases have the shape
(references, plants, seeds).
"""

import dataclasses
from collections.abc import Mapping, Sequence
from typing import Literal

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax.typing import DTypeLike
from jaxtyping import Array, PyTree

from fpjax.blocks.parameters import get_parameter, set_parameters
from fpjax.blocks.references import AbstractReference
from fpjax.errors import InputError
from fpjax.simulation.histories import usual_largest, with_histories
from fpjax.simulation.input_checks import check_frequency, check_one_run
from fpjax.simulation.loop import ClosedLoop
from fpjax.simulation.scan import Inputs, Stepper, Stepping, astype, loop_dtype, make_inputs, make_stepper, roll
from fpjax.simulation.seeds import checked_seed
from fpjax.simulation.solvers import AbstractPlantSolver
from fpjax.simulation.stability import warn_if_stiff

from .objective import AbstractObjective, get_objective
from .parameters import Parameter, Space, make_space

Aggregate = Literal["mean", "worst"]
References = AbstractReference | Sequence[AbstractReference] | Mapping[str, AbstractReference]


class Problem(eqx.Module):
    """Everything that a cost depends on. All leaves are arrays: new gains, references, plants or dt recompile nothing.

    Attributes:
        loop: the closed loop, before the parameters of a plant and of a candidate are set.
        stepper: step, samples, solver and stepping.
        time: [s], shape (samples,).
        references: one table for each node of the solver's step, of shape (references, samples) [rad/s], or [rad] for a
            position loop.
        noise: one table for each noise channel of the sensor, of shape (seeds, samples), in standard deviations.
        plants: of the true plants: values by parameter name, each of shape (plants,).
        objective: the cost of one run.
        space: the coordinates in which gradients move.
        parameters: names of the tuned parameters, in the order of a candidate (static).
        seeds: number of noise seeds, at least 1 (static).
        aggregate: "mean" or "worst" over the cases (static).
    """

    loop: ClosedLoop
    stepper: Stepper
    time: Array
    references: tuple[Array, ...]
    noise: tuple[Array, ...]
    plants: dict[str, Array]
    objective: AbstractObjective
    space: Space
    parameters: tuple[str, ...] = eqx.field(static=True)
    seeds: int = eqx.field(static=True)
    aggregate: Aggregate = eqx.field(static=True)

    @property
    def shape(self) -> tuple[int, int, int]:
        """(references, plants, seeds): their product is the number of simulations of one cost."""
        plants = next(iter(self.plants.values())).shape[0] if self.plants else 1
        return self.references[0].shape[0], plants, self.seeds

    @property
    def dtype(self) -> DTypeLike:
        """The loop's precision."""
        return self.time.dtype


def make_problem(
    loop: ClosedLoop,
    references: References,
    parameters: Sequence[str | Parameter],
    *,
    objective: str | AbstractObjective = "estimation",
    dt: float,
    duration: float | None = None,
    samples: int | None = None,
    solver: str | AbstractPlantSolver = "rk4",
    stepping: Stepping = "continuous",
    substeps: int = 1,
    plants: Mapping[str, PyTree] | None = None,
    noise_seeds: Sequence[int] = (),
    aggregate: Aggregate = "mean",
    largest: Mapping[str, float] | None = None,
) -> tuple[Problem, Array, tuple[str, ...]]:
    """(problem, start of shape (n,), labels of the references); the arguments are those of `tuning.tune`.

    Beside them `largest` gives the largest values that the parameters will have, by name; None for their bounds.

    Raises:
        InputError: for invalid settings.
    """
    stepper = make_stepper(
        dt=dt, duration=duration, samples=samples, solver=solver, stepping=stepping, substeps=substeps
    )
    dtype = loop_dtype(loop)
    labels, listed = label_references(references)
    if stepping == "sampled" and largest is None:
        parameters = [_bounded(loop, one, float(dt)) for one in parameters]
    names, start, space = make_space(loop, parameters, dtype)
    chosen = get_objective(objective)
    chosen = astype(chosen, dtype)
    if aggregate not in ("mean", "worst"):
        raise InputError(f"aggregate = {aggregate!r} is not known: choose 'mean' or 'worst'.")
    if not isinstance(noise_seeds, Sequence):
        raise InputError(f"noise_seeds must be a list of seeds, as [0, 1, 2], got {noise_seeds!r}.")
    if noise_seeds and not loop.sensor.noise_channels:
        raise InputError(
            f"noise_seeds = {list(noise_seeds)} needs a sensor with noise, not {type(loop.sensor).__name__}: "
            "give the loop a Gyro, with stepping='sampled'."
        )
    varied = {name: jnp.asarray(np.atleast_1d(np.asarray(values)), dtype) for name, values in (plants or {}).items()}
    sizes = {values.shape for values in varied.values()}
    if len(sizes) > 1:
        raise InputError(
            f"plants gives arrays of shapes {sorted(sizes)}: give each parameter one value for every plant."
        )
    if stepping == "sampled":
        # the candidates and the plants are traced: the largest of their delays counts
        delays = {name: float(np.max(values, initial=0.0)) for name, values in varied.items()}
        delays |= dict(zip(names, space.highest().tolist(), strict=True)) if largest is None else largest
        loop = with_histories(loop, float(dt), delays)
    for name, values in varied.items():
        get_parameter(loop, name)
        if values.ndim != 1 or not values.size:
            raise InputError(
                f"plants gives {name} values of shape {values.shape}: give a list with one number for each plant."
            )
        if name in names:
            raise InputError(f"{name} is both tuned and varied over the plants: leave it out of one of them.")
    # Every plant is checked before anything is compiled: a truth of zero, or a step too long for the lightest inertia.
    for index in range(next(iter(sizes))[0] if sizes else 1):
        judged = set_parameters(loop, {name: values[index] for name, values in varied.items()})
        chosen.check(judged)
        warn_if_stiff(judged, dt / (substeps if stepping == "sampled" else 1), stepper.solver)
    for reference in listed:
        check_frequency(reference, float(dt), ("The reference's", "dt"))
        check_one_run(loop, reference, stepper)
    # Once, outside the scan: a sine computed in every step takes 19 times as long (docs/performance.md).
    tables = [make_inputs(loop, reference, stepper) for reference in listed]
    channels = loop.sensor.noise_channels
    # Noise does not depend on the reference: the first one serves for all. Without seeds there is one row of zeros, so
    # that problems with and without noise have one structure.
    keys = [jax.random.key(checked_seed(seed, "noise_seeds")) for seed in noise_seeds]
    noisy = [make_inputs(loop, listed[0], stepper, key).noise for key in keys]
    noise = tuple(
        jnp.stack([rows[channel] for rows in noisy]) if noisy else tables[0].noise[channel][None]
        for channel in range(channels)
    )
    stacked = tuple(
        jnp.stack([table.references[node] for table in tables]) for node in range(len(tables[0].references))
    )
    problem = Problem(
        loop, stepper, tables[0].time, stacked, noise, varied, chosen, space, names, max(1, len(noise_seeds)), aggregate
    )
    return problem, start, labels


def _bounded(loop: ClosedLoop, one: str | Parameter, dt: float) -> str | Parameter:
    """A parameter with an upper bound, if it is a delay without one: the history that is kept must hold its values."""
    given = Parameter(one) if isinstance(one, str) else one
    if given.high is not None or given.scale != "log":
        return one
    value = get_parameter(loop, given.name) if given.start is None else np.asarray(given.start)
    most = usual_largest(given.name, float(np.max(value)), dt)
    return dataclasses.replace(given, high=most) if np.isfinite(most) else one


def under_noise(problem: Problem, draws: int) -> list[Problem]:
    """Copies of the problem, one for each of `draws` draws of its sensor's noise.

    Empty where the problem has noise already, or its sensor has none.
    """
    if not problem.noise or any(bool(np.any(np.asarray(table))) for table in problem.noise):
        return []
    found = []
    for seed in range(draws):
        random = np.random.default_rng(seed)  # on the host: nothing to compile
        drawn = tuple(jax.device_put(random.standard_normal(each.shape).astype(each.dtype)) for each in problem.noise)
        found.append(eqx.tree_at(lambda one: one.noise, problem, drawn))
    return found


def label_references(references: References) -> tuple[tuple[str, ...], list[AbstractReference]]:
    """(labels, references) of one reference, a list of them, or a dictionary by label.

    Raises:
        InputError: where there is none.
    """
    if isinstance(references, Mapping):
        labels, listed = tuple(references), list(references.values())
    else:
        listed = [references] if isinstance(references, AbstractReference) else list(references)
        kinds = [type(one).__name__.lower() for one in listed]
        labels = tuple(
            kind if kinds.count(kind) == 1 else f"{kind}_{kinds[: place + 1].count(kind)}"
            for place, kind in enumerate(kinds)
        )
    if not listed:
        raise InputError("There is no reference to tune on: give at least one, as fpjax.Sine(1.0, 1.0).")
    return labels, listed


def case_costs(values: Array, index: Array | None, problem: Problem, also: PyTree = None) -> PyTree:
    """Cost of every case of one candidate, shape (references, plants, seeds); not finite where a run diverged.

    Args:
        values: of the parameters, in their units, shape (n,).
        index: the only reference to simulate (the first axis then has length 1); None for all.
        problem: from `make_problem`.
        also: `also(loop, objective, horizon)` gives further measures by name; (costs, those measures) is then returned.
    """

    def judged(loop: ClosedLoop, inputs: Inputs) -> PyTree:
        measures = problem.objective.measures(loop, horizon(problem), False)
        extra = {} if also is None else also(loop, problem.objective, horizon(problem))
        assert not set(measures) & set(extra), "a further measure has the name of one of the objective's"
        # Only the accumulated measures leave the scan: stored traces would cost 5 to 8 times as much.
        finals, _, _ = roll(loop, inputs, problem.stepper, measures | extra)
        cost = problem.objective.cost(loop, finals)
        return cost if also is None else (cost, {name: finals[name] for name in extra})

    return _over_cases(judged, values, index, problem)


def lane_cost(values: Array, index: Array | None, problem: Problem) -> Array:
    """Mean or worst of `case_costs`, shape (); infinite where a run diverged."""
    costs = case_costs(values, index, problem)
    cost = jnp.mean(costs) if problem.aggregate == "mean" else jnp.max(costs)
    # NaN compares false with everything: as infinity a diverged run loses against any other.
    return jnp.where(jnp.isfinite(cost), cost, jnp.inf)


def lane_residuals(values: Array, index: Array | None, problem: Problem) -> Array:
    """The residuals of every case, shape (cases, residuals); arguments as of `case_costs`."""

    def judged(loop: ClosedLoop, inputs: Inputs) -> Array:
        measures = problem.objective.measures(loop, horizon(problem), True)
        finals, _, _ = roll(loop, inputs, problem.stepper, measures)
        return problem.objective.residuals(loop, finals)

    rows = _over_cases(judged, values, index, problem)
    return rows.reshape(-1, rows.shape[-1])


def horizon(problem: Problem) -> Array:
    """Time of the last sample [s]."""
    return problem.time[-1]


def simulations_of(problem: Problem, alone: bool) -> int:
    """Number of simulations of one cost: all cases, or those of one reference if `alone`."""
    references, plants, seeds = problem.shape
    return (1 if alone else references) * plants * seeds


def _over_cases(judged: PyTree, values: Array, index: Array | None, problem: Problem) -> PyTree:
    """`judged(loop, inputs)` of every case of one candidate; leaves have leading axes (references, plants, seeds)."""
    references = problem.references
    if index is not None:
        references = tuple(table[index][None] for table in references)
    _, plants, seeds = problem.shape

    def one(tables: tuple[Array, ...], plant: dict[str, Array], noise: tuple[Array, ...]) -> PyTree:
        candidate = {name: values[place] for place, name in enumerate(problem.parameters)}
        # The plant's parameters are the truth and the candidate's are tuned; `make_problem` refuses a name in both.
        loop = set_parameters(problem.loop, plant | candidate)
        return judged(loop, Inputs(problem.time, tables, noise))

    # axis_size is given because noise may be () and plants {}, which have no axis to take it from.
    over_seeds = jax.vmap(one, (None, None, 0), axis_size=seeds)
    over_plants = jax.vmap(over_seeds, (None, 0, None), axis_size=plants)
    return jax.vmap(over_plants, (0, None, None))(references, problem.plants, problem.noise)
