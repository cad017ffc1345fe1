"""Where the gap lies: the energy of the torque residual by time, velocity, position, frequency and regime.

The residual is passed through the Wiener filter that its own spectrum and the sensor's noise ask for, so that
differentiated
noise does not drown it; what noise still passes is taken off the energy. A place stands out if it holds more than its
share of
the samples and more than noise would put there. With nothing above the noise, nothing is listed.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np

from .diagnosis import Share, Where
from .null import null_residuals
from .residual import Residual, torque_residual
from .rigid import RigidBody

Values = np.ndarray

REGIMES = ("reversal", "low_speed", "acceleration", "cruise", "limit")
BINS = {"time": 48, "velocity": 25, "position": 25}
TIME_BIN = 0.1  # s, with at most MOST_TIME_BINS of them
MOST_TIME_BINS = 240
BANDS_PER_OCTAVE = 3
TIMES_EVEN = 1.6  # a place that stands out holds at least this many times an even share; half of all the time makes 2
SURE = 4.0  # standard deviations above what noise alone would show
BEYOND = 2.0  # times the largest energy among the draws of noise alone
MOST = {"time": 40, "velocity": 6, "position": 8, "frequency": 6}  # places named
LEAST = 0.2  # of the energy: fewer than this in all the places together says nothing
SMALLEST = {"time": 0.002, "velocity": 0.01, "position": 0.01, "frequency": 0.01}  # share of one bin
FOLDED_BEYOND = 2.0  # revolutions of travel after which positions are told within one revolution


def locate(log: Any, model: RigidBody) -> Where:
    """Where the gap between a log and a model lies.

    Args:
        log: a `fpjax.logs.Log` or a `Record`; positions of a `linear` one do not come round.
        model: the nominal model (`rigid_body` makes it from a `Machine`), or the corrected one for what is left.
    """
    residual = torque_residual(log, model)
    return locate_residual(residual, null_residuals(log, model, residual), linear=bool(getattr(log, "linear", False)))


def locate_residual(residual: Residual, nulls: list[Residual], *, linear: bool = False) -> Where:
    """Where the energy of a residual lies.

    Args:
        residual: from `torque_residual`.
        nulls: what noise alone would leave, from `null_residuals`.
        linear: positions are metres, which do not come round.
    """
    gap = above_noise(residual, nulls)
    axes = {"time": residual.time, "velocity": residual.velocity}
    if np.ptp(residual.position) > 0.0:
        axes["position"] = _told_position(residual, linear)
    maps, out = {}, {}
    for axis, values in axes.items():
        bins = BINS[axis]
        if axis == "time":
            bins = int(np.clip(np.ptp(values) / TIME_BIN, bins, MOST_TIME_BINS))
        edges = _edges(values, bins)
        if edges is None:
            continue
        index = np.clip(np.digitize(values, edges) - 1, 0, len(edges) - 2)
        maps[axis], sure = _bins(edges, index, gap)
        out[axis] = _standing_out(axis, maps[axis], sure)
    maps["frequency"], sure = _bands(gap)
    out["frequency"] = _standing_out("frequency", maps["frequency"], sure)
    regimes = regime_of(residual)
    energy = {name: float(np.sum(gap.energy[regimes == index])) for index, name in enumerate(REGIMES)}
    total = sum(max(value, 0.0) for value in energy.values())
    shares = {name: max(value, 0.0) / total if gap.found and total > 0.0 else 0.0 for name, value in energy.items()}
    return Where(
        time=out.get("time", ()),
        velocity=out.get("velocity", ()),
        position=out.get("position", ()),
        frequency=out["frequency"],
        regime=shares,
        residual=gap.signal,
        axes=axes,
        maps=maps,
    )


@dataclass(frozen=True)
class AboveNoise:
    """A residual freed of what noise explains.

    Attributes:
        signal: filtered [N m]; where nothing is above the noise, a plain low pass, shape (samples,).
        energy: its square less what noise puts there [N^2 m^2], zero where nothing was found, shape (samples,).
        nulls: squares of the equally filtered null residuals, shape (draws, samples).
        independent: independent samples per sample [1], from the filter's bandwidth.
        found: something is above the noise.
        gain: of the filter, shape (frequencies,).
        frequency: [Hz], shape (frequencies,).
        power: of the residual per frequency; sums to its mean square.
        null_power: what noise alone puts there, mean of the draws.
    """

    signal: Values
    energy: Values
    nulls: Values
    independent: float
    found: bool
    gain: Values
    frequency: Values
    power: Values
    null_power: Values


def above_noise(residual: Residual, nulls: list[Residual]) -> AboveNoise:
    """The residual through its Wiener filter; see the module."""
    count = len(residual.values)
    frequency = np.fft.rfftfreq(count, residual.dt)
    raw = _periodogram(residual.values)
    raw_nulls = np.stack([_periodogram(null.values) for null in nulls])
    # the noise is known to some ten per cent from differences; the top of the spectrum can only lower it
    top = slice(int(0.8 * len(frequency)), len(frequency) - 1)
    less = min(1.0, float(np.mean(raw[top]) / max(np.mean(raw_nulls[:, top]), 1e-300)))
    raw_nulls = raw_nulls * less
    power, averaged = _smooth(raw)
    smooth_nulls = np.stack([_smooth(null)[0] for null in raw_nulls])
    expected, largest = np.mean(smooth_nulls, axis=0), np.max(smooth_nulls, axis=0)
    # a taper correlates neighbours: `averaged` counts two periodogram values as one
    clear = power > np.maximum(expected * (1.0 + SURE * np.sqrt(2.0 / averaged)), BEYOND * largest) + 1e-300
    clear &= _smooth(clear.astype(float))[0] > 0.5
    gain = np.where(clear, np.clip(1.0 - expected / np.maximum(power, 1e-300), 0.0, 1.0), 0.0)
    plain = np.clip(1.0 - frequency / (0.05 / residual.dt), 0.0, 1.0)
    found = bool(np.any(clear))
    signal = _filtered(residual.values, gain if found else plain)
    squares = less * np.stack([_filtered(null.values, gain) ** 2 for null in nulls])
    found = found and bool(np.sum(signal**2) > BEYOND * np.max(np.sum(squares, axis=1)))
    if not found:
        signal = _filtered(residual.values, plain)
    energy = signal**2 - np.mean(squares, axis=0) if found else np.zeros(count)
    independent = np.sum(gain**2) ** 2 / max(np.sum(gain**4), 1e-300) / len(gain)
    independent = float(np.clip(independent, 1.0 / count, 1.0))
    return AboveNoise(signal, energy, squares, independent, found, gain, frequency, raw, np.mean(raw_nulls, axis=0))


def _periodogram(values: Values) -> Values:
    count = len(values)
    taper = np.sqrt(8.0 / 3.0) * np.sin(np.pi * (np.arange(count) + 0.5) / count) ** 2
    raw = np.abs(np.fft.rfft(values * taper)) ** 2 * 2.0 / count**2
    raw[0] *= 0.5
    return raw


def _filtered(values: Values, gain: Values) -> Values:
    """Zero-phase filtering by a gain per frequency; the signal is mirrored at its ends."""
    count = len(values)
    fine = np.interp(np.linspace(0.0, 1.0, count + 1), np.linspace(0.0, 1.0, len(gain)), gain)
    return np.fft.irfft(fine * np.fft.rfft(np.concatenate([values, values[::-1]])), 2 * count)[:count]


def regime_of(residual: Residual) -> Values:
    """The index in `REGIMES` of each sample, shape (samples,).

    limit: the torque is clipped, or among its largest 5 %; reversal: slower than 10 % of the top speed around a
    change of
    direction or a stop; low_speed: slower than 20 % otherwise; acceleration: more than 30 % of the top acceleration;
    cruise: the rest.
    """
    speed, torque = np.abs(residual.velocity), np.abs(residual.torque)
    top_speed = float(np.quantile(speed, 0.95))
    top_acceleration = float(np.quantile(np.abs(residual.acceleration), 0.95))
    regimes = np.full(len(speed), REGIMES.index("cruise"))
    regimes[np.abs(residual.acceleration) > 0.3 * top_acceleration] = REGIMES.index("acceleration")
    regimes[speed < 0.2 * top_speed] = REGIMES.index("low_speed")
    slow = speed < 0.1 * top_speed
    turns = np.concatenate([[False], np.diff(np.sign(residual.velocity)) != 0.0]) | (speed < 0.005 * top_speed)
    stretch = np.cumsum(np.concatenate([[True], np.diff(slow.astype(int)) != 0]))
    regimes[slow & np.isin(stretch, np.unique(stretch[turns & slow]))] = REGIMES.index("reversal")
    largest = float(np.max(torque))
    clipped = torque >= 0.9995 * largest
    threshold = 0.9995 * largest if np.mean(clipped) > 0.005 else max(float(np.quantile(torque, 0.95)), 1e-300)
    regimes[torque >= threshold] = REGIMES.index("limit")
    return regimes


def _told_position(residual: Residual, linear: bool) -> Values:
    position = residual.position
    if linear or np.ptp(position) < FOLDED_BEYOND * 2.0 * np.pi:
        return position
    return np.mod(position, 2.0 * np.pi)


def _edges(values: Values, bins: int) -> Values | None:
    low, high = np.quantile(values, [0.001, 0.999])
    return np.linspace(low, high, bins + 1) if high > low else None


def _bins(edges: Values, index: Values, gap: AboveNoise) -> tuple[tuple[Share, ...], Values]:
    bins = len(edges) - 1
    counts = np.bincount(index, minlength=bins).astype(float)
    energy = np.bincount(index, gap.energy, minlength=bins)
    total = float(np.sum(np.maximum(energy, 0.0)))
    shares = np.maximum(energy, 0.0) / total if total > 0.0 else np.zeros(bins)
    nulls = np.stack([np.bincount(index, null, minlength=bins) for null in gap.nulls])
    independent = np.maximum(counts * gap.independent, 0.5)
    sure = energy > np.mean(nulls, axis=0) * SURE * np.sqrt(2.0 / independent)
    sure &= energy > BEYOND * np.max(nulls, axis=0)
    return _shares(edges, shares, counts / len(index)), sure


def _bands(gap: AboveNoise) -> tuple[tuple[Share, ...], Values]:
    """The spectrum above the noise in bands of a third of an octave, or of four lines where these are wider."""
    line, top = gap.frequency[1], gap.frequency[-1]
    edges = [line]
    while edges[-1] < top:
        edges.append(max(edges[-1] * 2.0 ** (1.0 / BANDS_PER_OCTAVE), edges[-1] + 4.0 * line))
    edges[-1] = top
    edges = np.asarray([0.0, *edges] if len(edges) > 1 else [0.0, top])
    index = np.clip(np.digitize(gap.frequency, edges) - 1, 0, len(edges) - 2)
    excess = np.bincount(index, gap.gain**2 * (gap.power - gap.null_power), minlength=len(edges) - 1)
    noise = np.bincount(index, gap.gain**2 * gap.null_power, minlength=len(edges) - 1)
    lines = np.maximum(np.bincount(index, minlength=len(edges) - 1), 1)
    sure = (excess > SURE * noise * np.sqrt(2.0 / lines)) & gap.found
    excess = np.where(sure, excess, 0.0)
    total = float(np.sum(excess))
    shares = excess / total if total > 0.0 else np.zeros(len(excess))
    # Even along the axis as it is drawn, which is by octaves: any machine's residual is stronger at low frequencies.
    reach = gap.power > 3.0 * gap.null_power
    used = np.unique(index[reach]) if np.any(reach) else np.arange(len(excess))
    even = np.where(np.isin(np.arange(len(excess)), used), 1.0 / len(used), 0.0)
    return _shares(edges, shares, even), sure


def _shares(edges: Values, shares: Values, expected: Values) -> tuple[Share, ...]:
    return tuple(
        Share(float(edges[i]), float(edges[i + 1]), float(shares[i]), float(expected[i])) for i in range(len(shares))
    )


def _standing_out(axis: str, bins: tuple[Share, ...], sure: Values) -> tuple[Share, ...]:
    """Neighbouring bins that stand out, joined; largest share first."""
    found: list[Share] = []
    joined = False
    for place, certain in zip(bins, sure, strict=True):
        out = bool(certain) and place.share >= max(TIMES_EVEN * place.expected, SMALLEST[axis])
        if out and joined:
            last = found[-1]
            found[-1] = Share(last.start, place.stop, last.share + place.share, last.expected + place.expected)
        elif out:
            found.append(place)
        joined = out
    found = sorted(found, key=lambda place: -place.share)[: MOST[axis]]
    return tuple(found) if sum(place.share for place in found) >= LEAST else ()


def _smooth(values: Values) -> tuple[Values, Values]:
    """Running mean over 9 lines, or a seventh of the frequency where that is more, and its independent lines."""
    count = len(values)
    line = np.arange(count)
    half = np.maximum(4, line // 14)
    low, high = np.maximum(line - half, 0), np.minimum(line + half + 1, count)
    total = np.concatenate([[0.0], np.cumsum(values)])
    width = (high - low).astype(float)
    return (total[high] - total[low]) / width, 0.5 * width
