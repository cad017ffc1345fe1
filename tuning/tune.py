"""`tune` and `tune_each`: any method, any objective, one call."""

import os
import time
from collections.abc import Callable, Sequence
from typing import Any, Unpack

import jax
import numpy as np
from jaxtyping import Array

from fpjax.blocks.parameters import get_parameter
from fpjax.blocks.references import AbstractReference
from fpjax.errors import InputError
from fpjax.model_file import Model
from fpjax.output.progress import Stages
from fpjax.simulation.loop import ClosedLoop
from fpjax.simulation.scan import astype, make_inputs
from fpjax.simulation.solvers import AbstractPlantSolver
from fpjax.verbs import as_model, checked_loop, checked_reference, double_precision

from .file_bounds import bounded_parameters
from .gradient import adam, lbfgs
from .grid_search import algorithm_1, algorithm_1_repaired
from .identifiability import identifiability
from .lanes import Lanes, Outcome, Stopwatch
from .levenberg_marquardt import levenberg_marquardt
from .methods import LBFGS, METHODS, Adam, GridSearch, LevenbergMarquardt, Method, NelderMead, RepairedGridSearch
from .nelder_mead import nelder_mead
from .noisy import calmer, upset
from .notes import SETTLED, judging_measures, notes_of
from .objective import Thesis, get_objective
from .parameters import Parameter, default_parameters
from .problem import Problem, References, case_costs, label_references, make_problem, under_noise
from .result import TuningResult, versions
from .setup import Setup, SetupWords, settled
from .smoothness import not_smooth
from .starts import KEPT, placed_parameters, screen
from .stopping import Stop

