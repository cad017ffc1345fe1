"""Best: gains tuned in the truth itself, by a derivative-free search on its own closed loop."""

from collections.abc import Callable, Sequence

import numpy as np

from fpjax.improvement.search import FINE, ROUGHEST

from .machines import Gains, Truth, error, rough, run

CANDIDATES, ELITE, GENERATIONS = 24, 5, 6  # a candidate more costs little side by side, a generation as much again
WIDE = 0.2  # standard deviation of the first draws, of the range
SUBSTEPS, SECONDS = 8, 4.0  # of the search; the score is over the whole log
NARROW = 0.01


def best_gains(
    machines: Sequence[Truth], starts: Sequence[Sequence[Gains]], seed: int, tell: Callable[[float], None]
) -> list[Gains]:
    """The gains that follow best in each true machine, all machines side by side.

    Args:
        machines: the truth.
        starts: gains to begin with for each machine; the best of them is where the search begins.
        seed: of the draws.
        tell: called with the share done.
    """
    random = np.random.default_rng(seed)
    words = list(machines[0].now)
    low = np.array([[true.bounds[word][0] for word in words] for true in machines])
    high = np.array([[true.bounds[word][1] for word in words] for true in machines])

    def gains(place: int, share: np.ndarray) -> Gains:
        return dict(zip(words, (low[place] + share * (high[place] - low[place])).tolist(), strict=True))

    def share(place: int, values: Gains) -> np.ndarray:
        found = np.array([values[word] for word in words])
        return np.clip((found - low[place]) / (high[place] - low[place]), 0.0, 1.0)

    now = run([(true, true.now) for true in machines], SUBSTEPS, SECONDS)
    unit = np.array([[error(record), rough(record)] for record in now])

    def costs(shares: list[np.ndarray]) -> list[np.ndarray]:
        asked = [(true, gains(i, one)) for i, true in enumerate(machines) for one in shares[i]]
        records = iter(run(asked, SUBSTEPS, SECONDS))
        found = []
        for i, some in enumerate(shares):
            rows = [next(records) for _ in some]
            over = [max(rough(one) / (ROUGHEST * unit[i, 1]) - 1.0, 0.0) for one in rows]
            cost = np.array([error(one) for one in rows]) / unit[i, 0] + FINE * np.nan_to_num(np.array(over), nan=1e3)
            found.append(np.where(np.isfinite(cost), cost, 1e6))
        return found

    first = [np.array([share(i, one) for one in some]) for i, some in enumerate(starts)]
    scored = costs(first)
    best = [some[int(np.argmin(cost))] for some, cost in zip(first, scored, strict=True)]
    least = [float(cost.min()) for cost in scored]
    middle, deviation = [one.copy() for one in best], [np.full(len(words), WIDE) for _ in machines]
    for generation in range(GENERATIONS):
        drawn = [
            np.clip(middle[i] + deviation[i] * random.standard_normal((CANDIDATES, len(words))), 0.0, 1.0)
            for i in range(len(machines))
        ]
        for i, (some, cost) in enumerate(zip(drawn, costs(drawn), strict=True)):
            if cost.min() < least[i]:
                best[i], least[i] = some[int(np.argmin(cost))], float(cost.min())
            elite = some[np.argsort(cost)[:ELITE]]
            middle[i] = 0.5 * best[i] + 0.5 * elite.mean(axis=0)
            spread = np.sqrt(np.mean((elite - middle[i]) ** 2, axis=0))
            deviation[i] = np.clip(0.3 * deviation[i] + 0.7 * spread, NARROW, WIDE)
        tell((generation + 1) / GENERATIONS)
    return [gains(i, one) for i, one in enumerate(best)]
