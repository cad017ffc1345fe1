"""`tune` and `tune_each`: any method, any objective, one call."""

import time
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import jax
import numpy as np

from fpjax import AbstractPlantSolver, ClosedLoop
from fpjax.errors import InputError
from fpjax.output.progress import Stages
from fpjax.scan import Stepping

from .gradient import adam, lbfgs
from .grid_search import algorithm_1, algorithm_1_repaired
from .identifiability import identifiability
from .lanes import Clock, Lanes, Outcome
from .levenberg_marquardt import levenberg_marquardt
from .methods import LBFGS, METHODS, Adam, GridSearch, LevenbergMarquardt, Method, NelderMead, RepairedGridSearch
from .nelder_mead import nelder_mead
from .notes import notes_of, rate_measure
from .objective import AbstractObjective
from .parameters import Parameter
from .problem import Aggregate, References, case_costs, make_problem
from .result import TuningResult, versions
from .smoothness import set_valued
from .stopping import Stop

_SEARCHES: dict[type, Callable[[Any, Any, Stop], Outcome]] = {
    GridSearch: algorithm_1,
    RepairedGridSearch: algorithm_1_repaired,
    Adam: adam,
    LBFGS: lbfgs,
    LevenbergMarquardt: levenberg_marquardt,
    NelderMead: nelder_mead,
}


def tune(
    loop: ClosedLoop,
    references: References,
    *,
    parameters: Sequence[str | Parameter],
    dt: float,
    duration: float | None = None,
    samples: int | None = None,
    objective: str | AbstractObjective = "estimation",
    method: str | Method = "levenberg_marquardt",
    solver: str | AbstractPlantSolver = "rk4",
    stepping: Stepping = "continuous",
    substeps: int = 1,
    plants: Mapping[str, Any] | None = None,
    noise_seeds: Sequence[int] = (),
    aggregate: Aggregate = "mean",
    starts: int = 1,
    spread: float = 1.0,
    seed: int = 0,
    target: float = 0.0,
    max_simulations: int | None = None,
    progress: bool = False,
) -> TuningResult:
    """Tune named parameters of a closed loop, on all references at once.

    Args:
        loop: the closed loop; its own friction law is the truth that estimates are judged by.
        references: one, a list, or a dictionary by label; with several, one set of gains for all.
        parameters: names as "observer.gain_1", or `Parameter`s with start, bounds and scale.
        dt: step, or control period when sampled [s].
        duration: of a run [s]; or `samples`.
        samples: of a run.
        objective: "estimation", "tracking", "thesis", or an objective.
        method: "levenberg_marquardt", "lbfgs", "adam", "grid" (Algorithm 1), "grid_repaired", "nelder_mead", or a
            method's settings, as `Adam(rate=0.1)`.
        solver: "euler", "heun", "ode3" or "rk4".
        stepping: "continuous" or "sampled".
        substeps: solver steps per control period when sampled.
        plants: true plants to tune for: values by name, one a plant, as {"plant.friction.viscous": [1, 2, 5]}; see
            `population`. The observer keeps its own idea of the inertia.
        noise_seeds: seeds of the sensor's noise, a run for each; none for no noise.
        aggregate: "mean" or "worst" over references x plants x seeds.
        starts: number of starts: the parameters' own, and others drawn around it.
        spread: how far others are drawn: 10^(+-spread) times on a log scale, that share of the range on a linear one.
        seed: of the drawn starts.
        target: stop once the cost is at most this [1].
        max_simulations: stop before a start uses more; tangents count.
        progress: show a bar with an ETA on stderr, where that is a terminal.

    Returns:
        The best of all starts.

    Raises:
        InputError: for what cannot be, with what to do.
    """
    problem, start, labels = make_problem(
        loop,
        references,
        parameters,
        objective=objective,
        dt=dt,
        duration=duration,
        samples=samples,
        solver=solver,
        stepping=stepping,
        substeps=substeps,
        plants=plants,
        noise_seeds=noise_seeds,
        aggregate=aggregate,
    )
    drawn = _draw_starts(problem, np.asarray(start, float), starts, spread, seed)
    stop = Stop(target, max_simulations)
    (result,) = _search(Lanes(problem, drawn, None), [labels], _settings(method, loop), stop, starts, progress)
    return result


