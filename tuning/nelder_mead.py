"""scipy's Nelder-Mead in log-gain space, one lane after the other: scipy asks for one cost at a time."""

import numpy as np

from .lanes import Best, Lanes, Outcome
from .methods import NelderMead
from .stopping import Stop


class _OverError(Exception):
    """Ends scipy's search from within its cost function: target or budget reached, or nothing finite found."""


def nelder_mead(lanes: Lanes, settings: NelderMead, stop: Stop) -> Outcome:
    """Nelder-Mead; a diverged candidate is a vertex of infinite cost.

    Args:
        lanes: starts and references.
        settings: iterations, size, tolerance.
        stop: target, budget and progress bar.
    """
    best = Best(*lanes.start.shape)
    for lane in range(lanes.count):
        _one(lanes, lane, settings, stop, best)
    return best.outcome()


def _one(lanes: Lanes, lane: int, settings: NelderMead, stop: Stop, best: Best) -> None:
    """Search one lane; what it finds goes into `best`."""
    import scipy.optimize

    alone = Lanes(
        lanes.problem,
        lanes.start[lane : lane + 1],
        None if lanes.index is None else lanes.index[lane : lane + 1],
        lanes.clock,
    )
    begin = lanes.problem.space.coordinates(lanes.start[lane])
    n = begin.size

    def cost(at: np.ndarray) -> float:
        if stop.before(best, lanes.cases)[lane]:
            raise _OverError
        values = lanes.values(at)
        value = float(alone.costs(values[None, None])[0, 0])
        best.offer(lane, values, value, lanes.cases)
        # All n + 1 vertices of the first simplex diverged: their differences hold no direction.
        if not np.isfinite(best.costs[lane]) and best.iterations[lane] > n:
            raise _OverError
        stop.progress(best)
        return value

    simplex = np.vstack([begin, begin + settings.size * np.eye(n)])
    options = {
        "initial_simplex": simplex,
        "maxfev": settings.iterations,
        "maxiter": settings.iterations,
        "xatol": settings.tolerance,
        "fatol": settings.tolerance,
    }
    try:
        result = scipy.optimize.minimize(cost, begin, method="Nelder-Mead", options=options)
        if result.success:
            best.reasons[lane] = "the simplex no longer changes"
    except _OverError:
        pass
