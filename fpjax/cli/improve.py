"""`fpjax improve`: gains that follow better in nearly every machine that a log leaves possible."""

from __future__ import annotations

import argparse
import contextlib
import dataclasses
import hashlib
import json
import pathlib
import sys
from typing import TYPE_CHECKING, Any

from ..errors import InputError
from ..output.json_object import JsonObject
from ..output.progress import Stages
from ..output.runfile import RunFile, versions, write_json, write_whole
from .common import (
    add_log_options,
    add_out,
    finish,
    interruptible,
    log_options,
    read_measured,
    running_jax,
    say,
)
from .numbers import seed
from .simulate import open_model

if TYPE_CHECKING:
    from ..improvement.from_diagnosis import Known
    from ..improvement.result import Improvement
    from ..improvement.search import Found
    from ..logs import Log

EXAMPLES = """\
examples:
  fpjax improve run.csv --model servo.toml --out better
  fpjax improve run.csv --model servo.toml --free controller --free feedforward --out better
  fpjax improve run.csv --model servo.toml --free controller.kp=1:5 --out better
  fpjax improve run.csv --model servo.toml --diagnosis why --out better       after fpjax diagnose ... --out why
  fpjax simulate better/tuned.toml                                            the corrected model with the new gains
  fpjax export --c drive better/tuned.toml                                    the control law for the drive

After an interrupt the finished diagnosis and search are kept; the same command goes on from there.
"""
DIAGNOSIS, SEARCH = "diagnosed.json", "searched.json"  # written when a stage is finished, with a hash of its inputs
REFERENCE = "reference.csv"
KEPT = ("diagnosis.json", "corrected.toml", "posterior.npz")


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the command's arguments."""
    parser.epilog = EXAMPLES
    parser.add_argument("log", metavar="LOG", help="log of the machine at work, with its reference")
    parser.add_argument(
        "--model", metavar="MODEL", required=True, help="servo.toml of the nominal simulator, with its controller"
    )
    parser.add_argument(
        "--free", metavar="GAIN", action="append", default=[],
        help="gains that may change besides those of observer and feed-forward: controller, feedforward (added where "
        "there is none), or a gain by its name in the file, controller.kp, or with bounds, controller.kp=1:5",
    )  # fmt: skip
    parser.add_argument("--diagnosis", metavar="DIR", help="--out of a finished fpjax diagnose of this log and model")
    parser.add_argument(
        "--reference", choices=("log", "model"), default="log", help="reference to judge the gains on (default log)"
    )
    parser.add_argument("--seed", type=seed, default=0, help="of the drawn machines and of the search (default 0)")
    parser.add_argument("--no-report", action="store_true", help="improve.json and tuned.toml only")
    add_log_options(parser)
    add_out(parser, required=True)


def run(arguments: argparse.Namespace) -> int:
    """Improve."""
    with running_jax(arguments) as record:
        model = open_model(arguments.model, [], record)
        model.needed_controller()
        from ..improvement import improve

        record.stage("read")
        log = read_measured(arguments.log, model, arguments, record)
        folder = record.folder
        assert folder is not None
        record.seeds["machines, search"] = arguments.seed
        store = _Store(folder, record, arguments)
        arguments.kept = "nothing is finished yet; run it again"
        diagnosis = arguments.diagnosis or store.diagnosis(log)
        if diagnosis is not None and arguments.diagnosis is None:
            say(record, f"the diagnosis of {log.name} was finished before, in {folder}")
        record.stage("improve")
        with Stages("improve") as stages:
            found = interruptible(
                lambda: improve(
                    log, model, free=arguments.free, diagnosis=diagnosis, reference=arguments.reference,
                    seed=arguments.seed, progress=stages.stage, keep=store.keep, kept=store.search(),
                )
            )  # fmt: skip
        print(found)
        record.stage("write")
        _write(found, log, record, arguments)
        arguments.kept = ""
        sys.stdout.flush()
        finish(record)
    return 0


def _write(found: Improvement, log: Log, record: RunFile, arguments: argparse.Namespace) -> None:
    assert record.folder is not None
    given = arguments.diagnosis
    if given is not None and pathlib.Path(given).resolve() != record.folder.resolve():
        for name in (DIAGNOSIS, *KEPT):
            (record.folder / name).unlink(missing_ok=True)  # an earlier run's: these gains come from another diagnosis
    record.notes.extend(found.notes)
    write_json(record.path("improve.json"), found.to_dict())
    if found.model:
        write_whole(record.path("tuned.toml"), _with_reference(found.model, log, record))
    else:
        record.without("tuned.toml")
    note = record.without if arguments.no_report else record.path
    for name in ("improve.html", "improve.png"):
        note(name)
    if not arguments.no_report:
        found.report(record.folder)


