"""Start values of fits of a backlash or a spring, found with the measured motion imposed on the side that has a sensor.

The motion of a load that crosses a backlash depends on every contact before, and that of one on a soft spring on every
swing, so that the cost of a window has many local minima and a fit from rule-of-thumb values ends in the nearest one:
so it was in four of five development logs with a backlash, and with springs of 3 to 45 Hz whose friction is divided
unevenly. With the measured motion imposed nothing diverges: only the other mass is simulated, over the whole log at
once, and the shaft's torque is compared with the one that the measured side asks for.
"""

import itertools
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import jax.numpy as jnp
import numpy as np
from numpy.typing import ArrayLike

from ...blocks.signals import Motion
from ...logs.arrays import Values
from ..data.record import Record
from ..data.setting import Setting
from ..effects.parameters import highest_contact, highest_frequency, largest_gap, lowest_frequency
from ..simulate.hidden_states import HiddenStates
from ..simulate.lane_kernel import LANES
from .candidate import NOMINAL

# A grid over the parameters, then a random search around its best points, in logarithms of the parameters.
NAMES = ("gap", "load_share", "frequency", "damping_ratio", "friction_share", "viscous_share", *NOMINAL)  # rows
GAPS = 16  # number of clearances
LEAST_GAP = 3e-4  # the least, as the time to cross it at top speed [s]
LARGEST_GAP = 0.5  # the largest, of the largest that there may be [1]
SHARES = (0.15, 0.35, 0.6)  # of the inertia that is on the load [1]
RATIO = 0.3  # damping ratio of a face in contact [1]
FRICTIONS = (0.2, 0.7)  # of the friction that is on the load [1]
SPRINGS = 10  # resonances of a spring, from the lowest to the highest that a log shows
SLICE = 1.8  # ratio of the resonances in one slice, at most [1]: the best of each is a start
SLICES = (2, 6)  # fewest and most of them
SPRING_SHARES = (0.2, 0.5, 0.8)  # of the inertia that is on the load of a spring [1]
# Shares of the Coulomb and of the viscous friction that are on it [1].
SPRING_FRICTIONS = ((0.05, 0.05), (0.2, 0.2), (0.7, 0.7), (0.7, 0.1))
SPRING_RATIO = 0.05  # damping ratio of a spring [1]
CLOSED = 1e-9  # clearance of a spring, as the time to cross it at top speed [s]: its logarithm is finite
SAME = 0.05  # difference of fitted and given nominal numbers that makes them one point of the grid [1]
NUMBERS = 1.5  # factor by which a nominal number may be beyond the fitted and the given one [1]
ROUNDS = 4  # of the random search
BEST, VARIED = 8, 128  # points that are varied in a round, and variations of them together: two chunks of lanes
# Standard deviations of a variation in the first round, of the natural logarithm.
SPREAD = (0.3, 0.3, 0.4, 0.5, 0.3, 0.3, 0.1, 0.1, 0.1)
STARTS = 3  # of a backlash, returned for each side, and as many with less damping
APART = 0.25  # least difference of two of them in clearance, share or frequency, of the natural logarithm
FLOOR = 0.02  # of the compared torque's mean square: a stretch with less left counts as explained
# Corners of low-passes over the highest resonance. Behind the lower ones only a contact's impulse is left, or the slow
# swing of a soft spring, which are right before the course of a contact's torque is: they lead the search from afar.
BANDS = (0.12, 0.5)
SPRING_BANDS = (0.03, 0.12, 0.5)
ORDER = 3  # of the Butterworth low-passes
COARSE = 3  # samples that are averaged before they are filtered: a sixth of the Nyquist frequency is looked at
EDGE = 170  # coarse samples of padding at either end of a filtered course
LIVELY = 0.2  # of the damping found: errors of the contacts' times look like damping, so that less of it is tried too
MOVING = 0.01  # of the top speed: width of the reversal of friction


@dataclass(frozen=True)
class ImposedMotion:
    """A log whose motion is imposed on the side with the sensor, beside the nominal model.

    Attributes:
        hidden_states: of the family of a backlash, which at no clearance is a spring.
        which: index of the record.
        record: the log.
        course: the missing torque of the nominal model [N m], NaN where unknown, shape (samples,).
        nominal: that model's numbers by name.
        given: these numbers as they were given: a shaft bends those that are fitted without it.
        setting: sizes.
    """

    hidden_states: HiddenStates
    which: int
    record: Record
    course: Values
    nominal: dict[str, float]
    given: dict[str, float]
    setting: Setting


