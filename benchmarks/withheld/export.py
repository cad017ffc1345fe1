"""`--write DIR`: cases as folders, for people who work on the diagnosis and must not read the generators."""

import json
import shutil
from pathlib import Path

from fpjax import InputError

from .cases import PERIODS, Label, generate, log_path, read_labels
from .identity import Identity
from .progress import Progress
from .renew import renew_labels

# Keys of a label that an answer holds.
ANSWER = (
    "effects", "outside", "accepted", "also_true", "parameters", "set", "sensors", "system", "truth", "seed", "linear",
    "nominal_true", "nominal_error_percent", "measured_torque", "starter", "recording",
)  # fmt: skip


def answer_of(label: Label) -> Label:
    """The answer of a case, without the form of the law and the size of the clutter."""
    return {name: label[name] for name in ANSWER if name in label}


def write_collection(folder: Path, wanted: list[Identity], answers: Path | None, periods: int = PERIODS) -> int:
    """Write NAME/log.csv and NAME/servo.toml of each case, answer.json beside those of the development half.

    Answers of the reported half go to one file elsewhere, so that nobody meets them by chance.

    Args:
        folder: of the cases.
        wanted: the cases.
        answers: file of the reported half's answers; None if there are none.
        periods: of a log.
    """
    reported = [one for one in wanted if one.seed % 2]
    if reported and answers is None:
        raise InputError(
            f"{len(reported)} of these cases are of the reported half: their answers do not go beside the logs, "
            "give a file for them with --answers FILE."
        )
    scratch = folder / ".made"
    renew_labels(scratch, wanted, periods)  # of an interrupted run
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
