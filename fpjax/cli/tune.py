"""`fpjax tune`: gains by gradients, Algorithm 1 or Nelder-Mead, and the tuned servo.toml."""

import argparse
import dataclasses
import functools
from typing import TYPE_CHECKING, Any

from ..errors import InputError
from ..output.runfile import RunFile, write_json, write_whole
from .common import add_out, busy, finish, interruptible, running_jax, say, table
from .numbers import real, seed, whole
from .objective_arguments import add_cost_arguments, cost_settings

if TYPE_CHECKING:
    from tuning import Parameter, TuningResult

    from .. import Run
    from ..model_file import Model

METHODS = ("levenberg_marquardt", "lbfgs", "adam", "grid", "grid_repaired", "nelder_mead")
EXAMPLES = """\
examples:
  fpjax tune servo.toml --out tuned
  fpjax tune servo.toml --method levenberg_marquardt --method grid --out both
  fpjax tune servo.toml --parameter observer.gain_1=1:300:1e5 --parameter observer.gain_2 --starts 8 --out tuned
  fpjax tune servo.toml --references sine,triangle,chirp --spread plant.inertia=0.2 --worst --method lbfgs --out robust
"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the command's arguments."""
    parser.epilog = EXAMPLES
    add_cost_arguments(parser)
    parser.add_argument(
        "--parameter", metavar="NAME[=LOW:START:HIGH[:linear]]", action="append", default=[],
        help="parameter to tune (default: the observer's gains, or kp and ki without an observer)",
    )  # fmt: skip
    parser.add_argument(
        "--method", action="append", choices=METHODS, help="one or several to compare (default levenberg_marquardt)"
    )
    parser.add_argument(
        "--starts", type=whole, metavar="N",
        help="number of starts (default: the model's gains, and up to four from a screening around pole placement)",
    )  # fmt: skip
    parser.add_argument("--seed", type=seed, default=0, help="of the random starts (default 0)")
    parser.add_argument("--max-simulations", type=whole, metavar="N", help="largest number of simulations per start")
    parser.add_argument("--no-plots", action="store_true", help="no pictures")
    add_out(parser)


def run(arguments: argparse.Namespace) -> int:
    """Tune."""
    with running_jax(arguments) as record:
        model, references, settings = cost_settings(arguments, record)
        from tuning import tune
        from tuning.file_bounds import bounded_parameters

        parameters = bounded_parameters(model, [read_parameter(word) for word in arguments.parameter] or None)

        record.seeds["starts"] = arguments.seed
        results = []
        for method in dict.fromkeys(arguments.method or ["levenberg_marquardt"]):
            record.stage(method)
            arguments.kept = f"nothing was tuned yet by {method}"
            search = functools.partial(
                tune, model.loop, references, parameters=parameters, method=method, starts=arguments.starts,
                seed=arguments.seed, max_simulations=arguments.max_simulations, progress=True, **settings,
            )  # fmt: skip
            try:
                result = interruptible(search)
            except KeyboardInterrupt:
                if kept := _keep_finished(model, results, record, arguments):
                    arguments.kept = f"{kept}, its run marked interrupted"
                raise
            except InputError as error:  # a budget below what this method's first iteration needs
                if kept := _keep_finished(model, results, record, arguments):
                    raise InputError(f"{method}: {error} {kept[:1].upper()}{kept[1:]}.") from error
                raise
            print(result, end="\n\n")
            results.append(result)
        whole = [result for result in results if not result.diverged]
        if not whole:
            raise InputError(
                "Every start diverges: start from smaller gains (--parameter NAME=LOW:START:HIGH), or use a smaller "
                "[simulation] dt."
            )
        best = min(whole, key=lambda result: result.cost)
        if len(results) > 1:
            print(compare(results), end="\n\n")
        record.stage("check")
        tuned = dataclasses.replace(model, loop=best.apply(model.loop))
        runs = check(model, tuned, best, settings["duration"], record)
        record.stage("write")
        _write(tuned, runs, results, best, record, arguments)
        finish(record)
    return 0