def contact_starts(log: ImposedMotion) -> tuple[dict[str, float], ...]:
    """Start values of fits of a backlash, the sensors on the motor, then on the load, the most likely of each first.

    () where no stretch of the log can be used.
    """
    setting = log.setting
    least, most = LEAST_GAP * setting.speed, largest_gap(setting)
    gaps = np.geomspace(least, LARGEST_GAP * most, GAPS)
    frequencies = 0.35 * highest_frequency(setting), highest_frequency(setting)
    # A start divides both kinds of friction alike.
    rows = [[*one, one[-1]] for one in itertools.product(gaps, SHARES, frequencies, [RATIO], FRICTIONS)]
    low = [0.1 * least, 0.05, 0.1 * highest_frequency(setting), 0.02, 0.02, 0.02]
    high = [0.98 * most, 0.9, highest_contact(setting), 1.5, 0.98, 0.98]
    found: list[dict[str, float]] = []
    for side in (0.0, 1.0):
        objective = _Objective(log, side, BANDS)
        if not objective.usable:
            continue
        tried, scores = _searched(objective, rows, low, high, 1, lambda tried: np.zeros(tried.shape[1], int))
        chosen: list[Values] = []
        for index in np.argsort(scores):
            if all(np.max(np.abs(tried[:, index] - other)[:3]) > APART for other in chosen):
                chosen.append(tried[:, index])
            if len(chosen) == STARTS:
                break
        found += [_values(one, side) for one in chosen]
    return (*found, *(one | {"damping_ratio": LIVELY * one["damping_ratio"]} for one in found))


def spring_starts(log: ImposedMotion) -> tuple[dict[str, float], ...]:
    """Start values of fits of a spring, the sensors on either side: the best of each slice of resonances; () for none.

    Whether a spring of 3 or of 30 Hz leaves less in such a simulation says little of which is there: readings are
    noisy, and the slices differ in how much of the noise they take for a torque. Within one they do not.
    """
    setting = log.setting
    # A start at a bound has no gradient.
    least, most = 1.1 * lowest_frequency(setting), 0.9 * highest_frequency(setting)
    if not 1.5 * least < most:
        return ()
    frequencies, closed = np.geomspace(least, most, SPRINGS), CLOSED * setting.speed
    every = itertools.product(frequencies, SPRING_SHARES, SPRING_FRICTIONS)
    rows = [[closed, share, frequency, SPRING_RATIO, *friction] for frequency, share, friction in every]
    low, high = [closed, 0.06, least, 0.005, 0.02, 0.02], [closed, 0.94, most, 0.4, 0.98, 0.98]
    slices = int(np.clip(np.ceil(np.log(most / least) / np.log(SLICE)), *SLICES))
    edges = np.linspace(np.log(least), np.log(most), slices + 1)[1:-1]
    found: list[dict[str, float]] = []
    for side in (0.0, 1.0):
        objective = _Objective(log, side, SPRING_BANDS)
        if not objective.usable:
            continue
        tried, scores = _searched(objective, rows, low, high, slices, lambda tried: np.searchsorted(edges, tried[2]))
        own = np.searchsorted(edges, tried[2])
        for one in range(slices):
            best = min(np.flatnonzero(own == one), key=lambda index: scores[index])
            found.append({name: value for name, value in _values(tried[:, best], side).items() if name != "gap"})
    return tuple(found)


