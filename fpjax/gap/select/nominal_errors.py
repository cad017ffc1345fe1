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

RIGHT, GUESSED, WILD = range(3)


def wrong_numbers(fit: Fit, sizes: dict[str, float]) -> tuple[float, tuple[str, ...]]:
    """(log evidence [1], the nominal numbers that are wrong) of the best combination.

    Args:
        fit: with some of `NOMINAL` wide.
        sizes: of the nominal numbers (`fpjax.gap.fit.candidate.nominal_sizes`).
    """
    c, t = fit.candidate, THRESHOLDS
    names = [c.family.parameters[i].name for i in c.free]
    at = [names.index(n) for n in NOMINAL if n in c.wide]
    size = np.array([sizes[names[i]] for i in at])
    kinds = np.array(list(itertools.product((RIGHT, GUESSED, WILD), repeat=len(at))), int)  # (combinations, numbers)
    spread = np.tile(c.spread, (len(kinds), 1))
    spread[:, at] = np.choose(kinds, (SPIKE * size, t.wild * size, c.spread[at]))
    gained, moved = _gained(c, spread)
    # A number that ends beyond what counts as right is not right: a fit with it would be held at a bound.
    out = np.any((kinds == RIGHT) & (np.abs(moved[:, at]) > SPIKE_RANGE * size), axis=1)
    odds = t.wrong_number * (np.sum(kinds != RIGHT, axis=1) + np.sum(kinds == WILD, axis=1))
    best = int(np.argmax(np.where(out, -np.inf, gained + odds)))
    as_fitted = gained[-1]  # all wild
    wrong = tuple(names[i] for i, kind in zip(at, kinds[best], strict=True) if kind != RIGHT)
    return float(fit.evidence + gained[best] + odds[best] - as_fitted), wrong


def _gained(c: Candidate, spread: Values) -> tuple[Values, Values]:
    """(log evidence of the fit's Gaussian under other priors, but for a constant; how far each parameter is then off).

    Args:
        c: a finished candidate.
        spread: standard deviations of the priors, shape (combinations, free), as the second result; the first is
            (combinations,).
    """
    data = c.normal / c.scale[:, None] / c.scale  # precision that the logs give the free parameters
    data = 0.5 * (data + data.T)
    # In units of the new priors: columns that a log does not tell apart only add a zero.
    weight, turn = np.linalg.eigh(spread[:, :, None] * data * spread[:, None, :])
    weight = np.maximum(weight, 0.0)
    slope = (data + np.diag(1.0 / c.spread**2)) @ (c.vector[c.free] - c.center)
    pull = np.einsum("ckj,ck->cj", turn, spread * slope)
    gained = 0.5 * (np.sum(pull**2 / (1.0 + weight), axis=1) - np.sum(np.log1p(weight), axis=1))
    return gained, spread * np.einsum("ckj,cj->ck", turn, pull / (1.0 + weight))
