"""`fpjax sweep`: the cost on a dense grid of parameters, resumable."""

import argparse
import json
import math
import pathlib
import shutil
from typing import TYPE_CHECKING, Any

import numpy as np

from ..errors import InputError
from ..output.runfile import MARK, RunFile, read_run, write_json
from .common import add_out, busy, finish, running_jax, say
from .numbers import real, whole
from .objective_arguments import add_cost_arguments, cost_settings

if TYPE_CHECKING:
    from tuning import AbstractObjective, Axis, SweepResult

EXAMPLES = """\
examples:
  fpjax sweep servo.toml --axis observer.gain_1=10:1e4:60 --axis observer.gain_2=1:100:60 --out grid
  fpjax sweep servo.toml --axis controller.kp=50:300:30:linear --objective tracking --out grid
  fpjax sweep servo.toml --axis ... --out grid --resume       goes on after Ctrl-C
  fpjax sweep servo.toml --axis ... --tuned tuned --out grid  draws the paths of fpjax tune --out tuned
"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the command's arguments."""
    parser.epilog = EXAMPLES
    add_cost_arguments(parser)
    parser.add_argument(
        "--axis", metavar="NAME=LOW:HIGH:COUNT[:linear]", action="append", default=[],
        help="a parameter and its values, on a log scale unless :linear; once for each axis",
    )  # fmt: skip
    parser.add_argument("--resume", action="store_true", help="go on with an interrupted sweep in --out")
    parser.add_argument(
        "--tuned", metavar="DIR", help="--out of fpjax tune for the same model: the path of every method is drawn"
    )
    parser.add_argument(
        "--chunk", type=whole, default=4096, metavar="N", help="candidates computed and kept at a time (default 4096)"
    )
    parser.add_argument("--scheduler", metavar="ADDRESS", help="address of a Dask cluster (extra `cluster`)")
    parser.add_argument("--no-plots", action="store_true", help="no pictures")
    add_out(parser, required=True)


def run(arguments: argparse.Namespace) -> int:
    """Sweep."""
    with running_jax(arguments) as record:
        axes = [read_axis(word) for word in arguments.axis]
        if not axes:
            raise InputError(
                "There is nothing to sweep: give at least one --axis, as --axis observer.gain_1=10:1e4:50."
            )
        model, references, settings = cost_settings(arguments, record)
        paths = paths_of(arguments.tuned, axes, settings["objective"], list(references), record)
        from tuning import sweep
        from tuning.sweep import sweep_identity

        assert record.folder is not None
        if arguments.resume and _is_finished(
            record, sweep_identity(model.loop, references, axes=axes, chunk=arguments.chunk, **settings)
        ):
            say(record, f"this sweep was finished before, in {record.folder}; nothing was written.")
            record.folder = None  # its run.json stays that of the sweep
            return 0
        chunks = record.folder / "chunks"
        arguments.kept = f"finished chunks are kept in {chunks}; add --resume to the same command to go on"
        record.stage("sweep")
        record.mark()
        try:
            result = sweep(
                model.loop, references, axes=axes, chunk=arguments.chunk, out=chunks, resume=arguments.resume,
                scheduler=arguments.scheduler, progress=True, **settings,
            )  # fmt: skip
        except InputError as error:
            raise InputError(str(error).replace("resume=True", "--resume")) from error
        record.stage("write")
        print(result)
        for sentence in at_ends(result):
            print(f"  {sentence}")
        result.save(record.path("sweep.npz"))
        write_json(record.path("sweep.json"), result.to_dict())
        if not arguments.no_plots:
            with busy("sweep", "drawing"):
                result.plot(record.path("sweep.png"), paths=paths)
                result.page(record.path("sweep.html"), paths=paths)
        del result
        shutil.rmtree(chunks, ignore_errors=True)  # sweep.npz holds all of their contents
        arguments.kept = ""
        finish(record)
    return 0


