"""Runs the diagnosis on each case, keeps what it said, and scores it."""

import dataclasses
import json
import sys
import time
import traceback
import warnings
from pathlib import Path
from typing import Any

from .cases import Identity
from .progress import Progress
from .report import print_report, write_pictures
from .score import CaseScore, score_case
from .summary import summarise


def result_folder(folder: Path, case: str, encoder_only: bool = False) -> Path:
    """Where a case's diagnosis is kept."""
    return folder / ("results_encoder_only" if encoder_only else "results") / case


def diagnose_all(folder: Path, wanted: list[Identity], encoder_only: bool = False) -> None:
    """Diagnose the cases that have no `diagnosis.json` yet; a failed one is tried again."""
    from fpjax import read_log
    from fpjax.gap import diagnose

    places = {one.name: result_folder(folder, one.name, encoder_only) for one in wanted}
    missing = [one for one in wanted if not (places[one.name] / "diagnosis.json").exists()]
    progress = Progress("diagnosis")
    warm: set[bool] = set()
    for number, identity in enumerate(missing):
        log = folder / "logs" / identity.name
        place = places[identity.name]
        place.mkdir(parents=True, exist_ok=True)
        # the first log with and the first without a position compile: their times are kept apart
        kind = "position" in (log / "log.csv").open().readline()
        start = time.perf_counter()
        try:
            with warnings.catch_warnings():
                warnings.simplefilter("ignore")
                read: Any = log / "log.csv"
                if encoder_only:
                    read = dataclasses.replace(read_log(read), velocity=None)
                answer = diagnose(read, model=log / "servo.toml").to_dict()
        except Exception:
            # one log that breaks the tool is a miss to be counted, not the end of the benchmark
            (place / "error.txt").write_text(traceback.format_exc())
            print(f"{identity.name}: failed, see {place / 'error.txt'}", file=sys.stderr)
            continue
        finally:
            progress.share((number + 1) / len(missing), f"{number + 1}/{len(missing)}")
        run = {"seconds": time.perf_counter() - start, "warm": kind in warm}
        warm.add(kind)
        (place / "error.txt").unlink(missing_ok=True)
        (place / "run.json").write_text(json.dumps(run) + "\n")
        # written last and renamed: an interrupted run leaves no half answer
        partial = place / "diagnosis.json.part"
        partial.write_text(json.dumps(answer, indent=1) + "\n")
        partial.rename(place / "diagnosis.json")
    progress.end(f"{len(missing)} logs diagnosed, {len(wanted) - len(missing)} reused")


def read_scores(folder: Path, labels: list[dict[str, Any]], encoder_only: bool = False) -> list[CaseScore]:
    """Score every case from what is on disk; a case without an answer has failed."""
    scores = []
    for label in labels:
        place = result_folder(folder, label["case"], encoder_only)
        diagnosis, run = None, {}
        if (place / "diagnosis.json").exists():
            diagnosis = json.loads((place / "diagnosis.json").read_text())
            if (place / "run.json").exists():
                run = json.loads((place / "run.json").read_text())
        scores.append(score_case(diagnosis, label, run.get("seconds"), run.get("warm", True)))
    return scores


def versions() -> dict[str, str]:
    """Versions that a figure depends on."""
    import platform
    from importlib.metadata import PackageNotFoundError, version

    found = {"python": platform.python_version()}
    for name in ("fpjax", "jax", "numpy"):
        try:
            found[name] = version(name)
        except PackageNotFoundError:
            found[name] = "from the source tree"
    return found


def score_all(folder: Path, labels: list[dict[str, Any]], arguments: dict[str, Any]) -> None:
    """Print the tables, write `withheld.json` and the pictures."""
    encoder_only = bool(arguments.get("encoder_only"))
    scores = read_scores(folder, labels, encoder_only)
    summary = summarise(scores)
    summary["provenance"] = {
        "arguments": {name: str(value) for name, value in arguments.items()},
        "seeds": sorted({label["seed"] for label in labels}),
        "truth_version": sorted({label["version"] for label in labels}),
        "versions": versions(),
    }
    folder = folder / "encoder_only" if encoder_only else folder
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "withheld.json").write_text(json.dumps(summary, indent=1) + "\n")
    print_report(summary)
    write_pictures(folder, summary)
    print(f"\nwritten: {folder / 'withheld.json'}, confusion.png, calibration.png, parameters.png")
