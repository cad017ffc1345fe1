"""`python -m benchmarks improve`: gains tuned in the nominal model, by improve, and in the truth, run in the truth."""

import argparse
import csv
import json
import math
import time
from pathlib import Path
from typing import Any

from fpjax import InputError
from fpjax.output.json_object import JsonObject
from fpjax.output.runfile import versions, write_json

from ..run_command import fpjax_command
from ..withheld.identity import Identity, identities, seeds_of, spread_over
from ..withheld.progress import Progress
from .score import Row, goals, share_won, table

SETS = ("single", "wide", "pairs", "none", "outside")
SENSORS = {1: ("rate", "both", "encoder"), 2: ("rate", "both")}  # by generator: where the controller is known
PERIODS = 10_001
CHUNK = 12  # machines simulated side by side, where one more costs little; an interrupt loses at most these
RECORDED = 44  # likewise, of the logs after the first chunk: recording takes three minutes, however many there are
# Substeps in 1 ms of a run that is scored. The first generator takes 50 for logs, whose integration error must be below
# their noise. With 12 the error with the recorded gains differed by 3e-4 at most on five development machines.
SCORED = 12
VERSION = 3  # of the runs; to be raised when results of earlier ones must not be reused


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """The benchmark's words."""
    parser.add_argument("--out", type=Path, required=True, metavar="DIR", help="folder of machines and results")
    parser.add_argument("--machines", type=int, default=8, metavar="N", help="how many (default 8)")
    parser.add_argument("--half", default="development", choices=("development", "reported"))
    parser.add_argument("--seeds", type=int, default=1, metavar="N", help="seeds of the half they are drawn from")
    parser.add_argument("--skip", type=int, default=0, metavar="N", help="of the half's seeds, those before the first")
    parser.add_argument("--generator", default="both", choices=("1", "2", "both"), help="whose machines (default both)")
    parser.add_argument("--periods", type=int, default=PERIODS, help="of a log (default 10001, 10 s)")
    parser.add_argument("--no-best", action="store_true", help="do not search the gains that are best in the truth")
    parser.add_argument("--score-only", action="store_true", help="score what is finished already")


def run(arguments: argparse.Namespace) -> int:
    """Record, tune in three ways, run in the truth, score; what is finished is not done again."""
    if arguments.machines < 1 or arguments.seeds < 1:
        raise InputError(f"--machines {arguments.machines} and --seeds {arguments.seeds} must be at least 1.")
    if arguments.skip < 0:
        raise InputError(f"--skip must not be negative, got {arguments.skip}.")
    if arguments.periods < 2000:
        raise InputError(f"--periods must be at least 2000 (2 s), got {arguments.periods}.")
    wanted = cases_wanted(arguments)
    folder: Path = arguments.out
    if not arguments.score_only:
        _refuse_earlier(folder, wanted)
        for first in range(0, len(wanted), CHUNK):
            some = wanted[first : first + CHUNK]
            if any(not (folder / one.name / "made.json").exists() for one in some):
                _record(folder, wanted[first : first + (RECORDED if first else CHUNK)], arguments.periods)
            _tune(folder, some)
            if not arguments.no_best:
                _search(folder, some, arguments.periods)
            _drive(folder, some, arguments.periods)
    rows = [row for one in wanted if (row := _row(folder / one.name, one)) is not None]
    if not rows:
        raise InputError(f"{folder} holds no finished machine: leave --score-only out.")
    _tell(folder, rows, len(wanted), arguments)
    return 0


def cases_wanted(arguments: argparse.Namespace) -> list[Identity]:
    """Machines spread over generators, effects, sensors and systems.

    Those of the second generator have a rate sensor: its drives without one follow a position or derive the velocity,
    and the nominal model does not know their controller.
    """
    truths = (1, 2) if arguments.generator == "both" else (int(arguments.generator),)
    found = [
        one
        for seed in seeds_of(arguments.half, arguments.seeds, arguments.skip)
        for truth in truths
        for one in identities(seed, truth)
        if one.set in SETS and one.sensors in SENSORS[truth] and not one.recording
    ]
    return spread_over(found, arguments.machines)


def _refuse_earlier(folder: Path, wanted: list[Identity]) -> None:
    """Raise `InputError` where the folder holds machines of an earlier version of this benchmark."""
    for path in (folder / one.name / "made.json" for one in wanted):
        if path.exists() and _read(path)["version"] != VERSION:
            raise InputError(f"{folder} holds machines of an earlier version of this benchmark: give an empty folder.")


