"""Split: which windows are withheld from every fit."""

from collections.abc import Sequence

import numpy as np
from jaxtyping import Bool, Float

from ...logs.arrays import Values
from ..thresholds import THRESHOLDS


def every_fourth(windows: int, shift: int = 0) -> Bool[Values, " {windows}"]:
    """Whether each window is withheld: every fourth block of two windows, shape (windows,), bool.

    Every fourth time it is the block after, so that withheld blocks do not fall on the same part of a periodic motion.

    Args:
        windows: number of windows of a record.
        shift: of all withheld blocks [blocks].
    """
    block = np.arange(windows) // (2 if windows >= 16 else 1) + shift
    chosen = block % 4 == np.where(block // 4 % 4 == 0, 3, 2)
    if not np.any(chosen):
        chosen[-1] = True
    return chosen


def fairer_split(missing: Sequence[Float[Values, " _"]]) -> list[Bool[Values, " _"]] | None:
    """Windows to withhold that hold as much missing torque as the others; None where those of `every_fourth` do.

    A torque limit that is reached in a few windows could otherwise have all of them withheld, and not be fitted, or
    none, and not be confirmed. The missing torque is that of the nominal model, so that the choice favours no cause.

    Args:
        missing: mean square of its missing torque in each window [N^2 m^2], one array a record.
    """
    energy = [np.maximum(m, 0.0) for m in missing]
    tried = [[every_fourth(len(m), shift) for m in energy] for shift in range(4)]
    least = []  # for each shift, the lesser mean energy of the withheld and of the fitted windows [N^2 m^2]
    for split in tried:
        withheld = np.concatenate([m[own] for m, own in zip(energy, split, strict=True)])
        fitted = np.concatenate([m[~own] for m, own in zip(energy, split, strict=True)])
        least.append(min(float(np.mean(withheld)), float(np.mean(fitted))) if fitted.size else 0.0)
    best, whole = int(np.argmax(least)), float(np.mean(np.concatenate(energy)))
    return tried[best] if THRESHOLDS.unfair * least[0] < whole and least[best] > least[0] else None
