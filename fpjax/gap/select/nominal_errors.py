"""Which of the nominal model's own numbers are wrong, beside the effects of a fit.

Every fit frees inertia, Coulomb and viscous friction widely, so that a poor nominal model never blocks or bends another
cause. Afterwards each of the three is asked: right within a few per cent (a narrow prior, the spike), or wrong (a wide
one, the slab)? Around a fit the likelihood is Gaussian, so that the evidence of every combination of priors is a
formula, and no further fit is needed (spike and slab: Mitchell, Beauchamp, "Bayesian variable selection in linear
regression", 1988).
"""

import itertools

import numpy as np

from ..fit.candidate import NOMINAL, SPIKE, Candidate, Fit
from ..thresholds import THRESHOLDS


def wrong_numbers(fit: Fit, sizes: dict[str, float]) -> tuple[float, tuple[str, ...]]:
    """(log evidence [1], the nominal numbers that are wrong) of the best combination.

    Args:
        fit: with some of `NOMINAL` wide.
        sizes: of the nominal numbers (`fpjax.gap.fit.candidate.nominal_sizes`).
    """
    c = fit.candidate
    wide = [name for name in NOMINAL if name in c.wide]
    best = max(_subsets(wide), key=lambda some: _gained(c, sizes, some) + THRESHOLDS.wrong_number * len(some))
    gained = _gained(c, sizes, best) - _gained(c, sizes, tuple(wide)) + THRESHOLDS.wrong_number * len(best)
    return fit.evidence + gained, best


def _subsets(names: list[str]) -> list[tuple[str, ...]]:
    return [some for size in range(len(names) + 1) for some in itertools.combinations(names, size)]


def _gained(c: Candidate, sizes: dict[str, float], wide: tuple[str, ...]) -> float:
    """Log evidence of the fit's Gaussian under other priors, but for a constant."""
    data = c.normal / c.scale[:, None] / c.scale  # precision that the logs give the free parameters
    was = 1.0 / c.spread**2
    names = [c.family.parameters[i].name for i in c.free]
    spread = np.array([
        SPIKE * sizes[n] if n in c.wide and n not in wide else s for n, s in zip(names, c.spread, strict=True)
    ])  # fmt: skip
    # In units of the new priors: columns that a log does not tell apart only add a zero.
    weight, turn = np.linalg.eigh(spread[:, None] * (0.5 * (data + data.T)) * spread)
    weight = np.maximum(weight, 0.0)
    pull = turn.T @ (spread * ((data + np.diag(was)) @ (c.vector[c.free] - c.center)))
    return 0.5 * float(np.sum(pull**2 / (1.0 + weight)) - np.sum(np.log1p(weight)))
