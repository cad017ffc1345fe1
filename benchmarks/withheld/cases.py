"""From identities to logs and labels on disk."""

import contextlib
import json
import tempfile
import tomllib
from collections.abc import Callable
from pathlib import Path

from fpjax.output.json_object import JsonObject

from ..run_command import fpjax_command
from . import first
from .identity import Identity, split
from .second import cases as second
from .second import label as second_label

PERIODS = 10_001
CHUNK = 350  # machines simulated side by side; an interrupt loses at most these
Label = JsonObject


def generate(
    folder: Path, wanted: list[Identity], progress: Callable[[float], None] | None = None, periods: int = PERIODS
) -> int:
    """Write the cases that are not on disk yet; returns how many were made."""
    missing = [one for one in wanted if not label_path(folder, one).exists()]
    missing.sort(key=lambda one: one.truth)
    done = 0
    for truth in (1, 2):
        some = [one for one in missing if one.truth == truth]
        for start in range(0, len(some), CHUNK):
            part = some[start : start + CHUNK]

            def report(share: float, before: int = done, size: int = len(part)) -> None:
                if progress is not None:
                    progress((before + share * size) / len(missing))

            (_write_first if truth == 1 else _write_second)(folder, part, periods, report)
            done += len(part)
    return len(missing)


def log_path(folder: Path, one: Identity) -> Path:
    """The folder of log.csv and servo.toml."""
    return folder / "logs" / one.name


def label_path(folder: Path, one: Identity) -> Path:
    """The label, in a folder apart from the log: nothing beside a log tells its effect."""
    return folder / "labels" / f"{one.name}.json"


def _write_first(folder: Path, part: list[Identity], periods: int, report: Callable[[float], None]) -> None:
    for identity, (case, record) in zip(part, first.run(part, periods, report), strict=True):
        first.write(log_path(folder, identity), case, record)
        _finish(folder, identity, first.label_of(case, record))


def _write_second(folder: Path, part: list[Identity], periods: int, report: Callable[[float], None]) -> None:
    asked = [asked_of(one) for one in part]
    for i, (case, trace, size) in second.finished(asked, periods, report):
        identity = part[i]
        second_label.write(log_path(folder, identity), case, trace, identity.sensors)
        label = second_label.label_of(case, trace, size, identity.sensors, identity.set)
        _finish(folder, identity, label)


def asked_of(one: Identity) -> second.Asked:
    """What a case of the second generator is drawn from: its seed and its words."""
    words = f"{one.set}/{one.sensors}/{one.number}" + (f"/{one.recording}" if one.recording else "")
    return second.Asked(one.seed, words, one.set, one.sensors, one.system, one.effects, one.recording)


def _finish(folder: Path, one: Identity, label: Label) -> None:
    """The nominal of the set "starter", then the label, last: a case with a label is complete."""
    outside = one.effects[0] if one.set == "outside" else None
    label |= {
        "case": one.name,
        "truth": one.truth,
        "seed": one.seed,
        "half": split(one.seed),
        "set": one.set,
        "group": one.group,
        "sensors": one.sensors,
        "recording": one.recording,
        "system": one.system,
        "effects": [] if outside else list(one.effects),
        "outside": outside,
    }
    if one.set == "starter":
        label["starter"] = write_starter(log_path(folder, one), label["linear"])
        if label["starter"]:
            model = tomllib.loads((log_path(folder, one) / "servo.toml").read_text())
            given = {"inertia": model["plant"]["inertia"]} | {n: model["friction"][n] for n in ("coulomb", "viscous")}
            true = label["nominal_true"]
            label["nominal_error_percent"] = {name: 100 * (given[name] / true[name] - 1) for name in true}
    path = label_path(folder, one)
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(json.dumps(label, indent=1) + "\n")


def write_starter(place: Path, linear: bool) -> bool:
    """Replace the nominal model by the one that `fpjax inspect` writes from the log; False where it writes none."""
    with tempfile.TemporaryDirectory() as scratch:
        words = ["inspect", str(place / "log.csv"), "--no-plots", "--out", scratch]
        with contextlib.suppress(RuntimeError):
            fpjax_command([*words, *(["--linear"] if linear else [])])
        made = Path(scratch) / "servo.toml"
        if not made.exists():
            return False
        (place / "servo.toml").write_text(made.read_text())
        return True


def read_labels(folder: Path, wanted: list[Identity]) -> list[Label]:
    """The labels of the cases asked for, in their order."""
    return [json.loads(label_path(folder, one).read_text()) for one in wanted]
