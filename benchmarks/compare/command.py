"""`python -m benchmarks compare`: every way to tune, at the same objective, start and budget."""

import argparse
import json
import math
import os
import time
from pathlib import Path
from typing import Any

from fpjax.errors import InputError


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Options of the command."""
    parser.add_argument("--out", type=Path, required=True, help="folder for compare.json and the pictures")
    parser.add_argument("--quick", action="store_true", help="EFP alone, short runs, a small budget: a smoke test")
    parser.add_argument("--budget", type=int, help="simulations of each method and reference (default 160)")
    parser.add_argument("--points", type=int, help="points of the dense sweep along each axis (default 48)")


def run(args: argparse.Namespace) -> int:
    """Race all methods, print the table and the goals, write everything."""
    import jax

    from tuning.progress import Progress

    from .cases import all_cases, references
    from .goals import goals
    from .picture import draw
    from .race import Settings, race

    if args.budget is not None and args.budget < 12:
        raise InputError(f"--budget {args.budget} is too small to compare anything: give at least 12.")
    if args.points is not None and args.points < 2:
        raise InputError(f"--points {args.points} is no sweep: give at least 2.")
    jax.config.update("jax_enable_x64", True)  # stopping tests of 1e-3 want it; a command owns its process
    try:
        args.out.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise InputError(f"--out {args.out} cannot be made ({error.strerror}): give a folder that can be.") from error
    full = Settings()
    duration, points, budget = (0.1, 8, 24) if args.quick else (full.duration, full.points, full.budget)
    settings = Settings(duration=duration, points=args.points or points, budget=args.budget or budget)
    cases = all_cases()[:1] if args.quick else all_cases()
    signals = references(duration)
    if args.quick:
        signals = {name: signals[name] for name in ("sine", "chirp")}
    begin, rows, done = time.perf_counter(), [], 0
    expected = len(cases) * len(settings.objectives) * (1 + 6 * (len(signals) + 1))
    bar = Progress("compare")

    def share(note: str) -> None:
        nonlocal done
        done += 1
        bar.show(done / expected, note)

    try:
        for case in cases:
            for objective in settings.objectives:
                rows += race(case, objective, signals, settings, share)
                draw(rows, case.name, objective, args.out / f"compare_{case.name}_{objective}.png")
    finally:
        bar.end()
    judged = goals(rows)
    content = {
        "command": "python -m benchmarks compare" + (" --quick" if args.quick else ""),
        "settings": {"dt": settings.dt, "duration": duration, "budget": settings.budget, "points": settings.points},
        "seconds": time.perf_counter() - begin,
        "rows": rows,
        "goals": judged,
    }
    partial = args.out / ".compare.json.partial"
    partial.write_text(json.dumps(_plain(content), indent=1))
    os.replace(partial, args.out / "compare.json")
    print(_table(rows))
    print(_goals(judged))
    print(f"{content['seconds']:.0f} s; {args.out / 'compare.json'}")
    return 0


def _table(rows: list[dict[str, Any]]) -> str:
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


def _goals(judged: list[dict[str, Any]]) -> str:
    lines = []
    for goal in dict.fromkeys(one["goal"] for one in judged):
        of = [one for one in judged if one["goal"] == goal]
        lines.append(f"\n{goal}: {sum(one['met'] for one in of)} of {len(of)}")
        for one in of:
            where = f"{one['observer']}, {one['objective']}, {one['reference']}"
            ratio = "-" if one["ratio"] is None else f"{one['ratio']:.3g}"
            word = "met" if one["met"] else f"NOT met: {one['why_not']}"
            lines.append(f"  {where:<36} {ratio:>9}  {one['method'] or '':<20} {word}")
    return "\n".join(lines)


def _plain(value: Any) -> Any:
    if isinstance(value, dict):
        return {key: _plain(part) for key, part in value.items()}
    if isinstance(value, (list, tuple)):
        return [_plain(part) for part in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value
