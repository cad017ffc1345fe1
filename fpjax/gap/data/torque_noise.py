"""Noise of a measured torque: a sampled current holds noise that no machine feels.

What drives a simulation is then not what drove the machine. A model whose lag, scale or mass keeps the noise out of the
motion would be likelier by that alone (errors in variables: Fuller, "Measurement error models", 1987), so the noise is
estimated from the column itself, and `fpjax.gap.fit.response` takes it into account.
"""

import itertools

import numpy as np
from jaxtyping import Float

from ...logs import Log
from ...logs.arrays import Values

PIECE = 64  # samples of a spectrum
OCTAVES = (4, 8, 16, 33)  # their bounds, in bins of such a spectrum


def torque_noise(log: Log) -> float:
    """Standard deviation of a measured torque's white noise [N m], before its rows were resampled; 0 if commanded.

    White noise has the same density in every octave, and the torque itself only adds to it: the least of them counts,
    the median over time in each, so that neither a vibration nor reversals pass for noise.
    """
    if not log.torque_measured or len(log.torque) < 2 * PIECE:
        return 0.0
    torque, taper = np.asarray(log.torque, float), np.hanning(PIECE + 1)[:-1]
    rows = np.arange(0, len(torque) - PIECE + 1, PIECE // 2)[:, None] + np.arange(PIECE)
    power = np.abs(np.fft.rfft(torque[rows] * taper, axis=1)) ** 2 / np.sum(taper**2)
    power /= kept_noise(np.arange(PIECE // 2 + 1) / (PIECE * log.dt), log.dt, log.resampled)
    densities = [np.median(np.mean(power[:, a:b], axis=1)) / _median(b - a) for a, b in itertools.pairwise(OCTAVES)]
    return float(np.sqrt(min(densities)))


def _median(bins: int) -> float:
    """Median of the mean of some bins' power over its expectation [1], of white noise under a Hann taper.

    A scaled chi-square with the same variance (bins correlate by 4/9 with the next one and 1/36 with the one after),
    and its median by the cube root's normal law (Wilson and Hilferty, 1931).
    """
    variance = (1.0 + 2.0 * ((bins - 1) / bins * 4.0 / 9.0 + (bins - 2) / bins / 36.0)) / bins
    return (1.0 - variance / 9.0) ** 3


def kept_noise(frequency: Float[Values, " n"], dt: float, resampled: bool) -> Float[Values, " n"]:
    """Share of the variance of white noise at some frequencies [Hz] that is left of it after resampling [1].

    The mean over each period of a value that is held from stamp to stamp is (1 - a) times a reading and a times the
    next one, with an a between 0 and 1: (2 + cos w dt) / 3 on average.
    """
    return (2.0 + np.cos(2.0 * np.pi * frequency * dt)) / 3.0 if resampled else np.ones(len(frequency))
