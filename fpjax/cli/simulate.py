"""`fpjax simulate`: run a servo.toml, or replay a log through it, and print the errors."""

import argparse
import dataclasses
import sys
from typing import TYPE_CHECKING

import numpy as np

from ..errors import InputError
from ..output.json_object import JsonObject
from ..output.progress import Stages
from ..output.runfile import RunFile, whole_file, write_json
from .common import (
    add_log_options,
    add_out,
    finish,
    read_measured,
    read_pairs,
    running_jax,
    say,
    table,
)
from .numbers import real, seed

if TYPE_CHECKING:
    from ..model_file import Model

EXAMPLES = """\
examples:
  fpjax simulate servo.toml --out run
  fpjax simulate servo.toml --set observer.gain_1=500 --set plant.inertia=12
  fpjax simulate servo.toml --margins --at 0.5 --out run          Bode, margins, step response
  fpjax simulate emps.toml --log DATA_EMPS.mat --columns emps     replay a recorded reference
"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the command's arguments."""
    parser.epilog = EXAMPLES
    parser.add_argument("model", metavar="MODEL", help="servo.toml")
    parser.add_argument("--log", metavar="LOG", help="replay the log's reference, print its difference to the log")
    parser.add_argument(
        "--from-rest", action="store_true", help="replay from the log's first position at rest, without its velocity"
    )
    add_log_options(parser)
    parser.add_argument("--set", metavar="NAME=NUMBER", action="append", default=[], help="change a parameter")
    parser.add_argument("--duration", type=real, metavar="S", help="length of the run, instead of the model's [s]")
    parser.add_argument("--seed", type=seed, help="of the sensor's noise (default 0)")
    parser.add_argument(
        "--margins", action="store_true", help="also linearise: gain, phase, delay, modulus margin, Bode, step response"
    )
    parser.add_argument("--at", type=real, metavar="SPEED", help="speed for --margins [rad/s] (default: the run's rms)")
    parser.add_argument("--no-plots", action="store_true", help="no pictures")
    add_out(parser)


def run(arguments: argparse.Namespace) -> int:
    """Simulate or replay."""
    with running_jax(arguments) as record:
        model = open_model(arguments.model, arguments.set, record)
        _check_together(arguments)
        without = ""
        if arguments.log:
            _replay(model, arguments, record)
        else:
            without = _simulate(model, arguments, record)
        finish(record)
    if without:  # the run itself is whole, and usable
        print(f"fpjax simulate: there are no margins: {without}", file=sys.stderr)
        return 2
    return 0


def _check_together(arguments: argparse.Namespace) -> None:
    """Refuse options that would have no effect, as they belong to a replay or to a simulation only."""
    if arguments.log and arguments.margins:
        raise InputError("--margins needs a simulation: run it without --log.")
    if arguments.log and arguments.duration is not None:
        raise InputError("--duration has no effect with --log, whose rows are replayed: give --from and --to instead.")
    if arguments.log and arguments.seed is not None:
        raise InputError("--seed has no effect with --log: a replay is compared without sensor noise; leave it out.")
    if arguments.at is not None and arguments.log:
        raise InputError("--at is the speed at which a simulated loop is linearised: leave it out with --log.")
    if arguments.at is not None and not arguments.margins:
        raise InputError("--at is the speed at which the loop is linearised: add --margins, or leave --at out.")
    of_log = {
        "--from-rest": arguments.from_rest, "--columns": arguments.columns, "--rate": arguments.rate,
        "--from": arguments.start is not None, "--to": arguments.stop is not None, "--every": arguments.every != 1,
        "--strict": arguments.strict,
    }  # fmt: skip
    for option, given in of_log.items():
        if given and not arguments.log:
            raise InputError(f"{option} is about a log, but none is given: add --log LOG, or leave {option} out.")


def open_model(path: str, changes: list[str], record: RunFile) -> "Model":
    """The model of a command, with `--set` applied; its notes are printed.

    Raises:
        InputError: for invalid content of the file or of the changes.
    """
    from .. import set_parameters
    from ..model_file import load_model
    from ..model_file.admissible import check_changes
    from ..model_file.bounds import beliefs_kept, loop_names
    from ..model_file.reading import about_proportions

    model = load_model(record.read(path, "model"))
    for note in model.notes:
        say(record, note)
    if changes:
        pairs = loop_names(model.loop, read_pairs(changes, "--set"))
        before = model
        model = dataclasses.replace(model, loop=set_parameters(model.loop, pairs))
        changed = [
            *beliefs_kept(before, model, pairs),
            *check_changes(model.loop, pairs, model.units.name),
            *about_proportions(model),
        ]
        for note in changed:
            if note not in model.notes:
                say(record, note)
    return model


