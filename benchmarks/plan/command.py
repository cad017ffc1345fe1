"""`python -m benchmarks plan`: an ambiguous log, then a planned run against others, on withheld machines."""

import argparse
import json
from pathlib import Path
from typing import NamedTuple

import numpy as np

from fpjax import InputError
from fpjax.output.json_object import JsonObject

from ..run_command import fpjax_command
from ..withheld import first
from ..withheld.identity import split
from ..withheld.progress import Progress
from ..withheld.score import score_case
from . import machines

SURE = 0.8  # probability from which a statement counts as certain
RUNS = ("planned", "generic", "sweep")  # by the plan; a sine as usual; a sine sweep within the same limits
PURPOSE = {"planned": 4, "generic": 5, "sweep": 3}  # number that the sensor noise of each kind of run is drawn from
GOAL = 0.9  # share of machines that the planned run must decide rightly
LENGTHS = (2.0,)  # of the second run [s]; with 10 s nearly any run decides, so that nothing is compared
SHORTEST = 1.0  # shortest run that `plan` accepts [s]


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Options of the command."""
    parser.add_argument(
        "--out", type=Path, required=True, help="folder of logs, plans and results; what is there stays"
    )
    parser.add_argument("--count", type=int, default=6, metavar="N", help="machines (default 6)")
    parser.add_argument(
        "--seed", type=int, default=0, metavar="N", help="of the machines: even for development, odd to report"
    )
    parser.add_argument(
        "--lengths", type=float, nargs="+", default=LENGTHS, metavar="S",
        help="of the run that follows the first log, for all three kinds of runs (default 2)",
    )  # fmt: skip
    parser.add_argument("--seconds", type=float, default=20.0, metavar="S", help="processor time of a search")


def run(args: argparse.Namespace) -> int:
    """Simulate, diagnose, plan, simulate, diagnose, score; every finished step is kept."""
    if args.seed < 0:
        raise InputError(f"--seed must not be negative, got {args.seed}.")
    if not 1 <= args.count <= len(machines.EFFECTS):
        raise InputError(f"--count must be from 1 to {len(machines.EFFECTS)}, got {args.count}.")
    for length in args.lengths:
        if not SHORTEST <= length < float("inf"):
            raise InputError(f"--lengths must be at least {SHORTEST:g} s, the shortest run of a plan, got {length:g}.")
    asked = [_Asked(case, args.out / case.identity.name) for case in _cases(args)]
    progress = Progress("plan")
    try:
        _all(args, asked, progress)
    except KeyboardInterrupt:
        progress.end("interrupted")
        _report(args, asked)
        raise
    progress.end("")
    _report(args, asked)
    return 0


def _cases(args: argparse.Namespace) -> list[first.Case]:
    return [first.build(one) for one in machines.chosen(args.count, args.seed)]


class _Asked(NamedTuple):
    """A machine of the check and the folder of its logs, plans and diagnoses."""

    case: first.Case
    place: Path


def _all(args: argparse.Namespace, asked: list[_Asked], progress: Progress) -> None:
    """Machine by machine, so that an interrupt leaves whole machines."""
    _simulated([_Run(one, "first", machines.first_reference(one.case), 2) for one in asked])
    for turn, length in enumerate(args.lengths):
        for number, one in enumerate(asked):
            done = (turn + number / len(asked)) / len(args.lengths)
            said = f"machine {number + 1}/{len(asked)}, {length:g} s more"
            progress.share(done, f"{said}: first log")
            _diagnosed(one.place, ("first",), "why_first")
            score = _score(one.place, "why_first")
            if score is None or score["decided"]:
                continue
            progress.share(done, f"{said}: plan")
            _planned(one, length, args.seconds)
            references = {
                "planned": _table(one.place / _name("plan", length)),
                "generic": machines.generic_reference(one.case, length),
                "sweep": machines.sweep_reference(one.case, length),
            }
            _simulated([_Run(one, _name(kind, length), references[kind], PURPOSE[kind]) for kind in RUNS])
            for kind in RUNS:
                progress.share(done, f"{said}: {kind} run")
                _diagnosed(one.place, ("first", _name(kind, length)), "why_" + _name(kind, length))


def _name(kind: str, length: float) -> str:
    """The name of a folder, from kind and length of a run."""
    return f"{kind}_{length:g}s"


class _Run(NamedTuple):
    """A run of a machine: the name of its folder, its reference [rad/s] and what its noise is drawn for."""

    asked: _Asked
    name: str
    reference: np.ndarray
    purpose: int

    @property
    def place(self) -> Path:
        """Where its log is, or will be."""
        return self.asked.place / self.name


def _simulated(runs: list[_Run]) -> None:
    """Simulate the logs that are missing, all machines side by side: one machine takes as long as all."""
    missing = [one for one in runs if not (one.place / "log.csv").exists()]
    if not missing:
        return
    records = machines.run([(one.asked.case, one.reference, one.purpose) for one in missing])
    for one, record in zip(missing, records, strict=True):
        one.place.mkdir(parents=True, exist_ok=True)
        label = one.asked.place / "label.json"
        if not label.exists():
            label.write_text(json.dumps(machines.label_of(one.asked.case, record), indent=1) + "\n")
        machines.write(one.place, one.asked.case, record)


def _finished(folder: Path) -> bool:
    """Whether a command of the package ended there: an interrupted one leaves its run.json too."""
    file = folder / "run.json"
    return file.exists() and json.loads(file.read_text())["status"] == "completed"


def _diagnosed(place: Path, logs: tuple[str, ...], out: str) -> None:
    if _finished(place / out):
        return
    words = [str(place / name / "log.csv") for name in logs]
    model = str(place / "first" / "servo.toml")
    fpjax_command(["diagnose", *words, "--model", model, "--out", str(place / out), "--no-report"])


def _planned(one: _Asked, length: float, seconds: float) -> None:
    """Plan a run to separate the rivals of the first diagnosis; where it left none, one that shows every effect."""
    place = one.place / _name("plan", length)
    if _finished(place):
        return
    words = ["plan", "--model", str(one.place / "first" / "servo.toml"), "--out", str(place)]
    for name, value in machines.limits_of(one.case, length).items():
        words += [f"--{name}", f"{value:.6g}"]
    words += ["--seconds", f"{seconds:g}"]
    try:
        fpjax_command([*words, "--diagnosis", str(one.place / "why_first")])
    except RuntimeError as error:
        if "rivals" not in str(error):
            raise
        fpjax_command(words)


def _table(plan: Path) -> np.ndarray:
    return np.loadtxt(plan / "reference.csv", delimiter=",", skiprows=1)[:, 1]


def _score(place: Path, why: str) -> JsonObject | None:
    """The score of a diagnosis; None where there is none yet."""
    if not _finished(place / why):
        return None
    diagnosis = json.loads((place / why / "diagnosis.json").read_text())
    score = score_case(diagnosis, json.loads((place / "label.json").read_text()), None, True)
    sure = (score.probability or 0.0) >= SURE and score.verdict in ("explained", "partly_explained")
    return {
        "verdict": score.verdict, "first": diagnosis["ranking"][0]["effect"], "probability": score.probability,
        "right": bool(score.name), "decided": bool(score.name) and sure, "wrongly_sure": bool(score.wrongly_sure),
    }  # fmt: skip


def _report(args: argparse.Namespace, asked: list[_Asked]) -> None:
    """Print the finished machines, and write them to plan_check.json."""
    rows, curve = list[JsonObject](), list[JsonObject]()
    for one in asked:
        score = _score(one.place, "why_first")
        if score is not None:
            rows.append({"effect": one.case.identity.effects[0], "system": one.case.identity.system, "first": score})
    ambiguous = sum(not row["first"]["decided"] for row in rows)
    print(
        f"{len(rows)} of {len(asked)} machines, {split(args.seed)} seed {args.seed}; "
        f"{len(rows) - ambiguous} were decided by their first log of {machines.FIRST:g} s"
    )
    for row in rows:
        print(f"  {row['effect']:<28}{row['system']:<9}{_told(row['first'])}")
    for length in args.lengths:
        pairs = [(one, _runs_of(one, length)) for one in asked]
        whole = [(one, found) for one, found in pairs if found is not None]
        if not whole:
            continue
        print(f"\nafter the first log and {length:g} s more\n  {'effect':<28}", *(f"{kind:<33}" for kind in RUNS))
        for one, found in whole:
            told = " ".join(f"{_told(found[kind]):<33}" for kind in RUNS)
            print(f"  {one.case.identity.effects[0]:<28} {told}".rstrip())
        row: JsonObject = {"length": length, "machines": len(whole)}
        for kind in RUNS:
            scores = [found[kind] for _, found in whole]
            row[kind] = {name: sum(one[name] for one in scores) for name in ("right", "decided", "wrongly_sure")}
        row["rows"] = [{"effect": one.case.identity.effects[0], **found} for one, found in whole]
        curve.append(row)
    print(f"\nright cause first and sure (probability {SURE:g}); goal after the planned run {GOAL:.0%}")
    print(f"  {'length':<10}{'of':>4}" + "".join(f"{kind:>10}" for kind in RUNS) + "    wrongly sure, likewise")
    for row in curve:
        right = "".join(f"{row[kind]['decided']:>10}" for kind in RUNS)
        wrong = " ".join(str(row[kind]["wrongly_sure"]) for kind in RUNS)
        print(f"  {row['length']:<4g} s    {row['machines']:>4}{right}    {wrong}")
    content = {"seed": args.seed, "sure": SURE, "first": rows, "ambiguous": ambiguous, "curve": curve}
    (args.out / "plan_check.json").write_text(json.dumps(content, indent=1) + "\n")


def _runs_of(one: _Asked, length: float) -> JsonObject | None:
    """Scores after each kind of run of a length and what was expected of them; None where one is not there yet."""
    scores = {kind: _score(one.place, "why_" + _name(kind, length)) for kind in RUNS}
    if any(score is None for score in scores.values()):
        return None
    plan = json.loads((one.place / _name("plan", length) / "plan.json").read_text())
    return scores | {"aim": plan["aim"], "rivals": plan["rivals"], "worst_nats": plan["worst_nats"]}


def _told(score: JsonObject) -> str:
    probability = 0.0 if score["probability"] is None else score["probability"]
    mark = "+" if score["decided"] else "-"
    return f"{mark} {score['first']} {probability:.2f}"
