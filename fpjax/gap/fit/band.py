"""Band: in which frequencies a missing torque is told, and how much noise is really there."""

from collections.abc import Sequence

import numpy as np

from ..data.record import Record
from .modes import Modes

HEARD = 0.99  # of the speed's power: above the frequency that holds it, a torque moves less and less
CHANCE = 3.0  # standard deviations of the noise's energy, below which an octave's is noise
QUIET = 0.3  # share of a mode's variance that is torque, below which it shows the noise
FEW_QUIET = 30  # coefficients: fewer do not tell a variance

Values = np.ndarray
Coefficients = Sequence[tuple[Values, Values]]
"""(noise s^2 of each window, shape (windows,); plain coefficients, shape (windows, modes)), one entry a record."""


def level_with_bursts(modes: Modes, level: Values, coefficients: Coefficients) -> Values:
    """q by octave [N m], bursts included, shape (bands,): a log that is quiet but for a few pushes has no level.

    Args:
        modes: of a window.
        level: without its bursts, shape (bands,).
        coefficients: of the fit.
    """
    squares = np.sum([np.sum(c**2, axis=0) for _, c in coefficients], axis=0)
    noise = sum(float(np.sum(own)) for own, _ in coefficients)
    count, found = sum(len(own) for own, _ in coefficients), level.copy()
    for band in range(modes.bands):
        own = (modes.band == band) & ~modes.sensor
        if np.any(own):
            energy, chance = float(np.sum(squares[own] - noise)), CHANCE * noise * np.sqrt(2.0 * np.sum(own) / count)
            if energy > chance:
                found[band] = max(found[band], np.sqrt(energy / (count * np.sum(modes.gain[own]))))
    return found


def real_noise(modes: Modes, level: Values, coefficients: Coefficients) -> float:
    """Variance of modes that hold hardly any torque, over what the sensors' noise says [1].

    At most 1: rounding of slow motion is less than a sample's variance says, and must not be taken off twice.
    """
    ratios = [np.zeros(0)]
    for noise, c in coefficients:
        quiet = modes.wiener(level, noise) < QUIET
        ratios.append((c**2 / noise[:, None])[quiet & ~modes.sensor])
    found = np.concatenate(ratios)
    # The median of a chi-square of one degree of freedom: a few modes with a torque in them do not count.
    return float(min(np.median(found) / 0.4549, 1.0)) if len(found) > FEW_QUIET else 1.0


def highest_of_speed(records: Sequence[Record]) -> float:
    """Frequency [Hz] below which nearly all of the speed's power lies."""
    found = []
    for record in records:
        speed = record.speed - np.mean(record.speed)
        power = np.cumsum(np.abs(np.fft.rfft(speed * np.hanning(len(speed)))) ** 2)
        found.append(max(int(np.searchsorted(power, HEARD * power[-1])), 1) / (len(speed) * record.dt))
    return max(found)
