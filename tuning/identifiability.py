"""The identifiability block after every fit: which parameters the data pin, and which they do not."""

import dataclasses
import math

import numpy as np

from fpjax.analysis.verdicts import FLAT, verdicts
from fpjax.output.json_object import JsonObject

from .lanes import Lanes

PINNED = 1e-3  # singular value, as a fraction of the largest, below which a direction is not pinned
SHARE = 0.3  # of a direction, above which a parameter has a share in it
STEP = 1e-2  # finite-difference step [e-folds] where a set-valued law has no derivative


@dataclasses.dataclass(frozen=True)
class Identifiability:
    """What the residuals' slopes say about each parameter at the point that was reached, in log-gain space.

    Attributes:
        names: of the parameters.
        slopes: root mean square change of the residuals per e-fold (half range where linear) of each parameter [1].
        verdicts: by parameter: "pinned", or some of "dead" (moves nothing), "flat" (moves a hundredth of the others),
            "traded off with NAME" (another one undoes it), "not pinned" (a direction with a share in it moves nothing),
            "at its low bound", "at its high bound".
        condition: largest over smallest singular value of the slopes [1].
        free_direction: the direction that the residuals pin least: exponents by parameter, gain_i ~ s^exponent.
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
    """The block from a Jacobian.

    Args:
        names: of the parameters.
        jacobian: of the residuals by the parameters, shape (m, n), per e-fold or half range.
        share: where each parameter lies between its bounds, -1 to 1, shape (n,).
        derivative: how the Jacobian was had.
    """
    n = len(names)
    jacobian = np.where(np.isfinite(jacobian), jacobian, 0.0)
    lengths = np.linalg.norm(jacobian, axis=0)
    largest = float(lengths.max(initial=0.0))
    unit = jacobian / np.where(lengths > 0.0, lengths, 1.0)
    _, singular, directions = np.linalg.svd(jacobian, full_matrices=True)
    padded = np.concatenate([singular, np.zeros(n - singular.size)])
    # A direction that moves nothing leaves open every parameter with a share in it.
    unpinned = np.any((np.abs(directions) > SHARE) & (padded <= PINNED * largest)[:, None], axis=0)
    smallest = float(padded.min()) if n else 0.0
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
    """The block of every lane.

    Args:
        lanes: what was tuned.
        values: the points that were reached, in the parameters' units, shape (lanes, n).
        set_valued: whether a sign in the loop forbids derivatives; then finite differences are taken.
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
        # The map bends near the bounds; the verdict is about the gains, not about the map.
        bend = (1.0 - np.minimum(np.abs(shares[lane]), 0.999) ** 8) ** (9.0 / 8.0)
        found.append(judge(lanes.problem.parameters, jacobians[lane] / bend, shares[lane], how))
    return found


def _finite_differences(lanes: Lanes, at: np.ndarray) -> np.ndarray:
    columns = []
    for place in range(at.shape[1]):
        move = STEP * np.eye(at.shape[1])[place]
        above, below = lanes.residuals(at + move), lanes.residuals(at - move)
        columns.append((above - below) / (2.0 * STEP))
    return np.stack(columns, axis=-1)