def _is_finished(record: RunFile, identity: str) -> bool:
    """Whether the folder holds this very sweep, finished: then there is nothing to go on with.

    Raises:
        InputError: where it holds another one, which would be lost.
    """
    folder = record.folder
    assert folder is not None
    if (folder / "chunks").exists() or (folder / MARK).exists() or not (folder / "sweep.json").exists():
        return False
    try:
        found = json.loads((folder / "sweep.json").read_text()).get("identity")
    except (OSError, ValueError, AttributeError):
        found = None
    if found != identity:
        raise InputError(
            f"{folder} holds a finished sweep, and not this one (other axes, loop, reference, settings or versions): "
            "--resume goes on with an interrupted one; give another --out, or leave out --resume to replace that sweep."
        )
    return True


def paths_of(
    folder: str | None, axes: "list[Axis]", objective: "AbstractObjective", references: list[str], record: RunFile
) -> dict[str, dict[str, list[float]]]:
    """The path of every method of a finished `fpjax tune`, by the method's name: {method: {parameter: values}}.

    Raises:
        InputError: for a folder without a finished tuning, or one of another objective, reference or parameter.
    """
    if folder is None:
        return {}
    read_run(folder)  # refuses an unfinished run
    file = record.read(pathlib.Path(folder) / "tune.json", "tuning whose paths are drawn")
    try:
        results = json.loads(file.read_text())["results"]
        found = {
            result["method"]: (dict(result["path"]), result["objective"], result["references"]) for result in results
        }
    except (OSError, ValueError, KeyError, TypeError) as error:
        raise InputError(
            f"--tuned {folder}: its tune.json holds no paths ({type(error).__name__}): give the --out of fpjax tune."
        ) from error
    swept, kind = {axis.name for axis in axes[:2]}, type(objective).__name__.lower()
    for method, (path, word, labels) in found.items():
        if word != kind or labels != references:
            raise InputError(
                f"--tuned {folder}: {method} minimised the {word} cost on {', '.join(labels)}, this sweep has the "
                f"{kind} cost on {', '.join(references)}: give both commands the same --objective and --references."
            )
        if not swept <= set(path):
            raise InputError(
                f"--tuned {folder}: {method} tuned {', '.join(path)}, but the sweep's axes are "
                f"{', '.join(sorted(swept))}: sweep the parameters that were tuned."
            )
    model, tuned = record.inputs[0], (read_run(folder).get("inputs") or [{}])[0]
    if model.get("sha256") != tuned.get("sha256"):
        say(record, f"{folder} was tuned with another model file: its paths may belong to another cost function.")
    return {method: path for method, (path, _, _) in found.items()}


def read_axis(word: str) -> "Axis":
    """An `Axis` from NAME=LOW:HIGH:COUNT[:log|linear].

    Raises:
        InputError: for a word that cannot be read, or an empty range.
    """
    from tuning import Axis

    name, equals, rest = word.partition("=")
    parts = rest.split(":")
    try:
        if not equals or not 3 <= len(parts) <= 4:
            raise ValueError
        low, high, count = (real(part) for part in parts[:3])
        if count != int(count):
            raise ValueError
    except (ValueError, OverflowError):
        raise InputError(
            f"--axis {word!r} is not NAME=LOW:HIGH:COUNT: write for instance observer.gain_1=10:1e4:50, with :linear "
            f"at the end for a linear scale."
        ) from None
    scale: Any = parts[3] if len(parts) == 4 else "log"
    axis = Axis(name.strip(), low, high, int(count), scale)
    axis.check()
    return axis


def at_ends(result: "SweepResult") -> list[str]:
    """Sentences on axes along which the cost is flat, or at whose end the best candidate lies."""
    best, least = result.best()
    if not math.isfinite(least):
        return ["every candidate diverged: sweep smaller values, or use a smaller [simulation] dt"]
    cost = result.cost()
    place = np.unravel_index(int(np.argmin(cost)), cost.shape)
    flat, ends = [], []
    for number, axis in enumerate(result.axes):
        # the cost along this axis through the best
        through = cost[(*place[:number], slice(None), *place[number + 1 :])]
        if axis.count > 2 and np.all(through == through[0]):
            flat.append(axis.name)
        elif axis.count > 2 and best[axis.name] in (axis.values[0], axis.values[-1]):
            ends.append(axis.name)
    said = [f"the cost does not depend on {' and '.join(flat)} at its minimum"] if flat else []
    return [*said, f"the minimum lies at an end of {' and '.join(ends)}: widen that range"] if ends else said
