"""`python -m benchmarks defaults`: is what tune does by default as good as the best of many starts?"""

import argparse
import math
import pathlib
import sys
import time

import numpy as np

from fpjax import InputError
from fpjax.output.json_object import JsonObject

from ..resume import read_cost, unfinished
from .machines import Drawn, draw

NEAR = 1.1  # a default cost of up to this times the best of the many starts has reached it
GOAL = 0.95  # share of the machines that must reach it
ACCURATE = 0.03  # relative error of an estimate that counts as accurate
SPREAD = 3.0  # decades either side of the placed gains that the many starts span; the default's own screen spans 2


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """The benchmark's words."""
    parser.add_argument("--out", type=pathlib.Path, required=True, metavar="DIR", help="folder for defaults.json")
    parser.add_argument("--machines", type=int, default=60, metavar="N", help="how many (default 60)")
    parser.add_argument("--starts", type=int, default=64, metavar="N", help="starts compared with (default 64)")
    parser.add_argument("--seed", type=int, default=0, help="of the machines (default 0)")
    parser.add_argument("--resume", action="store_true", help="go on in --out with what an interrupted run left there")


def run(arguments: argparse.Namespace) -> int:
    """Tune every machine by default and from many starts; print and write the results, machine by machine."""
    if arguments.machines < 1 or arguments.starts < 1:
        raise InputError(f"--machines {arguments.machines} and --starts {arguments.starts} must be at least 1.")
    import jax

    from fpjax.compiled.native import enable_compilation_cache
    from fpjax.output.progress import Stages
    from fpjax.output.runfile import RunFile, open_folder, versions, write_json

    from .picture import draw_defaults

    folder = open_folder(arguments.out)
    assert folder is not None
    jax.config.update("jax_enable_x64", True)
    enable_compilation_cache(folder / "compiled")  # a cache of this benchmark's own, shared by its machines
    settings = {"starts": arguments.starts, "seed": arguments.seed}
    path = folder / "defaults.json"
    record = RunFile(folder, ["python", "-m", "benchmarks", *sys.argv[1:]])
    rows = _left(path, settings) if arguments.resume else []
    there = {row["name"] for row in rows}
    # Sorted by length: machines of one length share every compiled program.
    machines = sorted(
        (draw(number, arguments.seed) for number in range(arguments.machines)), key=lambda one: (one.samples, one.name)
    )
    bar = Stages("defaults")
    bar.begin_at(len(there) / len(machines))
    bar.stage("compiling, then the first machine")
    try:
        for machine in machines:
            if machine.name in there:
                continue
            row = judge(machine, arguments.starts)
            rows.append(row)
            content = {"settings": settings, "summary": summary(rows), "machines": rows, "versions": versions()}
            write_json(path, content)
            print(_line(row), flush=True)
            bar.stage(f"{len(rows)} of {len(machines)} machines", len(rows) / len(machines))
    finally:
        bar.end()
    wanted = {machine.name for machine in machines}
    rows = [row for row in rows if row["name"] in wanted]
    draw_defaults(rows, NEAR, record.path("defaults.png"))
    record.outputs.append("defaults.json")
    record.write()
    for name, value in summary(rows).items():
        print(f"{name}: {value}")
    return 0


def judge(machine: Drawn, starts: int) -> JsonObject:
    """One machine: its default tuning, the best of many starts, and the tuned estimates under noise."""
    import dataclasses

    import jax

    import fpjax as fp
    import tuning

    model = fp.load_model(machine.text)
    begin = time.process_time()
    found = tuning.tune(model)
    cpu = time.process_time() - begin
    many = tuning.tune(model, starts=starts, spread=SPREAD)
    tuned = dataclasses.replace(model, loop=found.apply(model.loop))
    # Judged under noise, by another simulation than the tuning used: what `fpjax simulate` shows to a user.
    run = fp.simulate(tuned, key=jax.random.key(0))
    truths = {"coulomb": machine.coulomb, "viscous": machine.viscous}
    off = {name: value / truths[name] - 1.0 for name, value in run.settled.items()}
    return {
        "name": machine.name,
        "samples": machine.samples,
        "cost": found.cost,
        "best": many.cost,
        "reached": bool(found.cost <= NEAR * many.cost),
        "diverged": bool(found.diverged or run.diverged),
        "at_bounds": found.at_bounds,
        "silent_bound": bool(found.at_bounds) and not str(found).startswith("NOT AN OPTIMUM"),
        "accurate": all(abs(each) <= ACCURATE for each in off.values()),
        "said": any("off the truth" in note or "cannot converge" in note for note in found.notes),
        "off": {name: value if math.isfinite(value) else None for name, value in off.items()},
        "off_by_tune": found.settled,
        "notes": found.notes,
        "cpu_s": cpu,
        "compile_s": found.compile_seconds,
        "gains": found.gains,
        "best_gains": many.gains,
        "text": machine.text,
    }


def summary(rows: list[JsonObject]) -> JsonObject:
    """Counts and goals as text by name.

    "in silence": off by more than 3 % (or at a bound) without a note or a first line that says so.
    """
    reached = float(np.mean([row["reached"] for row in rows]))
    spent = float(np.median([row["cpu_s"] for row in rows]))
    verdict = "met" if reached >= GOAL else "not met"
    return {
        "machines": len(rows),
        "reached within 10 %": f"{100.0 * reached:.0f} % (goal {100.0 * GOAL:.0f} %: {verdict})",
        "bounds in silence": sum(row["silent_bound"] for row in rows),
        "at bounds, said": sum(bool(row["at_bounds"]) for row in rows),
        "diverged": sum(row["diverged"] for row in rows),
        "estimates within 3 %": sum(row["accurate"] for row in rows),
        "estimates off and said": sum(row["said"] and not row["accurate"] for row in rows),
        "estimates off in silence": sum(not row["said"] and not row["accurate"] for row in rows),
        "processor s a default tuning, median, programs shared": round(spent, 2),
    }


def _line(row: JsonObject) -> str:
    shown = ", ".join(
        f"{name} {'?' if value is None else f'{100.0 * value:+.2g} %'}" for name, value in row["off"].items()
    )
    word = "within 3 %" if row["accurate"] else "off and said" if row["said"] else "OFF IN SILENCE"
    bound = f", at a bound: {', '.join(row['at_bounds'])}" if row["at_bounds"] else ""
    return (
        f"{row['name']} ({row['samples']} samples): default {row['cost']:.4g}, best of many {row['best']:.4g}, "
        f"{'reached' if row['reached'] else 'MISSED'}; {shown} ({word}){bound}; {row['cpu_s']:.1f} s"
    )


def _left(path: pathlib.Path, settings: JsonObject) -> list[JsonObject]:
    """The rows of an interrupted run.

    Raises:
        InputError: where there is none, or one with other options.
    """
    rows = list(unfinished(path, settings, ("machines",))["machines"])
    for row in rows:
        row["cost"], row["best"] = read_cost(row["cost"]), read_cost(row["best"])
    return rows
