"""Start values of fits of a backlash or a spring, found with the measured motion imposed on the side that has a sensor.

The motion of a load that crosses a backlash depends on every contact before, and that of one on a soft spring on every
swing, so that the cost of a window has many local minima and a fit from rule-of-thumb values ends in the nearest one:
so it was in four of five development logs with a backlash, and with springs of 3 to 45 Hz whose friction is divided
unevenly. So they are searched for with the measured motion imposed (`fpjax.gap.fit.imposed_motion`), by descents in low
frequencies first: with all at once they ended in a wider gap before a lighter load.
"""

import itertools
from collections.abc import Sequence

import numpy as np

from ...logs.arrays import Values
from ..effects.parameters import highest_contact, highest_frequency, largest_gap, lowest_frequency
from .imposed_motion import NAMES, ImposedMotion, Objective

# A grid over the parameters, then descents from its best points, in logarithms of the parameters.
GAPS = 10  # number of clearances
LEAST_GAP = 3e-4  # the least, as the time to cross it at top speed [s]
LARGEST_GAP = 0.5  # the largest, of the largest that there may be [1]
SHARES = (0.15, 0.35, 0.6)  # of the inertia that is on the load [1]
HARD = (0.15, 0.4, 1.0)  # resonances in contact, of the highest that sampling shows [1]
FACES, STARTS = 3, 4  # slices that each hold one of them, and starts on each side at most
RATIO = 0.3  # damping ratio of a face in contact [1]
FRICTIONS = (0.05, 0.25, 0.7)  # of the friction that is on the load [1]
SPRINGS = 10  # resonances of a spring, from the lowest to the highest that a log shows
SLICE = 1.8  # ratio of the resonances in one slice, at most [1]: the best of each is a start
SLICES = (2, 6)  # fewest and most of them
SPRING_SHARES = (0.2, 0.5, 0.8)  # of the inertia that is on the load of a spring [1]
# Shares of the Coulomb and of the viscous friction that are on it [1].
SPRING_FRICTIONS = ((0.05, 0.05), (0.2, 0.2), (0.7, 0.7), (0.7, 0.1))
SPRING_RATIO = 0.05  # damping ratio of a spring [1]
CLOSED = 1e-9  # clearance of a spring, as the time to cross it at top speed [s]: its logarithm is finite
SAME = 0.05  # difference of fitted and given nominal numbers that makes them one point of the grid [1]
NUMBERS = 1.5  # factor by which a nominal number may be beyond the fitted and the given one [1]
# Points of each slice from which the search descends, half of which go on from one band to the next: of a spring, and
# of a backlash, which has fewer slices and more minima.
DESCENTS, OF_CONTACT = 4, 8
LED, DESCENT = 4, 8  # its steps on each number of the lower bands, and then on all
FACTORS, WORSE, DAMPINGS = (0.1, 1.0, 10.0), 30.0, (1e-4, 1e4)  # on its damping, tried side by side; bounds of it [1]
FURTHEST = 0.5  # of a logarithm, in one step at most
TINY = 1e-9  # added to the normal equations: a clearance of a spring has no gradient
APART = 0.1  # least difference of two starts in a parameter of the shaft, of the natural logarithm
# Corners of low-passes over the highest resonance. Behind the lower ones only a contact's impulse is left, or the slow
# swing of a soft spring, which are right before the course of a contact's torque is: they lead the search from afar.
BANDS = (0.03, 0.12, 0.5)
LIVELY = 0.2  # of the damping found: errors of the contacts' times look like damping, so that less of it is tried too


