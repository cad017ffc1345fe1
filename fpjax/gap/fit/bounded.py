"""Bounded: damped Gauss-Newton steps that leave no parameter outside its bounds.

Marquardt, "An algorithm for least-squares estimation of nonlinear parameters", 1963; bounds by an active set.
"""

import numpy as np

from ...logs.arrays import Values
from .candidate import Candidate


def bounded_steps(c: Candidate, matrices: Values, slopes: Values, dampings: Values) -> Values:
    """The steps of damped normal equations; a parameter at a bound, whose step leads outside, is held there.

    Args:
        c: whose steps they are; a parameter within a billionth of its scale of a bound is at it.
        matrices: normal matrices in units of `Candidate.scale`, positive definite, shape (dampings, free, free).
        slopes: gradients in these units, shape (dampings, free).
        dampings: Marquardt's, times the diagonal [1].

    Returns:
        In units of `Candidate.scale`, shape (dampings, free).
    """
    value, edge = c.vector[c.free], 1e-9 * c.scale
    low, high = value <= c.low + edge, value >= c.high - edge
    # Marquardt's scaling by the diagonal; the small term keeps a parameter without influence solvable.
    diagonal, index = np.diagonal(matrices, axis1=1, axis2=2), np.arange(len(value))
    damped = matrices.copy()
    damped[:, index, index] += dampings[:, None] * diagonal + 1e-12
    steps = _solved(damped, slopes)
    for step, matrix, slope in zip(steps, damped, slopes, strict=True):
        held = np.zeros(len(value), bool)
        for _ in range(3):  # holding one parameter may drive another out
            out = (low & (step < 0)) | (high & (step > 0))
            if not np.any(out & ~held):
                break
            held |= out
            go = ~held
            step[held] = 0.0
            step[go] = _solved(matrix[None][:, go][:, :, go], slope[None, go])[0]
    return steps


def _solved(matrices: Values, slopes: Values) -> Values:
    """Solutions of A x = -b, (equations, unknowns), the diagonal scaled to one; by least squares where that fails."""
    size = 1.0 / np.sqrt(np.diagonal(matrices, axis1=1, axis2=2))
    scaled, right = matrices * size[:, :, None] * size[:, None, :], -slopes * size
    try:
        return np.linalg.solve(scaled, right[:, :, None])[:, :, 0] * size
    except np.linalg.LinAlgError:
        each = zip(scaled, right, strict=True)
        return np.array([np.linalg.lstsq(a, b, rcond=1e-13)[0] for a, b in each]) * size
