"""The course of the missing torque over time, from the same posterior as its level, and its variance by sensor noise.

d = V diag(band) c / sqrt(lambda): the coefficients c of a fit's residual in the modes of a window (`fit/modes.py`)
pass the Wiener filter of the nominal model's missing torque and are turned back into a torque. The courses of all
models pass the same filter, so that they can be compared, and the mean square of a course, noise's share taken out, is
the square of the reported gap.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from ...logs.arrays import Values
from ..fit.candidate import Fit
from ..fit.search import Search


@dataclass(frozen=True)
class Course:
    """Missing torque of one model along one log.

    Attributes:
        torque: that the real machine has and the model lacks [N m], shape (samples,); NaN outside windows.
        noise: variance of `torque` by the sensors' noise [N^2 m^2], shape (samples,); NaN outside windows.
        frequency: of the modes [Hz], shape (modes,).
        power: mean square of the missing torque by mode, noise's share taken out [N^2 m^2], shape (modes,).
        spread: standard deviation of `power` by noise [N^2 m^2], shape (modes,).
        independent: independent values of noise for each sample [1], at most 1: the filter correlates neighbours.
    """

    torque: Float[Values, " samples"]
    noise: Float[Values, " samples"]
    frequency: Float[Values, " modes"]
    power: Float[Values, " modes"]
    spread: Float[Values, " modes"]
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
    # Shapes: c (windows, modes), torque and variance (windows, samples). Modes that hold no torque, only a disagreement
    # of the two sensors, are left out.
    root = search.measure.root(fitter.noise[which][windows], fitter.torque_scale(fit.candidate))
    c = modes.plain(fitter.coefficients([fit.candidate], which, windows)[0])
    noise = modes.variance(search.real_noise * fitter.noise[which][windows])
    # The residual is simulated minus measured, so that the torque that the model lacks has the opposite sign.
    torque = -(c * root) @ modes.torque.T
    variance = (noise * root**2) @ (modes.torque**2).T
    place = record.rows()
    found, spread = (np.full(len(record.time), np.nan) for _ in range(2))
    found[place], spread[place] = torque, variance
    torques = ~modes.sensor
    weight = root[:, torques] ** 2 / record.samples
    # Of white noise of variance s^2: E c^2 = s^2 is taken off, var(c^2) = 2 s^4.
    power = np.mean(weight * (c[:, torques] ** 2 - noise[:, torques]), axis=0)
    deviation = np.sqrt(2.0 * np.sum((weight * noise[:, torques]) ** 2, axis=0)) / len(noise)
    # Degrees of freedom of the filtered noise, (sum of variances)^2 / sum of their squares (Satterthwaite), per sample.
    usual = np.mean(root**2, axis=0)
    independent = float(np.sum(usual) ** 2 / max(np.sum(usual**2), 1e-300)) / record.samples
    return Course(found, spread, modes.frequency[torques], power, deviation, min(max(independent, 1e-6), 1.0))