def tune_each(
    loop: ClosedLoop,
    references: References,
    *,
    parameters: Sequence[str | Parameter],
    dt: float,
    duration: float | None = None,
    samples: int | None = None,
    objective: str | AbstractObjective = "estimation",
    method: str | Method = "levenberg_marquardt",
    solver: str | AbstractPlantSolver = "rk4",
    stepping: Stepping = "continuous",
    substeps: int = 1,
    plants: Mapping[str, Any] | None = None,
    noise_seeds: Sequence[int] = (),
    aggregate: Aggregate = "mean",
    starts: int = 1,
    spread: float = 1.0,
    seed: int = 0,
    target: float = 0.0,
    max_simulations: int | None = None,
    progress: bool = False,
) -> dict[str, TuningResult]:
    """Tune on each reference alone, all of them side by side; arguments as of `tune`.

    Args:
        loop: see `tune`, as all others.
        references: several; each gets its own gains.
        parameters: what to tune.
        dt: step [s].
        duration: of a run [s].
        samples: of a run.
        objective: what to minimise.
        method: how.
        solver: of the runs.
        stepping: "continuous" or "sampled".
        substeps: solver steps per control period.
        plants: true plants.
        noise_seeds: seeds of the sensor's noise.
        aggregate: "mean" or "worst" over plants x seeds.
        starts: for each reference.
        spread: of the drawn starts.
        seed: of the drawn starts.
        target: cost to stop at [1].
        max_simulations: of a start.
        progress: show a bar.

    Returns:
        Results by label. Their `run_seconds` and `compile_seconds` are those of all references together.

    Raises:
        InputError: for what cannot be, with what to do.
    """
    problem, start, labels = make_problem(
        loop,
        references,
        parameters,
        objective=objective,
        dt=dt,
        duration=duration,
        samples=samples,
        solver=solver,
        stepping=stepping,
        substeps=substeps,
        plants=plants,
        noise_seeds=noise_seeds,
        aggregate=aggregate,
    )
    drawn = _draw_starts(problem, np.asarray(start, float), starts, spread, seed)
    index = np.repeat(np.arange(len(labels)), starts)
    lanes = Lanes(problem, np.tile(drawn, (len(labels), 1)), index)
    stop = Stop(target, max_simulations)
    groups = [(label,) for label in labels]
    results = _search(lanes, groups, _settings(method, loop), stop, starts, progress)
    return dict(zip(labels, results, strict=True))


def _settings(method: str | Method, loop: ClosedLoop) -> Method:
    if isinstance(method, str):
        if method not in METHODS:
            raise InputError(f"method = {method!r} is not known: choose one of {', '.join(METHODS)}.")
        method = METHODS[method]()
    if isinstance(method, (Adam, LBFGS, LevenbergMarquardt)) and (where := set_valued(loop)):
        raise InputError(
            f"{where} uses sign(), whose derivative says nothing: give it a steepness (fpjax.safe_steepness chooses "
            "one), or use 'grid', 'grid_repaired' or 'nelder_mead'."
        )
    return method


def _draw_starts(problem: Any, start: np.ndarray, starts: int, spread: float, seed: int) -> np.ndarray:
    if starts < 1:
        raise InputError(f"starts = {starts} cannot be: give at least 1.")
    draws = np.random.default_rng(seed).uniform(-spread, spread, (starts - 1, start.size))
    space = problem.space
    middle, half = np.asarray(space.middle, float), np.asarray(space.half, float)
    log = np.asarray(space.logarithmic) > 0
    moved = np.where(log, np.log(np.where(log, np.maximum(start, 1e-300), 1.0)), start)
    moved = moved + draws * np.where(log, np.log(10.0), 2.0 * half)
    moved = np.clip(moved, middle - half, middle + half)
    others = np.where(log, np.exp(np.where(log, moved, 0.0)), moved)
    return np.vstack([start, others])


