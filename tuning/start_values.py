"""Automatic start values: gains by pole placement, a coarse screen of costs around them, and its best few points.

From poor gains alone (1e-5) a single search ended at both bounds; hence the screen.
"""

import itertools
from collections.abc import Callable, Sequence

import numpy as np

from fpjax.analysis.placement import place_gain
from fpjax.simulation.loop import ClosedLoop

from .notes import truths
from .objective import AbstractObjective
from .parameters import DECADES, Parameter, Space

SCREENED = 64  # candidates of the screen, one cost each; as many lanes as one compiled kernel takes at full speed
KEPT = 4  # candidates from which the method starts, besides the gains in the loop
APART = 1.0  # least distance between two kept candidates [e-folds]: two in one valley would find one minimum
REACH = 2.0  # decades that the screen spans either side of the placed gains; their bounds are 4 (`DECADES`) away


def placed_parameters(
    loop: ClosedLoop,
    tables: Sequence[np.ndarray],
    dt: float,
    parameters: Sequence[str | Parameter],
    objective: AbstractObjective,
) -> list[Parameter]:
    """Parameters given by name alone, with start and range from pole placement.

    Args:
        loop: the closed loop.
        tables: references [rad/s] (or [rad] for a position loop), each of shape (samples,).
        dt: of the tables [s].
        parameters: as `tune` takes them; those with a start or a range of their own stay as they are.
        objective: gives true values that the friction law has no parameter for.

    Returns:
        `Parameter`s: the placed ones start at `place_gain` with bounds four decades either side; one without a
        placement rule keeps its value in the loop as start and the middle of its range.
    """
    full = [Parameter(one) if isinstance(one, str) else one for one in parameters]
    known = truths(loop, objective)
    placed = [place_gain(loop, tables, dt, one.name, known) if _free(one) else None for one in full]
    found = []
    for one, value in zip(full, placed, strict=True):
        if value is None:
            found.append(one)
            continue
        low, high = value * 10.0**-DECADES, value * 10.0**DECADES
        found.append(Parameter(one.name, value, low, high, "log"))
    return found


def _free(one: Parameter) -> bool:
    """Whether the caller said nothing about the parameter but its name."""
    return one.start is None and one.low is None and one.high is None and one.scale == "log"


def screen(
    space: Space, judge: Callable[[np.ndarray], np.ndarray], start: np.ndarray, written: np.ndarray, seed: int
) -> tuple[np.ndarray, int]:
    """(starts of shape (kept, n), number of costs computed): the best points of a coarse screen, at least `APART`.

    Args:
        space: of the parameters.
        judge: costs, shape (m,), of candidates of shape (m, n).
        start: the middle of the screen, shape (n,).
        written: the values in the loop, shape (n,); kept as the first start if they are in range and do not diverge.
        seed: of the Latin hypercube, used for three parameters and more.
    """
    count = start.size
    log = np.asarray(space.logarithmic) > 0
    middle, half = np.asarray(space.middle, float), np.asarray(space.half, float)
    # Half width of the screen: decades where log; where linear it is 1.9 half ranges, clipped at the bounds below, so
    # that it covers the whole range however far off centre the start is.
    span = np.where(log, REACH * np.log(10.0), 1.9 * half)
    # A full grid: 16 points for one parameter, 8 x 8 for two; `steps` has shape (candidates, n) in -1 to 1.
    if count <= 2:
        side = 16 if count == 1 else round(SCREENED**0.5)
        steps = np.array(list(itertools.product(np.linspace(-1.0, 1.0, side), repeat=count)))
    else:
        # Latin hypercube: each parameter's range is covered evenly, whatever their number.
        random = np.random.default_rng(seed)
        rows = [random.permutation(SCREENED) for _ in range(count)]
        steps = (np.stack(rows, axis=1) + 0.5) / SCREENED * 2.0 - 1.0
    centre = np.where(log, np.log(np.where(log, np.maximum(start, 1e-300), 1.0)), start)
    moved = np.clip(centre + steps * span, middle - half, middle + half)
    inside = np.all(np.abs(space.share(written)) <= 1.0) and np.all(np.isfinite(written))
    candidates = np.where(log, np.exp(np.where(log, moved, 0.0)), moved)
    # Row 0 is always there, so that the program is compiled for one number of rows.
    candidates = np.vstack([written if inside else start, candidates])
    costs = judge(candidates)
    # Stable: of equal costs the earlier candidate, so that results do not depend on the sort.
    order = np.argsort(np.where(np.isfinite(costs), costs, np.inf), kind="stable")
    # Distances are taken in the coordinates of the search: e-folds where log, half ranges where linear.
    scaled = np.where(log, np.log(np.where(log, candidates, 1.0)), candidates / np.where(log, 1.0, half))
    kept = [0] if np.isfinite(costs[0]) else []
    for place in order:
        # `kept` holds row 0 too, if it ran: up to KEPT + 1 starts.
        if len(kept) > KEPT or not np.isfinite(costs[place]):
            break
        if all(np.linalg.norm(scaled[place] - scaled[other]) > APART for other in kept):
            kept.append(int(place))
    return candidates[kept or [0]], len(candidates)
