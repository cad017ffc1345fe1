"""`python -m benchmarks compare`: every way to tune, at the same objective, start and budget."""

import argparse
import contextlib
import sys
from pathlib import Path

from fpjax import InputError
from fpjax.output.json_object import JsonObject

from ..resume import read_cost, unfinished


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Options of the command."""
    parser.add_argument("--out", type=Path, required=True, help="folder for compare.json and the pictures")
    parser.add_argument("--quick", action="store_true", help="EFP alone, short runs, a small budget: a smoke test")
    parser.add_argument("--budget", type=int, help="simulations of each method and reference (default 160)")
    parser.add_argument("--resume", action="store_true", help="go on in --out with what an interrupted run left there")
    parser.add_argument("--points", type=int, help="points of the dense sweep along each axis (default 48)")


def run(args: argparse.Namespace) -> int:
    """Race all methods, print the table and the goals; everything is written after every observer and objective."""
    import jax

    from fpjax.output.progress import Stages
    from fpjax.output.runfile import RunFile, open_folder, write_json

    from .cases import all_cases, references
    from .goals import goals
    from .picture import draw
    from .race import Settings, race

    if args.budget is not None and args.budget < 12:
        raise InputError(f"--budget {args.budget} is too small to compare anything: give at least 12.")
    if args.points is not None and args.points < 2:
        raise InputError(f"--points {args.points} does not make a sweep: give at least 2.")
    folder = open_folder(args.out)  # fails now, not after the work, if it cannot be written
    assert folder is not None
    jax.config.update("jax_enable_x64", True)  # for stopping tests of 1e-3; the process is ours
    full = Settings()
    duration, points, budget = (0.1, 8, 24) if args.quick else (full.duration, full.points, full.budget)
    settings = Settings(duration=duration, points=args.points or points, budget=args.budget or budget)
    cases = all_cases()[:1] if args.quick else all_cases()
    signals = references(duration)
    if args.quick:
        signals = {name: signals[name] for name in ("sine", "chirp")}
    shown = {"dt": settings.dt, "duration": duration, "budget": settings.budget, "points": settings.points}
    shown |= {"references": list(signals), "observers": [case.name for case in cases]}
    record = RunFile(folder, ["python", "-m", "benchmarks", *sys.argv[1:]])
    if args.resume and (folder / "compare.json").exists():
        record.read(folder / "compare.json", "the rows of the interrupted run")
    rows, spent = _left(folder / "compare.json", shown) if args.resume else ([], {})
    finished = {(row["observer"], row["objective"]) for row in rows}
    # Shares of the bar for one observer and objective: the sweep, and 6 methods on every reference and on all jointly.
    each = 1 + 6 * (len(signals) + 1)
    expected, done = len(cases) * len(settings.objectives) * each, each * len(finished)
    bar = Stages("compare")
    bar.begin_at(done / expected)

    def share(note: str) -> None:
        nonlocal done
        done += 1
        bar.stage(note, done / expected)

    try:
        for case, objective in ((case, objective) for case in cases for objective in settings.objectives):
            if (case.name, objective) in finished:
                continue
            name = f"{case.name}_{objective}"
            record.stage(name)
            rows += race(case, objective, signals, settings, share)
            record.stage("write")
            spent[name] = record.seconds[name]
            draw(rows, case.name, objective, record.path(f"compare_{name}.png"))
            content = {
                "command": "python -m benchmarks compare" + (" --quick" if args.quick else ""),
                "settings": shown,
                "seconds": spent,
                "rows": rows,
                "goals": goals(rows),
            }
            write_json(folder / "compare.json", content)
    except KeyboardInterrupt:
        record.notes.append("interrupted: go on with --resume")
        with contextlib.suppress(InputError):
            record.write("interrupted")
        raise
    finally:
        bar.end()
    record.outputs.append("compare.json")
    record.write()
    print(_table(rows))
    if args.quick:
        print("--quick: a smoke test of one observer on short runs; it judges no goal (leave --quick out for that)")
    else:
        print(_goals(goals(rows)))
    print(f"{sum(spent.values()):.0f} s; {folder / 'compare.json'}")
    return 0


def _left(path: Path, settings: JsonObject) -> tuple[list[JsonObject], dict[str, float]]:
    """(rows, seconds) of an interrupted run.

    Raises:
        InputError: where there is none, or one with other options.
    """
    content = unfinished(path, settings, ("rows", "seconds"))
    for row in content["rows"]:
        row["history"] = [(used, read_cost(cost)) for used, cost in row["history"]]
        row["cost"] = read_cost(row["cost"])
    return content["rows"], dict(content["seconds"])


def _table(rows: list[JsonObject]) -> str:
    head = (
        f"{'observer':<12}{'objective':<11}{'reference':<10}{'method':<21}{'gain_2':>9}{'gain_1':>10}"
        f"{'cost':>11}{'simulations':>12}{'run s':>8}{'compile s':>10}"
    )
    lines = [head, "-" * len(head)]
    for row in rows:
        lines.append(
            f"{row['observer']:<12}{row['objective']:<11}{row['reference']:<10}{row['method']:<21}"
            f"{row['gains']['gain_2']:>9.4g}{row['gains']['gain_1']:>10.5g}{row['cost']:>11.4g}"
            f"{row['simulations']:>12}{row['run_seconds']:>8.2f}{row['compile_seconds']:>10.2f}"
        )
    return "\n".join(lines)


def _goals(judged: list[JsonObject]) -> str:
    """Both goals: the default method's verdicts one by one, the other methods' in one line each."""
    lines = []
    for goal in dict.fromkeys(one["goal"] for one in judged):
        of = [one for one in judged if one["goal"] == goal]
        lines.append(f"\n{goal}:")
        for method in dict.fromkeys(one["method"] for one in of):
            ours = [one for one in of if one["method"] == method]
            word = " (the default)" if ours[0]["headline"] else ""
            lines.append(f"  {method}{word}: {sum(one['met'] for one in ours)} of {len(ours)}")
        for one in (one for one in of if one["headline"]):
            where = f"{one['observer']}, {one['objective']}, {one['reference']}"
            ratio = "-" if one["ratio"] is None else f"{one['ratio']:.3g}"
            lines.append(f"    {where:<36} {ratio:>9}  " + ("met" if one["met"] else f"NOT met: {one['why_not']}"))
    return "\n".join(lines)
