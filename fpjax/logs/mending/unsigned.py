"""Signed numbers that were recorded as unsigned: 65135 of a 16-bit register is -401, or 33068 is -300."""

import numpy as np

FEWEST = 5  # [values] on either side of zero


def signed(values: np.ndarray) -> tuple[np.ndarray, str] | None:
    """The column with its signs restored, and an example of a change in words; None where it is not such a column.

    A signed 16-bit register holds small numbers of both signs, so read as unsigned its values lie near the two ends of
    0 to 65535 (two's complement) or just above 0 and just above 32768 (a sign bit, as of Feetech's servos), and
    nowhere between. A counter that runs through its whole range is left alone.

    Args:
        values: a column as the file has it, shape (rows,).
    """
    known = values[np.isfinite(values)]
    if known.size < 2 * FEWEST or not 32768 <= known.max() <= 65535 or known.min() < 0 or (known % 1.0).any():
        return None
    quarter = np.floor(known / 16384.0).astype(int)
    count = np.bincount(quarter, minlength=4)
    if count[0] < FEWEST or count[1]:
        return None
    if count[3] >= FEWEST and not count[2]:
        meant = np.where(values > 32767.0, values - 65536.0, values)
    elif count[2] >= FEWEST and not count[3]:
        meant = np.where(values > 32767.0, 32768.0 - values, values)
    else:
        return None
    place = int(np.argmax(np.where(np.isfinite(values), values, -1.0)))
    return meant, f"{values[place]:.0f} stands for {meant[place]:.0f}"
