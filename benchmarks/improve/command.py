"""`python -m benchmarks improve`: gains tuned in the nominal model, by improve, and in the truth, run in the truth."""

import argparse
import csv
import json
import time
from pathlib import Path
from typing import Any

from fpjax.errors import InputError
from fpjax.output.runfile import versions, write_json

from ..run_command import fpjax_command
from ..withheld.identity import Identity, identities, seeds_of, spread_over
from ..withheld.progress import Progress
from .score import Row, goals, share_won, table

SETS, SENSORS = ("single", "wide", "pairs", "none", "outside"), ("rate", "both", "encoder")
PERIODS = 10_001
VERSION = 1  # of the runs: raise it when a folder of earlier ones must not be reused


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """The benchmark's words."""
    parser.add_argument("--out", type=Path, required=True, metavar="DIR", help="folder of machines and results")
    parser.add_argument("--machines", type=int, default=8, metavar="N", help="how many (default 8)")
    parser.add_argument("--half", default="development", choices=("development", "reported"))
    parser.add_argument("--seeds", type=int, default=1, metavar="N", help="seeds of the half they are drawn from")
    parser.add_argument("--periods", type=int, default=PERIODS, help="of a log (default 10001, 10 s)")
    parser.add_argument("--score-only", action="store_true", help="score what is finished already")


def run(arguments: argparse.Namespace) -> int:
    """Record, tune in three ways, run in the truth, score; what is finished is not done again."""
    if arguments.machines < 1 or arguments.seeds < 1:
        raise InputError(f"--machines {arguments.machines} and --seeds {arguments.seeds} must be at least 1.")
    if arguments.periods < 2000:
        raise InputError(f"--periods must be at least 2000 (2 s), got {arguments.periods}.")
    wanted = cases_wanted(arguments)
    folder: Path = arguments.out
    if not arguments.score_only:
        _record(folder, wanted, arguments.periods)
        _improve(folder, wanted)
        _truth(folder, wanted, arguments.periods)
    rows = [json.loads(path.read_text()) for one in wanted if (path := folder / one.name / "score.json").exists()]
    if not rows:
        raise InputError(f"{folder} holds no finished machine: leave --score-only out.")
    _tell(folder, rows, len(wanted), arguments)
    return 0


def cases_wanted(arguments: argparse.Namespace) -> list[Identity]:
    """The machines of the first generator, spread over effects, sensors and systems."""
    found = [
        one
        for seed in seeds_of(arguments.half, arguments.seeds)
        for one in identities(seed, 1)
        if one.set in SETS and one.sensors in SENSORS
    ]
    return spread_over(found, arguments.machines)


def _record(folder: Path, wanted: list[Identity], periods: int) -> None:
    missing = [one for one in wanted if not (folder / one.name / "made.json").exists()]
    if not missing:
        return
    from .machines import build, run, write

    progress = Progress("record")
    machines = [build(one, periods) for one in missing]
    for one, true, record in zip(missing, machines, run([(m, m.now) for m in machines]), strict=True):
        write(folder / one.name, true, record)
        write_json(folder / one.name / "made.json", {"version": VERSION, "periods": periods, "now": true.now})
    progress.end(f"{len(missing)} logs")


def _improve(folder: Path, wanted: list[Identity]) -> None:
    from fpjax import read_log
    from fpjax.improvement.nominal import nominal_gains
    from fpjax.model_file import load_model
    from fpjax.verbs import double_precision

    progress = Progress("tune")
    for place, one in enumerate(wanted):
        own = folder / one.name
        log, model, better = own / "log.csv", own / "servo.toml", own / "improve"
        if not (own / "nominal.json").exists():
            began = time.process_time()
            with double_precision():
                gains = nominal_gains(read_log(log), load_model(model))
            write_json(own / "nominal.json", {"gains": gains, "seconds": time.process_time() - began})
        if not (better / "improve.json").exists() or (better / "run.unfinished").exists():
            began = time.process_time()
            words = ["improve", str(log), "--model", str(model), "--no-report", "--out", str(better)]
            try:
                fpjax_command(words)
            except RuntimeError as error:  # a failed case is a result
                better.mkdir(parents=True, exist_ok=True)
                write_json(better / "improve.json", {"failed": str(error)[-600:]})
            write_json(own / "cost.json", {"processor_s": time.process_time() - began})
        progress.share((place + 1) / len(wanted), one.name)
    progress.end(f"{len(wanted)} machines")