def _search(
    lanes: Lanes, groups: list[tuple[str, ...]], settings: Method, stop: Stop, starts: int, progress: bool
) -> list[TuningResult]:
    name = next(word for word, kind in METHODS.items() if kind is type(settings))
    stop.expected = settings.iterations
    stop.bar = Stages(f"tune {name}") if progress else None
    begin, before = time.perf_counter(), lanes.clock.compile_seconds
    try:
        outcome = _SEARCHES[type(settings)](lanes, settings, stop)
    finally:
        if stop.bar is not None:
            stop.bar.end()
    spent = time.perf_counter() - begin
    compiled = lanes.clock.compile_seconds - before
    # What follows is told apart from the search: it is the report's cost, not the method's.
    by_group = outcome.costs.reshape(len(groups), starts)
    chosen = [group * starts + int(np.argmin(row)) for group, row in enumerate(by_group)]
    values = np.where(np.isfinite(outcome.values[chosen]), outcome.values[chosen], lanes.start[chosen])
    index = None if lanes.index is None else lanes.index[chosen]
    final = Lanes(lanes.problem, values, index, Clock())
    cases, rates = final.clock.call(_cases, values.astype(lanes.problem.dtype), index, lanes.problem)
    begun = np.array([lanes.start[group * starts] for group in range(len(groups))], lanes.problem.dtype)
    first, _ = final.clock.call(_cases, begun, index, lanes.problem)
    sign = bool(set_valued(lanes.problem.loop))
    blocks = identifiability(final, values, set_valued=sign)
    names = lanes.problem.parameters
    kind = type(lanes.problem.objective).__name__.lower()
    results = []
    for group, labels in enumerate(groups):
        of_group = slice(group * starts, (group + 1) * starts)
        lane, failed = chosen[group], ~np.isfinite(outcome.costs[of_group])
        used = int(outcome.simulations[of_group].sum())
        history = _together(outcome.history[of_group])
        tuned = _named(names, values[group])
        which = range(len(labels)) if lanes.index is None else [int(lanes.index[lane])]
        followed = [(label, lanes.problem.references[0][place]) for label, place in zip(labels, which, strict=True)]
        results.append(
            TuningResult(
                method=name,
                objective=kind,
                references=labels,
                gains=tuned,
                start=_named(names, lanes.start[group * starts]),
                cost=float(outcome.costs[lane]),
                start_cost=_aggregated(lanes.problem, first[group]),
                mean=float(np.mean(cases[group])),
                worst=float(np.max(cases[group])),
                cases=cases[group].tolist(),
                simulations=used,
                simulated_steps=used * lanes.problem.stepper.samples,
                iterations=int(outcome.iterations[lane]),
                history=history,
                starts=starts,
                diverged_starts=int(failed.sum()),
                message=outcome.reasons[lane],
                run_seconds=spent - compiled,
                compile_seconds=compiled,
                identifiability=None if failed.all() else blocks[group],
                versions=versions(),
                notes=()
                if failed.all()
                else tuple(notes_of(lanes.problem, tuned, float(np.max(rates[group])), followed)),
                standing=None if outcome.standing is None else _named(names, outcome.standing[lane]),
                standing_cost=None if outcome.standing_costs is None else float(outcome.standing_costs[lane]),
            )
        )
    return results


def _named(names: tuple[str, ...], values: np.ndarray) -> dict[str, float]:
    return {name: float(value) for name, value in zip(names, values, strict=True)}


def _aggregated(problem: Any, cases: np.ndarray) -> float:
    cost = float(np.mean(cases) if problem.aggregate == "mean" else np.max(cases))
    return cost if np.isfinite(cost) else float("inf")


def _together(histories: list[list[tuple[int, float]]]) -> list[tuple[int, float]]:
    """The histories of several starts as one: what all have used, and the best of all, iteration by iteration."""
    joined = []
    for step in range(max((len(history) for history in histories), default=0)):
        now = [history[min(step, len(history) - 1)] for history in histories if history]
        joined.append((sum(used for used, _ in now), min(cost for _, cost in now)))
    return joined


def _cases(values: Any, index: Any, problem: Any) -> Any:
    def one(values: Any, index: Any, problem: Any) -> Any:
        return case_costs(values, index, problem, rate_measure)

    return jax.vmap(one, (0, None if index is None else 0, None))(values, index, problem)