def _record(folder: Path, wanted: list[Identity], periods: int) -> None:
    missing = [one for one in wanted if not (folder / one.name / "made.json").exists()]
    if not missing:
        return
    from .machines import build, run, settled, write

    progress = Progress("record")
    drawn = settled(missing, periods)
    machines = [build(one, periods, how) for one, how in zip(missing, drawn, strict=True)]
    for true, how, record in zip(machines, drawn, run([(m, m.now) for m in machines]), strict=True):
        own = folder / true.identity.name
        write(own, true, record)
        write_json(own / "made.json", {"version": VERSION, "periods": periods, "now": true.now, "drawn": how})
    progress.end(f"{len(missing)} logs")


def _built(folder: Path, wanted: list[Identity], periods: int) -> list[Any]:
    from .machines import build

    return [build(one, periods, _read(folder / one.name / "made.json").get("drawn")) for one in wanted]


def _tune(folder: Path, wanted: list[Identity]) -> None:
    from fpjax import load_model, read_log
    from fpjax.improvement.nominal_gains import nominal_gains
    from fpjax.simulation.precision import double_precision

    progress = Progress("tune")
    for place, one in enumerate(wanted):
        own = folder / one.name
        log, path, better = own / "log.csv", own / "servo.toml", own / "improve"
        if not (own / "nominal.json").exists():
            began = time.process_time()
            with double_precision():
                model = load_model(path)
                gains = nominal_gains(read_log(log, linear=model.linear or None), model)
            write_json(own / "nominal.json", {"gains": gains, "seconds": time.process_time() - began})
        if not (better / "improve.json").exists() or (better / "run.unfinished").exists():
            began = time.process_time()
            words = ["improve", str(log), "--model", str(path), "--no-report", "--out", str(better)]
            try:
                fpjax_command(words)
            except RuntimeError as error:  # a failed case is a result
                better.mkdir(parents=True, exist_ok=True)
                write_json(better / "improve.json", {"failed": str(error)[-600:]})
            write_json(own / "cost.json", {"processor_s": time.process_time() - began})
        progress.share((place + 1) / len(wanted), one.name)
    progress.end(f"{len(wanted)} machines")


def _search(folder: Path, wanted: list[Identity], periods: int) -> None:
    """Candidates for the gains that are best in the truth."""
    missing = [one for one in wanted if not (folder / one.name / "searched.json").exists()]
    if not missing:
        return
    from .best import candidates

    progress = Progress("search in the truth")
    machines, places = _built(folder, missing, periods), [folder / one.name for one in missing]
    starts = [list(_tuned(own, true.now).values()) for true, own in zip(machines, places, strict=True)]
    for own, found in zip(places, candidates(machines, starts, 0, progress.share), strict=True):
        write_json(own / "searched.json", {"gains": found})
    progress.end(f"{len(missing)} machines")


def _tuned(own: Path, now: dict[str, float]) -> dict[str, dict[str, float]]:
    """The gains that ran, the nominal model's and improve's."""
    return {"now": now, "nominal": _read(own / "nominal.json")["gains"], "improve": _proposed(own, now)["gains"]}


def _drive(folder: Path, wanted: list[Identity], periods: int) -> None:
    """Simulate the true machines over the whole log with the recorded gains, those of the nominal model, those of
    `improve`, and the candidates of the search in the truth, of which the best counts.
    """
    from .best import costs
    from .machines import error, run, shares_of_allowed

    def is_missing(own: Path) -> bool:
        return not (own / "driven.json").exists() or ((own / "searched.json").exists() and not _best_of(own))

    missing = [one for one in wanted if is_missing(folder / one.name)]
    if not missing:
        return
    progress = Progress("drive")
    machines, places = _built(folder, missing, periods), [folder / one.name for one in missing]
    tuned = [_tuned(own, true.now) for true, own in zip(machines, places, strict=True)]
    searched = [_read(own / "searched.json")["gains"] if (own / "searched.json").exists() else [] for own in places]
    tried = [[*some.values(), *more] for some, more in zip(tuned, searched, strict=True)]
    records = iter(run([(true, one) for true, some in zip(machines, tried, strict=True) for one in some], SCORED))
    for own, true, some, names in zip(places, machines, tried, tuned, strict=True):
        rows = [next(records) for _ in some]
        if len(rows) > len(names):
            # Searched gains are compared by `costs`, with penalties; the other three by their errors alone.
            cost = costs(rows[0], rows, true.rating)
            cost[: len(names)] = [error(one) / error(rows[0]) for one in rows[: len(names)]]
            best = int(cost.argmin())
            write_json(own / "best.json", {"gains": some[best], "error": error(rows[best]), "tried": len(rows)})
        write_json(own / "driven.json", {name: error(one) for name, one in zip(names, rows, strict=False)})
        shares = [shares_of_allowed(one, rows[0], true.rating) for one in rows[: len(names)]]
        write_json(own / "allowed.json", dict(zip(names, shares, strict=True)))
    progress.end(f"{len(missing)} machines")