def _searched(
    objective: "_Objective", rows: Sequence[Sequence[float]], low: Sequence[float], high: Sequence[float], slices: int,
    slice_of: Callable[[Values], Values],
) -> tuple[Values, Values]:  # fmt: skip
    """A grid and a random search about its best points: (logarithms of the points, (parameters, points), scores).

    Args:
        objective: lower is better.
        rows: the grid without the nominal numbers, each (parameters,).
        low: lowest values of the random search, likewise.
        high: highest ones.
        slices: number of sets of points that are searched side by side.
        slice_of: the set of each point, by the points' logarithms.
    """
    log, rng = objective.log, np.random.default_rng(0)
    numbers = [[max(model[name], least) for name, least in _least(log).items()] for model in (log.nominal, log.given)]
    if np.allclose(*numbers, rtol=SAME, atol=0.0):
        numbers = numbers[:1]
    tried = np.log([[*one, *model] for one in rows for model in numbers]).T
    least = np.log([*low, *np.min(numbers, 0) / NUMBERS])[:, None]
    most = np.log([*high, *np.max(numbers, 0) * NUMBERS])[:, None]
    scores = objective.scores(np.exp(tried))
    for shrink in 0.6 ** np.arange(ROUNDS):
        own, order = slice_of(tried), np.argsort(scores)
        best = np.concatenate([order[own[order] == one][: max(BEST // slices, 2)] for one in range(slices)])
        size = shrink * np.array(SPREAD)[:, None]
        more = tried[:, rng.choice(best, VARIED)] + size * rng.standard_normal((len(size), VARIED))
        more = np.clip(more, least, most)
        tried = np.concatenate([tried, more], axis=1)
        scores = np.concatenate([scores, objective.scores(np.exp(more))])
    return tried, scores


def _least(log: ImposedMotion) -> dict[str, float]:
    """Least nominal numbers of the search: their logarithm is finite."""
    friction, speed = log.setting.friction, log.setting.speed
    return {"inertia": 0.0, "coulomb": 0.01 * friction, "viscous": 0.01 * friction / speed}


def _values(row: Values, side: float) -> dict[str, float]:
    """Start values by name, from the logarithms of a point, (parameters,)."""
    return {name: float(np.exp(value)) for name, value in zip(NAMES, row, strict=True)} | {"load_side": side}


class _Objective:
    """The objective of the search: how much torque a shaft leaves unexplained on the measured side, at the command.

    Args:
        log: and its nominal model.
        side: 0 for sensors on the motor, 1 on the load.
        bands: corners of low-passes over the highest resonance [1].
    """

    def __init__(self, log: ImposedMotion, side: float, bands: tuple[float, ...]):
        self.log, self.side = log, side
        record, setting, nominal = log.record, log.setting, log.nominal
        speed = 0.5 * (record.speed[1:] + record.speed[:-1])
        # A smooth sign: at a reversal the sign of a measured speed is uncertain by a few samples.
        turning = np.tanh(speed / (MOVING * setting.speed))
        # Torques are linear in these, so that their means over `COARSE` samples are those of what they are made of.
        self.slope, self.turning, self.speed = (_coarse(x) for x in (np.diff(record.speed) / record.dt, turning, speed))
        level, drag, held = _beside(log, speed)
        self.level, self.drag, self.held = _coarse(turning * level), _coarse(drag), _coarse(held)
        self.given = sum(self._parts(*([nominal[name]] for name in NOMINAL)))
        corners = [share * highest_frequency(setting) * record.dt * COARSE for share in bands]
        self.filters = _filters(len(speed) // COARSE, corners)
        course = log.course[:-1]
        # Stretches of half a window, at its start and at its middle; all of their samples must have a missing torque.
        known, half = _coarse(course), record.samples // 2 // COARSE - 1
        starts = -(-np.concatenate([record.starts, record.starts + record.samples // 2]) // COARSE)
        inside = starts[starts + half <= len(known)]
        rows = inside[:, None] + np.arange(half)
        self.rows = rows[np.all(np.isfinite(known[rows]), axis=1)]
        self.usable = len(self.rows) > 0 and half > 1
        self.missing = _coarse(np.where(np.isfinite(course), course, 0.0))[None]
        if self.usable:
            self.floors = [FLOOR * np.mean(energy) for energy in self._energies(self.missing)]

    def scores(self, rows: Values) -> Values:
        """Mean logarithm of the torque's energy that is left, lower is better, shape (lanes,).

        A logarithm, so that a few stretches with large contacts do not decide alone.

        Args:
            rows: one column of parameters a lane, shape (parameters, lanes).
        """
        log, found = self.log, []
        family = log.hidden_states.family
        base = family.neutral(log.setting)
        base[family.index("load_side")] = self.side
        places = [family.index(name) for name in NAMES]
        for first in range(0, rows.shape[1], LANES):
            some = rows[:, first : first + LANES]
            vectors = np.repeat(base[:, None], some.shape[1], axis=1)
            vectors[places] = some
            shaft = np.ascontiguousarray(_coarse(log.hidden_states.shafts(vectors, log.which)).T)
            share, (level, smooth), (inertia, coulomb, viscous) = some[1, :, None], some[4:6, :, None], some[6:]
            parts = self._parts(inertia, coulomb, viscous)
            # What the load side takes: its inertia, its share of the friction, a known load.
            taken = share * parts[0] + level * parts[1] + smooth * parts[2] + self.held
            if self.side > 0.5:
                # The load takes what the shaft gives, as the simulated motor winds it up; the rest as a torque at the
                # command, which reaches the shaft through the motor alone: else a weak spring would leave hardly any.
                left = self._energies(taken - shaft, self._lost(some))
            else:
                # One mass: J a = u - friction + missing. The motor: (1 - share) J a = u - its friction - shaft.
                # Their difference is the missing torque that this shaft would explain, beside other numbers.
                missing = self.missing + sum(parts) - self.given
                left = self._energies(missing - (taken - shaft))
            found.append(sum(np.mean(np.log(e + floor), axis=1) for e, floor in zip(left, self.floors, strict=True)))
        out = np.concatenate(found)
        return np.where(np.isfinite(out), out, np.inf)

    def _parts(self, inertia: ArrayLike, coulomb: ArrayLike, viscous: ArrayLike) -> tuple[Values, Values, Values]:
        """Torques of the inertia, of the friction's level and of its drag [N m], each (lanes, coarse samples)."""
        inertia, coulomb, viscous = (np.asarray(one)[:, None] for one in (inertia, coulomb, viscous))
        return inertia * self.slope, self.turning * coulomb + self.level, self.speed * viscous + self.drag

    def _lost(self, rows: Values) -> Values:
        """Torque at the command over what of it reaches a clamped load through the shaft [1], (lanes, frequencies).

        At least 1: where the motor swings on the shaft less is needed, but hardly ever as little as that.
        """
        dt, (share, hertz, ratio, _, smooth, inertia, _, viscous) = self.log.record.dt, rows[1:, :, None]
        frequency = 2.0 * np.pi * hertz
        reduced = inertia * share * (1.0 - share)
        stiffness, damping = reduced * frequency**2, 2.0 * ratio * reduced * frequency
        s = 2j * np.pi * np.fft.rfftfreq(2 * (len(self.filters[0]) - 1), COARSE * dt)
        rubbing = (1.0 - smooth) * viscous
        shaft = stiffness + damping * s
        return np.maximum(np.abs(((1.0 - share) * inertia * s**2 + rubbing * s + shaft) / shaft), 1.0)

    def _energies(self, course: Values, lost: Values | None = None) -> list[Values]:
        """For each band, variance in each stretch, (lanes, stretches); of a coarse course times `lost` by frequency.

        About the stretch's mean, since slow errors come from other causes. A lane whose course has a NaN keeps it: as
        zero, a load whose simulation diverged would score best.
        """
        with np.errstate(invalid="ignore", over="ignore"):
            return [np.var(passed[:, self.rows], axis=2) for passed in _passed(course, self.filters, lost)]


def _beside(log: ImposedMotion, speed: Values) -> tuple[Values, Values, Values]:
    """What the nominal model has beside its numbers, in the measured motion: (level, drag, load) [N m], (samples,)."""
    machine, angle = log.hidden_states.family.machine, log.record.angle
    torque, time = jnp.asarray(log.record.torque[: len(speed)]), jnp.asarray(log.record.time[: len(speed)])
    motion = Motion(jnp.asarray(speed), jnp.asarray(0.5 * (angle[1:] + angle[:-1])), time, torque)
    law = machine.law
    level = np.asarray(law.level(motion)) - float(law.coulomb)
    drag = np.asarray(law.drag(motion)) - float(law.viscous) * speed
    return level, drag, np.broadcast_to(np.asarray(machine.plant.load.readout(motion)), speed.shape)


def _coarse(course: Values) -> Values:
    """Means over `COARSE` samples, along the first axis."""
    count = len(course) // COARSE
    return np.mean(course[: count * COARSE].reshape(count, COARSE, *course.shape[1:]), axis=1)


def _filters(samples: int, corners: list[float]) -> list[Values]:
    """Magnitudes of Butterworth low-passes run forwards and backwards, at the frequencies of `_passed`.

    Args:
        samples: of a course.
        corners: in cycles a sample [1].
    """
    size = -(-(samples + 2 * EDGE) // 1024) * 1024  # a multiple of 1024 has small factors: a fast transform
    # The bilinear transform's frequency, as scipy.signal.butter has it; below Nyquist, where the tangent is infinite.
    warped = np.tan(np.pi * np.minimum(np.fft.rfftfreq(size), 0.4999))
    return [1.0 / (1.0 + (warped / np.tan(np.pi * corner)) ** (2 * ORDER)) for corner in corners]


def _passed(course: Values, filters: list[Values], lost: Values | None = None) -> list[Values]:
    """A course of shape (lanes, samples) through each filter, as by scipy.signal.filtfilt (whose import is slow).

    The ends are continued by an odd reflection, so that a slope at an end does not ring.

    Args:
        course: the torque.
        filters: magnitudes, each (frequencies,).
        lost: a further one for each lane, (lanes, frequencies).
    """
    samples = course.shape[1]
    edge, size = min(EDGE, samples - 1), 2 * (len(filters[0]) - 1)
    before = 2.0 * course[:, :1] - course[:, edge:0:-1]
    after = 2.0 * course[:, -1:] - course[:, -2 : -2 - edge : -1]
    spectrum = np.fft.rfft(np.concatenate([before, course, after], axis=1), size)
    spectrum = spectrum if lost is None else spectrum * lost
    return [np.fft.irfft(spectrum * one, size)[:, edge : edge + samples] for one in filters]
