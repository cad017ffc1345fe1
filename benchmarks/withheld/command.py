"""`python -m benchmarks withheld`: simulated logs with a hidden effect, diagnosed and scored."""

import argparse
from pathlib import Path
from typing import Any

from fpjax.errors import InputError

from .cases import SETS, generate, identities, read_labels, seeds_of
from .progress import Progress
from .truth.systems import KINDS


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Options of the command."""
    parser.add_argument("--out", type=Path, required=True, help="folder of logs and results")
    parser.add_argument("--seeds", type=int, default=1, help="seeds of the half (default 1)")
    parser.add_argument("--skip", type=int, default=0, help="first seeds of the half to leave out, once looked at")
    parser.add_argument("--sets", default=",".join(SETS), help="sets of cases, by commas")
    parser.add_argument("--half", default="reported", choices=("development", "reported"))
    parser.add_argument("--systems", default=",".join(KINDS), help="machines, by commas")
    parser.add_argument("--limit", type=int, help="only so many cases, spread over the sets")
    parser.add_argument("--truth-only", action="store_true", help="write the logs, no diagnosis")
    parser.add_argument("--score-only", action="store_true", help="score what is there already")
    parser.add_argument(
        "--encoder-only",
        action="store_true",
        help="logs with a position only, without their velocity column, and effects that are not of the rate sensor",
    )
    parser.add_argument("--real", type=Path, metavar="DIR", help="the EMPS logs' folder: check these")


def on_rate_sensor(label: dict[str, Any]) -> bool:
    """Whether an effect of the case is one of a sensor that an encoder-only log has not."""
    return any(name.startswith("velocity_") for name in label["effects"])


def chosen(text: str, known: tuple[str, ...], option: str) -> tuple[str, ...]:
    """Words of a comma-separated option."""
    words = tuple(word.strip() for word in text.split(",") if word.strip())
    for word in words:
        if word not in known:
            raise InputError(f"{option}: {word!r} is not one of {', '.join(known)}")
    if not words:
        raise InputError(f"{option} is empty; give some of {', '.join(known)}")
    return words


def run(args: argparse.Namespace) -> int:
    """Generate what is missing, diagnose what is missing, score everything."""
    if args.real is not None:
        from .real import run_real

        return run_real(args.real, args.out)
    if args.seeds < 1:
        raise InputError(f"--seeds {args.seeds}: give at least 1")
    if args.skip < 0:
        raise InputError(f"--skip {args.skip}: give 0 or more")
    sets = chosen(args.sets, SETS, "--sets")
    systems = chosen(args.systems, tuple(KINDS), "--systems")
    wanted = [one for seed in seeds_of(args.half, args.seeds, args.skip) for one in identities(seed, sets, systems)]
    if args.limit is not None:
        if args.limit < 1:
            raise InputError(f"--limit {args.limit}: give at least 1")
        # every k-th, so that a small sample still meets every set and machine
        step = max(1, len(wanted) // args.limit)
        wanted = wanted[::step][: args.limit]
    progress = Progress("truth")
    made = generate(args.out, wanted, progress.share)
    progress.end(f"{made} logs written, {len(wanted) - made} reused")
    if args.truth_only:
        return 0
    from .judge import diagnose_all, score_all

    labels = read_labels(args.out, wanted)
    if args.encoder_only:
        labels = [label for label in labels if label["with_position"] and not on_rate_sensor(label)]
        kept = {label["case"] for label in labels}
        wanted = [one for one in wanted if one.name in kept]
    if not args.score_only:
        diagnose_all(args.out, wanted, args.encoder_only)
    score_all(args.out, labels, vars(args))
    return 0
