"""Bounded: a damped Gauss-Newton step that leaves no parameter outside its bounds.

Marquardt, "An algorithm for least-squares estimation of nonlinear parameters", 1963; bounds by an active set.
"""

import numpy as np

from ...logs.arrays import Values
from .candidate import Candidate


def bounded_step(c: Candidate, matrix: Values, slope: Values, damping: float) -> Values:
    """The step of the damped normal equations; a parameter at a bound, whose step leads outside, is held there.

    Args:
        c: whose step it is; a parameter within a billionth of its scale of a bound is at it.
        matrix: normal matrix in units of `Candidate.scale`, shape (free, free).
        slope: gradient in these units, shape (free,).
        damping: Marquardt's, times the diagonal [1].

    Returns:
        In units of `Candidate.scale`, shape (free,).
    """
    value, edge = c.vector[c.free], 1e-9 * c.scale
    low, high = value <= c.low + edge, value >= c.high - edge
    # Marquardt's scaling by the diagonal; the small term keeps a parameter without influence solvable.
    damped = matrix + np.diag(damping * np.diag(matrix) + 1e-12)
    step = np.linalg.lstsq(damped, -slope, rcond=1e-13)[0]
    held = np.zeros(len(value), bool)
    for _ in range(3):  # holding one parameter may drive another out
        out = (low & (step < 0)) | (high & (step > 0))
        if not np.any(out & ~held):
            break
        held |= out
        go = ~held
        step = np.zeros(len(value))
        if not np.any(go):
            break
        step[go] = np.linalg.lstsq(damped[np.ix_(go, go)], -slope[go], rcond=1e-13)[0]
    return step
