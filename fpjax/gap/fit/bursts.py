"""Bursts: the law of the factor by which a tile of time and frequency holds more or less missing torque than usual."""

import functools
import math

import numpy as np

from ...logs.arrays import Values

TILE = 4  # coefficients that share a burst
BURSTS = np.array([*range(-5, 7), 8, 10, 13, 16, 20])  # log2 of the factors on a tile's q
BELOW = -int(BURSTS[0])


@functools.lru_cache(maxsize=8)
def bursts(tails: float) -> tuple[Values, Values]:
    """(log2 of the bursts, their prior [1]), each of shape (bursts,): a Laplace density on the grid, normalised."""
    law = np.exp(-np.abs(BURSTS) * math.log(2.0) / tails) * np.gradient(BURSTS.astype(float))
    # A tile gains log 2 a coefficient at most from half the level: with light tails that is never worth its prior. (One
    # burst for a whole side might be, while a fit looks for its valley with one level for all octaves.)
    some = slice(None) if math.log(2.0) / tails < TILE * math.log(2.0) else slice(BELOW, None)
    return BURSTS[some].astype(float), law[some] / np.sum(law[some])


@functools.lru_cache(maxsize=8)
def law_along(values: int, tails: float) -> Values:
    """The bursts' prior about each of some levels a factor of two apart, shape (levels, values)."""
    levels = values - BELOW - BURSTS[-1]
    out = np.zeros((levels, values))
    for place in range(levels):
        factors, law = bursts(tails)
        out[place, BELOW + place + factors.astype(int)] = law
    return out


def mixed_likelihood(by_burst: Values, law: Values) -> Values:
    """-2 log of the mean likelihood over the bursts' law: (..., bursts, windows, tiles) to (..., windows, tiles)."""
    least = np.min(by_burst, axis=-3)
    likely = by_burst - least[..., None, :, :]
    likely *= -0.5
    mean = law @ np.exp(likely, out=likely).reshape(*likely.shape[:-2], -1)
    return least - 2.0 * np.log(mean.reshape(least.shape))
