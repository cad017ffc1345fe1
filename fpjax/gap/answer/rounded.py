"""Rounded: what the rounding of the readings makes of the missing torque, in a log's own motion."""

import math
from collections.abc import Sequence

import numpy as np

from ...logs.arrays import Values
from ..data.channel import Channel
from ..data.octaves import details, gains
from ..fit.candidate import Fit
from ..fit.search import Search

# A reading whose rounding step is above this many standard deviations of its noise is one that is rounded: rounding, of
# standard deviation step / sqrt(12), is then half of the noise's energy. Below that the other half dithers it away.
ROUNDED = math.sqrt(6.0)
FASTEST = 2  # octaves, in which a motion hardly shows


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
                step = one.step / one.noise
                # The measured readings lie on the grid, so that a rounded simulation is whole steps from them.
                away = errors[place] / step
                if is_counted(one):
                    away = np.cumsum(away, axis=0)
                    away -= np.mean(away, axis=0)  # counts, up to where between two of them the window begins
                    own[place][place] = step * np.diff(np.round(away) - away, axis=0, prepend=0.0)
                else:
                    own[place][place] = step * (np.round(away) - away)
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
    return channel.step > ROUNDED * channel.noise or is_counted(channel)


def is_counted(channel: Channel) -> bool:
    """Whether a column holds differences of a counter, whose rounding is most of what its fastest octaves hold.

    A rate that is the difference of two counts has the difference of two rounding errors: little of a slow motion, and
    of a fast one up to twice what a rounded rate has, which passes for noise that dithers it. It falls with the
    frequency, as white noise does not.

    Args:
        channel: of the column.
    """
    if channel.step == 0.0:
        return False
    parts = [np.sqrt(np.mean(own**2)) for own in details(channel.values, FASTEST)[0]]
    rounded, counted = (gains(FASTEST, weights) for weights in ((1.0,), (1.0, -1.0)))
    found, law = parts / rounded / (channel.step / math.sqrt(12.0)), counted / rounded
    # Nearer to it than to white noise, by the geometric mean of both.
    nearer = found[0] > math.sqrt(law[0]) and found[0] / found[1] > math.sqrt(law[0] / law[1])
    return bool(nearer and np.all(found < math.sqrt(2.0) * law))


def _power(search: Search, place: int, channels: int) -> Values:
    """Variance of plain coefficients under white noise of one channel, over that of noise of all, shape (modes,)."""
    rows = np.split(search.modes.basis, channels)[place] @ search.modes.turn.T
    return np.sum(rows**2, axis=0)
