"""`python -m benchmarks plan`: an ambiguous log, then a planned run against others, on withheld machines."""

import argparse
import json
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from fpjax.errors import InputError

from ..run_command import fpjax_command
from ..withheld import first
from ..withheld.progress import Progress
from ..withheld.score import score_case
from . import machines

SURE = 0.8  # probability from which on a statement counts as sure
RUNS = ("planned", "generic", "sweep")  # by the plan, by habit, and a sine sweep within the same limits
GOAL = 0.9


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Options of the command."""
    parser.add_argument(
        "--out", type=Path, required=True, help="folder of logs, plans and results; what is there stays"
    )
    parser.add_argument("--count", type=int, default=6, metavar="N", help="machines (default 6)")
    parser.add_argument("--seed", type=int, default=0, metavar="N", help="of the machines: even, of development")
    parser.add_argument("--seconds", type=float, default=45.0, metavar="S", help="processor time of a design")


def run(args: argparse.Namespace) -> int:
    """Simulate, diagnose, plan, simulate, diagnose, score; every finished step is kept."""
    if args.seed < 0 or args.seed % 2:
        raise InputError(f"--seed must be even (development), got {args.seed}.")
    if not 1 <= args.count <= len(machines.EFFECTS):
        raise InputError(f"--count must be from 1 to {len(machines.EFFECTS)}, got {args.count}.")
    cases = [first.build(one) for one in machines.chosen(args.count, args.seed)]
    places = [args.out / case.identity.name for case in cases]
    progress = Progress("plan")
    both = list(zip(cases, places, strict=True))
    _simulated([_Run(case, place, "first", machines.first_reference(case), 2) for case, place in both])
    for number, (case, place) in enumerate(both):
        progress.share(0.4 * number / len(cases), f"first log {number + 1}/{len(cases)}")
        _diagnosed(place, ("first",), "why_first")
        _planned(case, place, args.seconds)
    open_ones = [i for i, place in enumerate(places) if not _score(place, "why_first")["decided"]]
    there = [places[i] for i in open_ones]
    _simulated(
        [_Run(cases[i], places[i], "planned", _table(places[i]), 4) for i in open_ones]
        + [_Run(cases[i], places[i], "generic", machines.generic_reference(cases[i]), 5) for i in open_ones]
        + [_Run(cases[i], places[i], "sweep", machines.sweep_reference(cases[i]), 3) for i in open_ones]
    )
    for number, place in enumerate(there):
        for kind in RUNS:
            progress.share(0.4 + 0.6 * number / len(there), f"{kind} run {number + 1}/{len(there)}")
            _diagnosed(place, ("first", kind), f"why_{kind}")
    progress.end("")
    _report(args, cases, places, open_ones)
    return 0


class _Run(NamedTuple):
    """A run of a machine: the folder of its log, its reference [rad/s] and what its noise is drawn for."""

    case: first.Case
    place: Path
    name: str
    reference: np.ndarray
    purpose: int


def _simulated(runs: list[_Run]) -> None:
    """The logs that are not there yet, all machines side by side: one by one they take as long each."""
    missing = [one for one in runs if not (one.place / one.name / "log.csv").exists()]
    if not missing:
        return
    records = machines.run([(one.case, one.reference, one.purpose) for one in missing])
    for one, record in zip(missing, records, strict=True):
        (one.place / one.name).mkdir(parents=True, exist_ok=True)
        label = one.place / "label.json"
        if not label.exists():
            label.write_text(json.dumps(machines.label_of(one.case, record), indent=1) + "\n")
        machines.write(one.place / one.name, one.case, record)


def _diagnosed(place: Path, logs: tuple[str, ...], out: str) -> None:
    if (place / out / "run.json").exists():
        return
    words = [str(place / name / "log.csv") for name in logs]
    model = str(place / "first" / "servo.toml")
    fpjax_command(["diagnose", *words, "--model", model, "--out", str(place / out), "--no-report"])


def _planned(case: first.Case, place: Path, seconds: float) -> None:
    """From the rivals of the first diagnosis; where it left none, a run that shows every effect."""
    if (place / "plan" / "run.json").exists():
        return
    words = ["plan", "--model", str(place / "first" / "servo.toml"), "--out", str(place / "plan")]
    for name, value in machines.limits_of(case).items():
        words += [f"--{name}", f"{value:.6g}"]
    words += ["--seconds", f"{seconds:g}"]
    try:
        fpjax_command([*words, "--diagnosis", str(place / "why_first")])
    except RuntimeError as error:
        if "rivals" not in str(error):
            raise
        fpjax_command(words)


def _table(place: Path) -> np.ndarray:
    return np.loadtxt(place / "plan" / "reference.csv", delimiter=",", skiprows=1)[:, 1]


def _score(place: Path, why: str) -> dict[str, Any]:
    diagnosis = json.loads((place / why / "diagnosis.json").read_text())
    score = score_case(diagnosis, json.loads((place / "label.json").read_text()), None, True)
    sure = (score.probability or 0.0) >= SURE and score.verdict in ("explained", "partly_explained")
    return {
        "verdict": score.verdict, "first": diagnosis["ranking"][0]["effect"], "probability": score.probability,
        "right": bool(score.name), "decided": bool(score.name) and sure, "wrongly_sure": bool(score.wrongly_sure),
    }  # fmt: skip


def _report(args: argparse.Namespace, cases: list[first.Case], places: list[Path], open_ones: list[int]) -> None:
    rows = []
    for i, (case, place) in enumerate(zip(cases, places, strict=True)):
        row: dict[str, Any] = {"effect": case.identity.effects[0], "system": case.identity.system}
        row["first"] = _score(place, "why_first")
        if i in open_ones:
            row |= {kind: _score(place, f"why_{kind}") for kind in RUNS}
            plan = json.loads((place / "plan" / "plan.json").read_text())
            row["plan"] = {"aim": plan["aim"], "rivals": plan["rivals"], "worst_nats": plan["worst_nats"]["plan"]}
        rows.append(row)
    counts = {kind: sum(row[kind]["decided"] for row in rows if kind in row) for kind in RUNS}
    total = len(open_ones)
    print(
        f"{len(cases)} machines, development seed {args.seed}; {len(cases) - total} were decided by their first log\n"
    )
    print(f"  {'effect':<28}{'machine':<9}{'first log':<34}{'planned':<34}{'generic':<34}sweep")
    for row in rows:
        told = [_told(row.get(kind)) for kind in ("first", *RUNS)]
        print(f"  {row['effect']:<28}{row['system']:<9}" + "".join(f"{one:<34}" for one in told).rstrip())
    print()
    for kind in RUNS:
        goal = f", goal {GOAL:.0%}" if kind == "planned" else ""
        print(
            f"  right cause first and sure (probability {SURE:g}) after the {kind} run: {counts[kind]} of {total}{goal}"
        )
    content = {"seed": args.seed, "sure": SURE, "ambiguous": total, "counts": counts, "rows": rows}
    (args.out / "plan_check.json").write_text(json.dumps(content, indent=1) + "\n")


def _told(score: dict[str, Any] | None) -> str:
    if score is None:
        return ""
    probability = 0.0 if score["probability"] is None else score["probability"]
    mark = "+" if score["decided"] else "-"
    return f"{mark} {score['first']} {probability:.2f}"