def read_parameter(word: str) -> "Parameter":
    """A `Parameter` from NAME, NAME=START or NAME=LOW:START:HIGH[:linear].

    Raises:
        InputError: for a word that cannot be read.
    """
    from tuning import Parameter

    name, equals, rest = word.partition("=")
    if not equals:
        return Parameter(name.strip())
    parts = rest.split(":")
    scale: Any = parts.pop() if len(parts) in (2, 4) and parts[-1] in ("log", "linear") else "log"
    try:
        numbers = [real(part) for part in parts]
        if len(numbers) == 1:
            return Parameter(name.strip(), start=numbers[0], scale=scale)
        low, start, high = numbers
    except ValueError:
        raise InputError(
            f"--parameter {word!r} is not NAME=LOW:START:HIGH: write for instance observer.gain_1=1:300:1e5."
        ) from None
    return Parameter(name.strip(), start=start, low=low, high=high, scale=scale)


def compare(results: "list[TuningResult]") -> str:
    """A table with a row for each method."""
    rows = []
    for result in results:
        gains = ", ".join(f"{value:.5g}" for value in result.gains.values())
        rows.append((result.method, result.cost, result.simulations, result.run_seconds, result.compile_seconds, gains))
    names = ", ".join(name.removeprefix("observer.") for name in results[0].gains)
    return table(rows, ("method", "cost", "simulations", "run s", "compile s", names))


def _keep_finished(
    model: "Model", results: "list[TuningResult]", record: RunFile, arguments: argparse.Namespace
) -> str:
    """Write the results of the methods that finished before the interrupt, or before one that could not begin.

    Returns:
        What is kept, as a clause; "" for nothing.
    """
    whole = [result for result in results if not result.diverged]
    if whole and record.folder is not None:
        arguments.no_plots = True  # drawing takes longer than a user waits after Ctrl-C
        best = min(whole, key=lambda result: result.cost)
        tuned = dataclasses.replace(model, loop=best.apply(model.loop))
        _write(tuned, {}, results, best, record, arguments)
        names = " and ".join(result.method for result in results)
        return f"what {names} found is kept in {record.folder}"
    return ""


def check(model: "Model", tuned: "Model", best: "TuningResult", duration: float, record: RunFile) -> "dict[str, Run]":
    """Simulate before and after with the model's own reference, and print the final values of the estimates.

    The sensor noise has the seed that `fpjax simulate` uses, so that both commands print the same numbers.
    """
    import jax

    from .. import set_parameters, simulate

    position = model.units.reference == "position"
    estimates = [f"estimates.{name}" for name in model.loop.observer.estimated]
    record_these = ("reference", "position" if position else "velocity", *estimates)
    key = jax.random.key(0) if model.loop.sensor.noise_channels else None
    begun = dataclasses.replace(model, loop=set_parameters(model.loop, best.start))
    with busy("tune", "compiling, then running before and after"):
        runs = {
            name: simulate(one, duration=duration, record=record_these, key=key)
            for name, one in (("before", begun), ("after", tuned))
        }
    rows = []
    for name, value in runs["after"].settled.items():
        true = model.nominal.get(name)
        rows.append((name, runs["before"].settled[name], value, true if true else "unknown"))
    if rows:
        print(table(rows, ("mean of the last quarter", "before", "tuned", "true")), end="\n\n")
    record.notes.extend(best.notes)  # printed with the result
    if best.warning:
        say(record, best.warning)
    return runs


def _write(
    tuned: "Model",
    runs: "dict[str, Run]",
    results: "list[TuningResult]",
    best: "TuningResult",
    record: RunFile,
    arguments: argparse.Namespace,
) -> None:
    if record.folder is None:
        return
    from ..model_file import dump_model

    write_json(record.path("tune.json"), {"best": best.method, "results": [result.to_dict() for result in results]})
    comments = {}
    for name, value in best.gains.items():
        section, _, key = name.rpartition(".")
        comments[section.split(".")[0], key] = f"tuned from {best.start[name]:g}" if value else ""
    write_whole(record.path("tuned.toml"), dump_model(tuned, comments=comments))
    if not arguments.no_plots:
        from .pictures import draw_tuning

        with busy("tune", "drawing"):
            draw_tuning(tuned, runs, results, record.path("tune.png"))
