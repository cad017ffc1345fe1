"""Signature: the trace that an effect leaves in a log, and how much of it another effect can copy.

The sensitivities of the residual to an effect's parameters span its signature. What the start states of the windows,
the nominal parameters (both under their priors) and the other causes can copy is taken out. The largest canonical
correlation of what is left (Hotelling, "Relations between two sets of variates", 1936) is 1 where some change of the
one effect looks exactly like some change of the other.
"""

import numpy as np

from .attribute import Fitted, Search
from .fit import Candidate, Fitter

DEAD = 1e-9  # of the largest column: what changes nothing spans nothing
RANK = 1e-6  # of the largest singular value


def canonical_correlation(search: Search, fitted: Fitted, effect: str, rival: Fitted, other: str) -> float:
    """The largest canonical correlation [1] of two effects' signatures in the fitted windows.

    Args:
        search: the fits.
        fitted: a model that holds `effect`; its other parameters are projected out.
        effect: name of the one.
        rival: a model that holds `other`.
        other: name of the other.
    """
    first, second = sensitivities(search, fitted.candidate), sensitivities(search, rival.candidate)
    own, others = own_parameters(fitted.candidate, effect), own_parameters(rival.candidate, other)
    common = [i for i, name in enumerate(_free(fitted.candidate)) if name not in own and name not in others]
    nuisance = first[:, common]
    # A prior is an observation of the parameter: it keeps the projection from taking out more than the prior allows.
    prior = np.diag(fitted.candidate.weight[common] ** 2)
    pairs = ((first, fitted.candidate, own), (second, rival.candidate, others))
    picked = [columns[:, [name in wanted for name in _free(c)]] for columns, c, wanted in pairs]
    left = [without(columns, nuisance, prior) for columns in picked]
    bases = [basis(columns) for columns in left]
    if min(base.shape[1] for base in bases) == 0:
        return 0.0
    return float(min(np.linalg.svd(bases[0].T @ bases[1], compute_uv=False)[0], 1.0))


def _free(candidate: Candidate) -> list[str]:
    return [candidate.family.parameters[i].name for i in candidate.free]


def own_parameters(candidate: Candidate, effect: str) -> set[str]:
    """Names of the parameters that an effect of the candidate frees."""
    return {p.name for e in candidate.effects if e.name == effect for p in e.parameters}


def sensitivities(search: Search, candidate: Candidate) -> np.ndarray:
    """Of the residual [standard deviations] to the free parameters, the start states projected out window by window.

    Returns:
        Shape (rows, free): rows are windows x channels x samples of the fitted windows of all records.
    """
    fitter = search.fitters[candidate.family.key]
    blocks = [
        _of_record(fitter, candidate, which, windows) for which, windows in enumerate(search.train) if len(windows)
    ]
    return np.concatenate(blocks)


def _of_record(fitter: Fitter, c: Candidate, which: int, windows: np.ndarray) -> np.ndarray:
    _, slope = fitter.jacobians([c], which, windows)[0]
    own, start = slope[:, :, : len(c.free)], slope[:, :, len(c.free) :]
    deviation, _ = fitter.scales[which]
    prior = np.diag(1.0 / deviation[deviation > 0] ** 2)
    return np.concatenate([without(a, b, prior) for a, b in zip(own, start, strict=True)])


def without(columns: np.ndarray, nuisance: np.ndarray, prior: np.ndarray) -> np.ndarray:
    """Columns less what the nuisance columns, under a prior precision, can copy of them; shape as `columns`."""
    if nuisance.shape[1] == 0:
        return columns
    # scaled first: parameters of many units would make the normal matrix look singular
    size = 1.0 / np.sqrt(np.sum(nuisance**2, axis=0) + np.diag(prior) + 1e-300)
    scaled = nuisance * size
    normal = scaled.T @ scaled + size[:, None] * prior * size
    return columns - scaled @ np.linalg.lstsq(normal, scaled.T @ columns, rcond=1e-12)[0]


def basis(columns: np.ndarray) -> np.ndarray:
    """Orthonormal basis of what the columns span, shape (rows, rank)."""
    size = np.sqrt(np.sum(columns**2, axis=0))
    alive = size > DEAD * max(float(np.max(size, initial=0.0)), 1e-300)
    if not np.any(alive):
        return columns[:, :0]
    left, singular, _ = np.linalg.svd(columns[:, alive] / size[alive], full_matrices=False)
    return left[:, singular > RANK * singular[0]]