def _truth(folder: Path, wanted: list[Identity], periods: int) -> None:
    missing = [one for one in wanted if not (folder / one.name / "score.json").exists()]
    if not missing:
        return
    from .best import best_gains
    from .machines import build, error, run

    progress = Progress("truth")
    machines = [build(one, periods) for one in missing]
    ours = [_proposed(folder / one.name, true.now) for one, true in zip(missing, machines, strict=True)]
    nominal = [json.loads((folder / one.name / "nominal.json").read_text())["gains"] for one in missing]
    starts = [[true.now, a, b["gains"]] for true, a, b in zip(machines, nominal, ours, strict=True)]
    best = best_gains(machines, starts, 0, lambda share: progress.share(0.9 * share))
    four = [
        (true, gains)
        for true, a, b, c in zip(machines, nominal, ours, best, strict=True)
        for gains in (true.now, a, b["gains"], c)
    ]
    errors = iter([error(record) for record in run(four)])
    for one, a, b, c in zip(missing, nominal, ours, best, strict=True):
        now, of_nominal, of_ours, of_best = (next(errors) for _ in range(4))
        row = {
            "case": one.name, "set": one.set, "sensors": one.sensors, "system": one.system, "effects": one.effects,
            "error_now": now, "error_nominal": of_nominal, "error_improve": of_ours,
            # The search in the truth saw a part of the log: what it has seen and did not choose counts too.
            "error_truth": min(now, of_nominal, of_ours, of_best),
            "decision": b["decision"], "verdict": b["verdict"], "reason": b["reason"], "promised": b["promised"],
            "gains": {"nominal": a, "improve": b["gains"], "truth": c},
        }  # fmt: skip
        write_json(folder / one.name / "score.json", row)
    progress.end(f"{len(missing)} machines")


def _proposed(own: Path, now: dict[str, float]) -> dict[str, Any]:
    content = json.loads((own / "improve" / "improve.json").read_text())
    if "failed" in content:
        failed = {"decision": "failed", "verdict": "failed", "reason": content["failed"]}
        return {"gains": now, "promised": [None, None], **failed}
    after = content["after"]
    promised = [after["error"]["low"], after["error"]["high"]]
    if content["decision"] not in ("change", "keep"):
        promised = [None, None]
    return {
        "gains": now | after["gains"], "decision": content["decision"], "verdict": content["verdict"],
        "reason": content["reason"], "promised": promised,
    }  # fmt: skip


def _tell(folder: Path, rows: list[Row], wanted: int, arguments: argparse.Namespace) -> None:
    groups = {
        "effect": table(rows, lambda row: "+".join(row["effects"]) or "none"),
        "sensors": table(rows, lambda row: row["sensors"]),
        "set": table(rows, lambda row: row["set"]),
    }
    found = goals(rows)
    print(f"{len(rows)} of {wanted} machines ({arguments.half} half, first generator)\n")
    for goal, want, have, word in found:
        print(f"  {goal:<52} {want:>12}   {have:>10}   {word}")
    for name, some in groups.items():
        print(
            f"\n  by {name}: machines, share of what is possible (median), worse than nominal, promises held, changes"
        )
        for row in some:
            won, kept = (row[key] for key in ("won, median", "promises held"))
            print(
                f"    {row['group']:<44} {row['machines']:>3}  {'-' if won is None else f'{won:.0%}':>6}  "
                f"{row['worse by over 2 %']:>3}  {'-' if kept is None else f'{kept:.0%}':>6}  {row['changes']:>3}"
            )
    content = {
        "half": arguments.half, "machines": len(rows), "goals": found, **groups, "rows": rows, "versions": versions(),
    }  # fmt: skip
    write_json(folder / "improve.json", content)
    with (folder / "improve.csv").open("w", newline="") as file:
        names = ("case", "set", "sensors", "system", "effects", "error_now", "error_nominal", "error_improve",
                 "error_truth", "decision", "verdict")  # fmt: skip
        writer = csv.writer(file)
        writer.writerow([*names, "share_won", "promised_low", "promised_high"])
        for row in rows:
            writer.writerow([*(row[name] for name in names), share_won(row), *row["promised"]])
    from .picture import draw

    draw(rows, folder / "improve.png")
