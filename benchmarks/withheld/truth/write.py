"""A case on disk: log.csv and servo.toml for the tool, the label in a folder of its own."""

import json
from pathlib import Path
from typing import Any

import numpy as np

from .machine import Record


def write_log(folder: Path, record: Record, with_position: bool) -> None:
    """log.csv with the contract's columns, SI units."""
    names = ["time", "torque", "velocity", "position", "reference"]
    if not with_position:
        names.remove("position")
    columns = np.stack([getattr(record, name) for name in names], axis=1)
    formats = ["%.6f" if name == "time" else "%.9g" for name in names]
    folder.mkdir(parents=True, exist_ok=True)
    np.savetxt(folder / "log.csv", columns, fmt=formats, delimiter=",", header=",".join(names), comments="")


def model_text(nominal: dict[str, float], gains: tuple[float, float], dt: float, with_position: bool) -> str:
    """The nominal servo.toml."""
    lines = [
        "[units]",
        'motion = "rotary"',
        'reference = "velocity"',
        f'sensors = "{"both" if with_position else "velocity"}"',
        "[plant]",
        'type = "one_mass"',
        f"inertia = {nominal['inertia']:.9g}",
        "[friction]",
        'type = "coulomb_viscous"',
        f"coulomb = {nominal['coulomb']:.9g}",
        f"viscous = {nominal['viscous']:.9g}",
    ]
    if nominal.get("offset", 0.0):
        lines.append(f"offset = {nominal['offset']:.9g}")
    if nominal.get("unbalance", 0.0):
        lines += [
            "[load]",
            'type = "unbalance"',
            f"amplitude = {nominal['unbalance']:.9g}",
            f"phase = {nominal['unbalance_phase']:.9g}",
        ]
    lines += [
        "[controller]",
        'type = "pi"',
        f"kp = {gains[0]:.9g}",
        f"ki = {gains[1]:.9g}",
        "[simulation]",
        f"dt = {dt:.9g}",
    ]
    return "\n".join(lines) + "\n"


def write_label(path: Path, label: dict[str, Any]) -> None:
    """The label as JSON; written last, so that a case with a label is complete."""
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(json.dumps(label, indent=1) + "\n")
