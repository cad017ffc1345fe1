"""`tune` and `tune_each`: any method, any objective, one call."""

import os
import time
from collections.abc import Callable, Sequence
from typing import Any, Unpack

import jax
import numpy as np
from jaxtyping import Array

from fpjax.analysis.placement import default_parameters
from fpjax.blocks.parameters import get_parameter
from fpjax.blocks.references import AbstractReference
from fpjax.errors import InputError
from fpjax.model_file import Model
from fpjax.model_file.as_model import as_model
from fpjax.output.progress import Stages
from fpjax.simulation.input_checks import checked_loop, checked_reference
from fpjax.simulation.loop import ClosedLoop
from fpjax.simulation.precision import double_precision
from fpjax.simulation.scan import astype, make_inputs
from fpjax.simulation.solvers import AbstractPlantSolver

from .file_bounds import bounded_parameters
from .gradient import adam, lbfgs
from .grid_search import algorithm_1, algorithm_1_repaired
from .identifiability import identifiability
from .lanes import Lanes, Outcome, Stopwatch
from .levenberg_marquardt import levenberg_marquardt
from .methods import LBFGS, METHODS, Adam, GridSearch, LevenbergMarquardt, Method, NelderMead, RepairedGridSearch
from .nelder_mead import nelder_mead
from .noise_sensitivity import less_sensitive, noise_sensitive
from .notes import SETTLED, judging_measures, notes_of
from .objective import Thesis, get_objective
from .parameters import Parameter
from .problem import Problem, References, case_costs, label_references, make_problem, under_noise
from .result import TuningResult, versions
from .setup import Setup, SetupWords, with_keywords
from .smoothness import not_smooth
from .start_values import KEPT, placed_parameters, screen
from .stopping import Stop

# Draws of the sensor's noise under which tuned gains are judged; the worst one counts. They reuse the compiled program
# of the judgement, so that eight cost little beside a search.
DRAWS = 8

_SEARCHES: dict[type, Callable[[Lanes, Any, Stop], Outcome]] = {
    GridSearch: algorithm_1,
    RepairedGridSearch: algorithm_1_repaired,
    Adam: adam,
    LBFGS: lbfgs,
    LevenbergMarquardt: levenberg_marquardt,
    NelderMead: nelder_mead,
}


