"""Run the command on each case, keep its `diagnosis.json`, and score that file alone."""

import json
import shutil
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path

from fpjax.output.json_object import JsonObject

from ..run_command import fpjax_command
from .cases import Label, log_path
from .identity import Identity
from .progress import Progress
from .report import print_report, write_pictures
from .score import CaseScore, Diagnosis, score_case
from .summary import summarise

Tool = Callable[[Path, Path, Path], None]


def by_command(log: Path, model: Path, out: Path) -> None:
    """`fpjax diagnose LOG --model MODEL --out OUT --no-report`."""
    fpjax_command(["diagnose", str(log), "--model", str(model), "--out", str(out), "--no-report"])


def result_folder(folder: Path, case: str) -> Path:
    """Where a case's diagnosis is kept."""
    return folder / "results" / case


def diagnose_all(folder: Path, wanted: list[Identity], tool: Tool = by_command, minutes: float | None = None) -> None:
    """Diagnose the cases that have no `diagnosis.json` yet; a failed one is tried again.

    Args:
        folder: of logs and results.
        wanted: the cases, in the order in which they are diagnosed.
        tool: leaves a `diagnosis.json`.
        minutes: after which no further case is begun; None for all.
    """
    missing = [one for one in wanted if not (result_folder(folder, one.name) / "diagnosis.json").exists()]
    progress = Progress("diagnosis")
    warm: set[str] = set()
    begun = time.monotonic()
    for number, one in enumerate(missing):
        if minutes is not None and time.monotonic() - begun > 60 * minutes:
            progress.end(f"{number} logs diagnosed in {minutes:g} min, {len(missing) - number} left for another run")
            return
        place, log = result_folder(folder, one.name), log_path(folder, one)
        place.mkdir(parents=True, exist_ok=True)
        # Written to another folder until it is complete: an interrupted run leaves no partial result.
        partial = place / "partial"
        shutil.rmtree(partial, ignore_errors=True)
        start = time.process_time()
        try:
            tool(log / "log.csv", log / "servo.toml", partial)
            json.loads((partial / "diagnosis.json").read_text())
        except (Exception, SystemExit) as error:
            # A log on which the command fails counts as a miss and does not end the benchmark.
            (place / "error.txt").write_text(f"{type(error).__name__}: {error}\n")
            print(f"{one.name}: failed, see {place / 'error.txt'}", file=sys.stderr)
            continue
        finally:
            progress.share((number + 1) / len(missing), f"{number + 1}/{len(missing)}")
        # The first log of each kind of sensors compiles programs; its time is counted separately.
        run = {"seconds": time.process_time() - start, "warm": one.sensors in warm}
        warm.add(one.sensors)
        (place / "error.txt").unlink(missing_ok=True)
        (place / "run.json").write_text(json.dumps(run) + "\n")
        (partial / "diagnosis.json").rename(place / "diagnosis.json")
        shutil.rmtree(partial, ignore_errors=True)
    progress.end(f"{len(missing)} logs diagnosed, {len(wanted) - len(missing)} reused")


def read_scores(folder: Path, labels: list[Label]) -> list[CaseScore]:
    """Score every case from what is on disk: one whose diagnosis failed is wrong, one not yet tried is left out."""
    scores = []
    for label in labels:
        place = result_folder(folder, label["case"])
        diagnosis: Diagnosis | None = None
        run: JsonObject = {}
        if (place / "diagnosis.json").exists():
            diagnosis = json.loads((place / "diagnosis.json").read_text())
            if (place / "run.json").exists():
                run = json.loads((place / "run.json").read_text())
        elif not (place / "error.txt").exists():
            continue
        scores.append(score_case(diagnosis, label, run.get("seconds"), run.get("warm", True)))
    return scores


def versions() -> dict[str, str]:
    """Versions that a figure depends on."""
    from fpjax.output.runfile import versions as all_versions

    found = all_versions()
    return {name: found[name] for name in ("python", "fpjax", "jax", "numpy")}


def commit() -> str:
    """The commit that is measured, with a + where files differ from it; "unknown" outside a checkout."""
    try:
        words = ["git", "-C", str(Path(__file__).parent), "describe", "--always", "--dirty=+", "--exclude=*"]
        return subprocess.run(words, capture_output=True, text=True, check=True).stdout.strip()
    except (OSError, subprocess.CalledProcessError):
        return "unknown"


def score_all(folder: Path, labels: list[Label], arguments: JsonObject) -> None:
    """Print the tables, write `withheld.json` and the pictures."""
    scores = read_scores(folder, labels)
    summary = summarise(scores)
    summary["provenance"] = {
        "arguments": {name: str(value) for name, value in arguments.items()},
        "seeds": sorted({label["seed"] for label in labels}),
        "truth_versions": sorted({f"truth {label['truth']}: {label['version']}" for label in labels}),
        "versions": versions(),
        "commit": commit(),
        "date": time.strftime("%Y-%m-%d", time.gmtime()),
        "cases": len(scores),
        "not_diagnosed": len(labels) - len(scores),
    }
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "withheld.json").write_text(json.dumps(summary, indent=1) + "\n")
    print_report(summary)
    if len(scores) < len(labels):
        print(f"\n{len(labels) - len(scores)} of {len(labels)} logs are not diagnosed yet and count nowhere.")
    found = ", ".join(f"{name} {number}" for name, number in versions().items())
    print(f"\n{summary['provenance']['date']}, commit {commit()}, {found}")
    write_pictures(folder, summary)
    print(f"\nwritten: {folder / 'withheld.json'}, confusion.png, calibration.png, parameters.png")
