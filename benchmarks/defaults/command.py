"""`python -m benchmarks defaults`: is what tune does by default as good as the best of many starts?"""

import argparse
import math
import pathlib
import time
from typing import Any

import numpy as np

from fpjax.errors import InputError
from fpjax.output.runfile import write_json

from .machines import Drawn, draw

NEAR = 1.1  # times the best of the many starts: a default result up to here reaches it
GOAL = 0.95  # of the machines
ACCURATE = 0.03  # of the true value


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """The benchmark's words."""
    parser.add_argument("--out", type=pathlib.Path, required=True, metavar="DIR", help="folder for defaults.json")
    parser.add_argument("--machines", type=int, default=60, metavar="N", help="how many (default 60)")
    parser.add_argument("--starts", type=int, default=64, metavar="N", help="starts compared with (default 64)")
    parser.add_argument("--seed", type=int, default=0, help="of the machines (default 0)")


def run(arguments: argparse.Namespace) -> int:
    """Tune every machine by default and from many starts; print and write what came of it."""
    if arguments.machines < 1 or arguments.starts < 1:
        raise InputError(f"--machines {arguments.machines} and --starts {arguments.starts} must be at least 1.")
    import jax

    jax.config.update("jax_enable_x64", True)
    rows = []
    for number in range(arguments.machines):
        row = judge(draw(number, arguments.seed), arguments.starts)
        rows.append(row)
        print(
            f"{row['name']}: default {row['cost']:.4g}, best of {arguments.starts} {row['best']:.4g}, "
            f"{'reached' if row['reached'] else 'MISSED'}, {row['estimates']}, {row['cpu_s']:.0f} s",
            flush=True,
        )
    told = summary(rows, arguments)
    arguments.out.mkdir(parents=True, exist_ok=True)
    write_json(arguments.out / "defaults.json", {"summary": told, "machines": rows, "jax": jax.__version__})
    for name, value in told.items():
        print(f"{name}: {value}")
    return 0


def judge(machine: Drawn, starts: int) -> dict[str, Any]:
    """One machine: its default tuning, the best of many starts around its gains, and the tuned estimates."""
    import dataclasses

    import fpjax as fp
    import tuning

    model = fp.load_model(machine.text)
    begin = time.process_time()
    found = tuning.tune(model)
    cpu = time.process_time() - begin
    # The many starts span the range of the default's screen and more: 10^(+-3) around the placed gains.
    many = tuning.tune(model, starts=starts, spread=3.0)
    tuned = dataclasses.replace(model, loop=found.apply(model.loop))
    run = fp.simulate(tuned)
    truths = {"coulomb": machine.coulomb, "viscous": machine.viscous}
    off = {name: value / truths[name] - 1.0 for name, value in run.settled.items()}
    accurate = all(abs(each) <= ACCURATE for each in off.values())
    # `fpjax tune` compares the same numbers with the same limit, and says so where they are off.
    shown = ", ".join(f"{name} {100.0 * value:+.3g} %" for name, value in off.items())
    words = "within 3 %" if accurate else f"off and said: {shown}"
    return {
        "name": machine.name,
        "cost": found.cost,
        "best": many.cost,
        "reached": bool(found.cost <= NEAR * many.cost),
        "diverged": bool(found.diverged or run.diverged),
        "at_bounds": found.at_bounds,
        "silent_bound": bool(found.at_bounds) and not str(found).startswith("NOT AN OPTIMUM"),
        "accurate": accurate,
        "estimates": words,
        "off": {name: value if math.isfinite(value) else None for name, value in off.items()},
        "cpu_s": cpu,
        "gains": found.gains,
        "best_gains": many.gains,
        "text": machine.text,
    }


def summary(rows: list[dict[str, Any]], arguments: argparse.Namespace) -> dict[str, Any]:
    """The counts against their goals."""
    reached = float(np.mean([row["reached"] for row in rows]))
    verdict = "met" if reached >= GOAL else "not met"
    return {
        "machines": len(rows),
        "seed": arguments.seed,
        "reached within 10 %": f"{100.0 * reached:.0f} % (goal {100.0 * GOAL:.0f} %: {verdict})",
        "bounds in silence": sum(row["silent_bound"] for row in rows),
        "at bounds, said": sum(bool(row["at_bounds"]) for row in rows),
        "diverged": sum(row["diverged"] for row in rows),
        "estimates within 3 %": sum(row["accurate"] for row in rows),
        "processor s a default tuning, median": float(np.median([row["cpu_s"] for row in rows])),
    }
