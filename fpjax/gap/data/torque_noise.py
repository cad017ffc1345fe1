"""Noise of a measured torque that no machine feels: found where nothing else that was recorded answers it, taken out.

A current that is sampled at one moment holds white noise, often a tenth of itself. As a torque it would shake the
simulation, and whatever filters a torque would seem likelier than a right model. What the machine feels, or what a loop
makes of its sensors' noise, is not that: readings or reference tell of it, linearly and within some samples. So the
noise is at most what they leave unexplained, in every octave, and white.

Octaves are those of `fpjax.gap.data.octaves`. Edges of the torque stand above its noise in them and stay.
"""

import dataclasses
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ...logs import Log
from ...logs.arrays import Values
from ...logs.noise import noise_level
from ..thresholds import THRESHOLDS
from .octaves import details, gains, passed

GAUSSIAN = 1.4826  # standard deviations of Gaussian noise in its median absolute value
EDGE = 3.5  # standard deviations of the noise from which a value is the torque's: one of 2,000 of noise alone
LAGS = 3  # samples on either side, at an octave's own rate, in which a reading may answer
ENOUGH = 10  # values of an octave for each weight of that answer
BY_CHANCE = 1e-3  # lines that noise alone may show in an octave
MOST = 0.5  # of the torque's rms [1]: a column with more noise is no measurement
SHOWS = 3.0  # of a sensor's noise in an octave [1]: a motion that large would have answered nine tenths of the torque
EXCESS = 0.1  # of the noise's power [1] that an octave may hold beside it and still be noise alone
LOOKED_AT = 100_000  # samples


@dataclass(frozen=True)
class TorqueNoise:
    """What was found in a measured torque.

    Attributes:
        size: standard deviation of the noise [N m].
        taken: whether it was taken out, by octave, the fastest first.
        dt: control period [s].
    """

    size: float
    taken: tuple[bool, ...]
    dt: float

    def left(self, frequency: Values) -> Values:
        """Standard deviation of white noise that is as dense as what is left of it at frequencies [Hz], [N m]."""
        octaves, rest = passed(frequency * self.dt, len(self.taken))
        kept = [own for own, taken in zip(octaves, self.taken, strict=True) if not taken]
        return self.size * np.abs(np.sum([rest, *kept], axis=0))