def tune(
    loop: ClosedLoop | Model | str | os.PathLike[str],
    references: References | None = None,
    *,
    parameters: Sequence[str | Parameter] | None = None,
    setup: Setup | None = None,
    method: str | Method = "levenberg_marquardt",
    starts: int | None = None,
    spread: float = 1.0,
    seed: int = 0,
    target: float = 0.0,
    max_simulations: int | None = None,
    progress: bool = False,
    **words: Unpack[SetupWords],
) -> TuningResult:
    """Tune named parameters of a closed loop, on all references at once.

    Args:
        loop: the closed loop; its own friction law is the truth that estimates are judged by. Or a `Model`, or the path
            of a servo.toml: arguments not given are then taken from it, and double precision is used.
        references: one, a list, or a dictionary by label; with several, one set of gains for all.
        parameters: names as "observer.gain_1", or `Parameter`s with start, bounds and scale; None for the observer's
            gains, or the controller's without an observer. Where they have no bounds, those of a model's [bounds] hold.
        setup: how gains are judged: step, horizon, solver, objective, plants, noise.
        method: "levenberg_marquardt", "lbfgs", "adam", "grid" (Algorithm 1), "grid_repaired", "nelder_mead", or a
            method's settings, as `Adam(rate=0.1)`.
        starts: number of starts: the parameters' own start, and others drawn around it. None: the gains in the loop and
            up to four more, the best of a screen of 64 around the gains that pole placement gives
            (`tuning.start_values`), so that no gains need be known; but one start for the "thesis" objective, a target,
            a budget and Algorithm 1, whose searches are compared with each other from one start.
        spread: half width of the draw: within 10^(+-spread) times the start on a log scale, within that share of the
            range on a linear one.
        seed: of the drawn starts.
        target: stop once the cost is at most this [1].
        max_simulations: most simulations of each start, tangents counted; None for no limit.
        progress: show a bar with an ETA on stderr, where that is a terminal.
        **words: fields of `Setup` (dt, duration, samples, objective, solver, stepping, substeps, plants, noise_seeds,
            aggregate), in place of those of `setup`.

    Returns:
        The best of all starts.

    Raises:
        InputError: for invalid input, with what to do.
    """
    judged = with_keywords(setup, words)
    model = None if isinstance(loop, ClosedLoop) else as_model(loop, "tune")
    if model is not None:
        model.needed_controller()
        # Recursion with the model's loop cast to float64: a servo.toml has no precision of its own.
        with double_precision():
            return tune(
                astype(model.loop, np.float64),
                model.needed_reference() if references is None else references,
                parameters=bounded_parameters(model, _listed(parameters)),
                setup=judged.of_model(model),
                method=method,
                starts=starts,
                spread=spread,
                seed=seed,
                target=target,
                max_simulations=max_simulations,
                progress=progress,
            )
    loop = checked_loop(loop, "tune")
    if references is None or judged.dt is None:
        raise InputError("tune needs a reference and dt, the step [s]: give both, or a model, which has its own.")
    if isinstance(references, AbstractReference | int | float):
        references = checked_reference(references)
    listed = _listed(parameters)
    parameters = default_parameters(loop) if listed is None else listed
    automatic = starts is None and _finds_own_starts(method, judged.objective, target, max_simulations)
    stepper = judged.stepper()
    written = parameters
    if automatic:
        _, listed = label_references(references)
        tables = [np.asarray(make_inputs(loop, one, stepper).references[0]) for one in listed]
        parameters = placed_parameters(loop, tables, float(judged.dt), parameters, get_objective(judged.objective))
    problem, start, labels = make_problem(loop, references, parameters, **judged.words())
    settings = _settings(method, loop, stepper.solver)
    bar = Stages(f"tune {_name(settings)}", what="the search") if progress else None
    try:
        middle, screened = np.asarray(start, float), 0
        if automatic:
            if bar is not None:
                bar.stage("compiling, then screening starts")
            # The screen compares the placed gains with those that the loop has already, if it has any.
            own = np.array([_value_of(loop, one, value) for one, value in zip(written, middle, strict=True)])
            clock = Stopwatch()
            drawn, screened = screen(
                problem.space, lambda values: _judged(clock, values, None, problem)[0], middle, own, seed
            )
        else:
            drawn = _draw_starts(problem, middle, 1 if starts is None else starts, spread, seed)
        # Always KEPT + 1 rows, however many starts the screen keeps: another number would compile every program again.
        # Rows are filled up with copies, which are computed but not counted. Nelder-Mead takes one start after the
        # other and needs none.
        count = max(len(drawn), KEPT + 1) if automatic and not isinstance(settings, NelderMead) else len(drawn)
        lanes = Lanes(problem, np.resize(drawn, (count, drawn.shape[1])), None)
        stop = Stop(target, max_simulations, bar)
        draws = under_noise(problem, DRAWS)
        (result,) = _search(lanes, [labels], settings, stop, len(drawn), screened, draws)
        if _finds_own_starts(method, judged.objective, target, max_simulations) and noise_sensitive(result):
            # Without noise a search may end at gains of an unstable observer: on the truth nothing excites its unstable
            # mode. Under noise the same programs run: another draw is another array.
            lanes = Lanes(draws[0], lanes.start, None)
            stop = Stop(target, max_simulations, bar)
            (again,) = _search(lanes, [labels], settings, stop, len(drawn), screened, draws)
            result = less_sensitive(result, again)
    finally:
        if bar is not None:
            bar.end()
    return result


def _listed(parameters: Sequence[str | Parameter] | None) -> Sequence[str | Parameter] | None:
    return [parameters] if isinstance(parameters, str | Parameter) else parameters


def _finds_own_starts(method: Any, objective: Any, target: float, budget: int | None) -> bool:
    """Whether start values are found automatically: not where searches are compared from one given start."""
    compared = objective == "thesis" or isinstance(objective, Thesis) or target > 0.0 or budget is not None
    printed = method in ("grid", "grid_repaired") or isinstance(method, GridSearch | RepairedGridSearch)
    return not compared and not printed


def _value_of(loop: ClosedLoop, one: str | Parameter, placed: float) -> float:
    """A parameter's own start, else its value in the loop if positive, else its placed value."""
    if isinstance(one, Parameter) and one.start is not None:
        return one.start
    value = float(np.asarray(get_parameter(loop, one if isinstance(one, str) else one.name)))
    return value if value > 0.0 else placed


