"""Identifiability after every tuning: which parameters the cost determines, and which it does not.

From the singular values of the residuals' Jacobian at the gains that were reached. Columns are per e-fold of a log
parameter, so that gains of different units compare.
"""

import dataclasses
import math

import numpy as np

from fpjax.analysis.verdicts import FLAT, verdicts
from fpjax.output.json_object import JsonObject

from .lanes import Lanes
from .parameters import INSIDE, SHARPNESS

PINNED = 1e-3  # singular value over the largest column norm, below which a direction is not pinned
SHARE = 0.3  # component in a unit direction above which a parameter takes part in it (9 % of its square)
STEP = 1e-2  # finite-difference step [e-folds] under a sign(): long enough to average over the jumps of the cost


@dataclasses.dataclass(frozen=True)
class Identifiability:
    """What the slopes of the residuals show about each parameter, at the gains reached and in log-gain space.

    Attributes:
        names: of the parameters.
        slopes: root mean square change of the residuals per e-fold (half range where linear) of each parameter [1].
        verdicts: by parameter: "pinned", or some of "dead" (no residual depends on it), "flat" (a hundredth of the
            largest slope, or less), "traded off with NAME" (a change of the other one cancels its effect), "not pinned"
            (part of a direction on which no residual depends), "at its low bound", "at its high bound".
        condition: largest over smallest singular value of the slopes [1].
        free_direction: the direction on which the residuals depend least: along it every gain changes as s^exponent, by
            parameter; the largest exponent is 1.
        derivative: "forward mode" or "finite differences" (set-valued friction).
    """

    names: tuple[str, ...]
    slopes: dict[str, float]
    verdicts: dict[str, str]
    condition: float
    free_direction: dict[str, float]
    derivative: str

    def to_dict(self) -> JsonObject:
        """As JSON takes it."""
        return dataclasses.asdict(self)

    def __str__(self) -> str:
        rows = [f"  {name:<28} {self.slopes[name]:10.3g}  {self.verdicts[name]}" for name in self.names]
        head = f"identifiability ({self.derivative}; slope per e-fold, verdict), condition {self.condition:.3g}:"
        return "\n".join([head, *rows])


def judge(
    names: tuple[str, ...], jacobian: np.ndarray, share: np.ndarray, derivative: str = "forward mode"
) -> Identifiability:
    """`Identifiability` from a Jacobian.

    Args:
        names: of the parameters.
        jacobian: of the residuals by the parameters, shape (m, n), per e-fold or half range.
        share: where each parameter lies between its bounds, -1 to 1, shape (n,).
        derivative: how the Jacobian was computed.
    """
    n = len(names)
    # A slope that is not finite comes of a diverged run; svd would raise on it.
    jacobian = np.where(np.isfinite(jacobian), jacobian, 0.0)
    lengths = np.linalg.norm(jacobian, axis=0)
    largest = float(lengths.max(initial=0.0))
    unit = jacobian / np.where(lengths > 0.0, lengths, 1.0)
    # Rows of `directions` (n, n) are unit vectors in parameter space, by falling singular value. Full matrices: with
    # fewer residuals than parameters the null space is among them, with singular values of zero.
    _, singular, directions = np.linalg.svd(jacobian, full_matrices=True)
    padded = np.concatenate([singular, np.zeros(n - singular.size)])
    # A direction on which no residual depends leaves every parameter that takes part in it undetermined.
    unpinned = np.any((np.abs(directions) > SHARE) & (padded <= PINNED * largest)[:, None], axis=0)
    smallest = float(padded.min()) if n else 0.0
    # Scaled to a largest exponent of 1, so that it reads as gain_i ~ s^exponent.
    weakest = directions[-1] / directions[-1][int(np.argmax(np.abs(directions[-1])))]
    return Identifiability(
        names,
        {name: float(length) for name, length in zip(names, lengths, strict=True)},
        verdicts(names, lengths, unit.T @ unit, unpinned, share, flat=FLAT),
        largest / smallest if smallest > 0.0 else math.inf,
        {name: float(part) for name, part in zip(names, weakest, strict=True)},
        derivative,
    )


def identifiability(lanes: Lanes, values: np.ndarray, *, set_valued: bool) -> list[Identifiability]:
    """`Identifiability` of every lane.

    Args:
        lanes: what was tuned.
        values: the points that were reached, in the parameters' units, shape (lanes, n).
        set_valued: whether a sign() in the loop forbids derivatives; finite differences are then taken.
    """
    space = lanes.problem.space
    at = space.coordinates(values)
    if set_valued:
        jacobians = _finite_differences(lanes, at)
    else:
        _, jacobians, _ = lanes.residuals_and_jacobian(at)
    shares = space.share(values)
    how = "finite differences" if set_valued else "forward mode"
    found = []
    for lane in range(lanes.count):
        # The map of `Space` flattens towards a bound. Its slope, (1 - |s|^p)^(1 + 1/p) at share s, is divided out: the
        # verdict is about the gains, not about the map.
        bend = (1.0 - np.minimum(np.abs(shares[lane]), INSIDE) ** SHARPNESS) ** (1.0 + 1.0 / SHARPNESS)
        found.append(judge(lanes.problem.parameters, jacobians[lane] / bend, shares[lane], how))
    return found


def _finite_differences(lanes: Lanes, at: np.ndarray) -> np.ndarray:
    """Jacobians of shape (lanes, m, n) by central differences of `STEP`."""
    columns = []
    for place in range(at.shape[1]):
        move = STEP * np.eye(at.shape[1])[place]
        above, below = lanes.residuals(at + move), lanes.residuals(at - move)
        columns.append((above - below) / (2.0 * STEP))
    return np.stack(columns, axis=-1)
