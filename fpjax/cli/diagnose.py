"""`fpjax diagnose`: where simulation and log differ, which effect causes it, how far the gap shrinks."""

import argparse
import dataclasses
import hashlib
import json
import pathlib
import shlex
import sys
from typing import TYPE_CHECKING

from ..errors import InputError
from ..output.folder_names import folder_names
from ..output.json_object import JsonObject
from ..output.progress import Stages, drawing
from ..output.runfile import FINISHED, RunFile, versions, write_json, write_whole
from ..output.work_done import part_of
from .common import (
    add_log_options,
    add_out,
    busy,
    finish,
    interruptible,
    log_options,
    read_measured,
    running_jax,
    say,
)
from .simulate import open_model

if TYPE_CHECKING:
    from ..gap.diagnosis import Diagnosis
    from ..logs import Log
    from ..model_file import Model

REPORT = 4.0  # time to draw the report, relative to the start-up of the command
EXAMPLES = """\
examples:
  fpjax diagnose run.csv --model servo.toml --out why
  fpjax diagnose monday.csv tuesday.csv --model servo.toml --holdout friday.csv --out why    runs of one machine
  fpjax diagnose a.csv b.csv --each --model servo.toml --out why                             separate machines
  fpjax simulate why/corrected.toml                       the corrected model runs, and can be tuned again
"""

DIAGNOSIS = "diagnosis.json"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the command's arguments."""
    parser.epilog = EXAMPLES
    parser.add_argument("logs", metavar="LOG", nargs="+", help="runs of one machine (with --each, of several)")
    parser.add_argument("--model", metavar="MODEL", required=True, help="servo.toml of the nominal simulator")
    parser.add_argument(
        "--holdout", metavar="LOG", nargs="+", default=[],
        help="runs that are only scored, never fitted (default: whole blocks of the logs themselves)",
    )  # fmt: skip
    parser.add_argument("--each", action="store_true", help="each log is of another machine, and gets its own folder")
    parser.add_argument(
        "--resume", action="store_true", help="with --each: skip finished logs (without, a diagnosis always resumes)"
    )
    add_log_options(parser)
    parser.add_argument("--no-report", action="store_true", help="diagnosis.json only: no report.html, no pictures")
    add_out(parser, required=True)


def run(arguments: argparse.Namespace) -> int:
    """Diagnose."""
    with running_jax(arguments) as record:
        model = open_model(arguments.model, [], record)
        record.stage("read")
        logs, refused = _read(model, record, arguments)
        holdout = [read_measured(path, model, arguments, record, role="holdout") for path in arguments.holdout]
        assert record.folder is not None
        if arguments.each:
            _each(model, logs, holdout, refused, record, arguments)
        else:
            arguments.kept = (
                f"what is fitted so far is kept in {record.folder}, and the same command goes on from there"
                f"{_earlier(record.folder)}"
            )
            _one(model, [read.log for read in logs], holdout, record.folder, record, arguments)
        arguments.kept = ""
        finish(record)
    if refused:  # after the others' results were finished: they are whole
        said = " ".join(refused.values())
        raise InputError(f"{len(refused)} of {len(arguments.logs)} logs cannot be diagnosed. {said}")
    return 0


@dataclasses.dataclass(frozen=True)
class _Read:
    """A log, its place in the command, and the SHA-256 of its file."""

    log: "Log"
    place: int
    sha256: str


def _read(model: "Model", record: RunFile, arguments: argparse.Namespace) -> tuple[list[_Read], dict[int, str]]:
    """(the logs; with `--each`, by place in the command, why others cannot be read)."""
    logs, refused = list[_Read](), dict[int, str]()
    for place, path in enumerate(arguments.logs):
        try:
            log = read_measured(path, model, arguments, record)
        except InputError as error:
            if not arguments.each or len(arguments.logs) == 1:
                raise
            refused[place] = str(error)  # the logs of other machines are none the worse for it
            say(record, refused[place])
            continue
        own = [entry["sha256"] for entry in record.inputs if entry["role"] == "log"]
        logs.append(_Read(log, place, own[-1]))
    return logs, refused


def _each(
    model: "Model",
    logs: list[_Read],
    holdout: "list[Log]",
    refused: dict[int, str],
    record: RunFile,
    arguments: argparse.Namespace,
) -> None:
    """Diagnose each log in a folder of its own; `refused` gains, by place in the command, why one cannot be.

    Raises:
        InputError: where none can be; what an earlier run left stays then.
    """
    assert record.folder is not None
    # Named by all the files, so that one which is mended later gets a folder of its own.
    folders = [record.folder / name for name in folder_names([pathlib.Path(path).name for path in arguments.logs])]
    bar, begun, done = None, 0, 0
    for index, read in enumerate(logs):
        folder, name = folders[read.place], read.log.name
        arguments.kept = (
            f"{done} of {len(folders)} logs are diagnosed in {record.folder}; add --resume to the same command to go on"
        )
        key, finished = _key(read.sha256, record, arguments), folder / FINISHED
        if arguments.resume and _is_finished(finished, key):
            say(record, f"{name} was diagnosed before, in {folder}")
            record.path(f"{folder.name}/{DIAGNOSIS}")
            done += 1
            continue
        # Logs skipped at the beginning took no time, so progress counts from the first one that is diagnosed.
        begun = index if bar is None else begun
        bar = Stages("diagnose", after=bar)
        if index:
            print()
        print(f"{name}, in {folder}:", flush=True)
        try:
            _one(model, [read.log], holdout, folder, record, arguments, bar, (index - begun, len(logs) - begun))
        except InputError as error:
            if len(folders) == 1:
                raise
            refused[read.place] = str(error) if name in str(error) else f"{name}: {error}"
            say(record, refused[read.place])
            continue
        done += 1
        write_json(finished, {"key": key, "diagnosis": _digest(finished.with_name(DIAGNOSIS))})
    if not done:
        said = " ".join(dict.fromkeys(refused.values()))  # a mistake of all is said once
        raise InputError(f"None of {len(folders)} logs can be diagnosed. {said}")
    for place in refused:
        _forget(folders[place].name, record)


