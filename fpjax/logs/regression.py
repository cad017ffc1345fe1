"""Least squares on columns of very different size, as every regression of a log's columns solves it."""

import numpy as np

Values = np.ndarray
RANK = 1e-12  # of the largest singular value, columns scaled to length one: below it two columns say the same


def solved(table: Values, target: Values, *, rank: float = RANK) -> Values | None:
    """The numbers x that make table x least different from target; None where the columns do not tell them apart.

    Columns are scaled to length one before, so that a torque in N m beside an acceleration of 1e4 rad/s^2 counts.

    Args:
        table: a column each unknown, shape (rows, unknowns).
        target: shape (rows,).
        rank: singular values below this share of the largest count as none.
    """
    size = np.linalg.norm(table, axis=0)
    if len(table) <= table.shape[1] or np.any(size == 0.0):
        return None
    solution, _, found, _ = np.linalg.lstsq(table / size, target, rcond=rank)
    return solution / size if found == table.shape[1] else None