def contact_starts(log: ImposedMotion) -> tuple[dict[str, float], ...]:
    """Start values of fits of a backlash, the sensors on the motor, then on the load, the most likely of each first.

    As many again with less damping; () where no stretch of the log can be used.
    """
    setting = log.setting
    least, most = LEAST_GAP * setting.speed, largest_gap(setting)
    gaps = np.geomspace(least, LARGEST_GAP * most, GAPS)
    frequencies = [share * highest_frequency(setting) for share in HARD]
    # A start divides both kinds of friction alike.
    rows = [[*one, one[-1]] for one in itertools.product(gaps, SHARES, frequencies, [RATIO], FRICTIONS)]
    low = [0.1 * least, 0.05, 0.1 * highest_frequency(setting), 0.02, 0.02, 0.02]
    high = [0.98 * most, 0.9, highest_contact(setting), 1.5, 0.98, 0.98]
    found: list[dict[str, float]] = []
    for side in (0.0, 1.0):
        objective = Objective(log, side, BANDS)
        if not objective.usable:
            continue
        descended = _descents(objective, rows, low, high, FACES, each=OF_CONTACT)
        found += [_values(log, one, side) for one in descended[:STARTS]]
    return (*found, *(one | {"damping_ratio": LIVELY * one["damping_ratio"]} for one in found))


def spring_starts(log: ImposedMotion) -> tuple[dict[str, float], ...]:
    """Start values of fits of a spring, the sensors on either side: the best of each slice of resonances; () for none.

    Whether a spring of 3 or of 30 Hz leaves less in such a simulation says little of which is there: readings are
    noisy, and the slices differ in how much of the noise they take for a torque. Within one they do not.
    """
    setting = log.setting
    # A start at a bound has no gradient.
    least, most = 1.1 * lowest_frequency(setting), 0.9 * highest_frequency(setting)
    if not 1.5 * least < most:
        return ()
    frequencies, closed = np.geomspace(least, most, SPRINGS), CLOSED * setting.speed
    every = itertools.product(frequencies, SPRING_SHARES, SPRING_FRICTIONS)
    rows = [[closed, share, frequency, SPRING_RATIO, *friction] for frequency, share, friction in every]
    low, high = [closed, 0.06, least, 0.005, 0.02, 0.02], [closed, 0.94, most, 0.4, 0.98, 0.98]
    slices = int(np.clip(np.ceil(np.log(most / least) / np.log(SLICE)), *SLICES))
    found: list[dict[str, float]] = []
    for side in (0.0, 1.0):
        objective = Objective(log, side, BANDS)
        if not objective.usable:
            continue
        best = [_values(log, one, side) for one in _descents(objective, rows, low, high, slices, of_each=True)]
        found += [{name: value for name, value in one.items() if name != "gap"} for one in best]
    return tuple(found)


def _descents(
    objective: Objective, rows: Sequence[Sequence[float]], low: Sequence[float], high: Sequence[float], slices: int,
    *, each: int = DESCENTS, of_each: bool = False,
) -> list[Values]:  # fmt: skip
    """Where the descents from the best points of each slice of a grid's resonances end, none twice.

    Args:
        objective: lower is better.
        rows: the grid without the nominal numbers, each (parameters,).
        low: lowest values, likewise.
        high: highest ones.
        slices: between the lowest and the highest resonance.
        each: points of a slice from which it descends.
        of_each: the best of each slice, which a descent does not leave, instead of the best of all.

    Returns:
        Logarithms of the points, each (parameters,).
    """
    log = objective.log
    numbers = [[max(model[name], least) for name, least in _least(log).items()] for model in (log.nominal, log.given)]
    if np.allclose(*numbers, rtol=SAME, atol=0.0):
        numbers = numbers[:1]
    grid = np.log([[*one, *model] for one in rows for model in numbers]).T
    least = np.log([*low, *np.min(numbers, 0) / NUMBERS])[:, None]
    most = np.log([*high, *np.max(numbers, 0) * NUMBERS])[:, None]
    edges = np.linspace(np.log(low[2]), np.log(high[2]), slices + 1)[1:-1]
    order = np.argsort(objective.scores(np.exp(grid)))
    own = np.searchsorted(edges, grid[2, order])
    begun = [order[own == one][:each] for one in range(slices)]
    slice_of = np.repeat(np.arange(slices), [len(some) for some in begun])
    if of_each:
        least, most = (np.repeat(bound, len(slice_of), axis=1) for bound in (least, most))
        least[2], most[2] = np.append(least[2, 0], edges)[slice_of], np.append(edges, most[2, 0])[slice_of]
    found, scores, slice_of = _descended(objective, grid[:, np.concatenate(begun)], least, most, slice_of)
    order, chosen = [int(at) for at in np.argsort(scores) if np.isfinite(scores[at])], list[int]()
    if of_each:
        order = [next(at for at in order if slice_of[at] == one) for one in np.unique(slice_of[order])]
    for at in order:
        if all(np.max(np.abs(found[:, at] - found[:, other])[: len(low)]) > APART for other in chosen):
            chosen.append(at)
    return [found[:, at] for at in chosen]


