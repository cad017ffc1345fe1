"""The one place where a motion is differentiated and integrated over time.

Three kinds of signals need three methods. A sensor reading has noise of unknown size: `local_polynomial` with the width
that `quiet_half` finds best; `smooth_motion` gives velocity and position this way. An observer gets a velocity behind a
low-pass of a stated cutoff: `measured_velocity`. A reference or a simulated motion has no noise: central differences,
`slope`.

numpy only, float64.
"""

import math
from typing import Any, Literal

import numpy as np
from jaxtyping import Float

from ...errors import InputError
from ..arrays import Values
from ..log import Log
from ..noise import even_pieces, noise_level

Differentiator = Literal["zero_phase", "causal"]

CUTOFF = 0.1  # of the control rate: the low-pass of `measured_velocity`, where none is given


def slope(values: Values, dt: float) -> Values:
    """Rate of change of a signal without noise [unit/s]: central differences, one-sided at both ends.

    Args:
        values: a reference or a simulated motion, shape (samples,).
        dt: from sample to sample [s].
    """
    return np.gradient(np.asarray(values, dtype=np.float64), dt)


def travel(velocity: Values, dt: float) -> Values:
    """Position [rad] at each sample, 0 at the first: the velocity integrated by the trapezoidal rule.

    Args:
        velocity: [rad/s], shape (samples,).
        dt: from sample to sample [s].
    """
    velocity = np.asarray(velocity, dtype=np.float64)
    return np.concatenate([[0.0], np.cumsum(0.5 * dt * (velocity[1:] + velocity[:-1]))])


def smooth_motion(velocity: Values | None, position: Values | None, dt: float) -> tuple[Values, Values]:
    """(velocity with little noise, position), each from the other where one is missing.

    Args:
        velocity: as it was read [rad/s], shape (samples,); None where there is none.
        position: as it was read [rad], shape (samples,); None where there is none, then the angle begins at 0.
        dt: from sample to sample [s].

    Raises:
        InputError: without either of them.
    """
    if velocity is not None:
        speed = local_polynomial(velocity, quiet_half(velocity, noise_level(velocity), derivative=0))
        return speed, travel(velocity, dt) if position is None else position
    if position is None:
        raise InputError("A motion needs a velocity or a position: map one of the log's columns to it.")
    half = quiet_half(position, noise_level(position))
    return local_polynomial(position, half, dt=dt, derivative=1), position


def measured_velocity(
    log: Log, *, differentiator: Differentiator = "zero_phase", cutoff: float | None = None
) -> tuple[Float[Values, " samples"], str]:
    """Velocity [rad/s] at the start of each period, shape (samples,), and a phrase on how it was obtained.

    Args:
        log: with velocity or position.
        differentiator: "zero_phase" or "causal", see `fpjax.estimate`.
        cutoff: of the low-pass on a differentiated position [Hz]; None for a tenth of the control rate.

    Raises:
        InputError: for a log without motion, and for an invalid cutoff.
    """
    if log.velocity is not None:
        return np.asarray(log.velocity, dtype=float), "as logged"
    if log.position is None:
        raise InputError(f"{log.name} has neither velocity nor position: an observer needs the motion.")
    frequency = CUTOFF * log.rate if cutoff is None else float(cutoff)
    if not 0.0 < frequency < 0.5 * log.rate:
        raise InputError(f"cutoff must lie between 0 and {0.5 * log.rate:g} Hz, got {frequency:g} Hz.")
    if differentiator not in ("zero_phase", "causal"):
        raise InputError(f'differentiator = {differentiator!r} is not known: choose "zero_phase" or "causal".')
    from scipy import signal  # takes a second to import, and most commands need none of it

    position = np.asarray(log.position, dtype=float)
    if differentiator == "zero_phase":
        # forward and backward: the fourth-order filter is applied twice, so its phase cancels and its attenuation
        # doubles
        low_pass: Any = signal.butter(4, 2.0 * frequency / log.rate)
        smooth = signal.filtfilt(low_pass[0], low_pass[1], position)
        return slope(smooth, log.dt), (
            f"by central differences of the position, zero-phase low-pass at {frequency:.4g} Hz"
        )
    keep = math.exp(-2.0 * math.pi * frequency * log.dt)
    difference = np.diff(position, prepend=position[0]) / log.dt
    # half a period of the difference, and keep / (1 - keep) periods of the first-order low-pass
    late = (0.5 + keep / (1.0 - keep)) * log.dt
    how = f"by backward differences of the position, low-pass at {frequency:.4g} Hz, {1e3 * late:.3g} ms late"
    return np.asarray(signal.lfilter([1.0 - keep], [1.0, -keep], difference)), how


