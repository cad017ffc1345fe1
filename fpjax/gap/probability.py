"""Probabilities: from log evidence, tempered and capped as development seeds showed it to be right."""

import numpy as np

TEMPERATURE = 3.0  # of log evidence
RIGHT_WHEN_EXPLAINED = 0.99
RIGHT_WHEN_UNEXPLAINED = 0.12
RIGHT_WHEN_NO_GAP = 0.02


def shares(evidence: np.ndarray, explained: bool, gap: bool) -> np.ndarray:
    """Probability of each of the rivals, shape (rivals,); what is missing to one is "none of these"."""
    top = RIGHT_WHEN_EXPLAINED if explained else RIGHT_WHEN_UNEXPLAINED
    if not gap:
        top = RIGHT_WHEN_NO_GAP
    finite = np.where(np.isfinite(evidence), evidence, -1e30)
    relative = np.exp(np.maximum((finite - np.max(finite)) / TEMPERATURE, -700.0))
    return top * relative / np.sum(relative)
