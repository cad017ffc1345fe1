"""Course: the missing torque over time, from the same posterior as its level, and what noise puts into it.

d = V diag(band) c / sqrt(lambda): the coefficients of a fit's residual, through the Wiener filter of the nominal
model's missing torque, back as a torque. Every model's course passes the same filter, so that they can be compared,
and the energy of a course is the square of the gap that is told.
"""

from dataclasses import dataclass

import numpy as np

from ..fit.candidate import Fit
from ..fit.search import Search

Values = np.ndarray


@dataclass(frozen=True)
class Course:
    """Missing torque of one model along one log.

    Attributes:
        torque: that the real machine has and the model lacks [N m], shape (samples,); NaN outside windows.
        noise: variance that the sensors' noise puts there [N^2 m^2], shape (samples,); NaN outside windows.
        frequency: of the modes [Hz], shape (modes,).
        power: mean square of the missing torque by mode, noise's share taken out [N^2 m^2], shape (modes,).
        spread: standard deviation that noise gives `power` [N^2 m^2], shape (modes,).
        independent: independent values of noise per sample [1].
    """

    torque: Values
    noise: Values
    frequency: Values
    power: Values
    spread: Values
    independent: float


def course_of(search: Search, fit: Fit, which: int) -> Course:
    """The course of a model's missing torque.

    Args:
        search: of the logs.
        fit: the model.
        which: index of the log.
    """
    record, modes, fitter = search.records[which], search.modes, search.fitters[fit.candidate.family.key]
    windows = np.arange(len(record.starts))
    share = np.where(modes.sensor, 0.0, search.band)
    root = np.where(modes.sensor | (modes.gain <= 0.0), 0.0, share / np.sqrt(np.maximum(modes.gain, 1e-300)))
    root = root * fitter.torque_scale(fit.candidate)
    c = modes.plain(fitter.coefficients([fit.candidate], which, windows)[0])
    noise = search.real_noise * fitter.noise[which][windows]
    # The residual is simulated less measured: what the model lacks has the other sign.
    torque = -(c * root) @ modes.torque.T
    variance = noise[:, None] * (modes.torque**2 @ root**2)
    place = record.starts[:, None] + np.arange(record.samples)
    found, spread = (np.full(len(record.time), np.nan) for _ in range(2))
    found[place], spread[place] = torque, variance
    torques = ~modes.sensor
    weight = root[torques] ** 2 / record.samples
    power = weight * np.mean(c[:, torques] ** 2 - noise[:, None], axis=0)
    deviation = weight * float(np.sqrt(2.0 * np.sum(noise**2))) / len(noise)
    whole = np.sum(root**2)
    independent = float(whole**2 / max(np.sum(root**4), 1e-300)) / record.samples
    return Course(found, spread, modes.frequency[torques], power, deviation, min(max(independent, 1e-6), 1.0))
