"""One search: a method's settings, the drawn starts, the run, and the judgement of the gains that it found."""

import time
from collections.abc import Callable, Sequence
from typing import Any

import jax
import numpy as np
from jaxtyping import Array

from fpjax.errors import InputError
from fpjax.simulation.loop import ClosedLoop
from fpjax.simulation.seeds import checked_seed
from fpjax.simulation.solvers import AbstractPlantSolver

from .gradient import adam, lbfgs
from .grid_search import algorithm_1, algorithm_1_repaired
from .identifiability import identifiability
from .lanes import Lanes, Outcome, Stopwatch
from .levenberg_marquardt import levenberg_marquardt
from .methods import LBFGS, METHODS, Adam, GridSearch, LevenbergMarquardt, Method, NelderMead, RepairedGridSearch
from .nelder_mead import nelder_mead
from .notes import SETTLED, judging_measures, notes_of
from .problem import Problem, case_costs
from .result import TuningResult, versions
from .smoothness import not_smooth
from .stopping import Stop

SEARCHES: dict[type, Callable[[Lanes, Any, Stop], Outcome]] = {  # by the type of a method's settings
    GridSearch: algorithm_1,
    RepairedGridSearch: algorithm_1_repaired,
    Adam: adam,
    LBFGS: lbfgs,
    LevenbergMarquardt: levenberg_marquardt,
    NelderMead: nelder_mead,
}


def name_of(settings: Method) -> str:
    """The word for a method, as `tune` takes it."""
    return next(word for word, kind in METHODS.items() if kind is type(settings))


def settings_of(method: str | Method, loop: ClosedLoop, solver: AbstractPlantSolver) -> Method:
    """A method's settings, by its word or as they are; refused where its gradient would be zero.

    Args:
        method: a word of `METHODS`, or settings.
        loop: to be tuned.
        solver: with which it is simulated.

    Raises:
        InputError: for an unknown word, or a method that needs a gradient and a loop that has none.
    """
    if isinstance(method, str):
        if method not in METHODS:
            raise InputError(f"method = {method!r} is not known: choose one of {', '.join(METHODS)}.")
        method = METHODS[method]()
    if isinstance(method, (Adam, LBFGS, LevenbergMarquardt)) and (where := not_smooth(loop, solver)):
        raise InputError(
            f"{where} uses sign(), whose derivative is zero wherever it exists: give it a steepness in s/rad (in a "
            f'servo.toml drop steepness = "sign" and a safe one is chosen; in Python use fpjax.safe_steepness), '
            f"or use 'grid', 'grid_repaired' or 'nelder_mead'."
        )
    return method


def draw_starts(problem: Problem, start: np.ndarray, starts: int, spread: float, seed: int) -> np.ndarray:
    """The start and others drawn uniformly around it within the bounds, shape (starts, n); in decades where log.

    Args:
        problem: gives the bounds and the scales.
        start: shape (n,).
        starts: how many, the given one included.
        spread: half width of the draw, as in `tune`.
        seed: of the draw.

    Raises:
        InputError: where `starts` is not a positive whole number.
    """
    if not isinstance(starts, int | np.integer):
        raise InputError(f"starts must be a whole number, got {type(starts).__name__} {starts!r}.")
    if starts < 1:
        raise InputError(f"starts must be at least 1, got {starts}.")
    # The first start is the given one itself; the others differ in every parameter.
    draws = np.random.default_rng(checked_seed(seed)).uniform(-spread, spread, (starts - 1, start.size))
    space = problem.space
    middle, half = np.asarray(space.middle, float), np.asarray(space.half, float)
    log = np.asarray(space.logarithmic) > 0
    moved = np.where(log, np.log(np.where(log, np.maximum(start, 1e-300), 1.0)), start)
    moved = moved + draws * np.where(log, np.log(10.0), 2.0 * half)
    moved = np.clip(moved, middle - half, middle + half)
    others = np.where(log, np.exp(np.where(log, moved, 0.0)), moved)
    return np.vstack([start, others])


