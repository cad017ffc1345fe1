"""Torque regressed on a motion, J a + C sgn(v) + B v + offset = u: the solver, and its form on pairs of samples.

Two forms of the regression answer two questions, and neither can replace the other:

* `fit_pairs` (here) takes the samples two by two, differentiates the velocity within each pair, and takes the inertia
  as given. It is the limit of an observer with slow gains, which gets the same pairs. `estimate` prints it beside the
  observer's estimates: where the two differ, the observer has not converged. The comparison is fair only because both
  make the same discretisation errors (the published least squares of EMPS has this form too).
* `fit_rigid` (`fpjax.logs.dynamics.nominal`) integrates the equation over short windows and takes no derivative. It
  serves `inspect`, its starter model and the checks of a log, which have to find the inertia themselves. The pairs
  cannot do that: a differentiated encoder of 2.9 mrad steps gives J = 0.008 on a pendulum of 0.21 kg m^2 (noise in the
  regressor biases its coefficient towards zero: errors in variables).

In both, the torque is held over the period from t_k to t_k+1, and the terms of the motion are their means over that
period (`mean_held`, `mean_direction`).
"""

import math

import numpy as np
from jaxtyping import Float

from ..arrays import Values

RANK = 1e-12  # of the largest singular value, columns scaled to length one: below it columns are linearly dependent
PAIRS_RANK = 1e-10  # the same for pairs of samples: below it direction and speed are linearly dependent
SLIDING = 0.01  # share of the largest speed below which pairs are left out: static friction does not follow the speed


def solved(table: Values, target: Values, *, rank: float = RANK) -> Values | None:
    """Least-squares solution x of table x = target, shape (unknowns,); None where the unknowns are not identifiable.

    Columns are scaled to length one first, so that a torque in N m is not lost beside an acceleration of 1e4 rad/s^2
    when the rank is judged.

    Args:
        table: a column for each unknown, shape (rows, unknowns).
        target: shape (rows,).
        rank: singular values below this share of the largest count as zero.
    """
    size = np.linalg.norm(table, axis=0)
    if len(table) <= table.shape[1] or np.any(size == 0.0):
        return None
    solution, _, found, _ = np.linalg.lstsq(table / size, target, rcond=rank)
    return solution / size if found == table.shape[1] else None


def mean_held(values: Values) -> Values:
    """Mean over each period from the values at its two ends; for the last sample, which has no successor, its value."""
    return 0.5 * (values + np.append(values[1:], values[-1]))


def mean_direction(velocity: Values) -> Values:
    """Mean of sgn(velocity) over each period, with a reversal within the period weighted by the times before and after.

    Between the samples the velocity is a straight line, so these times follow from its two ends.
    """
    after = np.append(velocity[1:], velocity[-1])
    total = np.abs(velocity) + np.abs(after)
    turned = np.divide(velocity + after, total, out=np.zeros_like(velocity), where=total > 0.0)
    return np.where(velocity * after < 0.0, turned, np.sign(velocity + after))


def fit_pairs(
    torque: Float[np.ndarray, " periods"], velocity: Float[np.ndarray, " periods+1"], dt: float, inertia: float
) -> dict[str, float]:
    """Coulomb, viscous and offset torque by least squares on the pairs of samples that an observer gets.

    Periods below 1 % of the largest speed, and those in which it changes its sign, are left out.

    Args:
        torque: held over each period [N m], shape (samples - 1,).
        velocity: at the start of each period and at the last one's end [rad/s], shape (samples,).
        dt: control period [s].
        inertia: J [kg m^2], taken as given for coulomb, viscous and offset.

    Returns:
        "coulomb" [N m], "viscous" [N m s/rad], "offset" [N m], and "free inertia" [kg m^2] of a second fit that has it
        as an unknown; NaN where they are not identifiable.
    """
    middle, acceleration = mean_held(velocity)[:-1], np.diff(velocity) / dt
    slides = (np.abs(middle) > SLIDING * np.max(np.abs(middle))) & (velocity[1:] * velocity[:-1] > 0.0)
    terms = [mean_direction(velocity)[:-1], middle, np.ones_like(middle), acceleration]
    motion = np.stack(terms, axis=1)[slides]
    given = solved(motion[:, :3], (torque - inertia * acceleration)[slides], rank=PAIRS_RANK)
    free = solved(motion, torque[slides], rank=PAIRS_RANK)
    numbers = np.full(3, np.nan) if given is None else given
    found = {name: float(value) for name, value in zip(("coulomb", "viscous", "offset"), numbers, strict=True)}
    return found | {"free inertia": math.nan if free is None else float(free[3])}
