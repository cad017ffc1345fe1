"""Rounded: what the rounding of the readings makes of the missing torque, in a log's own motion."""

import math
from collections.abc import Sequence

import numpy as np

from ...logs.arrays import Values
from ..data.channel import Channel
from ..fit.candidate import Fit
from ..fit.search import Search

# A reading whose rounding step is above this many standard deviations of its noise is one that is rounded: rounding, of
# standard deviation step / sqrt(12), is then half of the noise's energy. Below that the other half dithers it away.
ROUNDED = math.sqrt(6.0)


def rounding_of(search: Search, fit: Fit, windows: Sequence[Values] | None = None) -> tuple[float, float]:
    """What the rounding of the readings makes of the missing torque beside a model [N m].

    Rounding is white only in fast motion: a slow one that passes a step now and then reads as jumps, which no torque
    made. The simulated readings of the model are rounded as the measured ones are; where the model is right within a
    step, what that makes is what the model leaves.

    Args:
        search: of the logs.
        fit: of the model.
        windows: one array of indices for each log; None for the withheld ones.

    Returns:
        (of all readings, beyond what counts as noise, and no more than the model leaves; of the velocity, all of it).
    """
    windows = search.withheld if windows is None else windows
    fitter = search.fitters[fit.candidate.family.key]
    scale, beyond, of_velocity = fitter.torque_scale(fit.candidate), 0.0, 0.0
    for which, (record, chosen) in enumerate(zip(search.records, windows, strict=True)):
        channels = [one for one in (record.velocity, record.position) if one is not None]
        if not len(chosen) or not any(is_rounded(one) for one in channels):
            continue
        noise = fitter.noise[which][chosen]
        weight = search.measure.weight(noise, scale)
        errors = fitter.residuals(fit.candidate, which, chosen)
        own = [np.zeros_like(errors) for _ in channels]
        for place, one in enumerate(channels):
            if is_rounded(one):
                own[place][place] = rounding_error(errors[place], one.step / one.noise, counted=one.counted)
        squares = [search.modes.plain(search.modes.coefficients(each).T) ** 2 for each in (np.sum(own, axis=0), own[0])]
        coarse = [_power(search, place, len(channels)) for place, one in enumerate(channels) if is_rounded(one)]
        white = search.real_noise * noise[:, None] * np.sum(coarse, axis=0)
        beyond += max(float(np.sum((squares[0] - white) * weight)), 0.0)
        of_velocity += float(np.sum(squares[1] * weight)) if record.velocity is not None else 0.0
    count = max(sum(map(len, windows)), 1)
    most = fit.missing_rms(windows)
    return min(float(np.sqrt(beyond / count)), most) if beyond else 0.0, float(np.sqrt(of_velocity / count))


def is_rounded(channel: Channel) -> bool:
    """Whether a column's rounding is more than white noise.

    Args:
        channel: of the column.
    """
    return channel.step > ROUNDED * channel.noise or channel.counted


def rounding_error(residuals: Values, step: float, *, counted: bool) -> Values:
    """What rounding the simulated readings, as the measured ones are, adds to them; shape (samples, windows).

    Measured readings lie on the grid, so that a rounded simulation is whole steps from them. A counter adds up to a
    count that is rounded, of which a reading is the difference; where between two counts a window begins is not known.

    Args:
        residuals: simulated less measured readings, shape (samples, windows).
        step: of the grid, in their unit.
        counted: whether readings are differences of a counter.
    """
    away = residuals / step
    if not counted:
        return step * (np.round(away) - away)
    away = np.cumsum(away, axis=0)
    away -= np.mean(away, axis=0)
    return step * np.diff(np.round(away) - away, axis=0, prepend=0.0)


def _power(search: Search, place: int, channels: int) -> Values:
    """Variance of plain coefficients under white noise of one channel, over that of noise of all, shape (modes,)."""
    rows = np.split(search.modes.basis, channels)[place] @ search.modes.turn.T
    return np.sum(rows**2, axis=0)