def search(
    lanes: Lanes,
    groups: list[tuple[str, ...]],
    settings: Method,
    stop: Stop,
    starts: int,
    screened: int,
    draws: Sequence[Problem],
) -> list[TuningResult]:
    """Run a method and judge what it finds: one result for each group of lanes.

    Args:
        lanes: of all groups, group after group.
        groups: labels of the references of each: all of them in `tune`, one each in `tune_each`.
        settings: of the method.
        stop: target, budget and progress bar.
        starts: of each group; further lanes of a group are copies.
        screened: costs that the screen computed before.
        draws: the problem under draws of noise; empty for none.
    """
    name = name_of(settings)
    stop.expected = settings.iterations
    if stop.bar is not None:
        stop.bar.stage("compiling")
    begin, before = time.perf_counter(), lanes.clock.compile_seconds
    outcome = SEARCHES[type(settings)](lanes, settings, stop)
    if stop.bar is not None:
        stop.bar.stage("judging the result")
    spent = time.perf_counter() - begin
    compiled = lanes.clock.compile_seconds - before
    # What follows judges the gains: its time and simulations are not counted as the method's.
    each = lanes.count // len(groups)  # rows of a group: its starts, and copies of them
    by_group = outcome.costs.reshape(len(groups), each)
    # The cheapest lane of each group; infinity where it diverged.
    chosen = [group * each + int(np.argmin(row)) for group, row in enumerate(by_group)]
    # A group whose lanes all diverged has no best values: its start is reported, with infinite cost.
    values = np.where(np.isfinite(outcome.values[chosen]), outcome.values[chosen], lanes.start[chosen])
    # Padded to the number of rows for which the residuals and the screen were compiled, so that nothing recompiles.
    padded = np.resize(values, (lanes.count, values.shape[1]))
    index = None if lanes.index is None else np.resize(lanes.index[chosen], lanes.count)
    final = Lanes(lanes.problem, padded, index, Stopwatch())
    begun = np.array([lanes.start[group * each] for group in range(len(groups))])
    # Rows: the best of every group, then the first start of every group, repeated up to the rows of the screen.
    rows = np.resize(np.concatenate([values, begun]), (max(screened, 2 * len(groups)), values.shape[1]))
    which = None if lanes.index is None else np.resize(np.tile(lanes.index[chosen], 2), len(rows))
    totals, cases, further = judge(final.clock, rows, which, lanes.problem)
    rates, fastest = further.pop("rate", np.zeros_like(cases)), further.pop("fastest")
    if draws:  # the same program: only the noise tables change
        noisy = [judge(final.clock, rows, which, one) for one in draws]
        # costs (draws, rows) -> worst (rows,); measures (rows, ...) -> (rows, draws, ...).
        worst = np.max([found for found, _, _ in noisy], axis=0)
        further = {name: np.stack([found[name] for _, _, found in noisy], axis=1) for name in further}
    else:
        worst = None
    sign = bool(not_smooth(lanes.problem.loop, lanes.problem.stepper.solver))
    blocks = identifiability(final, padded, set_valued=sign)
    names = lanes.problem.parameters
    kind = type(lanes.problem.objective).__name__.lower()
    results = []
    for group, labels in enumerate(groups):
        of_group = slice(group * each, group * each + starts)
        lane, failed = chosen[group], ~np.isfinite(outcome.costs[of_group])
        # The screen counts too: its simulations were needed to find the starts.
        used = int(outcome.simulations[of_group].sum()) + screened * lanes.cases
        history = _joined_history(outcome.history[of_group])
        tuned = _named(names, values[group])
        # Estimates of a diverged run are not numbers; there is nothing to say about where they end.
        ended = {} if failed.all() else {name: found for name, found in further.items() if name.startswith(SETTLED)}
        off = {name.removeprefix(SETTLED): _largest_error(found[group]) for name, found in ended.items()}
        which = range(len(labels)) if lanes.index is None else [int(lanes.index[lane])]
        followed = [(label, lanes.problem.references[0][place]) for label, place in zip(labels, which, strict=True)]
        # rates, fastest and cases have the shape (rows, references, plants, seeds).
        about = (lanes.problem, tuned, float(np.max(rates[group])), float(np.max(fastest[group])), off, followed)
        notes = [] if failed.all() else notes_of(*about, len(draws))
        results.append(
            TuningResult(
                method=name,
                objective=kind,
                references=labels,
                gains=tuned,
                start=_named(names, lanes.start[group * each]),
                cost=float(outcome.costs[lane]),
                start_cost=float(totals[len(groups) + group]),
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
                notes=tuple(notes),
                path={name: [float(at[place]) for at in outcome.paths[lane]] for place, name in enumerate(names)},
                settled=off,
                noisy_cost=None if worst is None else float(worst[group]),
                standing=None if outcome.standing is None else _named(names, outcome.standing[lane]),
                standing_cost=None if outcome.standing_costs is None else float(outcome.standing_costs[lane]),
            )
        )
    return results


def _largest_error(errors: np.ndarray) -> float:
    """The error of the largest magnitude, with its sign; NaN where one is NaN (argmax takes NaN as the largest)."""
    flat = np.ravel(errors)
    return float(flat[int(np.argmax(np.abs(flat)))])


def _named(names: tuple[str, ...], values: np.ndarray) -> dict[str, float]:
    return {name: float(value) for name, value in zip(names, values, strict=True)}


def _joined_history(histories: list[list[tuple[int, float]]]) -> list[tuple[int, float]]:
    """The histories of several starts as one: by iteration, the simulations used by all and the least cost of all.

    A start that has ended keeps its last entry.
    """
    joined = []
    for step in range(max((len(history) for history in histories), default=0)):
        now = [history[min(step, len(history) - 1)] for history in histories if history]
        joined.append((sum(used for used, _ in now), min(cost for _, cost in now)))
    return joined


def judge(
    clock: Stopwatch, values: np.ndarray, index: Any, problem: Any
) -> tuple[np.ndarray, np.ndarray, dict[str, np.ndarray]]:
    """Costs (m,), infinite where a run diverged; cases (m, ...); `judging_measures` (m, ...); of candidates (m, n).

    Args:
        clock: counts compile and run time.
        values: the candidates' parameters, shape (m, n).
        index: the reference of each candidate; None for all references.
        problem: what they are judged on.
    """
    cases, further = clock.call(_cases, values.astype(problem.dtype), index, problem)
    flat = cases.reshape(len(values), -1)
    costs = np.mean(flat, axis=1) if problem.aggregate == "mean" else np.max(flat, axis=1)
    return np.where(np.isfinite(costs), costs, np.inf).astype(float), cases, further


def _cases(values: Array, index: Array | None, problem: Problem) -> Any:
    def one(values: Array, index: Array | None, problem: Problem) -> Any:
        return case_costs(values, index, problem, judging_measures)

    return jax.vmap(one, (0, None if index is None else 0, None))(values, index, problem)
