"""Channel: one sensor's column with its noise, its rounding step and its number of independent readings."""

from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float, Int, Num

from ...logs.arrays import Values
from ...logs.noise import noise_level, rounding_step


@dataclass(frozen=True)
class Channel:
    """One sensor's column, its noise and its rounding.

    Attributes:
        values: float64, shape (samples,).
        noise: standard deviation of one sample, rounding included, in the column's unit.
        step: the column is rounded to multiples of it; 0 where no rounding is seen.
    """

    values: Float[Values, " samples"]
    noise: float
    step: float

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


def make_channel(values: Num[Values, " samples"]) -> Channel:
    """A channel of a column of shape (samples,), its noise and its rounding estimated from it."""
    values = np.asarray(values, float)
    step = rounding_step(values)
    return Channel(values, noise_level(values, step), step)


def common_noise(channels: list[Channel | None]) -> list[Channel | None]:
    """Channels of one sensor in several logs, each with the noise of the log in which it is largest.

    Smoothing before storage makes a log quieter from sample to sample and adds no information.
    """
    noise = max((channel.noise for channel in channels if channel is not None), default=0.0)
    return [None if channel is None else replace(channel, noise=noise) for channel in channels]