def torque_noise(log: Log, inertia: float, viscous: float) -> float:
    """Standard deviation of the white noise of a log's torque that nothing else recorded answers [N m].

    0 where it would be too little to matter (`nothing`), where it would be most of the torque (an excitation by noise,
    with a sensor that shows little of it), and where the machine could have felt it without that the sensors would
    show it. A torque that was commanded has none: its loop's noise, or an excitation, shows in what else
    was recorded. Whether a column was measured its name does not always say.

    Args:
        log: as recorded.
        inertia: nominal J [kg m^2].
        viscous: nominal B [N m s/rad].
    """
    part = slice(0, LOOKED_AT)
    torque, *columns = (
        None if one is None else np.asarray(one, float)[part]
        for one in (log.torque, log.velocity, log.position, log.reference)
    )
    assert torque is not None
    columns = [None if one is None or not np.ptp(one) else one for one in columns]
    weights = (2 * LAGS + 1) * sum(one is not None for one in columns)
    # Resampling takes a part of the noise in the fastest octave; the slowest must hold enough values for an answer.
    first = 1 if log.resampled else 0
    octaves = first + 1
    while len(torque) >> (octaves + 1) >= ENOUGH * max(weights, 1):
        octaves += 1
    found = _unanswered(torque, [one for one in columns if one is not None], octaves)[first:].min()
    size = float(np.sqrt(np.mean(torque**2)))
    if not THRESHOLDS.nothing * size < found < MOST * size:
        return 0.0
    frequency = np.arange(1, len(torque) // 2 + 1) / len(torque)
    moved = found / np.abs(2j * np.pi * frequency / log.dt * inertia + viscous)
    looked = passed(frequency, octaves)[0][first:]
    for order, one in enumerate(columns[:2]):  # the velocity, the position
        if one is not None and _shows(moved / (2.0 * np.pi * frequency / log.dt) ** order, noise_level(one), looked):
            return float(found)
    return 0.0


def _shows(motion: Values, noise: float, octaves: Sequence[Values]) -> bool:
    """Whether a motion stands far above a sensor's noise in some octave.

    Args:
        motion: its standard deviation by frequency, as that of white noise, shape (frequencies,), in the sensor's unit.
        noise: of the sensor, in its unit.
        octaves: what each passes, each of shape (frequencies,) [1].
    """
    return any(np.sum((own * motion) ** 2) > SHOWS**2 * noise**2 * np.sum(own**2) for own in octaves)


def _unanswered(torque: Values, others: Sequence[Values], octaves: int) -> Values:
    """Standard deviation of the white noise that columns leave unexplained of a torque in each octave [N m]."""
    weights = (2 * LAGS + 1) * len(others)
    columns = [details(one, octaves)[0] for one in others]
    found = []
    for octave, own in enumerate(details(torque, octaves)[0]):
        least = _spread(own)
        reach = LAGS << octave
        rows = np.arange(reach, len(own) - reach)
        # Edges of torque and motion would be fitted alone.
        rows = rows[np.abs(own[rows]) < EDGE * least]
        values = max(len(rows) >> octave, 1)
        if columns and values > 2 * weights:
            table = np.stack(
                [one[octave][rows + (lag << octave)] for one in columns for lag in range(-LAGS, LAGS + 1)], 1
            )
            table = table / np.maximum(np.sqrt(np.mean(table**2, axis=0)), 1e-300)
            left = own[rows] - table @ np.linalg.lstsq(table, own[rows], rcond=1e-10)[0]
            least = min(least, _spread(left) / np.sqrt(1.0 - weights / values))
        found.append(least)
    return np.array(found) / gains(octaves)


def _spread(values: Values) -> float:
    return GAUSSIAN * float(np.median(np.abs(values)))


def without_noise(log: Log, noise: float) -> tuple[Log, TorqueNoise]:
    """(the log without that noise of its torque, in the octaves in which nothing but noise and edges is; what is left).

    These are the fastest ones. Next to an octave that holds more one stays as it is, since a slow torque reaches into
    it, and all that are slower stay.

    Args:
        log: as recorded.
        noise: of `torque_noise` [N m].
    """
    torque = np.asarray(log.torque, float)
    if noise == 0.0:
        return log, TorqueNoise(0.0, (), float(log.dt))
    count = max(int(np.log2(len(torque) / 8)), 1)
    parts, rest = details(torque, count)
    edges = [np.abs(own) > EDGE * noise * size for own, size in zip(parts, gains(count), strict=True)]
    noisy = [_is_noise(own, edge, noise, octave) for octave, (own, edge) in enumerate(zip(parts, edges, strict=True))]
    fast = count if all(noisy) else max(noisy.index(False) - 1, 0)
    taken = tuple(octave < fast for octave in range(count))
    for own, edge, gone in zip(parts, edges, taken, strict=True):
        rest = rest + (np.where(edge, own, 0.0) if gone else own)
    return dataclasses.replace(log, torque=rest), TorqueNoise(noise, taken, float(log.dt))


def _is_noise(values: Values, edge: Values, noise: float, octave: int) -> bool:
    """Whether an octave of a torque holds no more than white noise but at its edges, neither as power nor as a line of
    its spectrum.
    """
    values = np.where(edge, 0.0, values)
    frequency = np.arange(len(values) // 2 + 1) / len(values)
    expected = passed(frequency, octave + 1)[0][octave] ** 2
    density = np.abs(np.fft.rfft(values)) ** 2 / len(values) / noise**2
    own = expected > 0.1
    doubt = 2.0 * np.sqrt(2.0 / max(len(values) >> octave, 1))
    power = np.sum(density) / np.sum(expected) * len(edge) / max(np.sum(~edge), 1)
    # The power of a bin over its mean is exponentially distributed: exp(-x) of them exceed x.
    line = float(np.max(density[own] / expected[own], initial=0.0))
    return bool(power < 1.0 + EXCESS + doubt and line < np.log(np.sum(own) / BY_CHANCE))


def about_torque_noise(log: Log, noise: TorqueNoise) -> str:
    """What was noticed of a measured torque and done."""
    effort, unit = ("force", "N") if log.linear else ("torque", "N m")
    said = (
        f"{log.name}: the {effort} holds white noise of {noise.size:.3g} {unit} rms that no reading answers, as a "
        "measured one does"
    )
    if not any(noise.taken):
        return f"{said}: it counts as noise."
    slowest = 0.5 / noise.dt / 2.0 ** sum(noise.taken)
    return f"{said}: above {slowest:.3g} Hz it was taken out before the gap was measured, and below it counts as noise."
