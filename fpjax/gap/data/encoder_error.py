"""Encoder error: what an encoder misreads periodically along its scale, seen with a rate sensor beside it.

The interpolation within a line of the scale, an eccentric disc or an unbalanced pair of sine and cosine tracks make a
reading wrong by a sine of the position (Heydemann, "Determination and correction of quadrature fringe measurement
errors in interferometers", 1981). Differentiated twice it is a torque that nothing made, the larger the faster the
machine turns, and looks like cogging. A rate sensor does not have it: where the two part by a sine of the position, it
is taken out of the position's column before anything is fitted.
"""

import dataclasses
import functools
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ...logs import Log
from ...logs.arrays import Values
from ...logs.checks.agreement import in_another_unit
from ...logs.dynamics.derivative import travel
from ...logs.noise import is_derived
from ..thresholds import THRESHOLDS
from .channel import Channel, make_channel
from .late_reading import Comparison, as_late, compared, lowest

MOST = 200_000  # samples in which a sine is looked for: of a longer log those that travel most
BINS = 2**21  # of the position, at most
TONES = 6  # sines, at most
FEWEST = 3  # periods within the travel
NEIGHBOURS = 256  # sines whose median power one is held against
ROUNDED = 1e-3  # by which the two may part more where the machine rests and there is nothing to correct
STEEPEST = 0.5  # of the error against the position [1]: one that turns the reading back is no encoder's
SLOWEST = 0.3  # longest time over which the two are compared [s]


@dataclass(frozen=True)
class EncoderError:
    """One sine of the position by which the encoder misreads.

    Attributes:
        periods: per turn (of a linear axis per 2 pi m), as those of cogging [1].
        sine, cosine: reading less position is sine x sin(periods x position) + cosine x cos(...) [rad].
    """

    periods: float
    sine: float
    cosine: float

    @property
    def amplitude(self) -> float:
        """Of the error [rad]."""
        return float(np.hypot(self.sine, self.cosine))

    def at(self, position: Values) -> Values:
        """The error at some positions [rad]."""
        angle = self.periods * position
        return self.sine * np.sin(angle) + self.cosine * np.cos(angle)


def encoder_errors(log: Log, inertia: float) -> tuple[EncoderError, ...]:
    """What a log's encoder misreads, the largest first; nothing where no rate sensor shows it.

    Args:
        log: one in which the rate is no derivative of the position.
        inertia: nominal J [kg m^2].
    """
    if log.velocity is None or log.position is None:
        return ()
    dt, part = float(log.dt), _liveliest(np.asarray(log.position, float))
    rate, angle = np.asarray(log.velocity, float)[part], np.asarray(log.position, float)[part]
    if 0.0 in (np.ptp(angle), np.ptp(rate)) or is_derived(rate, angle) or in_another_unit(rate, angle, dt):
        return ()
    position = make_channel(angle)
    apart = _Apart.of(rate, position, angle, dt)
    if apart is None:
        return ()
    effort = float(np.sqrt(np.mean(np.square(log.torque[part]))))
    torque = inertia * float(np.sqrt(np.mean(rate**4)))  # of a sine, per rad and squared period
    found: list[EncoderError] = []
    left = apart.left
    while len(found) < TONES and (periods := apart.strongest(left)) > 0.0:
        nearer = found
        for _ in range(2):  # at the position as read, then at that without what was found
            apart = _Apart.of(rate, position, _true(angle, nearer), dt) or apart
            periods = apart.refined(apart.without(found), periods)
            nearer = apart.fitted([*(one.periods for one in found), periods])
        left = apart.without(nearer)
        slight = torque * nearer[-1].amplitude * periods**2 < THRESHOLDS.nothing * effort
        steep = nearer[-1].amplitude * periods > STEEPEST
        if slight or steep or np.mean(left**2) > (1.0 - THRESHOLDS.sine_takes) * np.mean(apart.without(found) ** 2):
            break
        found = nearer
    if not found or not _holds_everywhere(log, found, apart):
        return ()
    return tuple(sorted(found, key=lambda one: -one.amplitude * one.periods**2))


