"""`fpjax diagnose`: where simulation and log differ, which effect causes it, how far the gap shrinks."""

import argparse
import dataclasses
import pathlib
import shlex
import sys
from typing import Any

from ..errors import InputError
from ..output.progress import Stages
from ..output.runfile import RunFile, write_json, write_whole
from .common import add_log_options, add_out, check_torque_unit, finish, log_options, running, start_jax
from .simulate import open_model

EXAMPLES = """\
examples:
  fpjax diagnose run.csv --model servo.toml --out why
  fpjax diagnose monday.csv tuesday.csv --model servo.toml --holdout friday.csv --out why    runs of one machine
  fpjax diagnose a.csv b.csv --each --model servo.toml --out why                             separate machines
  fpjax simulate why/corrected.toml                       the corrected model runs, and can be tuned again
"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """The command's words."""
    parser.epilog = EXAMPLES
    parser.add_argument("logs", metavar="LOG", nargs="+", help="runs of one machine (with --each, of several)")
    parser.add_argument("--model", metavar="MODEL", required=True, help="servo.toml of the nominal simulator")
    parser.add_argument(
        "--holdout", metavar="LOG", nargs="+", default=[],
        help="runs that are only scored, never fitted (default: whole blocks of the logs themselves)",
    )  # fmt: skip
    parser.add_argument("--each", action="store_true", help="each log is a machine of its own, with its own folder")
    add_log_options(parser)
    parser.add_argument("--no-report", action="store_true", help="diagnosis.json only: no report.html, no pictures")
    add_out(parser, required=True)


def run(arguments: argparse.Namespace) -> int:
    """Diagnose."""
    with running(arguments) as record:
        record.stage("start")
        start_jax(arguments)
        model = open_model(arguments.model, [], record)
        record.stage("read")
        logs = [_log(path, "log", model, arguments, record) for path in arguments.logs]
        holdout = [_log(path, "holdout", model, arguments, record) for path in arguments.holdout]
        assert record.folder is not None
        if not arguments.each:
            _one(model, logs, holdout, record.folder, record, arguments)
        else:
            names = folder_names([log.name for log in logs])
            for place, (log, name) in enumerate(zip(logs, names, strict=True)):
                arguments.kept = f"{place} of {len(logs)} logs are diagnosed in {record.folder}"
                if place:
                    print()
                _one(model, [log], holdout, record.folder / name, record, arguments)
        arguments.kept = ""
        finish(record)
    return 0


def folder_names(names: list[str]) -> list[str]:
    """A folder for each log, by its name without the suffix, numbered where two are the same."""
    stems = [pathlib.PurePath(name).stem for name in names]
    return [
        f"{stem}-{stems[: place + 1].count(stem)}" if stems.count(stem) > 1 else stem
        for place, stem in enumerate(stems)
    ]


def _log(path: str, role: str, model: Any, arguments: argparse.Namespace, record: RunFile) -> Any:
    from ..logs import read_log

    log = read_log(record.read(path, role), linear=model.linear, **log_options(arguments))
    check_torque_unit(log, model)
    if abs(log.dt / model.dt - 1.0) > 1e-3:
        raise InputError(
            f"{log.name} has a period of {log.dt:g} s and the model [simulation] dt = {model.dt:g} s: write the log's "
            f"period there, dt = {log.dt:g}."
        )
    record.notes.extend(log.warnings)
    return log


def _one(
    model: Any,
    logs: list[Any],
    holdout: list[Any],
    folder: pathlib.Path,
    record: RunFile,
    arguments: argparse.Namespace,
) -> None:
    from ..gap import diagnose

    record.stage("diagnose")
    with Stages("diagnose") as stages:
        found = diagnose(logs, model, holdout=holdout, progress=stages.stage)
    found = dataclasses.replace(found, provenance=_provenance(found, record))
    print(found)
    record.stage("write")
    prefix = "" if folder == record.folder else f"{folder.name}/"
    folder.mkdir(parents=True, exist_ok=True)
    write_json(folder / "diagnosis.json", found.to_dict())
    record.outputs.append(f"{prefix}diagnosis.json")
    if found.model:
        write_whole(folder / "corrected.toml", found.model)
        record.outputs.append(f"{prefix}corrected.toml")
    if not arguments.no_report:
        found.report(folder)
        record.outputs.append(f"{prefix}report.html")
    sys.stdout.flush()


def _provenance(found: Any, record: RunFile) -> dict[str, Any]:
    """The diagnosis' own, with the command as it was typed."""
    return {**found.provenance, "command": shlex.join(record.command)}
