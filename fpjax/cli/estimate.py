"""`fpjax estimate`: an observer over a log, friction estimates over time beside least squares."""

import argparse
import dataclasses
import sys
from collections.abc import Callable
from typing import TYPE_CHECKING, Any

import numpy as np

from ..errors import InputError
from ..output.runfile import RunFile, whole_file, write_json
from .common import add_log_options, add_out, finish, read_measured, running_jax, say
from .numbers import real, whole
from .simulate import open_model

if TYPE_CHECKING:
    from .. import AbstractObserver, Estimated
    from ..logs import Log
    from ..model_file import Model

LAPS = 20.0  # time constants in a log, for default gains
NOISE_WIDTHS = 0.5  # steepness x noise standard deviation of the speed: tanh reaches 0.96 at four deviations
EXAMPLES = """\
examples:
  fpjax estimate run.csv --model servo.toml --out friction
  fpjax estimate DATA_EMPS.mat --columns emps --model emps.toml --average 6.24 --out friction
without [observer] in the model an EFP is used, with gains from the inertia and the log's speed
"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the command's arguments."""
    parser.epilog = EXAMPLES
    parser.add_argument("log", metavar="LOG", help="CSV, .npz, .mat, Parquet or MCAP with torque and motion")
    parser.add_argument("--model", metavar="MODEL", required=True, help="servo.toml: inertia, known load, observer")
    add_log_options(parser)
    parser.add_argument("--set", metavar="NAME=NUMBER", action="append", default=[], help="change a parameter")
    parser.add_argument(
        "--average", type=real, metavar="S", help="mean over the last S seconds, such as a lap (default: a quarter)"
    )
    parser.add_argument(
        "--differentiator", choices=("zero_phase", "causal"), default="zero_phase",
        help="filter that gives a log without velocity one (default zero_phase; causal is possible in a drive)",
    )  # fmt: skip
    parser.add_argument(
        "--passes", type=whole, default=1, metavar="N",
        help="passes over the log, each starting from the estimates of the one before, for slow gains (default 1)",
    )  # fmt: skip
    parser.add_argument("--cutoff", type=real, metavar="HZ", help="cutoff of that filter (default: sample rate / 10)")
    parser.add_argument("--no-plots", action="store_true", help="no pictures")
    add_out(parser)


def run(arguments: argparse.Namespace) -> int:
    """Estimate."""
    with running_jax(arguments) as record:
        model, log = open_model_and_log(arguments, record)
        from .. import estimate, set_parameters
        from ..logs.dynamics.derivative import measured_velocity
        from .common import read_pairs

        observer = model.loop.observer
        if not observer.estimated:
            velocity, _ = measured_velocity(log, differentiator=arguments.differentiator, cutoff=arguments.cutoff)
            observer = default_observer(model, log, velocity, record)
            own = read_pairs(arguments.observer_set, "--set")
            observer = set_parameters(observer, own)
        record.stage("estimate")
        found = estimate(
            log, observer, load=model.loop.plant.load, average=arguments.average,
            differentiator=arguments.differentiator, cutoff=arguments.cutoff, passes=arguments.passes,
        )  # fmt: skip
        print(found)
        record.notes.extend(found.sentences)
        record.stage("write")
        if record.folder is not None:
            write_json(record.path("estimate.json"), found.to_dict())
            _write_traces(found, record)
            if not arguments.no_plots:
                found.plot(record.path("estimate.png"))
        finish(record)
    return 0


def open_model_and_log(arguments: argparse.Namespace, record: RunFile) -> "tuple[Model, Log]":
    """The model and the log of a command, checked against each other.

    Raises:
        InputError: for what is invalid in one of them.
    """
    from ..logs.checks.suspicions import Numbers, suspicions

    changes = [word for word in arguments.set if not word.startswith("observer.")]
    arguments.observer_set = [word.removeprefix("observer.") for word in arguments.set if word.startswith("observer.")]
    model = open_model(arguments.model, changes, record)
    if model.loop.observer.estimated and arguments.observer_set:
        from .. import set_parameters
        from .common import read_pairs

        observer = set_parameters(model.loop.observer, read_pairs(arguments.observer_set, "--set"))
        model = dataclasses.replace(model, loop=dataclasses.replace(model.loop, observer=observer))
    record.stage("read")
    log = read_measured(arguments.log, model, arguments, record)
    # Friction is what is to be estimated, so the checks get the inertia and the load only.
    for one in suspicions(log, Numbers(model.nominal["inertia"], load=_known_load(model))):
        print(f"warning: {one.sentence}", file=sys.stderr)
        record.notes.append(one.sentence)
    return model, log


def _known_load(model: "Model") -> Callable[[Any, Any, Any], np.ndarray]:
    """The model's load as a function for the checks: (velocity, position, time) -> torque [N m]."""
    from .. import Motion

    load = model.loop.plant.load
    return lambda velocity, position, time: np.asarray(load.readout(Motion(velocity, position, time)), float)


def default_observer(model: "Model", log: "Log", velocity: np.ndarray, record: RunFile) -> "AbstractObserver":
    """An EFP for a model without an observer; both modes get a time constant of a twentieth of the log (4.12).

    The averaged matrix of (4.12) has the diagonal -gain_2 / J, -gain_1 mean(w^2) / J, whose inverses are set to -tau.
    The torque is not used, so the gains do not depend on the answer.

    Near zero the sign of a noisy speed is that of the noise. An observer that compensates by it learns too little
    Coulomb friction and too much viscous friction. So the compensation is a tanh as wide as the noise (gimbal motor,
    noise 0.2 % of the peak speed: an error of -19 % became -5 %).
    """
    from .. import ExtendedFriedlandPark
    from ..logs.noise import noise_level

    inertia = model.nominal["inertia"]
    mean_square = float(np.mean(np.square(velocity)))
    if mean_square == 0.0:
        raise InputError(f"{log.name} has no motion, so no friction can be estimated from it: record a moving axis.")
    time_constant = log.duration / LAPS
    gain_1 = float(f"{inertia / (time_constant * mean_square):.3g}")
    gain_2 = float(f"{inertia / time_constant:.3g}")
    noise = noise_level(np.asarray(velocity, float))
    steepness = float(f"{NOISE_WIDTHS / noise:.3g}") if noise > 0.0 else None
    softened = "" if steepness is None else f", and steepness = {steepness:g} from the speed's noise of {noise:.2g}"
    say(
        record,
        f"[observer] is not given: an EFP with gain_1 = {gain_1:g} and gain_2 = {gain_2:g} was chosen, from the "
        f"inertia and the log's speed, for a time constant of about {time_constant:.3g} s{softened}.",
    )
    return ExtendedFriedlandPark(inertia=inertia, gain_1=gain_1, gain_2=gain_2, steepness=steepness)


def _write_traces(found: "Estimated", record: RunFile) -> None:
    columns = np.column_stack([found.time, found.velocity, *found.estimates.values()])
    header = ",".join(["time", "velocity", *found.estimates])
    with whole_file(record.path("estimate.csv")) as file:
        np.savetxt(file, columns, delimiter=",", header=header, comments="", fmt="%.8g")
