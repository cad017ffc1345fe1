"""Where the gap lies: the energy of the missing torque by time, velocity, position, frequency and regime.

The variance by noise is known and subtracted. A place stands out if its energy is well above its share of the samples
and above what noise would give. Where nothing is above the noise, nothing is listed.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ...logs.arrays import Numbers, Values
from ..data.record import Record
from ..thresholds import THRESHOLDS
from .course import Course
from .findings import Share, Where

REGIMES = ("reversal", "low_speed", "acceleration", "cruise", "limit")
BINS = {"time": 48, "velocity": 25, "position": 25}
TIME_BIN = 0.1  # width of a bin of time [s], with 48 to MOST_TIME_BINS of them
MOST_TIME_BINS = 240
BANDS_PER_OCTAVE = 3
# A place that stands out holds at least this many times its even share; below 2, because one that takes half of the
# time cannot hold more than twice its share.
TIMES_EVEN = 1.6
MOST = {"time": 40, "velocity": 6, "position": 8, "frequency": 6}  # most places that are listed
SMALLEST = {"time": 0.002, "velocity": 0.01, "position": 0.01, "frequency": 0.01}  # least share of one bin
FOLDED_BEYOND = 2.0  # revolutions of travel from which positions are given within one revolution


@dataclass(frozen=True)
class Energy:
    """Energy of a missing torque at samples.

    Attributes:
        above: square minus the variance by noise [N^2 m^2], shape (samples,).
        noise: variance by noise [N^2 m^2], shape (samples,).
        independent: independent values of noise for each sample [1].
        found: whether the sum over all samples is above the noise.
    """

    above: Values
    noise: Values
    independent: float
    found: bool

    def sure(self, above: Numbers, noise: Numbers, counts: Numbers | float) -> Values:
        """Whether sums over `counts` samples are above the noise: a chi-square of n degrees has the relative scatter
        sqrt(2 / n).

        Args:
            above: sums of `above` [N^2 m^2].
            noise: sums of `noise` [N^2 m^2].
            counts: samples in each sum.
        """
        return np.asarray(
            above > noise * THRESHOLDS.stands_out * np.sqrt(2.0 / np.maximum(counts * self.independent, 0.5))
        )


def locate(records: Sequence[Record], courses: Sequence[Course]) -> Where:
    """Where the missing torque of a model lies: by time in the first log, by everything else in all of them.

    Args:
        records: the logs.
        courses: of the model's missing torque, one for each log.
    """
    inside = [np.isfinite(course.torque) for course in courses]
    torque = np.concatenate([c.torque[at] for c, at in zip(courses, inside, strict=True)])
    noise = np.concatenate([c.noise[at] for c, at in zip(courses, inside, strict=True)])
    energy = _energy(torque, noise, courses[0].independent)
    regimes = np.concatenate([regime_of(r)[at] for r, at in zip(records, inside, strict=True)])
    speed = np.concatenate([r.speed[at] for r, at in zip(records, inside, strict=True)])
    angle = np.concatenate([r.angle[at] for r, at in zip(records, inside, strict=True)])
    first = int(np.sum(inside[0]))
    axes = {"time": records[0].time[inside[0]], "velocity": speed}
    if np.ptp(angle) > 0.0:
        axes["position"] = _shown_position(angle, records[0].linear)
    maps, out = {}, {}
    for axis, values in axes.items():
        bins = BINS[axis]
        if axis == "time":
            # One bin for 0.1 s, so that short disturbances stand out.
            bins = int(np.clip(np.ptp(values) / TIME_BIN, bins, MOST_TIME_BINS))
        edges = _edges(values, bins)
        if edges is None:
            continue
        index = np.clip(np.digitize(values, edges) - 1, 0, len(edges) - 2)
        # Times of several logs are not comparable: only the first one is mapped over time.
        here = _energy(torque[:first], noise[:first], energy.independent) if axis == "time" else energy
        maps[axis], sure = _bins(edges, index, here)
        out[axis] = _standing_out(axis, maps[axis], sure)
    maps["frequency"], sure = _bands(courses, found=energy.found)
    out["frequency"] = _standing_out("frequency", maps["frequency"], sure)
    sums = {name: float(np.sum(energy.above[regimes == index])) for index, name in enumerate(REGIMES)}
    total = sum(max(value, 0.0) for value in sums.values())
    shares = {name: max(v, 0.0) / total if energy.found and total > 0.0 else 0.0 for name, v in sums.items()}
    return Where(
        time=out.get("time", ()),
        velocity=out.get("velocity", ()),
        position=out.get("position", ()),
        frequency=out["frequency"],
        regime=shares,
        residual=torque[:first],
        axes={name: values[:first] for name, values in axes.items()},
        maps=maps,
    )


def _energy(torque: Values, noise: Values, independent: float) -> Energy:
    energy = Energy(torque**2 - noise, noise, independent, found=False)
    count = np.array(len(torque))
    found = bool(energy.sure(np.sum(energy.above), np.sum(noise), count)) and float(np.sum(energy.above)) > 0.0
    return Energy(energy.above if found else np.zeros(len(torque)), noise, independent, found)


def regime_of(record: Record) -> Values:
    """The index in `REGIMES` of each sample, shape (samples,).

    limit: the torque is clipped, or among its largest 5 %; reversal: slower than 10 % of the top speed around a
    change of direction or a stop; low_speed: slower than 20 % otherwise; acceleration: more than 30 % of the top
    acceleration; cruise: the rest.
    """
    speed, torque, acceleration = np.abs(record.speed), np.abs(record.torque), np.abs(record.acceleration)
    # The 95 % quantile, not the maximum: a single overshoot would turn everything else into low speed.
    top_speed = float(np.quantile(speed, 0.95))
    regimes = np.full(len(speed), REGIMES.index("cruise"))
    regimes[acceleration > 0.3 * float(np.quantile(acceleration, 0.95))] = REGIMES.index("acceleration")
    regimes[speed < 0.2 * top_speed] = REGIMES.index("low_speed")
    slow = speed < 0.1 * top_speed
    turns = np.concatenate([[False], np.diff(np.sign(record.speed)) != 0.0]) | (speed < 0.005 * top_speed)
    # Stretches of slow samples, numbered; one that holds a change of sign or a stop is a reversal as a whole.
    stretch = np.cumsum(np.concatenate([[True], np.diff(slow.astype(int)) != 0]))
    regimes[slow & np.isin(stretch, np.unique(stretch[turns & slow]))] = REGIMES.index("reversal")
    largest = float(np.max(torque))
    clipped = torque >= 0.9995 * largest
    # Clipped if more than 0.5 % of the samples lie at the maximum: only a limit repeats one value.
    threshold = 0.9995 * largest if np.mean(clipped) > 0.005 else max(float(np.quantile(torque, 0.95)), 1e-300)
    # Last, so that it overrides the others: at its limit the loop is open, whatever the motion is.
    regimes[torque >= threshold] = REGIMES.index("limit")
    return regimes


def _shown_position(position: Values, linear: bool) -> Values:
    """The position, within one revolution where the travel is long."""
    if linear or np.ptp(position) < FOLDED_BEYOND * 2.0 * np.pi:
        return position
    return np.mod(position, 2.0 * np.pi)


def _edges(values: Values, bins: int) -> Values | None:
    """Edges of equal bins, shape (bins + 1,); None where nothing varies. Outliers (0.1 % a side) go to the end bins."""
    low, high = np.quantile(values, [0.001, 0.999])
    return np.linspace(low, high, bins + 1) if high > low else None


def _bins(edges: Values, index: Values, energy: Energy) -> tuple[tuple[Share, ...], Values]:
    """(share of the energy by bin, whether each bin is above the noise) of samples whose bins are `index`."""
    bins = len(edges) - 1
    counts = np.bincount(index, minlength=bins).astype(float)
    above = np.bincount(index, energy.above, minlength=bins)
    total = float(np.sum(np.maximum(above, 0.0)))
    shares = np.maximum(above, 0.0) / total if total > 0.0 else np.zeros(bins)
    sure = energy.sure(above, np.bincount(index, energy.noise, minlength=bins), counts) & (above > 0.0)
    return _shares(edges, shares, counts / len(index)), sure


def _bands(courses: Sequence[Course], *, found: bool) -> tuple[tuple[Share, ...], Values]:
    """As `_bins`, of the power of the modes in bands of a third of an octave (four modes, where those are wider)."""
    frequency = courses[0].frequency
    order = np.argsort(frequency)
    frequency = frequency[order]
    power = np.mean([c.power[order] for c in courses], axis=0)
    spread = np.sqrt(np.sum([c.spread[order] ** 2 for c in courses], axis=0)) / len(courses)
    line, top = 2.0 * frequency[0], frequency[-1]
    # From twice the lowest mode: its band and all below are one.
    edges = [line]
    while edges[-1] < top:
        edges.append(max(edges[-1] * 2.0 ** (1.0 / BANDS_PER_OCTAVE), edges[-1] + 4.0 * line))
    edges[-1] = max(top, line)
    edges = np.asarray([0.0, *edges] if len(edges) > 1 else [0.0, edges[-1]])
    index = np.clip(np.digitize(frequency, edges) - 1, 0, len(edges) - 2)
    excess = np.bincount(index, power, minlength=len(edges) - 1)
    noise = np.sqrt(np.bincount(index, spread**2, minlength=len(edges) - 1))
    sure = (excess > THRESHOLDS.stands_out * noise) & found
    excess = np.where(sure, excess, 0.0)
    total = float(np.sum(excess))
    shares = excess / total if total > 0.0 else np.zeros(len(excess))
    # An even share for each band, that is, a constant power per octave: the torque of any machine is stronger at low
    # frequencies, so that against a constant power per hertz the lowest band would always stand out.
    used = np.flatnonzero(sure) if np.any(sure) else np.arange(len(excess))
    even = np.where(np.isin(np.arange(len(excess)), used), 1.0 / len(used), 0.0)
    return _shares(edges, shares, even), sure


def _shares(edges: Values, shares: Values, expected: Values) -> tuple[Share, ...]:
    return tuple(
        Share(float(edges[i]), float(edges[i + 1]), float(shares[i]), float(expected[i])) for i in range(len(shares))
    )


def _standing_out(axis: str, bins: tuple[Share, ...], sure: Values) -> tuple[Share, ...]:
    """Bins that stand out, neighbours joined, largest share first; none where they hold too little together."""
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
    return tuple(found) if sum(place.share for place in found) >= THRESHOLDS.listed else ()