def tune_each(
    loop: ClosedLoop,
    references: References,
    *,
    parameters: Sequence[str | Parameter],
    setup: Setup | None = None,
    method: str | Method = "levenberg_marquardt",
    starts: int = 1,
    spread: float = 1.0,
    seed: int = 0,
    target: float = 0.0,
    max_simulations: int | None = None,
    progress: bool = False,
    **words: Unpack[SetupWords],
) -> dict[str, TuningResult]:
    """Tune on each reference alone, all of them side by side; arguments as of `tune`.

    Args:
        loop: see `tune`, as all others.
        references: several; each gets its own gains.
        parameters: what to tune.
        setup: how gains are judged.
        method: how.
        starts: for each reference.
        spread: of the drawn starts.
        seed: of the drawn starts.
        target: cost to stop at [1].
        max_simulations: of a start.
        progress: show a bar.
        **words: fields of `Setup`, in place of those of `setup`.

    Returns:
        Results by label. Their `run_seconds` and `compile_seconds` are those of all references together.

    Raises:
        InputError: for invalid input, with what to do.
    """
    judged = with_keywords(setup, words)
    if judged.dt is None:
        raise InputError("tune_each needs dt, the step [s].")
    problem, start, labels = make_problem(loop, references, parameters, **judged.words())
    drawn = _draw_starts(problem, np.asarray(start, float), starts, spread, seed)
    index = np.repeat(np.arange(len(labels)), starts)
    lanes = Lanes(problem, np.tile(drawn, (len(labels), 1)), index)
    settings = _settings(method, loop, judged.stepper().solver)
    bar = Stages(f"tune {_name(settings)}", what="the search") if progress else None
    groups = [(label,) for label in labels]
    try:
        draws = under_noise(problem, DRAWS)
        results = _search(lanes, groups, settings, Stop(target, max_simulations, bar), starts, 0, draws)
    finally:
        if bar is not None:
            bar.end()
    return dict(zip(labels, results, strict=True))


def _name(settings: Method) -> str:
    return next(word for word, kind in METHODS.items() if kind is type(settings))


def _settings(method: str | Method, loop: ClosedLoop, solver: AbstractPlantSolver) -> Method:
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


def _draw_starts(problem: Problem, start: np.ndarray, starts: int, spread: float, seed: int) -> np.ndarray:
    """The start and others drawn uniformly around it within the bounds, shape (starts, n); in decades where log."""
    if not isinstance(starts, int | np.integer):
        raise InputError(f"starts must be a whole number, got {type(starts).__name__} {starts!r}.")
    if starts < 1:
        raise InputError(f"starts must be at least 1, got {starts}.")
    # The first start is the given one itself; the others differ in every parameter.
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
    name = _name(settings)
    stop.expected = settings.iterations
    if stop.bar is not None:
        stop.bar.stage("compiling")
    begin, before = time.perf_counter(), lanes.clock.compile_seconds
    outcome = _SEARCHES[type(settings)](lanes, settings, stop)
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
    totals, cases, further = _judged(final.clock, rows, which, lanes.problem)
    rates, fastest = further.pop("rate", np.zeros_like(cases)), further.pop("fastest")
    if draws:  # the same program: only the noise tables change
        noisy = [_judged(final.clock, rows, which, one) for one in draws]
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


def _judged(
    clock: Stopwatch, values: np.ndarray, index: Any, problem: Any
) -> tuple[np.ndarray, np.ndarray, dict[str, np.ndarray]]:
    """Costs (m,), infinite where a run diverged; cases (m, ...); `judging_measures` (m, ...); of candidates (m, n)."""
    cases, further = clock.call(_cases, values.astype(problem.dtype), index, problem)
    flat = cases.reshape(len(values), -1)
    costs = np.mean(flat, axis=1) if problem.aggregate == "mean" else np.max(flat, axis=1)
    return np.where(np.isfinite(costs), costs, np.inf).astype(float), cases, further


def _cases(values: Array, index: Array | None, problem: Problem) -> Any:
    def one(values: Array, index: Array | None, problem: Problem) -> Any:
        return case_costs(values, index, problem, judging_measures)

    return jax.vmap(one, (0, None if index is None else 0, None))(values, index, problem)
