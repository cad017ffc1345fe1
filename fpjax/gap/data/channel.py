"""Channel: one sensor's column with its noise, its rounding step and its number of independent readings."""

from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float, Int, Num

from ...logs.arrays import Values
from ...logs.noise import even_pieces, noise_level, rounding_step
from .octaves import details, gains

OCTAVES = 3  # the fastest ones, in which a motion hardly shows, or the column is not called counted
PIECE = 16  # samples of a piece, at the slowest octave's own rate


@dataclass(frozen=True)
class Channel:
    """One sensor's column, its noise and its rounding.

    Attributes:
        values: float64, shape (samples,).
        noise: standard deviation of one sample, rounding included, in the column's unit.
        step: the column is rounded to multiples of it; 0 where no rounding is seen.
        counted: whether it holds differences of a counter, of which `step` is one count (a rate alone).
    """

    values: Float[Values, " samples"]
    noise: float
    step: float
    counted: bool = False

    def runs(self, starts: Int[Values, " windows"], samples: int) -> Float[Values, " windows"]:
        """Samples per distinct reading in each window [1], shape (windows,).

        Rounding is white noise only while the signal crosses about one count a sample. In slower motion a run of `n`
        equal readings has the information of one reading, so each of its samples gets `n` times the variance.

        Args:
            starts: first sample of each window, shape (windows,).
            samples: length of a window.
        """
        if self.step == 0.0:
            return np.ones(len(starts))
        # Number of changes up to each sample, shape (samples,); half a step, so that float noise is no change.
        changed = np.concatenate([[0], np.cumsum(np.abs(np.diff(self.values)) > 0.5 * self.step)])
        last = np.minimum(starts + samples - 1, len(changed) - 1)
        distinct = changed[last] - changed[starts] + 1
        # A reading of a sensor that is noisier than its step changes at every sample anyway.
        return np.maximum(samples / distinct, 1.0)


def make_channel(values: Num[Values, " samples"], *, rate: bool = False) -> Channel:
    """A channel of a column, its noise and its rounding estimated from it.

    Args:
        values: shape (samples,).
        rate: whether it is a velocity, which may be counted.
    """
    values = np.asarray(values, float)
    step = rounding_step(values)
    return Channel(values, noise_level(values, step), step, rate and is_counted(values, step))


def is_counted(values: Num[Values, " samples"], step: float) -> bool:
    """Whether a column holds differences of a counter, whose rounding is most of what its fastest octaves hold.

    A rate that is the difference of two counts has the difference of two rounding errors, whose spectrum falls towards
    slow frequencies: in the fastest octave up to twice what a rounded rate has, which passes for noise that dithers the
    steps, in the third half of it. A rounded rate, or one that is dithered, has as much in all.

    Args:
        values: shape (samples,).
        step: that they are rounded to; 0 for none.
    """
    length = PIECE << OCTAVES
    if step == 0.0 or len(values) < 2 * length:
        return False
    pieces = even_pieces(np.asarray(values, float))
    pieces = pieces[:, : pieces.shape[1] // length * length]
    parts = np.stack([details(piece, OCTAVES)[0] for piece in pieces], 1).reshape(OCTAVES, -1, length)
    # Readings that stay the same tell nothing of how they change; an outlier or a corner is in few pieces.
    moves = np.any(np.diff(pieces.reshape(-1, length), axis=1) != 0.0, axis=1)
    if not np.any(moves):
        return False
    found = np.median(np.sqrt(np.mean(parts[:, moves] ** 2, axis=2)), axis=1) / (step / np.sqrt(12.0))
    rounded, counted = gains(OCTAVES), gains(OCTAVES, (1.0, -1.0))
    # By the geometric mean of both laws, nearer to this one; and it makes half of the energy there is in each octave.
    nearer = found[0] / found[1] > np.sqrt(counted[0] / counted[1] * rounded[0] / rounded[1])
    return bool(nearer and found[0] > np.sqrt(counted[0] * rounded[0]) and np.all(found < np.sqrt(2.0) * counted))


def common_noise(channels: list[Channel | None]) -> list[Channel | None]:
    """Channels of one sensor in several logs, each with the noise of the log in which it is largest.

    Smoothing before storage makes a log quieter from sample to sample and adds no information.
    """
    noise = max((channel.noise for channel in channels if channel is not None), default=0.0)
    return [None if channel is None else replace(channel, noise=noise) for channel in channels]
