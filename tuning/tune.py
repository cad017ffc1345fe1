"""`tune` and `tune_each`: any method, any objective, one call."""

import os
from collections.abc import Sequence
from typing import Any, Unpack

import numpy as np

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
from fpjax.simulation.seeds import checked_seed

from .file_bounds import bounded_parameters
from .lanes import Lanes, Stopwatch
from .methods import GridSearch, Method, NelderMead, RepairedGridSearch
from .noise_sensitivity import less_sensitive, noise_sensitive
from .objective import Thesis, get_objective
from .parameters import Parameter
from .problem import References, label_references, make_problem, under_noise
from .result import TuningResult
from .search import draw_starts, judge, name_of, search, settings_of
from .setup import Setup, SetupWords, with_keywords
from .start_values import KEPT, placed_parameters, screen
from .stopping import Stop

# Draws of the sensor's noise under which tuned gains are judged; the worst one counts. They reuse the compiled program
# of the judgement, so that eight cost little beside a search.
DRAWS = 8


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
        max_simulations: most simulations of each start, tangents counted, at least those of one iteration; None for no
            limit.
        progress: show a bar with an ETA on stderr, where that is a terminal.
        **words: fields of `Setup` (dt, duration, samples, objective, solver, stepping, substeps, plants, noise_seeds,
            aggregate), in place of those of `setup`.

    Returns:
        The best of all starts.

    Raises:
        InputError: for invalid input, with what to do.
    """
    checked_seed(seed)
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
    settings = settings_of(method, loop, stepper.solver)
    bar = Stages(f"tune {name_of(settings)}", what="the search") if progress else None
    try:
        middle, screened = np.asarray(start, float), 0
        if automatic:
            if bar is not None:
                bar.stage("compiling, then screening starts")
            # The screen compares the placed gains with those that the loop has already, if it has any.
            own = np.array([_value_of(loop, one, value) for one, value in zip(written, middle, strict=True)])
            clock = Stopwatch()
            drawn, screened = screen(
                problem.space, lambda values: judge(clock, values, None, problem)[0], middle, own, seed
            )
        else:
            drawn = draw_starts(problem, middle, 1 if starts is None else starts, spread, seed)
        # Always KEPT + 1 rows, however many starts the screen keeps: another number would compile every program again.
        # Rows are filled up with copies, which are computed but not counted. Nelder-Mead takes one start after the
        # other and needs none.
        count = max(len(drawn), KEPT + 1) if automatic and not isinstance(settings, NelderMead) else len(drawn)
        lanes = Lanes(problem, np.resize(drawn, (count, drawn.shape[1])), None)
        stop = Stop(target, max_simulations, bar)
        draws = under_noise(problem, DRAWS)
        (result,) = search(lanes, [labels], settings, stop, len(drawn), screened, draws)
        if _finds_own_starts(method, judged.objective, target, max_simulations) and noise_sensitive(result):
            # Without noise a search may end at gains of an unstable observer: on the truth nothing excites its unstable
            # mode. Under noise the same programs run: another draw is another array.
            lanes = Lanes(draws[0], lanes.start, None)
            stop = Stop(target, max_simulations, bar)
            (again,) = search(lanes, [labels], settings, stop, len(drawn), screened, draws)
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
    drawn = draw_starts(problem, np.asarray(start, float), starts, spread, seed)
    index = np.repeat(np.arange(len(labels)), starts)
    lanes = Lanes(problem, np.tile(drawn, (len(labels), 1)), index)
    settings = settings_of(method, loop, judged.stepper().solver)
    bar = Stages(f"tune {name_of(settings)}", what="the search") if progress else None
    groups = [(label,) for label in labels]
    try:
        draws = under_noise(problem, DRAWS)
        results = search(lanes, groups, settings, Stop(target, max_simulations, bar), starts, 0, draws)
    finally:
        if bar is not None:
            bar.end()
    return dict(zip(labels, results, strict=True))
