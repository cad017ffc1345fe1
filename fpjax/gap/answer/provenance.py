"""Provenance: inputs, versions and date of a diagnosis, so that it can be traced and repeated."""

import contextlib
import datetime
import hashlib
from typing import Any

import jax
import numpy as np

from ...compiled.stored import description
from ...errors import InputError
from ...logs import Log
from ...model_file import Model
from ...output.json_object import JsonObject
from ...output.runfile import versions
from ..data.record import Record
from .gap_size import SEED


def provenance(
    logs: list[Log], records: list[Record], model: Model, allowed: tuple[str, ...], started: datetime.datetime
) -> JsonObject:
    """The `provenance` of `diagnosis.json` and of the report.

    Args:
        logs: the fitted ones first, then those that are withheld whole.
        records: the same logs, prepared for the fit.
        model: the nominal model.
        allowed: names of the effects that were tried; () for the whole vocabulary.
        started: when the diagnosis began, with a time zone.

    Returns:
        `command`, `arguments`, `inputs` (a list of {name, role: "fitted", "withheld" or "model", sha256, of a log:
        columns (a hash of their numbers), samples, windows_fitted, windows_withheld, and of the model: machine, its
        plant, actuator and sensor}),
        `windows` ({fitted, withheld, seconds}), `versions`, `started` (ISO 8601), `seeds`.
    """
    inputs = [_log(log, record) for log, record in zip(logs, records, strict=True)]
    windows = {side: sum(entry[f"windows_{side}"] for entry in inputs) for side in ("fitted", "withheld")}
    name = "servo.toml" if model.path is None else model.path.name
    nominal = {"name": name, "role": "model", "sha256": _model_hash(model), "machine": _machine(model)}
    return {
        "command": "fpjax.gap.diagnose",
        "arguments": {
            "log": [entry["name"] for entry in inputs if entry["role"] == "fitted"],
            "holdout": [entry["name"] for entry in inputs if entry["role"] == "withheld"],
            "effects": list(allowed) if allowed else "all",
        },
        "inputs": [*inputs, nominal],
        "windows": {**windows, "seconds": records[0].samples * records[0].dt},
        "versions": versions(),
        "started": started.isoformat(timespec="seconds"),
        "seeds": {"bootstrap": SEED},
    }


def _log(log: Log, record: Record) -> JsonObject:
    """The entry of one log in `inputs`."""
    withheld = int(record.withheld.sum())
    return {
        "name": log.name,
        "role": "withheld" if withheld == len(record.withheld) else "fitted",
        "sha256": getattr(log, "sha256", "") or columns_hash(log),
        "columns": columns_hash(log),
        "samples": len(log.time),
        "windows_fitted": len(record.withheld) - withheld,
        "windows_withheld": withheld,
    }


def columns_hash(log: Log) -> str:
    """SHA-256 of a log's columns as little-endian doubles, each after its name."""
    digest = hashlib.sha256()
    for name in ("time", "torque", "velocity", "position", "reference"):
        column = getattr(log, name, None)
        if column is not None:
            digest.update(name.encode())
            digest.update(column.astype("<f8").tobytes())
    return digest.hexdigest()


def refuse_other_log(known: JsonObject, log: Log, name: str) -> int:
    """Refuse a diagnosis of another log.

    Args:
        known: the diagnosis' `provenance`; an older one that does not say is not refused.
        log: with which the diagnosis is to be used; its further stretches are parts of it.
        name: of the diagnosis.

    Returns:
        How many of the logs that were diagnosed are others.

    Raises:
        InputError: where all of them are.
    """
    inputs = [entry for entry in known.get("inputs", ()) if isinstance(entry, dict)]
    fitted = [entry for entry in inputs if entry.get("role") == "fitted"]
    own = {columns_hash(one) for one in (log, *log.further)}
    others = [entry for entry in fitted if not _is_of(entry, log, own, alone=len(fitted) == 1)]
    if fitted and len(others) == len(fitted):
        names = ", ".join(dict.fromkeys(str(entry.get("name")) for entry in fitted))
        raise InputError(
            f"{name} belongs to {names}, not to {log.name}: give the one of this log, or none to have it diagnosed."
        )
    return len(others)


def _is_of(entry: JsonObject, log: Log, own: set[str], *, alone: bool) -> bool:
    """Whether an entry of `inputs` is of a log, by its file or its columns; where neither is known, a lone one is."""
    if log.sha256 and entry.get("sha256") == log.sha256:
        return True
    if "columns" in entry:
        return entry["columns"] in own
    return alone and not (log.sha256 and entry.get("sha256"))


def refuse_other_machine(known: JsonObject, model: Model, name: str) -> None:
    """Refuse a diagnosis that was made beside another nominal machine; its controller may be another one.

    Args:
        known: the diagnosis' `provenance`; an older one that does not say is not refused.
        model: beside which the diagnosis is to be used.
        name: of the diagnosis.

    Raises:
        InputError: where plant, actuator or sensor are others.
    """
    inputs = [entry for entry in known.get("inputs", ()) if isinstance(entry, dict)]
    found = next((entry for entry in inputs if entry.get("role") == "model"), {})
    then, now = found.get("machine"), _machine(model)
    if isinstance(then, dict) and not _same(then, now):
        here = "the model" if model.path is None else model.path.name
        raise InputError(
            f"{name} was made beside another machine than that of {here}: plant, friction, actuator or sensor differ. "
            "Give the model that was diagnosed, or diagnose again beside this one."
        )


def _machine(model: Model) -> JsonObject:
    """Plant, actuator and sensor: `form`, a hash of their types and of what no number says, and `values` in order."""
    parts: Any = (model.loop.plant, model.loop.actuator, model.loop.sensor)
    leaves, structure = jax.tree.flatten(parts)
    values: list[float] = []
    for leaf in leaves:
        with contextlib.suppress(TypeError, ValueError):  # a user's own block may hold anything
            values += np.ravel(np.asarray(leaf, float)).tolist()
    form = description(structure) or ""  # none of a user's own block
    return {"form": hashlib.sha256(form.encode()).hexdigest(), "values": values}


def _same(one: JsonObject, other: JsonObject) -> bool:
    """Whether two of `_machine` are one, to the digits that both precisions have."""
    values, others = (np.array(each.get("values", ()), float) for each in (one, other))
    alike = values.shape == others.shape and np.allclose(values, others, rtol=1e-5, atol=0.0)
    return bool(alike) and one.get("form") == other.get("form")


def _model_hash(model: Model) -> str:
    """SHA-256 of the model's file, or of its text where there is no file (any more)."""
    content = model.text.encode()
    if model.path is not None and model.path.is_file():
        content = model.path.read_bytes()
    return hashlib.sha256(content).hexdigest()