def local_polynomial(values: Values, half: int, *, dt: float = 1.0, degree: int = 2, derivative: int = 0) -> Values:
    """Value or derivative of a polynomial fitted to 2 half + 1 samples around each (Savitzky, Golay, 1964).

    At the ends, where the window would leave the log, the polynomial of the first and of the last whole window is
    evaluated off its centre.

    Args:
        values: shape (samples,), at least degree + 1 of them.
        half: samples on either side; limited to what the length of the log and the degree allow.
        dt: from sample to sample [s].
        degree: of the polynomial: 2 for velocities, 3 or 4 for accelerations with less bias.
        derivative: 0 for the value, 1 for the slope [unit/s], 2 for the curvature [unit/s^2].
    """
    values = np.asarray(values, dtype=np.float64)
    half = min(max(int(half), (degree + 1) // 2), (values.size - 1) // 2)
    degree = min(degree, 2 * half)
    if derivative > degree:
        return np.zeros_like(values)
    # places from -1 to 1: powers of sample numbers up to 400 would make the least squares ill-conditioned
    places = np.arange(-half, half + 1) / max(half, 1)
    powers = places[:, None] ** np.arange(degree + 1)
    solve = np.linalg.pinv(powers)  # coefficients of each power, from the samples
    # m-th derivative at the centre: m! times the m-th coefficient, over (half dt)^m for the scaled places
    scale = float(np.prod(np.arange(1, derivative + 1))) / (max(half, 1) * dt) ** derivative
    found = np.empty_like(values)
    found[half : values.size - half] = np.convolve(values, solve[derivative][::-1], "valid") * scale
    steps = np.arange(derivative, degree + 1)
    # d^m/dx^m of x^k is k (k - 1) ... (k - m + 1) x^(k - m)
    factors = np.array([np.prod(np.arange(k - derivative + 1, k + 1)) for k in steps])
    slope = places[:, None] ** (steps - derivative) * factors
    unit = 1.0 / (max(half, 1) * dt) ** derivative
    found[:half] = (slope @ (solve[steps] @ values[: 2 * half + 1]) * unit)[:half]
    found[values.size - half :] = (slope @ (solve[steps] @ values[-(2 * half + 1) :]) * unit)[half + 1 :]
    return found


def quiet_half(values: Values, noise: float, *, degree: int = 2, derivative: int = 1, widest: int = 400) -> int:
    """The half-width [samples] whose local polynomial has the least mean squared error, noise and bias together.

    The noise that passes a given width is known. The bias is estimated from the difference between the fits of the full
    and of half the width, beyond what noise explains: the wider fit is the best unbiased one on its window, so the
    variance of the difference is the difference of the two variances.

    Args:
        values: shape (samples,).
        noise: standard deviation of one reading, from `noise_level`, in the unit of values.
        degree: of the polynomial.
        derivative: which one is wanted with the least error; 1 for a velocity.
        widest: largest half-width that is tried [samples].
    """
    pieces = even_pieces(np.asarray(values, dtype=np.float64).ravel(), 20_000)
    half = narrow = max((degree + 1) // 2, 1)
    best, least = narrow, (_noise_gain(narrow, degree, derivative) * noise) ** 2
    while True:
        half, narrow = max(half + 1, round(1.25 * half)), max((degree + 1) // 2, 1, half // 2)
        if half > min(widest, (pieces.shape[1] - 1) // 4):
            return best
        away = [
            local_polynomial(piece, half, degree=degree, derivative=derivative)
            - local_polynomial(piece, narrow, degree=degree, derivative=derivative)
            for piece in pieces
        ]
        inner = np.concatenate([difference[half:-half] for difference in away])
        wide_noise = (_noise_gain(half, degree, derivative) * noise) ** 2
        narrow_noise = (_noise_gain(narrow, degree, derivative) * noise) ** 2
        bias = max(float(np.mean(inner**2)) - max(narrow_noise - wide_noise, 0.0), 0.0)
        if bias + wide_noise < least:
            best, least = half, bias + wide_noise
        # The bias grows with the width from here on: wider windows need not be tried. The factor 4 keeps one noisy
        # estimate of the bias from ending the search.
        elif bias > 4.0 * least:
            return best


def _noise_gain(half: int, degree: int, derivative: int) -> float:
    """Standard deviation of the estimate at the window's centre, for white noise of standard deviation 1 and dt = 1."""
    powers = (np.arange(-half, half + 1) / half)[:, None] ** np.arange(degree + 1)
    weights = np.linalg.pinv(powers)[derivative] * np.prod(np.arange(1.0, derivative + 1)) / half**derivative
    return float(np.sqrt(weights @ weights))
