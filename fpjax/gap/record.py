# pyright: reportArgumentType=false, reportReturnType=false
"""Record: a log made ready for the fit: noise levels, smoothed motion, windows, tables."""

import functools
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import jax.numpy as jnp
import numpy as np

from ..errors import InputError
from ..logs.noise import quantisation as counts
from .replay import TAPS, Tables

WINDOW_SECONDS = 0.25
POSITION_SECONDS = 1.0  # without a rate sensor: what a torque does to a position grows with the square of the time
FEWEST = 12  # windows that a log without a rate sensor is cut into at least
SHORTEST = 64  # samples of a window
LONGEST = 1024
PAST = 384  # periods of the past that a hidden state is integrated over
HALVES = (6, 9, 13, 19, 28, 40)  # samples on either side of a local quadratic, where a position is differentiated
QUIET_SPEED = 0.002  # noise of the speed, of the top speed, that a wider one is taken to get below
QUIET = 0.02  # noise of the acceleration, of its rms, that a wider local quadratic is taken to get below
EDGE = 32  # samples kept after the last window, for a sensor's dead time


@dataclass(frozen=True)
class Channel:
    """What one sensor's column is like.

    Attributes:
        values: float64, shape (samples,).
        noise: standard deviation of one sample, rounding included, in the column's unit.
        step: the column is rounded to multiples of it; 0 where no rounding is seen.
    """

    values: np.ndarray
    noise: float
    step: float


@dataclass(frozen=True)
class Record:
    """One log, its motion and its windows.

    Attributes:
        name: the log's.
        time: [s].
        torque: commanded [N m].
        velocity: the rate sensor's column; None without.
        position: the encoder's column; None without.
        reference: or None.
        dt: [s].
        linear: metres and newtons.
        speed: smoothed rate reading [rad/s].
        acceleration: its rate of change [rad/s^2].
        angle: smoothed position [rad]: measured, or the integral of the rate.
        starts: first sample of each window, shape (windows,).
        samples: length of a window.
        withheld: windows that are never fitted, shape (windows,), bool.
        half: samples on either side of the local quadratics that differentiate a position.
    """

    name: str
    time: np.ndarray
    torque: np.ndarray
    velocity: Channel | None
    position: Channel | None
    reference: np.ndarray | None
    dt: float
    linear: bool
    speed: np.ndarray
    acceleration: np.ndarray
    angle: np.ndarray
    starts: np.ndarray
    samples: int
    withheld: np.ndarray
    half: int = HALVES[0]

    @property
    def channel(self) -> Channel:
        """The one that the gap is told in: the rate where there is one."""
        chosen = self.velocity if self.velocity is not None else self.position
        assert chosen is not None
        return chosen


def window_seconds(logs: Sequence[Any]) -> float:
    """Length of the windows that several logs are cut into [s]: longer where only the position is known."""
    if any(log.velocity is not None for log in logs):
        return WINDOW_SECONDS
    shortest = min(len(log.time) * float(log.dt) for log in logs)
    return float(np.clip(shortest / FEWEST, WINDOW_SECONDS, POSITION_SECONDS))