def _liveliest(angle: Values) -> slice:
    """The samples that are looked at: all, or of a long log the part that travels most."""
    starts = range(0, max(len(angle) - MOST, 0) + 1, MOST)
    first = max(starts, key=lambda start: float(np.ptp(angle[start : start + MOST])))
    return slice(first, first + MOST)


def _holds_everywhere(log: Log, errors: Sequence["EncoderError"], apart: "_Apart") -> bool:
    """Whether some errors bring encoder and rate together in every part of a log, and not only where they were found.

    Periods that are a little off go out of step far from there.
    """
    assert log.velocity is not None
    rate, read = np.asarray(log.velocity, float), np.asarray(log.position, float)
    for start in range(0, len(read) - 2 * apart.half, MOST):
        part = slice(start, start + MOST)
        moved = apart.high_passed(travel(rate[part], apart.dt))
        before, after = (
            float(np.mean((apart.high_passed(apart.as_read(each)) - moved) ** 2))
            for each in (read[part], _true(read[part], errors))
        )
        if after > (1.0 + ROUNDED) * before:
            return False
    return True


@dataclass(frozen=True)
class _Apart:
    """What the encoder and the integral of the rate part by, less its average over the samples around.

    Attributes:
        rate: the velocity column [rad/s], shape (samples,).
        position: the encoder's column as read.
        angle: the same without what was found so far [rad], shape (samples,).
        both: the comparison of the two, with how late the rate is.
        half: samples on either side that the average is taken over.
        dt: control period [s].
    """

    rate: Values
    position: Channel
    angle: Values
    both: Comparison
    half: int
    dt: float

    @staticmethod
    def of(rate: Values, position: Channel, angle: Values, dt: float) -> "_Apart | None":
        """Of a velocity column and an encoder; None where too little is recorded to tell how late the rate is."""
        both = compared(rate, dataclasses.replace(position, values=angle), float(np.sqrt(np.mean(rate**2))), dt)
        if both is None:
            return None
        # The integral of white noise wanders: after so many samples by as much as the encoder's own noise.
        noise = make_channel(rate).noise * dt
        most = max(SLOWEST / dt, 16.0)
        half = max(int(min(position.noise / max(noise, 1e-300), np.sqrt(most)) ** 2), 16)
        return _Apart(rate, position, angle, both, half, dt)

    @functools.cached_property
    def moved(self) -> Values:
        """The integral of the rate, without what is slow [rad], shape (samples,)."""
        return self.high_passed(travel(self.rate, self.dt))

    @functools.cached_property
    def left(self) -> Values:
        """What the encoder and that part by [rad], shape (samples,)."""
        return self.high_passed(self.as_read(self.position.values)) - self.moved

    def as_read(self, values: Values) -> Values:
        """An angle as late and as large as the rate sensor reads it."""
        key = self.both.ranked[0]
        errors = self.both.errors(key)
        scale = self.both.lines[key][int(np.argmin(errors))].scale
        return scale * as_late(values, key, lowest(self.both.late, errors), self.dt)

    def high_passed(self, values: Values) -> Values:
        """Less the average of the samples around each, of those that are there at the ends."""
        total = np.concatenate([[0.0], np.cumsum(values - values[0])])
        index = np.arange(len(values))
        low, high = np.maximum(index - self.half, 0), np.minimum(index + self.half + 1, len(values))
        return values - values[0] - (total[high] - total[low]) / (high - low)

    def strongest(self, left: Values) -> float:
        """Periods of the strongest sine of the position in what is left; 0 where none stands out."""
        reach = float(np.ptp(self.angle))
        # A sine that passes within four samples of the usual speed is none to tell.
        fastest = 0.5 * np.pi / float(np.sqrt(np.mean(np.diff(self.angle) ** 2)))
        bins = int(min(2.0 ** np.ceil(np.log2(max(4.0 * reach * fastest / np.pi, 16.0))), BINS))
        periods = np.pi / reach * np.arange(bins + 1)
        power, own = (self._power(values, bins) for values in (left, self.moved))
        allowed = (periods > 2.0 * np.pi * FEWEST / reach) & (periods < fastest)
        # Where the motion itself has that sine, a part of it that a lag leaves is no error of the encoder.
        allowed &= power > THRESHOLDS.sine_own**2 * np.maximum(own - THRESHOLDS.sine_stands_out * _around(own), 0.0)
        ratio = np.where(allowed, power / np.maximum(_around(power), 1e-300), 0.0)
        place = int(np.argmax(ratio))
        return float(periods[place]) if ratio[place] > THRESHOLDS.sine_stands_out else 0.0

    def _power(self, values: Values, bins: int) -> Values:
        """Power of the sines of the position, shape (bins + 1,), every half period more within the travel."""
        place = (self.angle - np.min(self.angle)) * (bins / np.ptp(self.angle))
        sums = np.bincount(np.minimum(place.astype(int), bins - 1), weights=values, minlength=bins)
        return np.abs(np.fft.rfft(sums, 2 * bins)) ** 2

    def refined(self, left: Values, periods: float) -> float:
        """Periods next to some that leave least of what is left."""
        near = periods + np.pi / float(np.ptp(self.angle)) * np.linspace(-1.0, 1.0, 9)
        tables = [self._table([one]) for one in near]
        return lowest(near, np.array([np.mean((left - t @ np.linalg.lstsq(t, left)[0]) ** 2) for t in tables]))

    def _table(self, periods: Sequence[float]) -> Values:
        """Sine and cosine of each of some periods as the rate sensor would read them, shape (samples, 2 of each)."""
        waves = [f(n * self.angle) for n in periods for f in (np.sin, np.cos)]
        return np.stack([self.high_passed(self.as_read(wave)) for wave in waves], 1)

    def fitted(self, periods: Sequence[float]) -> list[EncoderError]:
        """Errors of those periods by least squares, in their order."""
        weights = np.linalg.lstsq(self._table(periods), self.left)[0].reshape(-1, 2)
        return [EncoderError(n, float(a), float(b)) for n, (a, b) in zip(periods, weights, strict=True)]

    def without(self, errors: Sequence[EncoderError]) -> Values:
        """What is left without some errors [rad], shape (samples,)."""
        return self.left - self.high_passed(self.as_read(sum((one.at(self.angle) for one in errors), np.zeros(1))))


