"""`--write DIR`: cases as folders for whoever works on the diagnosis and is not to read the truths."""

import json
import shutil
from pathlib import Path

from fpjax.errors import InputError

from .cases import PERIODS, Label, generate, log_path, read_labels
from .identity import Identity
from .progress import Progress

TOLD = (
    "effects", "outside", "accepted", "also_true", "parameters", "set", "sensors", "system", "truth", "seed", "linear",
    "nominal_true", "nominal_error_percent", "measured_torque", "starter", "recording",
)  # fmt: skip


def answer_of(label: Label) -> Label:
    """What a development case's answer.json says: no law, no size of the clutter."""
    return {name: label[name] for name in TOLD if name in label}


def write_collection(folder: Path, wanted: list[Identity], answers: Path | None, periods: int = PERIODS) -> int:
    """NAME/log.csv and NAME/servo.toml, with answer.json for development cases, the others' in a file of their own."""
    reported = [one for one in wanted if one.seed % 2]
    if reported and answers is None:
        raise InputError(
            f"{len(reported)} of these cases are of the reported half: their answers do not go beside the logs, "
            "give a file for them with --answers FILE."
        )
    scratch = folder / ".made"
    progress = Progress("truth")
    made = generate(scratch, wanted, progress.share, periods)
    apart = {}
    for one, label in zip(wanted, read_labels(scratch, wanted), strict=True):
        place = folder / one.name
        place.mkdir(parents=True, exist_ok=True)
        for name in ("log.csv", "servo.toml"):
            shutil.copyfile(log_path(scratch, one) / name, place / name)
        if one.seed % 2:
            apart[one.name] = answer_of(label)
        else:
            (place / "answer.json").write_text(json.dumps(answer_of(label), indent=1) + "\n")
    if answers is not None:
        answers.write_text(json.dumps(apart, indent=1) + "\n")
    shutil.rmtree(scratch)
    progress.end(f"{made} cases in {folder}")
    return 0