def make_record(log, *, withhold: str = "blocks", window: float = WINDOW_SECONDS, half: int | None = None) -> Record:
    """From a log to a record.

    Args:
        log: anything with `time`, `torque`, `velocity`, `position`, `reference`, `dt`, `name`, `linear` (see
            `fpjax.logs.Log`).
        withhold: "blocks" keeps every fourth block of windows out of the fit, "none" fits all, "all" fits nothing.
        window: length of a window [s], from `window_seconds`.
        half: samples on either side of the local quadratics; None for what the log asks for.

    Raises:
        InputError: for a log that is too short or holds no motion.
    """
    if log.velocity is None and log.position is None:
        raise InputError(
            f"{log.name}: neither a velocity nor a position column: the diagnosis needs at least one of them."
        )
    count, dt = len(log.time), float(log.dt)
    samples = int(np.clip(round(window / dt), SHORTEST, LONGEST))
    if count < 6 * samples + EDGE:
        raise InputError(
            f"{log.name}: {count} samples ({count * dt:.3g} s) are too few: at least {6 * samples} "
            f"({6 * samples * dt:.3g} s) are needed to fit some blocks and to withhold others; record longer."
        )
    velocity = None if log.velocity is None else _channel(log.velocity)
    position = None if log.position is None else _encoder(log.position)
    if half is None:
        half = HALVES[0] if velocity is not None or position is None else _quiet_half(position, dt)
    speed, acceleration, angle = _motion(velocity, position, dt, half)
    edge = EDGE if velocity is not None else 2 * half + 2
    starts = np.arange(0 if velocity is not None else PAST + edge, count - samples - edge + 1, samples)
    withheld = np.zeros(len(starts), bool)
    if withhold == "all":
        withheld[:] = True
    elif withhold == "blocks":
        # Whole blocks of two windows; every fourth, now and then moved by one so that they do not beat with laps.
        block = np.arange(len(starts)) // 2
        withheld[:] = block % 4 == np.where(block // 4 % 4 == 0, 3, 2)
        if not np.any(withheld):
            withheld[-1] = True
    return Record(
        log.name,
        np.asarray(log.time, float),
        np.asarray(log.torque, float),
        velocity,
        position,
        None if log.reference is None else np.asarray(log.reference, float),
        dt,
        bool(getattr(log, "linear", False)),
        speed,
        acceleration,
        angle,
        starts,
        samples,
        withheld,
        half,
    )


def with_common_noise(records: list[Record]) -> list[Record]:
    """The records of one machine, every channel with the noise of the log in which it is largest.

    One sensor has one noise: a log that was smoothed before it was stored shows less from sample to sample, not less
    error.
    """

    def common(channels: list[Channel | None]) -> float:
        return max((channel.noise for channel in channels if channel is not None), default=0.0)

    rate, angle = common([r.velocity for r in records]), common([r.position for r in records])
    return [
        replace(
            r,
            velocity=None if r.velocity is None else replace(r.velocity, noise=rate),
            position=None if r.position is None else replace(r.position, noise=angle),
        )
        for r in records
    ]


def tables_of(record: Record, dtype=np.float64) -> Tables:
    """The record as the replay loop reads it, padded so that logs of similar length share one compiled loop."""
    count = len(record.time)
    padded = _padded(count + TAPS + 64)
    torque = np.full(padded, record.torque[0])
    torque[TAPS : TAPS + count] = record.torque
    velocity, velocity_weight = _column(record.velocity, count, padded)
    position, position_weight = _column(record.position, count, padded)
    return Tables(
        jnp.asarray(torque, dtype),
        jnp.asarray(velocity, dtype),
        jnp.asarray(velocity_weight, dtype),
        jnp.asarray(position, dtype),
        jnp.asarray(position_weight, dtype),
        jnp.asarray(record.dt, dtype),
    )


def quantisation(values: np.ndarray) -> float:
    """The step that a column is rounded to: the median gap of its distinct values where these are few; else 0."""
    distinct = np.unique(values)
    if len(distinct) < 3 or len(distinct) > 0.5 * len(values):
        return 0.0
    gaps = np.diff(distinct)
    step = float(np.median(gaps[gaps > 1e-9 * np.ptp(distinct)]))
    step = float(np.mean(gaps[np.abs(gaps - step) < 0.2 * step]))
    step = float(np.ptp(distinct)) / max(
        round(float(np.ptp(distinct)) / step), 1
    )  # over the whole range: far more exact
    off = distinct / step - np.round(distinct / step)
    off = off - np.median(off)
    return step if np.mean(np.abs(off) < 0.1) > 0.9 else 0.0


def noise_level(values: np.ndarray, step: float) -> float:
    """Standard deviation of a sample, from fourth differences in many short pieces: the quieter half, so that
    motion does not count.
    """
    fourth = np.diff(values, 4) / np.sqrt(70.0)
    size = 50
    pieces = fourth[: len(fourth) // size * size].reshape(-1, size)
    levels = np.sqrt(np.mean(pieces**2, axis=1))
    moving = np.median(levels)
    spread = 1.4826 * np.median(np.abs(fourth - np.median(fourth)))
    level = float(min(moving, spread)) if spread > 0 else float(moving)
    return max(level, step / np.sqrt(12.0), 1e-12 * (float(np.ptp(values)) + 1e-30))


def smoothed(values: np.ndarray, half: int) -> tuple[np.ndarray, np.ndarray]:
    """(value, slope per sample) of a local quadratic over 2 half + 1 samples; the ends repeat the nearest fit."""
    from scipy.signal import savgol_filter

    width = 2 * half + 1
    return savgol_filter(values, width, 2), savgol_filter(values, width, 2, deriv=1)


@functools.lru_cache(maxsize=8)
def band_weights(half: int) -> np.ndarray:
    """By which second differences are averaged when the slope of a local quadratic is taken twice; they sum to 1."""
    places = np.arange(-half, half + 1)
    once = np.cumsum(places[::-1])[:-1].astype(float)  # of the first differences
    once /= np.sum(once)
    return np.convolve(once, once)


def stride_of(half: int) -> int:
    """Samples from one value to the next of a signal smoothed by `band_weights`, which is all that it holds."""
    return 2 * half - 2


def _narrow_half(position: Channel, travel: float, widest: int) -> int:
    """The narrowest local quadratic whose slope is quiet beside a travel in one period; the widest where none is."""
    for half in range(1, widest):
        if position.noise / np.sqrt(np.sum(np.arange(-half, half + 1.0) ** 2)) < QUIET_SPEED * travel:
            return half
    return widest


def _quiet_half(position: Channel, dt: float) -> int:
    """The narrowest local quadratic whose acceleration is quiet; the widest where none is."""
    for half in HALVES:
        weights = np.convolve(band_weights(half), (1.0, -2.0, 1.0))
        acceleration = np.convolve(position.values, weights, "valid")
        if position.noise * np.sqrt(np.sum(weights**2)) < QUIET * np.sqrt(np.mean(acceleration**2)):
            return half
    return HALVES[-1]


def _channel(values: np.ndarray) -> Channel:
    values = np.asarray(values, float)
    step = quantisation(values)
    return Channel(values, noise_level(values, step), step)


def _encoder(values: np.ndarray) -> Channel:
    """An encoder's column: its counts are seen however many of them it went through."""
    values = np.asarray(values, float)
    step = counts(values) or 0.0
    return Channel(values, noise_level(values, step), step)


def _motion(
    velocity: Channel | None, position: Channel | None, dt: float, wide: int
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    if velocity is not None:
        half = 5 if velocity.step == 0 else 10
        speed, slope = smoothed(velocity.values, half)
    else:
        assert position is not None
        _, slope = smoothed(position.values, wide)
        speed = slope / dt
        _, slope = smoothed(speed, wide)
        # A reversal's corner must not be rounded off more than the noise asks for: there the friction changes sign.
        narrow = _narrow_half(position, float(np.quantile(np.abs(speed), 0.95)) * dt, wide)
        speed = smoothed(position.values, narrow)[1] / dt
    if position is not None:
        angle, _ = smoothed(position.values, 5 if velocity is not None else wide - 1)
    else:
        assert velocity is not None
        # The exact integral of a line between samples; it starts at zero because nothing says where it starts.
        angle = np.concatenate([[0.0], np.cumsum(0.5 * dt * (velocity.values[1:] + velocity.values[:-1]))])
    return speed, slope / dt, angle


def _column(channel: Channel | None, count: int, padded: int) -> tuple[np.ndarray, np.ndarray]:
    values, weight = np.zeros(padded), np.zeros(padded)
    if channel is not None:
        values[TAPS : TAPS + count] = channel.values
        values[TAPS + count :] = channel.values[-1]
        weight[TAPS : TAPS + count] = 1.0 / channel.noise
    return values, weight


def _padded(count: int) -> int:
    size = 4096
    while size < count:
        size *= 2
    return size
