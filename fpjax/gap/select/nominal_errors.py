"""Which of the nominal model's own numbers are wrong, beside the effects of a fit.

Every fit frees inertia, Coulomb and viscous friction widely, so that a poor nominal model never blocks or bends another
cause. Afterwards each of the three is asked: right within a few per cent (a narrow prior, the spike), a guess, or wild
(wider ones, the slabs)? Around a fit the likelihood is Gaussian, so that the evidence of every combination of priors is
a formula, and no further fit is needed (spike and slab: Mitchell, Beauchamp, "Bayesian variable selection in linear
regression", 1988).
"""

import itertools

import numpy as np

from ...logs.arrays import Values
from ..fit.candidate import NOMINAL, SPIKE, SPIKE_RANGE, Candidate, Fit
from ..thresholds import THRESHOLDS

GUESS = 0.3  # standard deviation of a nominal value that was guessed, relative


def wrong_numbers(fit: Fit, sizes: dict[str, float]) -> tuple[float, tuple[str, ...]]:
    """(log evidence [1], the nominal numbers that are wrong) of the best combination.

    Args:
        fit: with some of `NOMINAL` wide.
        sizes: of the nominal numbers (`fpjax.gap.fit.candidate.nominal_sizes`).
    """
    c, t = fit.candidate, THRESHOLDS
    names = [c.family.parameters[i].name for i in c.free]
    wide = [(names.index(n), sizes[n]) for n in NOMINAL if n in c.wide]
    as_fitted = _gained(c, c.spread)[0]
    best, wrong = -np.inf, ()
    for kinds in itertools.product(("right", "guess", "wild"), repeat=len(wide)):
        spread = c.spread.copy()
        for (i, size), kind in zip(wide, kinds, strict=True):
            spread[i] = {"right": SPIKE * size, "guess": GUESS * size, "wild": c.spread[i]}[kind]
        gained, moved = _gained(c, spread)
        # A number that ends beyond what counts as right is not right: a fit with it would be held at a bound.
        if any(k == "right" and abs(moved[i]) > SPIKE_RANGE * size for (i, size), k in zip(wide, kinds, strict=True)):
            continue
        odds = t.wrong_number * (sum(k != "right" for k in kinds) + kinds.count("wild"))
        if gained + odds > best:
            best, wrong = gained + odds, tuple(names[i] for (i, _), k in zip(wide, kinds, strict=True) if k != "right")
    return fit.evidence + best - as_fitted, wrong


def _gained(c: Candidate, spread: Values) -> tuple[float, Values]:
    """(log evidence of the fit's Gaussian under other priors, but for a constant; how far each parameter is then off).

    Args:
        c: a finished candidate.
        spread: standard deviations of the priors, shape (free,).
    """
    data = c.normal / c.scale[:, None] / c.scale  # precision that the logs give the free parameters
    was = 1.0 / c.spread**2
    # In units of the new priors: columns that a log does not tell apart only add a zero.
    weight, turn = np.linalg.eigh(spread[:, None] * (0.5 * (data + data.T)) * spread)
    weight = np.maximum(weight, 0.0)
    pull = turn.T @ (spread * ((data + np.diag(was)) @ (c.vector[c.free] - c.center)))
    gained = 0.5 * float(np.sum(pull**2 / (1.0 + weight)) - np.sum(np.log1p(weight)))
    return gained, spread * (turn @ (pull / (1.0 + weight)))
