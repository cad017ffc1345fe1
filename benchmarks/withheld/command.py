"""`python -m benchmarks withheld`: simulated logs with a hidden effect, diagnosed and scored."""

import argparse
from pathlib import Path

from fpjax import InputError

from .cases import PERIODS, generate, read_labels
from .identity import SENSORS, SETS, SYSTEMS, Identity, identities, seeds_of, split, spread_over
from .progress import Progress
from .renew import renew_labels

QUICK = (6, 4001)  # number of cases, and periods of their logs


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Options of the command."""
    place = parser.add_mutually_exclusive_group(required=True)
    place.add_argument("--out", type=Path, help="folder of logs and results")
    place.add_argument("--write", type=Path, metavar="DIR", help="only write the cases, one folder each, no diagnosis")
    parser.add_argument(
        "--answers", type=Path, metavar="FILE", help="with --write: the reported half's answers go there"
    )
    parser.add_argument("--truth", default="1,2", help="generators, by commas (default 1,2)")
    parser.add_argument(
        "--seeds", type=int, nargs="+", default=[1], metavar="N",
        help="one number: the first so many seeds of the half (default 1); several: these very seeds",
    )  # fmt: skip
    parser.add_argument("--seed", type=int, nargs="+", metavar="N", help="these very seeds, one or several")
    parser.add_argument("--skip", type=int, default=0, help="first seeds of the half to leave out, once looked at")
    parser.add_argument("--half", default="reported", choices=("development", "reported"))
    parser.add_argument("--sets", default=",".join(SETS), help="sets of cases, by commas")
    parser.add_argument("--sensors", default=",".join(SENSORS), help="what the logs hold, by commas")
    parser.add_argument("--systems", default=",".join(SYSTEMS), help="machines, by commas")
    parser.add_argument("--limit", type=int, help="only so many cases, spread over effects, machines, sets and sensors")
    parser.add_argument("--quick", action="store_true", help="a few short logs: shows that it runs and judges nothing")
    parser.add_argument("--minutes", type=float, help="begin no further diagnosis after so long; a later run goes on")
    parser.add_argument("--score-only", action="store_true", help="score what is there already")


def chosen(text: str, known: tuple[str, ...], option: str) -> tuple[str, ...]:
    """The words of a comma-separated option."""
    words = tuple(word.strip() for word in text.split(",") if word.strip())
    for word in words:
        if word not in known:
            raise InputError(f"{option}: {word!r} is not one of {', '.join(known)}.")
    if not words:
        raise InputError(f"{option} is empty; give some of {', '.join(known)}.")
    return words


def seeds_wanted(args: argparse.Namespace) -> list[int]:
    """The seeds that are meant."""
    if args.skip < 0:
        raise InputError(f"--skip must not be negative, got {args.skip}.")
    if args.seed is not None and (args.seeds != [1] or args.skip):
        raise InputError("--seed names the seeds themselves; drop --seeds and --skip.")
    if args.seed is None and len(args.seeds) == 1:
        if args.seeds[0] < 1:
            raise InputError(f"--seeds must be at least 1, got {args.seeds[0]}.")
        return seeds_of(args.half, args.seeds[0], args.skip)
    option, seeds = ("--seeds", args.seeds) if args.seed is None else ("--seed", args.seed)
    for seed in seeds:
        if seed < 0 or split(seed) != args.half:
            raise InputError(
                f"{option}: {seed} is not of the {args.half} half; development seeds are even, reported ones odd."
            )
    return sorted(set(seeds))


def cases_wanted(args: argparse.Namespace) -> list[Identity]:
    """The cases that the options mean."""
    truths = chosen(args.truth, ("1", "2"), "--truth")
    sets = chosen(args.sets, SETS, "--sets")
    sensors = chosen(args.sensors, SENSORS, "--sensors")
    systems = chosen(args.systems, SYSTEMS, "--systems")
    found = [
        one
        for seed in seeds_wanted(args)
        for truth in truths
        for one in identities(seed, int(truth))
        if one.set in sets and one.sensors in sensors and one.system in systems
    ]
    if not found:
        raise InputError("no case has these sets, sensors and machines together: give more of them.")
    limit = args.limit
    if limit is not None and limit < 1:
        raise InputError(f"--limit must be at least 1, got {limit}.")
    if args.minutes is not None and not args.minutes > 0:
        raise InputError(f"--minutes must be positive, got {args.minutes:g}.")
    if args.quick:
        limit = min(limit or QUICK[0], QUICK[0])
    return found if limit is None else spread_over(found, limit)


def run(args: argparse.Namespace) -> int:
    """Generate what is missing, diagnose what is missing, score everything."""
    wanted = cases_wanted(args)
    seeds = sorted({one.seed for one in wanted})
    print(f"{len(wanted)} cases of {'seed' if len(seeds) == 1 else 'seeds'} {', '.join(map(str, seeds))}")
    periods = QUICK[1] if args.quick else PERIODS
    if args.write is not None:
        from .export import write_collection

        return write_collection(args.write, wanted, args.answers, periods)
    if args.answers is not None:
        raise InputError("--answers goes with --write; with --out the answers are kept in OUT/labels.")
    folder = args.out / "quick" if args.quick else args.out
    renewed = renew_labels(folder, wanted, periods)
    if renewed:
        print(f"{renewed} labels of an earlier version made anew, their logs kept")
    progress = Progress("truth")
    made = generate(folder, wanted, progress.share, periods)
    progress.end(f"{made} logs written, {len(wanted) - made} reused")
    from .judge import diagnose_all, score_all

    if not args.score_only:
        diagnose_all(folder, wanted, minutes=args.minutes)
    score_all(folder, read_labels(folder, wanted), vars(args))
    if args.quick:
        print(f"\n--quick: {len(wanted)} logs of {periods / 1000:.0f} s. This shows that it runs; it judges nothing.")
    return 0