def _forget(name: str, record: RunFile) -> None:
    """Take away what an earlier run left for a log of which this one has no diagnosis."""
    from ..gap.answer.files import RESULTS

    assert record.folder is not None
    (record.folder / name / FINISHED).unlink(missing_ok=True)
    for left in RESULTS:
        record.without(f"{name}/{left}")


def _key(own: str, record: RunFile, arguments: argparse.Namespace) -> str:
    """A hash of everything that one log's diagnosis depends on: log, model, holdout, options, versions."""
    shared = [entry["sha256"] for entry in record.inputs if entry["role"] != "log"]
    content = [own, shared, log_options(arguments), arguments.no_report, versions()]
    return hashlib.sha256(json.dumps(content, sort_keys=True, default=str).encode()).hexdigest()


def _earlier(folder: pathlib.Path) -> str:
    """A note on an earlier diagnosis in the folder, for the message after an interrupt."""
    return f"; {folder / DIAGNOSIS} is the earlier one" if (folder / DIAGNOSIS).exists() else ""


def _is_finished(path: pathlib.Path, key: str) -> bool:
    """Whether a log's folder holds its diagnosis, whole, from the same inputs."""
    try:
        found = json.loads(path.read_text())
        return found["key"] == key and found["diagnosis"] == _digest(path.with_name(DIAGNOSIS))
    except (OSError, ValueError, KeyError, TypeError):
        return False


def _digest(path: pathlib.Path) -> str:
    return hashlib.sha256(path.read_bytes()).hexdigest()


def _one(
    model: "Model",
    logs: "list[Log]",
    holdout: "list[Log]",
    folder: pathlib.Path,
    record: RunFile,
    arguments: argparse.Namespace,
    bar: Stages | None = None,
    part: tuple[int, int] = (0, 1),
) -> None:
    """Diagnose and write the results; `part` is (index, number) of this diagnosis among several that share the bar."""
    from ..gap import diagnose
    from ..gap.answer.files import PICTURES
    from ..gap.fit.saved_fits import NAME, SavedFits

    record.stage("diagnose")
    prefix = "" if folder == record.folder else f"{folder.name}/"
    folder.mkdir(parents=True, exist_ok=True)
    kept = SavedFits(folder / NAME)
    try:
        with bar or Stages("diagnose", tail=0.0 if arguments.no_report else drawing(REPORT)) as stages:

            def progress(stage: str, share: float) -> None:
                named = stage if part[1] == 1 else f"log {part[0] + 1} of {part[1]}, {stage}"
                stages.stage(named, part_of(share, *part))

            found = interruptible(lambda: diagnose(logs, model, holdout=holdout, progress=progress, keep=kept))
    except InputError:
        kept.discard()  # of no use: the same input would be refused again
        raise
    except KeyboardInterrupt:
        if kept.lost and not arguments.each:
            arguments.kept = f"nothing is kept, because {kept.path} could not be written ({kept.lost})"
        raise
    if kept.taken:
        say(record, f"{kept.taken} fits of the run that was interrupted are taken over")
    if kept.lost:
        say(record, f"{kept.path} could not be written ({kept.lost}): an interrupt would have kept nothing")
    found = dataclasses.replace(found, provenance=_provenance(found, record))
    # Warnings of the log reader were printed before.
    print(dataclasses.replace(found, warnings=tuple(each for each in found.warnings if each not in record.notes)))
    record.stage("write")
    write_json(record.path(f"{prefix}{DIAGNOSIS}"), found.to_dict())
    for name, text in (("corrected.toml", found.model), ("learned.toml", found.learned_model)):
        if text:
            write_whole(record.path(f"{prefix}{name}"), text)
        else:
            record.without(f"{prefix}{name}")
    if found.posterior is not None:
        found.posterior.save(record.path(f"{prefix}posterior.npz"))
    else:
        record.without(f"{prefix}posterior.npz")
    if arguments.no_report:
        for name in ("report.html", *PICTURES):
            record.without(f"{prefix}{name}")
    else:
        record.path(f"{prefix}report.html")
        with busy("diagnose", "drawing the report"):
            found.report(folder)
        for name in PICTURES:
            if (folder / name).is_file():
                record.path(f"{prefix}{name}")
    kept.discard()
    sys.stdout.flush()


def _provenance(found: "Diagnosis", record: RunFile) -> JsonObject:
    """The provenance of the diagnosis, with the command as it was typed."""
    return {**found.provenance, "command": shlex.join(record.command)}
