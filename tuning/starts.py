"""Where a search starts by itself: gains that pole placement gives, a coarse screen around them, the best few of it."""

import itertools
from collections.abc import Callable, Sequence

import numpy as np

from fpjax.analysis.placement import place_gain
from fpjax.simulation.loop import ClosedLoop

from .notes import truths
from .objective import AbstractObjective
from .parameters import DECADES, Parameter, Space

SCREENED = 64  # candidates of the screen, one cost each, in one kernel
KEPT = 4  # of them that the method starts from
APART = 1.0  # distance of two kept ones [e-folds]
REACH = 2.0  # decades that the screen spans to either side of the placed gains


def placed_parameters(
    loop: ClosedLoop,
    tables: Sequence[np.ndarray],
    dt: float,
    parameters: Sequence[str | Parameter],
    objective: AbstractObjective,
) -> list[Parameter]:
    """Every parameter that is given by its name alone with the start and the range of its rule.

    Args:
        loop: the closed loop.
        tables: references [rad/s] (or [rad] for a position loop), each of shape (samples,).
        dt: of the tables [s].
        parameters: as `tune` takes them; those with a start or a range of their own stay as they are.
        objective: tells true values where the law does not.

    Returns:
        `Parameter`s, the placed ones with `place_gain` as start and four decades to either side; what has no rule
        keeps its value as the middle of its range.
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
    return one.start is None and one.low is None and one.high is None and one.scale == "log"


def screen(
    space: Space, judge: Callable[[np.ndarray], np.ndarray], start: np.ndarray, written: np.ndarray, seed: int
) -> tuple[np.ndarray, int]:
    """(starts of shape (kept, n), costs computed): the best of a coarse screen that are apart from each other.

    Args:
        space: of the parameters.
        judge: costs, shape (m,), of candidates of shape (m, n).
        start: the middle of the screen, shape (n,).
        written: the values that the loop has; the first start where they lie in the range and ran whole.
        seed: of the draws where the parameters are too many for a grid.
    """
    count = start.size
    log = np.asarray(space.logarithmic) > 0
    middle, half = np.asarray(space.middle, float), np.asarray(space.half, float)
    span = np.where(log, REACH * np.log(10.0), 1.9 * half)
    if count <= 2:
        side = 16 if count == 1 else round(SCREENED**0.5)
        steps = np.array(list(itertools.product(np.linspace(-1.0, 1.0, side), repeat=count)))
    else:
        # Latin hypercube: each parameter's range is covered evenly, whatever their number.
        random = np.random.default_rng(seed)
        rows = [random.permutation(SCREENED) for _ in range(count)]
        steps = (np.stack(rows, axis=1) + 0.5) / SCREENED * 2.0 - 1.0
    centre = np.where(log, np.log(np.where(log, np.maximum(start, 1e-300), 1.0)), start)
    bent = np.clip(centre + steps * span, middle - half, middle + half)
    inside = np.all(np.abs(space.share(written)) <= 1.0) and np.all(np.isfinite(written))
    candidates = np.where(log, np.exp(np.where(log, bent, 0.0)), bent)
    candidates = np.vstack([written if inside else start, candidates])
    costs = judge(candidates)
    order = np.argsort(np.where(np.isfinite(costs), costs, np.inf), kind="stable")
    scaled = np.where(log, np.log(np.where(log, candidates, 1.0)), candidates / np.where(log, 1.0, half))
    kept = [0] if np.isfinite(costs[0]) else []
    for place in order:
        if len(kept) > KEPT or not np.isfinite(costs[place]):
            break
        if all(np.linalg.norm(scaled[place] - scaled[other]) > APART for other in kept):
            kept.append(int(place))
    return candidates[kept or [0]], len(candidates)
