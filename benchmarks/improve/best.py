"""The gains that are best in the truth: a derivative-free search on the closed loop of the true machine.

A cross-entropy search: draw gains around a middle, keep the best few, move the middle and the spread towards them
(Rubinstein, "The cross-entropy method for combinatorial and continuous optimization", 1999). The truth generators are
numpy programs without derivatives.
"""

from collections.abc import Callable, Sequence

import numpy as np

from fpjax.improvement.search import FINE

from .machines import Gains, Record, Truth, error, run, shares_of_allowed

# The truth steps all machines as vectors, and most of the time is the interpreter's for each step: sixty loops take 1.2
# times as long as one (8 substeps of 1 ms, 1 s: 0.74 and 0.62 s). Hence few, large generations, on a part of the log.
CANDIDATES, ELITE, GENERATIONS = 32, 6, 4  # drawn in a generation, kept of it, and generations
WIDE = 0.2  # standard deviation of the first draws, as a share of each gain's range
NARROW = 0.01  # least standard deviation, likewise
SUBSTEPS, SECONDS = 8, 3.0  # of the integrator in 1 ms, and length of the part of the log [s]
KEPT, POLISHED = 6, 14  # best gains of the search, and draws close to them, that run over the whole log at the end
CLOSE = 0.04  # standard deviation of those draws, as a share of the range


def candidates(
    machines: Sequence[Truth], starts: Sequence[Sequence[Gains]], seed: int, tell: Callable[[float], None]
) -> list[list[Gains]]:
    """Gains that follow well in each true machine over a part of its log, all machines side by side.

    Args:
        machines: the truth.
        starts: gains to begin with for each machine; the best of them is where the search begins.
        seed: of the draws.
        tell: called with the share of the work done.

    Returns:
        `KEPT` + `POLISHED` gains a machine, the best of the search first; `chosen` decides over the whole log.
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

    def costs_of(shares: list[np.ndarray]) -> list[np.ndarray]:
        asked = [(true, gains(i, one)) for i, true in enumerate(machines) for one in shares[i]]
        records = iter(run([*((true, true.now) for true in machines), *asked], SUBSTEPS, SECONDS))
        now = [next(records) for _ in machines]
        return [costs(now[i], [next(records) for _ in some], machines[i].rating) for i, some in enumerate(shares)]

    seen = [np.array([share(i, one) for one in some]) for i, some in enumerate(starts)]
    # The first generation also covers the whole range by a Latin hypercube: better gains may be far from the starts.
    latin = [np.stack([random.permutation(CANDIDATES) for _ in words], axis=1) for _ in machines]
    wide = [(one + random.random(one.shape)) / CANDIDATES for one in latin]
    seen = [np.concatenate([some, more]) for some, more in zip(seen, wide, strict=True)]
    scored = costs_of(seen)
    deviation = [np.full(len(words), WIDE) for _ in machines]
    middle = [some[int(np.argmin(cost))] for some, cost in zip(seen, scored, strict=True)]
    tell(1.0 / (GENERATIONS + 1))
    for generation in range(GENERATIONS):
        drawn = [
            np.clip(middle[i] + deviation[i] * random.standard_normal((CANDIDATES, len(words))), 0.0, 1.0)
            for i in range(len(machines))
        ]
        for i, (some, cost) in enumerate(zip(drawn, costs_of(drawn), strict=True)):
            seen[i], scored[i] = np.concatenate([seen[i], some]), np.concatenate([scored[i], cost])
            elite = some[np.argsort(cost)[:ELITE]]
            # Halfway between the best so far and the mean of the elite: the elite alone drifts on noisy costs.
            middle[i] = 0.5 * seen[i][int(np.argmin(scored[i]))] + 0.5 * elite.mean(axis=0)
            spread = np.sqrt(np.mean((elite - middle[i]) ** 2, axis=0))
            # Smoothed, so that one lucky generation does not end the search early.
            deviation[i] = np.clip(0.3 * deviation[i] + 0.7 * spread, NARROW, WIDE)
        tell((generation + 2) / (GENERATIONS + 1))
    found = []
    for i, (some, cost) in enumerate(zip(seen, scored, strict=True)):
        best = some[np.argsort(cost)[:KEPT]]
        near = best[np.arange(POLISHED) % 2] + CLOSE * random.standard_normal((POLISHED, len(words)))
        found.append([gains(i, one) for one in np.concatenate([best, np.clip(near, 0.0, 1.0)])])
    return found


def costs(now: Record, records: Sequence[Record], rating: float | None) -> np.ndarray:
    """Costs of runs: tracking error over that with the recorded gains, plus the penalties that `improve` uses.

    A smaller error does not count if its torque is rougher, or much larger, than the torque of the recorded gains.

    Args:
        now: the run with the recorded gains.
        records: the runs to judge.
        rating: the drive's largest torque, where the model file tells it [N m].

    Returns:
        Shape (records,) [1]; 1e6 for an unstable loop.
    """
    unit = error(now)
    unit = unit if np.isfinite(unit) else 1.0
    cost = np.array([error(one) for one in records]) / unit
    shares = [shares_of_allowed(one, now, rating) for one in records]
    for name in ("roughness", "peak"):
        # Share by which the size exceeds what is allowed.
        over = np.array([max(one[name] - 1.0, 0.0) for one in shares])
        cost = cost + FINE * np.nan_to_num(over, posinf=1e3)
    return np.where(np.isfinite(cost), cost, 1e6)
