"""Populations of true plants around a nominal one, for `plants=`."""

import itertools
from collections.abc import Mapping

import numpy as np

from fpjax.blocks.parameters import get_parameter
from fpjax.errors import InputError
from fpjax.simulation.loop import ClosedLoop
from fpjax.simulation.seeds import checked_seed


def population(
    loop: ClosedLoop, spread: Mapping[str, float], *, count: int | None = None, seed: int = 0
) -> dict[str, np.ndarray]:
    """True plants around the loop's own, the first of them the loop's own.

    Observer and controller stay as they are: their nominal inertia is then off by as much as the plant's is varied.

    Args:
        loop: the nominal loop.
        spread: by parameter name, the largest deviation either way as a fraction of its value: {"plant.inertia": 0.2}.
        count: number of plants, drawn uniformly within the spread; None for the 2^n corners of the box and the nominal.
        seed: of the draw.

    Returns:
        Values by parameter name, each of shape (plants,), as `tune(plants=...)` takes them.

    Raises:
        InputError: for an invalid spread.
    """
    if not spread:
        raise InputError("population needs at least one parameter to vary, as {'plant.inertia': 0.2}.")
    for name, share in spread.items():
        if not 0.0 < share < 1.0:
            raise InputError(f"{name}: a spread must be a fraction between 0 and 1, as 0.2, got {share:g}.")
    if count is None:
        # The corners bound the cost where it is monotonic in each parameter.
        signs = np.array(list(itertools.product((-1.0, 1.0), repeat=len(spread))))
    else:
        if count < 1:
            raise InputError(f"count = {count} leaves no plant: give at least 1.")
        signs = np.random.default_rng(checked_seed(seed)).uniform(-1.0, 1.0, (count - 1, len(spread)))
    # Row 0, all zeros, is the nominal plant; shape (plants, n).
    factors = 1.0 + np.vstack([np.zeros(len(spread)), signs]) * np.array(list(spread.values()))
    return {name: float(get_parameter(loop, name)) * factors[:, place] for place, name in enumerate(spread)}
