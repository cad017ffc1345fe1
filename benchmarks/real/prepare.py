"""Logs that are made of a record before they are diagnosed."""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

Stretch = tuple[float, float]


@dataclass(frozen=True)
class Prepared:
    """A log that was made, and the stretches of time [s] in which something acted that it does not know."""

    log: Path
    hidden: tuple[Stretch, ...]


def stretches(active: np.ndarray, stamps: np.ndarray) -> tuple[Stretch, ...]:
    """Stretches of time in which a mask is true [s]."""
    edges = np.flatnonzero(np.diff(np.concatenate([[0], active.astype(int), [0]])))
    return tuple((float(stamps[a]), float(stamps[b - 1])) for a, b in edges.reshape(-1, 2))


def leave_out_pulses(record: Path, place: Path) -> Prepared:
    """The EMPS pulse record with its pulses taken out of the force: a disturbance that nobody recorded.

    `vir` [V] holds the pulses [V]; both become N by gtau.
    """
    import scipy.io

    raw = scipy.io.loadmat(record)
    gain, stamps = float(raw["gtau"].item()), raw["t"].ravel()
    pulses = raw["pulses_N"].ravel()
    columns = {
        "time": stamps,
        "torque": gain * (raw["vir"].ravel() - pulses),
        "position": raw["qm"].ravel(),
        "reference": raw["qg"].ravel(),
    }
    path = place / "pulses_left_out.csv"
    rows = np.stack(list(columns.values()), axis=1)
    np.savetxt(path, rows, fmt="%.12g", delimiter=",", header=",".join(columns), comments="")
    return Prepared(path, stretches(pulses != 0, stamps))


PREPARE: dict[str, Callable[[Path, Path], Prepared]] = {"leave_out_pulses": leave_out_pulses}
