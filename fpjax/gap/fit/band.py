"""Band: the frequencies in which the missing torque is measured, and the sensors' noise that is really there."""

from collections.abc import Sequence

import numpy as np

from ...logs.arrays import Values
from ..data.record import Record
from ..thresholds import THRESHOLDS
from .modes import Modes

QUIET = 0.3  # share of torque in a mode's variance below which the mode serves to estimate the noise
FEW_QUIET = 30  # least coefficients for that estimate: its relative standard error is 0.4 with so many

Coefficients = Sequence[tuple[Values, Values]]
"""(noise s^2 of each window, shape (windows,); plain coefficients, shape (windows, modes)), one entry a record."""


def level_with_bursts(modes: Modes, level: Values, coefficients: Coefficients) -> Values:
    """q by octave [N m] with the bursts' energy in it, shape (bands,).

    `Modes.best_level` gives the level between the bursts: zero for a log that is quiet but for a few pushes, although
    there is a missing torque in it.

    Args:
        modes: of a window.
        level: q between the bursts, shape (bands,).
        coefficients: of a fit.
    """
    squares = np.sum([np.sum(c**2, axis=0) for _, c in coefficients], axis=0)
    noise = sum(float(np.sum(own)) for own, _ in coefficients)
    count, found = sum(len(own) for own, _ in coefficients), level.copy()
    for band in range(modes.bands):
        own = (modes.band == band) & ~modes.sensor
        if np.any(own):
            # A sum of n squares of variance s^2 has a standard deviation of s^2 sqrt(2 n); E[c^2] - s^2 = q^2 lambda.
            energy = float(np.sum(squares[own] - noise))
            if energy > THRESHOLDS.octave * noise * np.sqrt(2.0 * np.sum(own) / count):
                found[band] = max(found[band], np.sqrt(energy / (count * np.sum(modes.gain[own]))))
    return found


def real_noise(modes: Modes, level: Values, coefficients: Coefficients) -> float:
    """Measured over assumed variance of the sensors' noise, from modes that hold hardly any torque [1].

    At most 1: rounding of slow motion has less noise than assumed, and noise's share of the missing torque must not be
    taken out twice.
    """
    ratios = [np.zeros(0)]
    for noise, c in coefficients:
        quiet = modes.wiener(level, noise) < QUIET
        ratios.append((c**2 / noise[:, None])[quiet & ~modes.sensor])
    found = np.concatenate(ratios)
    # 0.4549 is the median of a chi-square of one degree of freedom. A median, so that a few modes with torque in them
    # change nothing.
    return float(min(np.median(found) / 0.4549, 1.0)) if len(found) > FEW_QUIET else 1.0


def highest_of_speed(records: Sequence[Record]) -> float:
    """Frequency [Hz] below which nearly all of the speed's power lies."""
    found = []
    for record in records:
        speed = record.speed - np.mean(record.speed)
        # A Hann window: the record's ends differ, and their jump would leak into every frequency.
        power = np.cumsum(np.abs(np.fft.rfft(speed * np.hanning(len(speed)))) ** 2)
        found.append(max(int(np.searchsorted(power, THRESHOLDS.heard * power[-1])), 1) / (len(speed) * record.dt))
    return max(found)
