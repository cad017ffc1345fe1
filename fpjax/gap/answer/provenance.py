"""Provenance: inputs, versions and date of a diagnosis, so that it can be traced and repeated."""

import datetime
import hashlib
from typing import Any

import jax
import numpy as np

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
        samples, windows_fitted, windows_withheld, and of the model: machine, a hash of plant, actuator and sensor}),
        `windows` ({fitted, withheld, seconds}), `versions`, `started` (ISO 8601), `seeds`.
    """
    inputs = [_log(log, record) for log, record in zip(logs, records, strict=True)]
    windows = {side: sum(entry[f"windows_{side}"] for entry in inputs) for side in ("fitted", "withheld")}
    name = "servo.toml" if model.path is None else model.path.name
    nominal = {"name": name, "role": "model", "sha256": _model_hash(model), "machine": _machine_hash(model)}
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
        "samples": len(log.time),
        "windows_fitted": len(record.withheld) - withheld,
        "windows_withheld": withheld,
    }


def columns_hash(log: Log) -> str:
    """SHA-256 of a log that is not from a file: its columns as little-endian doubles, each after its name."""
    digest = hashlib.sha256()
    for name in ("time", "torque", "velocity", "position", "reference"):
        column = getattr(log, name, None)
        if column is not None:
            digest.update(name.encode())
            digest.update(column.astype("<f8").tobytes())
    return digest.hexdigest()


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
    if found.get("machine", _machine_hash(model)) != _machine_hash(model):
        here = "the model" if model.path is None else model.path.name
        raise InputError(
            f"{name} was made with another machine than that of {here} (plant, friction, actuator or sensor of its "
            f"{found.get('name', 'model')} differ): give the model that was diagnosed, or diagnose again with this one."
        )


def _machine_hash(model: Model) -> str:
    """SHA-256 of plant, actuator and sensor: names and values, to the digits that both precisions have."""
    parts: Any = (model.loop.plant, model.loop.actuator, model.loop.sensor)
    leaves = jax.tree_util.tree_flatten_with_path(parts)[0]
    words = [type(part).__name__ for part in parts]
    for path, leaf in leaves:
        values = np.ravel(leaf)
        numeric = np.issubdtype(values.dtype, np.number)  # a user's own block may hold anything
        words.append(f"{jax.tree_util.keystr(path)} {[f'{x:.5g}' for x in values.tolist()] if numeric else type(leaf)}")
    return hashlib.sha256("\n".join(words).encode()).hexdigest()


def _model_hash(model: Model) -> str:
    """SHA-256 of the model's file, or of its text where there is no file (any more)."""
    content = model.text.encode()
    if model.path is not None and model.path.is_file():
        content = model.path.read_bytes()
    return hashlib.sha256(content).hexdigest()
