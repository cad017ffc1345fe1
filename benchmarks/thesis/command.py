"""`python -m benchmarks thesis`: every printed cell as printed / obtained / verdict, and the thesis' figures."""

import argparse
import sys
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import NamedTuple

from .cells import Cell, Printed

QUICK_HELP = "check the verdicts with another solver only, not with a ten times finer step"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Options of the command."""
    parser.add_argument("--out", type=Path, required=True, help="folder of thesis.json and the figures")
    parser.add_argument("--quick", action="store_true", help=QUICK_HELP)
    parser.add_argument("--no-figures", action="store_true", help="the cells only")


def run(args: argparse.Namespace) -> int:
    """Compute every cell and its verdict, print the table, write the files, draw the figures."""
    import jax

    jax.config.update("jax_enable_x64", True)  # Algorithm 1 stops at 1e-3, and chatter amplifies rounding
    from fpjax.output.progress import Stages
    from fpjax.output.runfile import RunFile, open_folder, write_json, write_whole

    from .changing_parameters import recoveries, text
    from .presets import PRINTED
    from .table import markdown, table

    # Fails before the work if the folder cannot be written; results of an earlier run stay until this one is done.
    record = RunFile(open_folder(args.out), ["python", "-m", "benchmarks", *sys.argv[1:]])
    record.notes.append(f"printed cells with {PRINTED}; no input files, no random draws")
    record.stage("cells")
    with Stages("thesis: cells") as stages:
        cells = all_cells(quick=args.quick, progress=lambda share, name: stages.stage(name, share))
    print(table(cells))
    found = recoveries()
    print("\n" + text(found) + "\n")
    write_json(record.path("thesis.json"), [cell.row() for cell in cells])
    write_json(record.path("thesis_details.json"), [cell.details() for cell in cells])
    write_json(record.path("recoveries.json"), [one._asdict() for one in found])
    write_whole(record.path("thesis.md"), markdown(cells))
    pictures: list[str] = []
    if not args.no_figures:
        from .figures import draw_all

        record.stage("figures")
        with Stages("thesis: figures") as stages:
            pictures = [path.name for path in draw_all(args.out, lambda share, name: stages.stage(name, share))]
        record.outputs += pictures
        print(f"{len(pictures)} figures in {args.out}")
    record.write()
    took = ", ".join(f"{name} {spent:.0f} s" for name, spent in record.seconds.items())
    print(f"{args.out / 'thesis.json'} written; {took}")
    return 0


class Chapter(NamedTuple):
    """What a chapter's module gives.

    Attributes:
        printed: its cells.
        obtain: every cell with one setting.
        reasons: why cells miss, from what was obtained.
        checked: whether other settings count towards the verdict.
    """

    printed: tuple[Printed, ...]
    obtain: Callable[..., dict[str, float]]
    reasons: Callable[[Mapping[str, float]], dict[str, str]]
    checked: bool = True


def chapters() -> dict[str, Chapter]:
    """The chapters by name."""
    from . import chapter2, chapter3, chapter4, search, small_steps

    return {
        "chapter2": Chapter(chapter2.PRINTED, chapter2.obtain, chapter2.reasons),
        "chapter3": Chapter(chapter3.PRINTED, chapter3.obtain, chapter3.reasons),
        "chapter4": Chapter(chapter4.PRINTED, chapter4.obtain, chapter4.reasons),
        "search": Chapter(search.PRINTED, search.obtain, search.reasons),
        "limits": Chapter(small_steps.PRINTED, small_steps.obtain, small_steps.reasons, checked=False),
    }


def all_cells(
    *, quick: bool, names: tuple[str, ...] = (), progress: Callable[[float, str], object] | None = None
) -> list[Cell]:
    """Every cell with its verdict.

    Args:
        quick: check with another solver only.
        names: chapters; none for all.
        progress: called with the share done and what is next.
    """
    from .cells import judge
    from .presets import FINER_STEP, FINEST_STEP, OTHER_SOLVER, PRINTED

    chosen = {name: chapter for name, chapter in chapters().items() if not names or name in names}
    checks = (OTHER_SOLVER,) if quick else (OTHER_SOLVER, FINER_STEP)
    finest = FINER_STEP if quick else FINEST_STEP
    jobs = sum(1 + len(checks) if chapter.checked else 1 for chapter in chosen.values())
    done = 0
    cells = []
    for name, chapter in chosen.items():
        found = {}
        for setting in (PRINTED, *checks) if chapter.checked else (finest,):
            if progress is not None:
                progress(done / jobs, f"{name}, {setting}")
            found[setting] = chapter.obtain(setting)
            done += 1
        obtained = found.pop(PRINTED if chapter.checked else finest)
        others = {str(setting): values for setting, values in found.items()}
        cells += judge(chapter.printed, obtained, others, chapter.reasons(obtained))
    return cells
