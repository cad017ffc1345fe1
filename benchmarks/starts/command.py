"""`python -m benchmarks starts`: does a fit from the diagnosis' own starts end where one from the truth does?"""

import argparse
import math
import pathlib
import sys
import time
from collections.abc import Callable
from typing import TYPE_CHECKING

from fpjax import InputError
from fpjax.output.json_object import JsonObject

from ..resume import unfinished

if TYPE_CHECKING:
    from .machines import Drawn

NEAR = 10.0  # evidence [nats] by which a fit may be behind that from the truth and still count as the same


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """The benchmark's words."""
    parser.add_argument("--out", type=pathlib.Path, required=True, metavar="DIR", help="folder for starts.json")
    parser.add_argument("--machines", type=int, default=4, metavar="N", help="how many of each effect (default 4)")
    parser.add_argument("--seed", type=int, default=0, help="of the machines (default 0)")
    parser.add_argument("--effects", default="", metavar="NAMES", help="effects, by commas (default all)")
    parser.add_argument("--resume", action="store_true", help="go on in --out with what an interrupted run left there")


def run(arguments: argparse.Namespace) -> int:
    """Fit every machine's effect from its own starts and from the truth; print and write the results as they come."""
    if arguments.machines < 1 or arguments.seed < 0:
        raise InputError(
            f"--machines {arguments.machines} must be at least 1 and --seed {arguments.seed} not below zero."
        )
    import jax

    from fpjax.compiled.native import enable_compilation_cache
    from fpjax.output.progress import Stages
    from fpjax.output.runfile import RunFile, open_folder, versions, write_json

    from .machines import BY_NAME, draw

    effects = [name.strip() for name in arguments.effects.split(",") if name.strip()] or list(BY_NAME)
    if unknown := [name for name in effects if name not in BY_NAME]:
        raise InputError(
            f"--effects: {unknown[0]} is not one that starts are made for: choose of {', '.join(BY_NAME)}."
        )
    folder = open_folder(arguments.out)
    assert folder is not None
    jax.config.update("jax_enable_x64", True)
    enable_compilation_cache(folder / "compiled")
    settings = {"machines": arguments.machines, "seed": arguments.seed, "effects": effects}
    path = folder / "starts.json"
    record = RunFile(folder, ["python", "-m", "benchmarks", *sys.argv[1:]])
    rows: list[JsonObject] = []
    if arguments.resume:
        rows = [_read(row) for row in unfinished(path, settings, ["machines"])["machines"]]
    there = {(row["effect"], row["number"]) for row in rows}
    wanted = [(name, number) for name in effects for number in range(arguments.machines)]
    bar = Stages("starts")
    bar.begin_at(len(there) / len(wanted))
    bar.stage("compiling, then the first machine")
    try:
        for name, number in wanted:
            if (name, number) in there:
                continue
            rows.append({"effect": name, "number": number} | judge(draw(name, number, arguments.seed)))
            content = {"settings": settings, "machines": [_written(row) for row in rows], "versions": versions()}
            write_json(path, content)
            print(_line(rows[-1]), flush=True)
            bar.stage(f"{len(rows)} of {len(wanted)} machines", len(rows) / len(wanted))
    finally:
        bar.end()
    record.outputs.append("starts.json")
    record.write()
    print("\n".join(table(rows)))
    return 0


def judge(drawn: "Drawn", tick: Callable[[float], None] | None = None) -> JsonObject:
    """One machine: evidence of the fit of its effect from its own starts, behind that of the fit from the truth.

    Args:
        drawn: the machine.
        tick: called with the share of the fits that is done [1].
    """
    from fpjax.gap.fit.candidate import NOMINAL, Start
    from fpjax.gap.select.starts import alone, nominal_for
    from fpjax.gap.verb import make_search
    from fpjax.simulation.precision import double_precision

    begin = time.process_time()
    effects = (drawn.effect,)
    with double_precision():
        search = make_search([drawn.log], [], drawn.model)
        search.tick = tick or search.tick
        # Beside the numbers alone: `explore` compares what it fits with them.
        starts = [start for start in alone(search) if start.effects in ((), effects)]
        fits = search.explore(starts)
        found = max((fit for fit in fits if fit.candidate.effects == effects), key=lambda fit: fit.evidence)
        nominal = max(fit.evidence for fit in fits if not fit.candidate.effects)
        from_truth = []
        for wide in nominal_for(*effects):
            values = {n: value for n, value in drawn.values.items() if wide or n not in NOMINAL}
            candidate = search.candidate(Start(effects, wide, values))
            search.go_on([candidate], search.train, 25, white=True)
            from_truth += search.finish([candidate])
    best = max(from_truth, key=lambda fit: fit.evidence)
    own, right = found.candidate.values(), best.candidate.values()
    return {
        "behind": best.evidence - found.evidence,
        "gains": found.evidence - nominal,
        "truth": drawn.values,
        "found": {name: own[name] for name in drawn.values},
        "from_truth": {name: right[name] for name in drawn.values},
        "cpu_s": time.process_time() - begin,
    }


def table(rows: list[JsonObject]) -> list[str]:
    """Lines: of each effect how many machines were found, and how far the worst is behind."""
    lines = [f"{'effect':28} {'found':>9} {'behind: median':>15} {'worst [nats]':>13}"]
    for name in dict.fromkeys(row["effect"] for row in rows):
        behind = sorted(row["behind"] for row in rows if row["effect"] == name)
        found = sum(value <= NEAR for value in behind)
        middle = behind[len(behind) // 2]
        lines.append(f"{name:28} {f'{found} of {len(behind)}':>9} {middle:15.1f} {behind[-1]:13.1f}")
    total = sum(row["behind"] <= NEAR for row in rows)
    return [*lines, f"{'all':28} {f'{total} of {len(rows)}':>9}   (within {NEAR:g} nats of the fit from the truth)"]


def _line(row: JsonObject) -> str:
    word = "found" if row["behind"] <= NEAR else "ANOTHER END"
    return (
        f"{row['effect']:28} {row['number']:3d}  {word:11}  {row['behind']:9.1f} nats behind the fit from the truth, "
        f"{row['gains']:9.0f} before the numbers alone, {row['cpu_s']:.0f} s"
    )


def _written(row: JsonObject) -> JsonObject:
    """For JSON, which has no infinity."""
    return row | {name: row[name] if math.isfinite(row[name]) else None for name in ("behind", "gains")}


def _read(row: JsonObject) -> JsonObject:
    return row | {name: math.inf if row[name] is None else row[name] for name in ("behind", "gains")}
