"""Arguments that sweep and tune share: the objective, the references, the plants to tune for."""

import argparse
from typing import TYPE_CHECKING

import numpy as np

from ..errors import InputError
from ..output.json_object import JsonObject
from ..output.runfile import RunFile
from .common import say
from .numbers import real, whole
from .simulate import open_model

if TYPE_CHECKING:
    from tuning.objective import AbstractObjective

    from .. import AbstractReference
    from ..model_file import Model

REFERENCES = ("sine", "constant", "chirp", "triangle", "square")


def add_cost_arguments(parser: argparse.ArgumentParser) -> None:
    """--objective, and the references, plants and noise over which it is averaged."""
    parser.add_argument("model", metavar="MODEL", help="servo.toml")
    parser.add_argument(
        "--objective", choices=("estimation", "tracking", "thesis"),
        help="estimation: squared relative error of the estimates (default with an observer); tracking: squared "
        "tracking error (default without); thesis: final error, Appendix B",
    )  # fmt: skip
    parser.add_argument("--after", type=real, metavar="S", default=0.0, help="count nothing before this time [s]")
    parser.add_argument(
        "--references", metavar="LIST",
        help=f"several references, of {','.join(REFERENCES)}, with the amplitude and frequency of [reference]",
    )  # fmt: skip
    parser.add_argument(
        "--plants", metavar="NAME=A,B,...", action="append", default=[],
        help="true plants, as plant.friction.viscous=1,2,5 (the first values of several lists make one plant)",
    )  # fmt: skip
    parser.add_argument(
        "--spread", metavar="NAME=SHARE", action="append", default=[],
        help="true plants at the corners of +- SHARE around the model, as plant.inertia=0.2",
    )  # fmt: skip
    parser.add_argument("--worst", action="store_true", help="minimise the worst case instead of the mean")
    parser.add_argument("--noise-seeds", type=whole, metavar="N", default=0, help="runs with N draws of sensor noise")
    parser.add_argument("--set", metavar="NAME=NUMBER", action="append", default=[], help="change a parameter first")
    parser.add_argument("--duration", type=real, metavar="S", help="length of a run, instead of the model's [s]")


def cost_settings(
    arguments: argparse.Namespace, record: RunFile
) -> "tuple[Model, dict[str, AbstractReference], JsonObject]":
    """(model, references, keyword arguments of `tune` and `sweep`).

    Raises:
        InputError: for invalid input.
    """
    from tuning import population
    from tuning.objective import Estimation, Thesis, Tracking

    model = open_model(arguments.model, arguments.set, record)
    model.needed_controller()
    duration = arguments.duration if arguments.duration is not None else model.needed_duration()
    if not 0.0 <= arguments.after < duration:
        raise InputError(f"--after must lie within the run of {duration:g} s, got {arguments.after:g} s.")
    observed = bool(model.loop.observer.estimated)
    chosen = arguments.objective or ("estimation" if observed else "tracking")
    objective: AbstractObjective = {
        "estimation": lambda: Estimation(start=arguments.after),
        "tracking": lambda: Tracking(start=arguments.after, position=model.units.reference == "position"),
        "thesis": Thesis,
    }[chosen]()
    if chosen == "thesis" and arguments.after:
        raise InputError("--after has no effect on the thesis objective, which counts the final error: leave it out.")
    plants = dict(map(_plants, arguments.plants))
    spread = dict(map(_share, arguments.spread))
    for option, words, found in (("--plants", arguments.plants, plants), ("--spread", arguments.spread, spread)):
        if len(found) < len(words):
            raise InputError(f"{option} gives one name twice: give each name once.")
    if plants and spread:
        raise InputError("--plants and --spread both give the true plants: give one of them.")
    if len({len(values) for values in plants.values()}) > 1:
        raise InputError("--plants: all lists must have the same length: the n-th value of each makes the n-th plant.")
    if spread:
        plants = {name: list(values) for name, values in population(model.loop, spread).items()}
    if arguments.noise_seeds < 0:
        raise InputError(f"--noise-seeds must be zero or more, got {arguments.noise_seeds}.")
    record.seeds["sensor noise"] = arguments.noise_seeds
    if chosen == "tracking" and not arguments.noise_seeds:
        has = bool(np.any(np.asarray(getattr(model.loop.sensor, "noise", 0.0))))
        add = "add --noise-seeds 4" if has else "give the model a [sensor] noise and add --noise-seeds 4"
        say(record, f"without sensor noise only the step and the limits keep the gains from growing: {add}.")
    settings = {
        "dt": model.dt,
        "duration": duration,
        "objective": objective,
        "solver": model.solver,
        "stepping": model.stepping,
        "substeps": model.substeps,
        "plants": plants or None,
        "noise_seeds": tuple(range(arguments.noise_seeds)),
        "aggregate": "worst" if arguments.worst else "mean",
    }
    return model, references_of(model, arguments.references, duration), settings


def _share(word: str) -> tuple[str, float]:
    name, values = _plants(word)
    if len(values) > 1:
        raise InputError(
            f"--spread {word} has {len(values)} shares: give one, as --spread {name}={values[0]:g}, or the values "
            "themselves with --plants."
        )
    return name, values[0]


def _plants(word: str) -> tuple[str, list[float]]:
    name, equals, numbers = word.partition("=")
    try:
        values = [real(number) for number in numbers.split(",")]
    except ValueError:
        values, equals = [], ""
    if not equals or not values or not np.all(np.isfinite(values)):
        raise InputError(f"{word!r} is not NAME=A,B,...: write for instance plant.friction.viscous=1,2,5.")
    return name.strip(), values


def references_of(model: "Model", words: str | None, duration: float) -> "dict[str, AbstractReference]":
    """The model's reference, or several shapes with its amplitude and frequency."""
    import fpjax as fp

    own = model.needed_reference()
    if not words:
        return {type(own).__name__.lower(): own}
    amplitude, frequency = getattr(own, "amplitude", None), getattr(own, "frequency", None)
    if amplitude is None or frequency is None:
        raise InputError(
            "--references takes amplitude and frequency from [reference], which has none: use a sine, triangle or "
            "square there."
        )
    makers = {
        "sine": lambda: fp.Sine(amplitude, frequency),
        "constant": lambda: fp.Constant(amplitude),
        "chirp": lambda: fp.Chirp(amplitude, 0.0, frequency, duration),
        "triangle": lambda: fp.Triangle(amplitude, frequency),
        "square": lambda: fp.Square(amplitude, frequency),
    }
    chosen = {}
    for word in words.split(","):
        if word.strip() not in makers:
            raise InputError(f"--references {word.strip()!r} is not known: choose among {', '.join(makers)}.")
        chosen[word.strip()] = makers[word.strip()]()
    return chosen