def _descended(
    objective: Objective, points: Values, least: Values, most: Values, slice_of: Values
) -> tuple[Values, Values, Values]:
    """Points after steps of Levenberg and Marquardt, their scores and slices: in the lowest band first, then in more.

    The better half of each slice goes on from one band to the next.

    Args:
        objective: lower is better.
        points: logarithms of the parameters, shape (parameters, points).
        least: lowest ones, (parameters, points or 1).
        most: highest ones.
        slice_of: index of each point's slice, (points,).
    """
    points, one = np.clip(points, least, most), np.eye(len(points))
    least, most = (np.broadcast_to(bound, points.shape) for bound in (least, most))
    damping = np.full(points.shape[1], FACTORS[0])
    bands, led_by = len(objective.filters), 1
    for used in [*(band for band in range(1, bands) for _ in range(LED)), *[bands] * DESCENT]:
        if used > led_by:
            kept, led_by = _better_half(objective.scores(np.exp(points), used), slice_of), used
            points, least, most = points[:, kept], least[:, kept], most[:, kept]
            damping, slice_of = damping[kept], slice_of[kept]
        before, gradient, matrix = objective.linearised(np.exp(points), used)
        held = ((points <= least) & (gradient.T > 0.0)) | ((points >= most) & (gradient.T < 0.0))  # by a bound
        free = np.where(held.T, 0.0, 1.0)
        gradient, matrix = gradient * free, matrix * free[:, :, None] * free[:, None, :]
        size = np.einsum("pkk->pk", matrix)
        trials = []
        for factor in FACTORS:
            ridged = matrix + ((factor * damping)[:, None] * size + TINY)[:, :, None] * one
            step = np.linalg.solve(ridged, -gradient[:, :, None])[:, :, 0].T
            trials.append(np.clip(points + np.clip(step, -FURTHEST, FURTHEST), least, most))
        scores = objective.scores(np.exp(np.concatenate(trials, axis=1)), used).reshape(len(FACTORS), -1)
        chosen, better = np.argmin(scores, axis=0), np.min(scores, axis=0) < before
        points = np.where(better, np.stack(trials)[chosen, :, np.arange(len(chosen))].T, points)
        damping = np.clip(damping * np.where(better, np.array(FACTORS)[chosen], WORSE), *DAMPINGS)
    return points, objective.scores(np.exp(points)), slice_of


def _better_half(scores: Values, slice_of: Values) -> Values:
    """Indices of the points with the lower scores in each slice, half of them and one at the least.

    Both arguments have the shape (points,).
    """
    kept = []
    for one in np.unique(slice_of):
        own = np.flatnonzero(slice_of == one)
        kept.append(own[np.argsort(scores[own], kind="stable")][: (len(own) + 1) // 2])
    return np.concatenate(kept)


def _least(log: ImposedMotion) -> dict[str, float]:
    """Least nominal numbers of the search: their logarithm is finite."""
    friction, speed = log.setting.friction, log.setting.speed
    return {"inertia": 0.0, "coulomb": 0.01 * friction, "viscous": 0.01 * friction / speed}


def _values(log: ImposedMotion, row: Values, side: float) -> dict[str, float]:
    """Start values by name, from the logarithms of a point, (parameters,)."""
    found = {name: float(np.exp(value)) for name, value in zip(NAMES, row, strict=True)} | {"load_side": side}
    # The search means the resonance with the point's own inertia, a candidate with that of a shaft that is known.
    known = log.hidden_states.family.known.get("shaft_inertia", 0.0)
    return found | ({"frequency": found["frequency"] * (found["inertia"] / known) ** 0.5} if known else {})