def _around(power: Values) -> Values:
    """Median of each value's neighbours, from block to block in straight lines, shape as given."""
    blocks = max(len(power) // NEIGHBOURS, 1)
    parts = np.array_split(power, blocks)
    middle = np.cumsum([len(part) for part in parts]) - 0.5 * np.array([len(part) for part in parts])
    return np.interp(np.arange(len(power)), middle, [float(np.median(part)) for part in parts])


def without_errors(log: Log, errors: Sequence[EncoderError]) -> Log:
    """The log with its position as it was, where the encoder misread it by some sines."""
    return dataclasses.replace(log, position=_true(np.asarray(log.position, float), errors)) if errors else log


def _true(read: Values, errors: Sequence[EncoderError]) -> Values:
    """The position [rad] of which an encoder with some errors, small beside their periods, makes a reading."""
    position = read
    for _ in range(3):
        position = read - sum((one.at(position) for one in errors), np.zeros(1))
    return position


def about_errors(log: Log, errors: Sequence[EncoderError]) -> str:
    """What was noticed of an encoder and done."""
    sines = ", ".join(
        f"{one.amplitude:.3g} m (a period of {2.0 * np.pi / one.periods:.3g} m)"
        if log.linear
        else f"{one.amplitude:.3g} rad ({one.periods:.4g} periods a turn)"
        for one in errors
    )
    return (
        f"{log.name}: the position misreads by a sine of itself that the rate sensor does not have, of amplitude "
        f"{sines}: the column was corrected before the gap was measured."
    )