def _best_of(own: Path) -> JsonObject | None:
    return _read(own / "best.json") if (own / "best.json").exists() else None


def _row(own: Path, one: Identity) -> Row | None:
    """A machine's row as far as it is finished; None where it is not driven yet."""
    if not (own / "driven.json").exists():
        return None
    driven = {name: _size(value) for name, value in _read(own / "driven.json").items()}
    nominal = _read(own / "nominal.json")["gains"]
    ours = _proposed(own, _read(own / "made.json")["now"])
    best = _best_of(own)
    least = None if best is None else _size(best["error"])
    allowed = _read(own / "allowed.json") if (own / "allowed.json").exists() else {}
    return {
        "case": one.name, "generator": one.truth, "set": one.set, "sensors": one.sensors, "system": one.system,
        "effects": list(one.effects), "error_now": driven["now"], "error_nominal": driven["nominal"],
        "error_improve": driven["improve"], "error_truth": least, "decision": ours["decision"],
        "verdict": ours["verdict"], "reason": ours["reason"], "promised": ours["promised"],
        "of_allowed": {name: {key: _size(one) for key, one in some.items()} for name, some in allowed.items()},
        "told": ours["told"],
        "processor_s": _read(own / "cost.json")["processor_s"],
        "gains": {"nominal": nominal, "improve": ours["gains"], "truth": None if best is None else best["gains"]},
    }  # fmt: skip


def _size(error: float | None) -> float:
    """The error of an unstable loop, which is infinite and null in JSON."""
    return math.inf if error is None else error


def _read(path: Path) -> JsonObject:
    return json.loads(path.read_text())


def _proposed(own: Path, now: dict[str, float]) -> JsonObject:
    content = _read(own / "improve" / "improve.json")
    if "failed" in content:
        failed = {"decision": "failed", "verdict": "failed", "reason": content["failed"]}
        return {"gains": now, "promised": [None, None], "told": None, **failed}
    after = content["after"]
    promised = [after["error"]["low"], _size(after["error"]["high"])]
    if content["decision"] not in ("change", "keep"):
        promised = [None, None]
    return {
        "gains": now | after["gains"], "decision": content["decision"], "verdict": content["verdict"],
        "reason": content["reason"], "promised": promised, "told": content.get("nominal"),
    }  # fmt: skip


def _tell(folder: Path, rows: list[Row], wanted: int, arguments: argparse.Namespace) -> None:
    groups = {
        "generator": table(rows, lambda row: f"generator {row['generator']}"),
        "verdict": table(rows, lambda row: row["verdict"]),
        "effect": table(rows, lambda row: "+".join(row["effects"]) or "none"),
        "sensors": table(rows, lambda row: row["sensors"]),
        "set": table(rows, lambda row: row["set"]),
    }
    found = goals(rows)
    print(f"{len(rows)} of {wanted} machines ({arguments.half} half)\n")
    for goal, want, have, word in found:
        print(f"  {goal:<52} {want:>12}   {have:>10}   {word}")
    for name, some in groups.items():
        print(
            f"\n  by {name}: machines, share of what is possible (median), worse than nominal, intervals held, changes"
        )
        for row in some:
            won, kept = (row[key] for key in ("won, median", "intervals held"))
            print(
                f"    {row['group']:<44} {row['machines']:>3}  {'-' if won is None else f'{won:.0%}':>6}  "
                f"{row['worse by over 2 %']:>3}  {'-' if kept is None else f'{kept:.0%}':>6}  {row['changes']:>3}"
            )
    content = {
        "half": arguments.half, "machines": len(rows), "goals": found, **groups, "rows": rows, "versions": versions(),
    }  # fmt: skip
    write_json(folder / "improve.json", content)
    with (folder / "improve.csv").open("w", newline="") as file:
        names = ("case", "generator", "set", "sensors", "system", "effects", "error_now", "error_nominal",
                 "error_improve", "error_truth", "decision", "verdict", "processor_s")  # fmt: skip
        writer = csv.writer(file)
        writer.writerow([*names, "share_won", "promised_low", "promised_high"])
        for row in rows:
            writer.writerow([*(row[name] for name in names), share_won(row), *row["promised"]])
    from .picture import draw

    draw(rows, folder / "improve.png")
