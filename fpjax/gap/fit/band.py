"""Band: the frequencies in which the missing torque is measured, and the sensors' noise that is really there."""

from collections.abc import Sequence

import numpy as np

from ...logs.arrays import Values
from ..data.record import Record
from ..data.torque_noise import TorqueNoise
from ..thresholds import THRESHOLDS
from .modes import Modes

QUIET = 0.3  # share of torque in a mode's variance below which the mode serves to estimate the noise
SILENT = 1e-6  # energy over that of noise [1]: less in every mode is none
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
    noise = np.sum([np.sum(modes.variance(own), axis=0) for own, _ in coefficients], axis=0)
    count, found = sum(len(own) for own, _ in coefficients), level.copy()
    for band in range(modes.bands):
        own = (modes.band == band) & ~modes.sensor
        if np.any(own):
            # A sum of n squares of variance s^2 has a standard deviation of s^2 sqrt(2 n); E[c^2] - s^2 = q^2 lambda.
            energy = float(np.sum(squares[own] - noise[own]))
            if energy > THRESHOLDS.octave * np.mean(noise[own]) * np.sqrt(2.0 * np.sum(own) / count):
                found[band] = max(found[band], np.sqrt(energy / (count * np.sum(modes.gain[own]))))
    return found


def unanswered(modes: Modes, level: Values, there: Values) -> Values:
    """What the readings hold beyond noise that is no torque, by octave, as a torque [N m], shape (bands,).

    Where the command and the inertial torque together are far below the torque that seems to be missing, that is no
    torque: a machine moves by what acts on it. It is rounding, jitter of the stamps or a vibration of the sensor, which
    the inertia times their second derivative makes look like a torque. It counts as noise of the readings.

    Args:
        modes: of a window.
        level: q of the nominal model, its numbers free, shape (bands,) [N m].
        there: mean square of the command and of the inertial torque in each mode [N^2 m^2], shape (modes,).
    """
    found = np.zeros(modes.bands)
    for band in range(modes.bands):
        own = (modes.band == band) & ~modes.sensor
        if np.any(own):
            # A missing torque is a command less an inertial torque, and (a - b)^2 is at most 2 (a^2 + b^2).
            found[band] = np.sqrt(max(level[band] ** 2 - 2.0 * float(np.mean(there[own])), 0.0))
    return found


def unfelt(modes: Modes, noises: Sequence[TorqueNoise]) -> Values:
    """What is left of the noise of measured torques, by octave [N m], shape (bands,): the simulations feel it alone.

    Args:
        modes: of a window.
        noises: what is left in each log.
    """
    found = np.zeros(modes.bands)
    for band in range(modes.bands):
        own = (modes.band == band) & ~modes.sensor
        if noises and np.any(own):
            found[band] = np.sqrt(np.mean([noise.left(modes.frequency[own]) ** 2 for noise in noises]))
    return found


def real_noise(modes: Modes, level: Values, coefficients: Coefficients) -> float:
    """Measured over assumed variance of the sensors' noise, from modes that hold hardly any torque [1].

    At most 1: rounding of slow motion has less noise than assumed, and noise's share of the missing torque must not be
    taken out twice.
    """
    ratios = [np.zeros(0)]
    for noise, c in coefficients:
        variance = modes.variance(noise)
        quiet = (modes.wiener(level, noise) < QUIET) & (variance < (1.0 + QUIET) * noise[:, None]) & ~modes.sensor
        # A machine at rest under readings that stay the same tells nothing of their noise in motion.
        silent = np.max(c**2 / variance, axis=1) < SILENT
        ratios.append((c**2 / variance)[quiet & ~silent[:, None]])
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
