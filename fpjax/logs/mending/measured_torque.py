"""Delay and gain of a measured torque against the commanded one."""

from typing import NamedTuple

import numpy as np

LONGEST = 0.1  # [s]: a signal that is later is not this torque's measurement
LOOKED_AT = 200_000  # [samples]
LIKE = 0.5  # correlation below which the two are unrelated
SAME = 1e-6  # of the torque's rms: what the digits of a text file leave


def constant_ratio(torque: np.ndarray, measured: np.ndarray) -> float | None:
    """The constant torque / measured where it is the same in every row, else None.

    Such a torque column was computed from the measured one and was never commanded.

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
        lag: delay of the measured torque behind the commanded one [s].
        gain: measured over commanded, in their units.
        correlation: of the changes of the two at that lag [1].
    """

    lag: float
    gain: float
    correlation: float


def following(commanded: np.ndarray, measured: np.ndarray, dt: float) -> Followed | None:
    """Delay and gain of the measured torque where the two correlate most; None where they do not correlate at any lag.

    The correlation is that of the slightly smoothed changes, since slow signals correlate at any lag. A parabola
    through its largest three values gives the lag between the samples.

    Args:
        commanded: shape (samples,).
        measured: at the same times, shape (samples,).
        dt: [s].
    """
    first, second = np.diff(commanded[:LOOKED_AT]), np.diff(measured[:LOOKED_AT])
    if first.size < 32 or not np.ptp(first) > 0.0 or not np.ptp(second) > 0.0:
        return None
    # Rounding makes single changes meaningless: changes are summed over 5 % of the longest lag (5 ms).
    width = int(np.clip(round(0.05 * LONGEST / dt), 1, max(first.size // 50, 1)))
    if width > 1:
        first, second = (np.convolve(each, np.ones(width), "valid") for each in (first, second))
    first, second = first - first.mean(), second - second.mean()
    most = int(min(round(LONGEST / dt), first.size // 4))
    # cross-correlation by FFT, zero-padded to twice the length so that it is not circular
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


def related(commanded: np.ndarray, measured: np.ndarray) -> bool:
    """Whether the two levels correlate, whatever their changes do: under noise, slow torques have changes of their own.

    Args:
        commanded: shape (samples,).
        measured: at the same times, shape (samples,).
    """
    first, second = commanded[:LOOKED_AT] - commanded.mean(), measured[:LOOKED_AT] - measured.mean()
    power = float(np.sqrt((first @ first) * (second @ second)))
    return power > 0.0 and abs(float(first @ second)) >= LIKE * power