def _with_reference(text: str, log: Log, record: RunFile) -> str:
    """The tuned model with a reference, so that it can be simulated: its own, or the log's in a file beside it."""
    if "[reference]" in text or log.reference is None:
        return text
    rows = "\n".join(f"{time:.9g},{value:.9g}" for time, value in zip(log.time, log.reference, strict=True))
    write_whole(record.path(REFERENCE), f"time,reference\n{rows}\n")
    duration = "" if "\nduration = " in text else f"duration = {(log.samples - 1) * log.dt:.9g}\n"
    section = f'[reference]\ntype = "recorded"\nfile = "{REFERENCE}"\n\n[simulation]\n{duration}'
    return text.replace("[simulation]\n", section, 1)


class _Store:
    """The finished stages in the folder, each with a hash of its inputs, to go on from after an interrupt."""

    def __init__(self, folder: pathlib.Path, record: RunFile, arguments: argparse.Namespace) -> None:
        self.folder, self.record, self.arguments = folder, record, arguments
        hashes = [entry["sha256"] for entry in record.inputs]
        # A reference in a file of its own, named by the model, is not part of the hash.
        self.key = _hash([hashes, log_options(arguments), versions()])
        # Of a diagnosis in another folder the contents count, not the folder: it may hold another diagnosis by now.
        given = [] if arguments.diagnosis is None else _contents(pathlib.Path(arguments.diagnosis))
        self.search_key = _hash([self.key, arguments.free, arguments.reference, arguments.seed, given])

    def diagnosis(self, log: Log) -> Known | None:
        """The finished diagnosis of the same inputs; None without one."""
        if _read(self.folder / DIAGNOSIS).get("key") != self.key:
            return None
        from ..improvement.from_diagnosis import known_in

        with contextlib.suppress(InputError):
            found = known_in(self.folder, log, finished=False)
            for name in KEPT:
                if (self.folder / name).exists():
                    self.record.path(name)
            return found
        return None

    def search(self) -> Found | None:
        """The finished search of the same inputs; None without one."""
        content = _read(self.folder / SEARCH)
        if content.get("key") != self.search_key:
            return None
        import numpy as np

        from ..improvement.search import Found

        try:
            fields = content["found"]
            return Found(**fields | {"values": np.array(fields["values"]), "history": tuple(fields["history"])})
        except (KeyError, TypeError):
            return None

    def keep(self, what: str, done: Any) -> None:
        """Write a finished stage at once; its key last, so that a crash in between leaves no valid stage."""
        if what == "diagnosis":
            (self.folder / DIAGNOSIS).unlink(missing_ok=True)
            write_json(self.record.path("diagnosis.json"), done.to_dict())
            if done.model:
                write_whole(self.record.path("corrected.toml"), done.model)
            else:
                self.record.without("corrected.toml")
            if done.posterior is None:
                self.record.without("posterior.npz")
                raise InputError("The diagnosis has no posterior to draw machines from: nothing can be improved.")
            done.posterior.save(self.record.path("posterior.npz"))
            write_json(self.folder / DIAGNOSIS, {"key": self.key})
            self.arguments.kept = f"the diagnosis is kept in {self.folder}; the same command goes on from there"
        else:
            write_json(self.folder / SEARCH, {"key": self.search_key, "found": dataclasses.asdict(done)})
            self.arguments.kept = (
                f"the diagnosis and the search are kept in {self.folder}; the same command goes on from there"
            )


def _contents(folder: pathlib.Path) -> list[str]:
    found = []
    for name in ("diagnosis.json", "posterior.npz"):
        with contextlib.suppress(OSError):  # reported where the diagnosis is read
            found.append(hashlib.sha256((folder / name).read_bytes()).hexdigest())
    return found


def _read(path: pathlib.Path) -> JsonObject:
    try:
        content = json.loads(path.read_text())
    except (OSError, ValueError):
        return {}
    return content if isinstance(content, dict) else {}


def _hash(content: Any) -> str:
    return hashlib.sha256(json.dumps(content, sort_keys=True, default=str).encode()).hexdigest()
