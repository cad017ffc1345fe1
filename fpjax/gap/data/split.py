"""Split: which windows are withheld from every fit."""

from collections.abc import Sequence

import numpy as np

UNFAIR = 4.0  # times as much energy in all windows as in the withheld or in the fitted ones: then others are withheld

Values = np.ndarray


def every_fourth(windows: int, shift: int = 0) -> np.ndarray:
    """Whole blocks of two windows; every fourth, now and then moved by one so that they do not beat with laps.

    Args:
        windows: of a record.
        shift: by which all are moved, in blocks.
    """
    block = np.arange(windows) // (2 if windows >= 16 else 1) + shift
    chosen = block % 4 == np.where(block // 4 % 4 == 0, 3, 2)
    if not np.any(chosen):
        chosen[-1] = True
    return chosen


def fairer_split(missing: Sequence[Values]) -> list[Values] | None:
    """Windows to withhold in which as much is missing as in the others; None where those of `every_fourth` will do.

    A torque limit that is reached in a few windows would else have none on which it can be told, or none to be fitted
    on. The nominal model alone is asked, so that the choice favours no cause.

    Args:
        missing: mean square of its missing torque in each window [N^2 m^2], one array a record.
    """
    energy = [np.maximum(m, 0.0) for m in missing]
    tried = [[every_fourth(len(m), shift) for m in energy] for shift in range(4)]
    least = []  # of the withheld windows' energy and of the fitted ones'
    for split in tried:
        withheld = np.concatenate([m[own] for m, own in zip(energy, split, strict=True)])
        fitted = np.concatenate([m[~own] for m, own in zip(energy, split, strict=True)])
        least.append(min(float(np.mean(withheld)), float(np.mean(fitted))) if fitted.size else 0.0)
    best, whole = int(np.argmax(least)), float(np.mean(np.concatenate(energy)))
    return tried[best] if UNFAIR * least[0] < whole and least[best] > least[0] else None
