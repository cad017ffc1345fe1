"""`fpjax plan`: which run to record next, as a table with a picture and a sentence for each pair of rivals."""

import argparse
import sys
import threading

from ..errors import InputError
from ..output.progress import Stages
from ..output.runfile import write_json
from .command_line import exit_code
from .common import add_log_options, add_out, finish, read_measured, running_jax, say, started
from .numbers import real, seed
from .simulate import open_model

EXAMPLES = """\
examples:
  fpjax plan --model servo.toml --speed 2 --torque 40 --travel 6 --out next        show every effect
  fpjax plan --model servo.toml --diagnosis why --travel 6 --out next              separate the causes left open in why/
  fpjax plan --model servo.toml --log run.csv --out next                           diagnose run.csv first
  fpjax diagnose run.csv next_run.csv --model servo.toml --out why2                with the run that was recorded then

next/reference.csv is the reference for the drive; in servo.toml: [reference] type = "recorded", file = "reference.csv"
"""
# The stages that an interrupt ends, from the first of which on there is a run that can be kept.
SEARCHING = ("trying starts", "improving by gradients")
LIMITS = (
    ("speed", "rad/s", "largest speed"),
    ("acceleration", "rad/s^2", "largest acceleration (default: the torque limit less friction, over the inertia)"),
    ("torque", "N m", "largest commanded torque (default: the model's limit, or a fifth above the log's)"),
    ("travel", "rad", "largest distance between both ends of the motion"),
    ("duration", "s", "length of the run"),
)


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the command's arguments."""
    parser.epilog = EXAMPLES
    parser.add_argument("--model", metavar="MODEL", required=True, help="servo.toml of the nominal simulator")
    source = parser.add_mutually_exclusive_group()
    source.add_argument("--log", metavar="LOG", help="log of an earlier run: it is diagnosed first")
    source.add_argument(
        "--diagnosis", metavar="DIR", help="the --out of fpjax diagnose, whose rival causes are to be separated"
    )
    for name, unit, words in LIMITS:
        parser.add_argument(f"--{name}", type=real, metavar="X", help=f"{words} [{unit}]")
    parser.add_argument("--missing", type=real, metavar="X", help="missing torque assumed in every model, rms [N m]")
    parser.add_argument("--velocity-noise", type=real, metavar="X", help="noise standard deviation [rad/s]")
    parser.add_argument("--position-noise", type=real, metavar="X", help="noise standard deviation [rad]")
    parser.add_argument(
        "--seconds",
        type=real,
        default=20.0,
        metavar="S",
        help="processor time of the search, after compiling (default 20)",
    )
    parser.add_argument("--seed", type=seed, default=0, help="of the random motions tried first (default 0)")
    parser.add_argument("--no-plots", action="store_true", help="no picture")
    add_log_options(parser)
    add_out(parser, required=True)


def run(arguments: argparse.Namespace) -> int:
    """Plan a run; after an interrupt the best one so far is written."""
    with running_jax(arguments) as record:
        model = open_model(arguments.model, [], record)
        log = None
        if arguments.log:
            log = read_measured(arguments.log, model, arguments, record)
        if arguments.diagnosis:
            record.read(f"{arguments.diagnosis}/diagnosis.json", "diagnosis")
        if arguments.seconds <= 0.0:
            raise InputError(f"--seconds must be above zero, got {arguments.seconds:g}.")
        record.seeds["starts"] = arguments.seed
        record.stage("plan")
        arguments.kept = "no run was found yet; nothing was written"
        from .. import plan

        with Stages("plan") as stages:
            reached, asked = list[str](), threading.Event()

            def progress(stage: str, share: float) -> None:
                reached.append(stage)
                if asked.is_set() and stage in SEARCHING:  # `plan` ends with the best run so far
                    raise KeyboardInterrupt
                stages.stage(stage, share)

            result = started(
                lambda: plan(
                    model, log=log, diagnosis=arguments.diagnosis, speed=arguments.speed, torque=arguments.torque,
                    acceleration=arguments.acceleration, travel=arguments.travel, duration=arguments.duration,
                    missing=arguments.missing, velocity_noise=arguments.velocity_noise,
                    position_noise=arguments.position_noise, seconds=arguments.seconds, seed=arguments.seed,
                    progress=progress,
                )
            )  # fmt: skip
            code = 0
            try:
                found = result()
            except KeyboardInterrupt as error:
                if SEARCHING[0] not in reached:  # still in the diagnosis or the compiler, so there is nothing to keep
                    raise
                asked.set()
                code, arguments.kept = exit_code(error), "no run was kept; nothing was written"
                print("note: ending with the best run so far; interrupted again, at once without it", file=sys.stderr)
                try:
                    found = result()
                except KeyboardInterrupt:  # a second one; or no start had a finite cost yet
                    raise error from None
        arguments.kept = ""
        for note in found.notes:
            say(record, note)
        print(found)
        record.stage("write")
        found.write_reference(record.path("reference.csv"))
        write_json(record.path("plan.json"), found.to_dict())
        if not arguments.no_plots:
            found.plot(record.path("plan.png"))
        finish(record)
    return code if found.ended == "interrupted" else 0