def _simulate(model: "Model", arguments: argparse.Namespace, record: RunFile) -> str:
    """Simulate; returns why there are no margins, where there are none although they are asked for."""
    import jax

    from .. import simulate
    from .measures import excitation_sentences, measures_of, recorded_names, summary

    model.needed_controller()
    if arguments.margins:
        from ..linear.linearise import refuse_turning_load

        refuse_turning_load(model.loop, 1.0 if arguments.at is None else arguments.at)
    reference = model.needed_reference()
    duration = arguments.duration if arguments.duration is not None else model.needed_duration()
    noise = record.seeds["sensor noise"] = arguments.seed or 0
    record.stage("simulate")
    with Stages("simulate") as stages:
        stages.stage("compiling, then running")
        run = simulate(
            model.loop, reference, dt=model.dt, duration=duration, solver=model.solver, stepping=model.stepping,
            substeps=model.substeps, measures=measures_of(model), record=recorded_names(model),
            key=jax.random.key(noise),
        )  # fmt: skip
    # written before the divergence is reported: the file shows what happened until then
    signals = {"time": np.asarray(run.time), **{name: np.asarray(each) for name, each in run.signals.items()}}
    record.stage("write")
    if record.folder is not None:
        write_signals(record, signals)
    if run.diverged:
        raise InputError(_diverged(model, signals))
    rows = summary(model, run)
    print(f"{_title(model)}: {run.message}, {len(run.time)} samples of {model.dt:g} s")
    print(table(rows, ("quantity", "value", "unit")))
    for sentence in excitation_sentences(model, signals["velocity"], run.settled):
        say(record, sentence)
    content: JsonObject = {
        "status": run.message,
        "measures": {name: {"value": value, "unit": unit} for name, value, unit in rows},
    }
    if record.folder is not None:
        write_json(record.path("simulation.json"), content)
        if not arguments.no_plots:
            from .pictures import draw_run

            draw_run(model, signals, record.path("simulation.png"))
    if not arguments.margins:
        return ""
    try:
        found = _margins(model, arguments, record, signals["velocity"])
    except InputError as error:  # no steady motion at that speed
        record.notes.append(str(error))
        return str(error)
    if record.folder is not None:
        write_json(record.path("simulation.json"), content | {"margins": found})
    return ""


def _margins(model: "Model", arguments: argparse.Namespace, record: RunFile, velocity: np.ndarray) -> JsonObject:
    """Print the margins about a steady motion, write margins.png, and return them for simulation.json."""
    record.stage("margins")
    # friction makes the loop nonlinear: without --at it is linearised at a typical speed of the run
    speed = arguments.at if arguments.at is not None else float(np.sqrt(np.mean(np.square(velocity))))
    linear = model.loop.linearise(
        speed, dt=model.dt, stepping=model.stepping, solver=model.solver, substeps=model.substeps
    )
    margins, unit = linear.margins(), model.units.name("rad/s")
    time = f"sampled every {linear.dt:g} s" if linear.dt is not None else "in continuous time"
    stable = "stable" if margins.stable else "UNSTABLE"
    print(f"\n  about a steady {speed:.4g} {unit}, {time}, opened at the commanded torque: {stable}")
    bandwidth = ("bandwidth", linear.bandwidth() / (2.0 * np.pi), "Hz")
    rows = [*margins.rows(), bandwidth]
    print(table(rows, ("margin", "value", "unit")))
    if record.folder is not None and not arguments.no_plots:
        linear.plot(record.path("margins.png"))
    return {"speed": speed, "bandwidth_hz": bandwidth[1], **vars(margins)}


def _title(model: "Model") -> str:
    return model.path.name if model.path else "the model"


def _diverged(model: "Model", signals: dict[str, np.ndarray]) -> str:
    from ..simulation.divergence import LARGEST, in_proportion

    # not a number compares false, so it counts as diverged
    healthy = np.ones(signals["time"].size, bool) & np.asarray(in_proportion(model.loop.controller, signals))
    for values in signals.values():
        healthy &= np.abs(values) < LARGEST
    first = int(np.argmin(healthy)) if not healthy.all() else healthy.size - 1
    return (
        f"The loop diverges at t = {signals['time'][first]:g} s: use smaller gains (controller or observer) or a "
        f"smaller [simulation] dt, and check the signs."
    )


def write_signals(record: RunFile, signals: dict[str, np.ndarray]) -> None:
    """Write simulation.csv with the columns of a log, so that every command that reads a log can read it."""
    names = {"measured_velocity": "velocity", "measured_position": "position"}
    own = {"velocity": "true_velocity", "position": "true_position"}
    first = ("time", "torque", "measured_velocity", "measured_position", "reference")
    order = [name for name in first if name in signals] + [name for name in signals if name not in first]
    header = ",".join(names.get(name, own.get(name, name)) for name in order)
    columns = np.column_stack([signals[name] for name in order])
    with whole_file(record.path("simulation.csv")) as file:
        np.savetxt(file, columns, delimiter=",", header=header, comments="", fmt="%.10g")


def _replay(model: "Model", arguments: argparse.Namespace, record: RunFile) -> None:
    from .replay import replay

    record.stage("read")
    log = read_measured(arguments.log, model, arguments, record, require=("torque", "reference"))
    record.stage("replay")
    found = replay(model, log, from_rest=arguments.from_rest)
    rows = [(name, error, unit, f"{100.0 * relative:.3g} %") for name, (error, unit, relative) in found.errors.items()]
    print(f"{_title(model)} against {log}")
    print(table(rows, ("log less simulation", "rms", "unit", "of the log's rms")))
    recorded, simulated = found.tracking
    print(f"\n  tracking error rms: {recorded:.4g} {found.unit} recorded, {simulated:.4g} {found.unit} simulated")
    record.stage("write")
    if record.folder is None:
        return
    write_json(
        record.path("replay.json"),
        {
            "log": log.name,
            "samples": log.samples,
            "dt": log.dt,
            "errors": {
                name: {"rms": error, "unit": unit, "relative": relative}
                for name, (error, unit, relative) in found.errors.items()
            },
            "tracking": {"recorded": recorded, "simulated": simulated, "unit": found.unit},
        },
    )
    # checked by `require` above
    assert log.reference is not None
    write_signals(record, {"time": log.time, "reference": log.reference, **found.signals})
    if not arguments.no_plots:
        from .pictures import draw_replay

        draw_replay(model, found, record.path("replay.png"))
