"""Preparation of a record before it is diagnosed: a log is made of it that lacks something known."""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

Stretch = tuple[float, float]


@dataclass(frozen=True)
class Prepared:
    """A prepared log, and the (start, end) [s] of what acted on the machine and was removed from the log."""

    log: Path
    hidden: tuple[Stretch, ...]


def stretches(active: np.ndarray, stamps: np.ndarray) -> tuple[Stretch, ...]:
    """(start, end) [s] of the stretches in which a mask of shape (samples,) is true."""
    edges = np.flatnonzero(np.diff(np.concatenate([[0], active.astype(int), [0]])))
    return tuple((float(stamps[a]), float(stamps[b - 1])) for a, b in edges.reshape(-1, 2))


def leave_out_pulses(record: Path, place: Path) -> Prepared:
    """The EMPS record with pulses, without the pulses in its force column: they become an unrecorded disturbance.

    `vir` is the drive's command [V] with the pulses `pulses_N` [V] in it; `gtau` [N/V] makes a force of it.
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
