"""Labels that an earlier version wrote beside the very logs that this one makes: made anew, the logs kept."""

import json
import math
from pathlib import Path

from fpjax import InputError

from .cases import PERIODS, Label, asked_of, label_path
from .identity import Identity
from .second import cases as second
from .second import label as second_label
from .second.equivalent import EFFECTS

CHANGED = ("version", "parameters", "law")  # all else of a label, a starter's nominal say, belongs to the files


def renew_labels(folder: Path, wanted: list[Identity], periods: int = PERIODS) -> int:
    """Bring the labels of cases on disk to this version; returns how many were of an earlier one.

    A case whose label needs its true motion is simulated again. Its log and its nominal model are not touched.
    """
    again: list[tuple[Identity, Label]] = []
    renewed = 0
    for one in wanted:
        if one.truth != 2 or not label_path(folder, one).exists():
            continue
        label = json.loads(label_path(folder, one).read_text())
        if not second.SAME_LOGS <= label["version"] < second.VERSION:
            continue
        renewed += 1
        if set(EFFECTS) & set(label["parameters"]):
            again.append((one, label))
        else:
            replace_label(folder, one, label | {"version": second.VERSION, "law": {}})
    for i, (case, trace, size) in second.finished([asked_of(one) for one, _ in again], periods):
        one, label = again[i]
        fresh = second_label.label_of(case, trace, size, one.sensors, one.set)
        replace_label(folder, one, renewed_label(label, fresh))
    return renewed


def renewed_label(old: Label, fresh: Label) -> Label:
    """The old label with what this version says otherwise, once it is sure that both are of one machine."""
    law = fresh["parameters"] | fresh["law"]
    same = old["parameters"].keys() == law.keys() and all(
        given.keys() == law[effect].keys()
        and all(math.isclose(given[name]["value"], law[effect][name]["value"], rel_tol=1e-6) for name in given)
        for effect, given in old["parameters"].items()
    )
    if not same:
        raise InputError(f"{old['case']}: this generator makes another machine; delete its label, log and result.")
    return old | {name: fresh[name] for name in CHANGED}


def replace_label(folder: Path, one: Identity, label: Label) -> None:
    """Write a label over the one that is there; an interrupted run leaves one of the two."""
    path = label_path(folder, one)
    partial = path.with_suffix(".partial")
    partial.write_text(json.dumps(label, indent=1) + "\n")
    partial.replace(path)
