"""`fpjax export`: the control law as C."""

import argparse
import pathlib
from typing import Any

from ..errors import InputError
from ..output.runfile import RunFile, write_json
from .common import add_out, finish, running, say, start_jax, table

EXAMPLES = """\
examples:
  fpjax export tuned.toml --c drive --check              C99, compiled and compared with the simulation
  fpjax export tuned.toml --c drive --precision float    for a drive with a single-precision unit
"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """The command's words."""
    parser.epilog = EXAMPLES
    parser.add_argument("model", metavar="MODEL", help="servo.toml, as tuned or corrected")
    parser.add_argument("--c", metavar="DIR", help="the control law as C99: header, source, test program, vectors")
    parser.add_argument("--precision", choices=("double", "float"), default="double", help="of the C (default double)")
    parser.add_argument("--name", metavar="WORD", help="prefix of the C's files and symbols (default: the file's)")
    parser.add_argument("--check", action="store_true", help="compile the C with cc, compare it with the simulation")
    parser.add_argument("--set", metavar="NAME=NUMBER", action="append", default=[], help="change a parameter")
    add_out(parser)


def run(arguments: argparse.Namespace) -> int:
    """Write what is asked for."""
    if not arguments.c:
        raise InputError("nothing to export: give --c DIR.")
    if not arguments.out:
        arguments.out = arguments.c
    with running(arguments) as record:
        record.stage("start")
        start_jax(arguments)
        from .simulate import open_model

        model = open_model(arguments.model, arguments.set, record)
        if arguments.c:
            _export_c(model, arguments, record)
        finish(record)
    return 0


def _export_c(model: Any, arguments: argparse.Namespace, record: RunFile) -> None:
    from ..export import export_c
    from ..export.c_code import unit_of
    from ..export.vectors import ULPS

    record.stage("C")
    made = export_c(model, arguments.c, precision=arguments.precision, name=arguments.name, check=arguments.check)
    for note in made.notes:
        say(record, note)
    print(f"{made.code.name}_control: {made.cost.sentence(made.law.dt)}")
    print(f"  libm: {', '.join(made.code.libm) or 'nothing'}")
    content: dict[str, Any] = {
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
        print(f"  {found.nanoseconds:.3g} ns a step on this machine; passed")
        content["check"] = {**vars(found), "run_bounds": made.bounds}
    same = pathlib.Path(arguments.out).resolve() == made.folder.resolve()
    record.outputs.extend(name if same else str(made.folder / name) for name in made.files)
    write_json(record.path("export.json"), {"c": content})
