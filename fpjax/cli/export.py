"""`fpjax export`: the control law as C, the mechanics as MuJoCo or URDF."""

import argparse
import pathlib
from typing import TYPE_CHECKING

from ..errors import InputError
from ..logs.columns.units import is_label
from ..output.json_object import JsonObject
from ..output.runfile import RunFile, write_json
from .common import add_log_options, add_out, finish, read_measured, running_jax, say, table

if TYPE_CHECKING:
    from ..logs import Log
    from ..model_file import Model

EXAMPLES = """\
examples:
  fpjax export tuned.toml --c drive --check              C99, compiled and compared with the simulation
  fpjax export tuned.toml --c drive --precision float    for a drive with a single-precision unit
  fpjax export corrected.toml --mujoco sim --log run.csv     MJCF, replayed in MuJoCo against the log
  fpjax export corrected.toml --urdf sim
"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the command's arguments."""
    parser.epilog = EXAMPLES
    parser.add_argument("model", metavar="MODEL", help="servo.toml, as tuned or corrected")
    parser.add_argument("--c", metavar="DIR", help="the control law as C99: header, source, test program, vectors")
    parser.add_argument("--precision", choices=("double", "float"), default="double", help="of the C (default double)")
    parser.add_argument("--name", metavar="WORD", help="prefix of the C files and symbols (default: the model's name)")
    parser.add_argument("--check", action="store_true", help="compile the C with cc, compare it with the simulation")
    parser.add_argument("--mujoco", metavar="DIR", help="the mechanics as MJCF, replayed in MuJoCo if it is installed")
    parser.add_argument("--urdf", metavar="DIR", help="the mechanics as URDF, replayed in MuJoCo if it is installed")
    parser.add_argument("--log", metavar="LOG", help="log to replay (default: the model's reference against fpjax)")
    add_log_options(parser)
    parser.add_argument("--set", metavar="NAME=NUMBER", action="append", default=[], help="change a parameter")
    add_out(parser)


def run(arguments: argparse.Namespace) -> int:
    """Write what is asked for."""
    targets = [folder for folder in (arguments.c, arguments.mujoco, arguments.urdf) if folder]
    if not targets:
        raise InputError("nothing to export: give --c DIR, --mujoco DIR or --urdf DIR, or several of them.")
    if arguments.check and not arguments.c:
        raise InputError("--check compiles the C of the control law: give --c DIR too, or leave --check out.")
    if arguments.log and not (arguments.mujoco or arguments.urdf):
        raise InputError("--log is replayed in MuJoCo: give --mujoco DIR or --urdf DIR too, or leave --log out.")
    if not arguments.out:
        arguments.out = targets[0]
    with running_jax(arguments) as record:
        from .simulate import open_model

        model = open_model(arguments.model, arguments.set, record)
        content: JsonObject = {}
        if arguments.c:
            content["c"] = _export_c(model, arguments, record)
        log = _log(model, arguments, record) if arguments.mujoco or arguments.urdf else None
        for target in ("mujoco", "urdf"):
            if getattr(arguments, target):
                content[target] = _export_body(target, model, log, arguments, record)
        write_json(record.path("export.json"), content)
        finish(record)
    return 0


def _log(model: "Model", arguments: argparse.Namespace, record: RunFile) -> "Log | None":
    if not arguments.log:
        return None
    record.stage("read")
    return read_measured(arguments.log, model, arguments, record, require=("torque", "reference"))


def _export_body(
    target: str, model: "Model", log: "Log | None", arguments: argparse.Namespace, record: RunFile
) -> JsonObject:
    from ..export import export_mujoco, export_urdf
    from ..export.c_code import unit_of

    record.stage(target)
    write = export_mujoco if target == "mujoco" else export_urdf
    made = write(model, getattr(arguments, target), log=log)
    for note in made.notes:
        say(record, note)
    name = "MuJoCo" if target == "mujoco" else "the URDF in MuJoCo"
    print(f"\n{made.file.name}:" + ("" if made.errors else " written"))
    if made.errors:
        rows = [
            (each, ours, theirs, size, unit_of(each, model.units)) for each, (ours, theirs, size) in made.errors.items()
        ]
        print(table(rows, (f"rms error against {made.against}", "fpjax", name, "rms of that", "unit")))
    held = [left.name for left in made.body.leftovers]
    unit = unit_of(made.tracked, model.units)
    if made.costs:
        print(f"\n  not expressed there, and what that adds to the rms error of the {made.tracked}:")
        print(table([(left, cost, unit) for left, cost in made.costs.items()]))
    elif held:
        print(f"  not expressed there: {', '.join(held)}")
    else:
        label = f", in units of {model.units.torque}" if is_label(model.units.torque) else ""
        print(f"  all of the model's mechanics is expressed there{label}")
    # files beside run.json are listed by name, so that the folder can be moved; others by their path
    same = pathlib.Path(arguments.out).resolve() == made.file.parent.resolve()
    record.outputs.append(made.file.name if same else str(made.file))
    errors = {
        each: {"fpjax": ours, "target": theirs, "rms": size} for each, (ours, theirs, size) in made.errors.items()
    }
    return {"file": made.file.name, "against": made.against, "errors": errors, "not_held": made.costs or held}


def _export_c(model: "Model", arguments: argparse.Namespace, record: RunFile) -> JsonObject:
    from ..export import export_c
    from ..export.c_code import unit_of
    from ..export.vectors import ULPS

    record.stage("C")
    made = export_c(model, arguments.c, precision=arguments.precision, name=arguments.name, check=arguments.check)
    for note in made.notes:
        say(record, note)
    print(f"{made.code.name}_control: {made.cost.sentence(made.law.dt)}")
    print(f"  libm: {', '.join(made.code.libm) or 'nothing'}")
    content: JsonObject = {
        "files": made.files, "precision": made.law.precision, "period": made.law.dt, "libm": made.code.libm,
        "state": made.law.states, "outputs": made.law.outputs, "cost": vars(made.cost),
    }  # fmt: skip
    if made.checked is not None:
        found = made.checked
        print(f"\n  {found.compiler}, {found.rows} samples against fpjax.simulate:")
        units = {name: unit_of(name, model.units) for name in made.law.outputs}
        rows = [
            (name, found.steps[name], found.runs[name], made.bounds[name], units[name]) for name in made.law.outputs
        ]
        print(table(rows, ("output", f"a step [ulp, {ULPS:g} allowed]", "the run", "bound", "unit")))
        print(f"  {found.nanoseconds:.3g} ns per step on this machine; passed")
        content["check"] = {**vars(found), "run_bounds": made.bounds}
    same = pathlib.Path(arguments.out).resolve() == made.folder.resolve()
    record.outputs.extend(name if same else str(made.folder / name) for name in made.files)
    return content
