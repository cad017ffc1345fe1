"""A torque that was measured beside the one that was commanded: how late it is, and how large."""

from typing import NamedTuple

import numpy as np

LONGEST = 0.1  # s: a lag beyond it is another signal
LOOKED_AT = 200_000  # samples
LIKE = 0.5  # correlation below which the two have nothing to do with each other


SAME = 1e-6  # of the torque's rms


def constant_ratio(torque: np.ndarray, measured: np.ndarray) -> float | None:
    """The one number that makes the torque of the measured one in every row; None where there is none.

    Such a torque was computed from the reading and never commanded.

    Args:
        torque: shape (rows,).
        measured: in the same rows, shape (rows,).
    """
    both = np.isfinite(torque) & np.isfinite(measured)
    power = float(measured[both] @ measured[both])
    if both.sum() < 32 or not np.ptp(torque[both]) > 0.0 or not power > 0.0:
        return None
    ratio = float(torque[both] @ measured[both]) / power
    left = torque[both] - ratio * measured[both]
    return ratio if float(np.max(np.abs(left))) <= SAME * float(np.sqrt(np.mean(torque[both] ** 2))) else None


class Followed(NamedTuple):
    """How a measured torque follows its command.

    Attributes:
        lag: [s]; positive where the measured one is later.
        gain: measured over commanded, in their units.
        correlation: of the two at that lag, of their changes [1].
    """

    lag: float
    gain: float
    correlation: float


def following(commanded: np.ndarray, measured: np.ndarray, dt: float) -> Followed | None:
    """The lag at which the measured torque is most like the commanded one; None where it is nowhere alike.

    The correlation is taken over slightly smoothed changes, since slow courses are alike at any lag, and read between
    the samples by a parabola.

    Args:
        commanded: shape (samples,).
        measured: at the same times, shape (samples,).
        dt: [s].
    """
    first, second = np.diff(commanded[:LOOKED_AT]), np.diff(measured[:LOOKED_AT])
    if first.size < 32 or not np.ptp(first) > 0.0 or not np.ptp(second) > 0.0:
        return None
    # rounding makes single changes of no meaning: as many samples together as a tenth of the longest lag
    width = int(np.clip(round(0.05 * LONGEST / dt), 1, max(first.size // 50, 1)))
    if width > 1:
        first, second = (np.convolve(each, np.ones(width), "valid") for each in (first, second))
    first, second = first - first.mean(), second - second.mean()
    most = int(min(round(LONGEST / dt), first.size // 4))
    size = 1 << int(np.ceil(np.log2(2 * first.size)))
    spectrum = np.conj(np.fft.rfft(first, size)) * np.fft.rfft(second, size)
    across = np.fft.irfft(spectrum, size)
    lags = np.arange(-most, most + 1)
    power = float(np.sqrt(first @ first) * np.sqrt(second @ second))
    like = across[lags] / power
    best = int(np.argmax(np.abs(like)))
    if abs(like[best]) < LIKE:
        return None
    shift = 0.0
    if 0 < best < like.size - 1:
        below, here, above = (float(abs(like[best + k])) for k in (-1, 0, 1))
        bend = below - 2.0 * here + above
        shift = 0.5 * (below - above) / bend if bend < 0.0 else 0.0
    gain = float(like[best]) * float(np.sqrt(second @ second) / np.sqrt(first @ first))
    return Followed(float((lags[best] + shift) * dt), gain, float(like[best]))