DRAWS = 8  # of the sensor's noise, under which tuned gains are looked at

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
            of a servo.toml: what is not given then has its values, in double precision.
        references: one, a list, or a dictionary by label; with several, one set of gains for all.
        parameters: names as "observer.gain_1", or `Parameter`s with start, bounds and scale; None for the observer's
            gains, or the controller's without an observer. Where they have no bounds, those of a model's [bounds] hold.
        setup: how gains are judged: step, horizon, solver, objective, plants, noise.
        method: "levenberg_marquardt", "lbfgs", "adam", "grid" (Algorithm 1), "grid_repaired", "nelder_mead", or a
            method's settings, as `Adam(rate=0.1)`.
        starts: number of starts: the parameters' own, and others drawn around it. None: the parameters' own and up to
            four more, the best of a screen of 64 around the gains that pole placement gives (`tuning.starts`), so that
            no gains need be known; but one start for the "thesis" objective, a target, a budget and Algorithm 1, which
            are there for comparing.
        spread: how far others are drawn: 10^(+-spread) times on a log scale, that share of the range on a linear one.
        seed: of the drawn starts.
        target: stop once the cost is at most this [1].
        max_simulations: stop before a start uses more; tangents count.
        progress: show a bar with an ETA on stderr, where that is a terminal.
        **words: fields of `Setup` (dt, duration, samples, objective, solver, stepping, substeps, plants, noise_seeds,
            aggregate), in place of those of `setup`.

    Returns:
        The best of all starts.

    Raises:
        InputError: for invalid input, with what to do.
    """
    judged = settled(setup, words)
    model = None if isinstance(loop, ClosedLoop) else as_model(loop, "tune")
    if model is not None:
        model.needed_controller()
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
    automatic = starts is None and _searches(method, judged.objective, target, max_simulations)
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
            own = np.array([_value_of(loop, one, value) for one, value in zip(written, middle, strict=True)])
            clock = Stopwatch()
            drawn, screened = screen(
                problem.space, lambda values: _judged(clock, values, None, problem)[0], middle, own, seed
            )
        else:
            drawn = _draw_starts(problem, middle, 1 if starts is None else starts, spread, seed)
        # One number of rows whatever the screen keeps: another one would compile everything again. What fills it up is
        # computed side by side and not counted; Nelder-Mead takes one start after the other.
        count = max(len(drawn), KEPT + 1) if automatic and not isinstance(settings, NelderMead) else len(drawn)
        lanes = Lanes(problem, np.resize(drawn, (count, drawn.shape[1])), None)
        stop = Stop(target, max_simulations, bar)
        draws = under_noise(problem, DRAWS)
        (result,) = _search(lanes, [labels], settings, stop, len(drawn), screened, draws)
        if _searches(method, judged.objective, target, max_simulations) and upset(result):
            # Without noise a search may end where the observer is unstable: nothing there pushes it off the truth.
            lanes = Lanes(draws[0], lanes.start, None)
            stop = Stop(target, max_simulations, bar)
            (again,) = _search(lanes, [labels], settings, stop, len(drawn), screened, draws)
            result = calmer(result, again)
    finally:
        if bar is not None:
            bar.end()
    return result


def _listed(parameters: Sequence[str | Parameter] | None) -> Sequence[str | Parameter] | None:
    return [parameters] if isinstance(parameters, str | Parameter) else parameters


def _searches(method: Any, objective: Any, target: float, budget: int | None) -> bool:
    """Whether the search looks for its own starts: not where it is compared with another one from the same start."""
    compared = objective == "thesis" or isinstance(objective, Thesis) or target > 0.0 or budget is not None
    printed = method in ("grid", "grid_repaired") or isinstance(method, GridSearch | RepairedGridSearch)
    return not compared and not printed


def _value_of(loop: ClosedLoop, one: str | Parameter, placed: float) -> float:
    """Where a parameter stands: its own start, else its value in the loop, else where it was placed."""
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
    judged = settled(setup, words)
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
            f"{where} uses sign(), whose derivative says nothing: give it a steepness in s/rad (in a servo.toml drop "
            f'steepness = "sign" and a safe one is chosen; in Python fpjax.safe_steepness chooses one), or use '
            f"'grid', 'grid_repaired' or 'nelder_mead'."
        )
    return method


def _draw_starts(problem: Problem, start: np.ndarray, starts: int, spread: float, seed: int) -> np.ndarray:
    if not isinstance(starts, int | np.integer):
        raise InputError(f"starts must be a whole number, got {type(starts).__name__} {starts!r}.")
    if starts < 1:
        raise InputError(f"starts must be at least 1, got {starts}.")
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
    # What follows is told apart from the search: it is the report's cost, not the method's.
    each = lanes.count // len(groups)  # rows of a group: its starts, and copies of them that fill it up
    by_group = outcome.costs.reshape(len(groups), each)
    chosen = [group * each + int(np.argmin(row)) for group, row in enumerate(by_group)]
    values = np.where(np.isfinite(outcome.values[chosen]), outcome.values[chosen], lanes.start[chosen])
    # Every kernel was compiled for a number of rows: what is asked of it now is padded to it, and nothing recompiles.
    padded = np.resize(values, (lanes.count, values.shape[1]))
    index = None if lanes.index is None else np.resize(lanes.index[chosen], lanes.count)
    final = Lanes(lanes.problem, padded, index, Stopwatch())
    begun = np.array([lanes.start[group * each] for group in range(len(groups))])
    rows = np.resize(np.concatenate([values, begun]), (max(screened, 2 * len(groups)), values.shape[1]))
    which = None if lanes.index is None else np.resize(np.tile(lanes.index[chosen], 2), len(rows))
    totals, cases, further = _judged(final.clock, rows, which, lanes.problem)
    rates, fastest = further.pop("rate", np.zeros_like(cases)), further.pop("fastest")
    if draws:  # the program is there: another draw of the noise compiles nothing
        noisy = [_judged(final.clock, rows, which, one) for one in draws]
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
        used = int(outcome.simulations[of_group].sum()) + screened * lanes.cases
        history = _together(outcome.history[of_group])
        tuned = _named(names, values[group])
        ended = {} if failed.all() else {name: found for name, found in further.items() if name.startswith(SETTLED)}
        off = {name.removeprefix(SETTLED): _furthest(found[group]) for name, found in ended.items()}
        which = range(len(labels)) if lanes.index is None else [int(lanes.index[lane])]
        followed = [(label, lanes.problem.references[0][place]) for label, place in zip(labels, which, strict=True)]
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


def _furthest(errors: np.ndarray) -> float:
    """The error of the largest magnitude, with its sign; one that is no number is the largest."""
    flat = np.ravel(errors)
    return float(flat[int(np.argmax(np.abs(flat)))])


def _named(names: tuple[str, ...], values: np.ndarray) -> dict[str, float]:
    return {name: float(value) for name, value in zip(names, values, strict=True)}


def _together(histories: list[list[tuple[int, float]]]) -> list[tuple[int, float]]:
    """The histories of several starts as one: what all have used, and the best of all, iteration by iteration."""
    joined = []
    for step in range(max((len(history) for history in histories), default=0)):
        now = [history[min(step, len(history) - 1)] for history in histories if history]
        joined.append((sum(used for used, _ in now), min(cost for _, cost in now)))
    return joined


def _judged(
    clock: Stopwatch, values: np.ndarray, index: Any, problem: Any
) -> tuple[np.ndarray, np.ndarray, dict[str, np.ndarray]]:
    """(costs of shape (m,), infinite where a run diverged; cases; `judging_measures`) of candidates of shape (m, n)."""
    cases, further = clock.call(_cases, values.astype(problem.dtype), index, problem)
    flat = cases.reshape(len(values), -1)
    costs = np.mean(flat, axis=1) if problem.aggregate == "mean" else np.max(flat, axis=1)
    return np.where(np.isfinite(costs), costs, np.inf).astype(float), cases, further


def _cases(values: Array, index: Array | None, problem: Problem) -> Any:
    def one(values: Array, index: Array | None, problem: Problem) -> Any:
        return case_costs(values, index, problem, judging_measures)

    return jax.vmap(one, (0, None if index is None else 0, None))(values, index, problem)
