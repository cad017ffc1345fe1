"""A load on a shaft, simulated with the measured motion imposed on the side that has a sensor.

Nothing diverges then: only the other mass is simulated, over a whole part of the log at once, and the shaft's torque is
compared with the one that the measured side asks for.
"""

import functools
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import jax.numpy as jnp
import numpy as np
from numpy.typing import ArrayLike

from ...blocks.signals import Motion
from ...logs.arrays import Values
from ..data.record import Record
from ..data.setting import Setting
from ..effects.parameters import highest_frequency
from ..simulate.hidden_states import BLOCK, HiddenStates
from ..simulate.lane_kernel import LANES
from .candidate import NOMINAL

NAMES = ("gap", "load_share", "frequency", "damping_ratio", "friction_share", "viscous_share", *NOMINAL)
"""The parameters of a load and of both masses: the rows that `Objective` takes."""
HELD_RATIO = 0.5  # damping ratio of a load on a held motor [1], behind which the motor's noise is weighed
FLOOR = 0.02  # of the compared torque's mean square: a stretch with less left counts as explained
ORDER = 3  # of the Butterworth low-passes
COARSE = 3  # samples that are averaged before they are filtered: a sixth of the Nyquist frequency is looked at
EDGE = 170  # coarse samples of padding at either end of a filtered course
MOVING = 0.01  # of the top speed: width of the reversal of friction
WINDOWS = 8  # of the log, at least, that are looked at together: about as many reversals
CHANGE = 0.01  # of a logarithm, for a derivative
DIVERGED = 1e60  # derivative of a torque [N m] from which on a simulation has diverged


@dataclass(frozen=True)
class ImposedMotion:
    """A log whose motion is imposed on the side with the sensor, beside the nominal model.

    Attributes:
        hidden_states: of the family of a backlash, which at no clearance is a spring.
        which: index of the record.
        record: the log.
        course: the missing torque of the nominal model [N m], NaN where unknown, shape (samples,); with all noise of
            the readings in it, which what a shaft explains holds too.
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

    @functools.cached_property
    def part(self) -> slice:
        """The samples that are looked at: the part in which most torque is missing, mean logarithm of its windows.

        Of whole blocks, as they are simulated: the search takes most of the time before any effect is fitted.
        """
        samples, starts, size = len(self.record.time), self.record.starts, self.record.samples
        span = -(-WINDOWS * size // BLOCK) * BLOCK
        if samples <= span:
            return slice(0, samples)
        courses = self.course[starts[:, None] + np.arange(size)]
        energy = np.log(np.maximum(np.var(courses, axis=1), np.finfo(float).tiny))  # NaN where it is withheld
        first = starts[starts + span <= samples]
        inside = (starts >= first[:, None]) & (starts + size <= first[:, None] + span)
        known = inside & np.isfinite(energy)
        mean = np.sum(np.where(known, energy, 0.0), axis=1) / np.maximum(np.sum(known, axis=1), 1)
        best = int(first[int(np.argmax(np.where(np.any(known, axis=1), mean, -np.inf)))]) if len(first) else 0
        return slice(best, best + span)


class Objective:
    """The objective of the search: how much torque a shaft leaves unexplained on the measured side, at the command.

    Args:
        log: and its nominal model.
        side: 0 for sensors on the motor, 1 on the load.
        bands: corners of low-passes over the highest resonance [1].
    """

    def __init__(self, log: ImposedMotion, side: float, bands: tuple[float, ...]):
        self.log, self.side = log, side
        record, setting, nominal, part = log.record, log.setting, log.nominal, log.part
        measured = record.speed[part]
        speed = 0.5 * (measured[1:] + measured[:-1])
        # A smooth sign: at a reversal the sign of a measured speed is uncertain by a few samples.
        turning = np.tanh(speed / (MOVING * setting.speed))
        # Torques are linear in these, so that their means over `COARSE` samples are those of what they are made of.
        self.slope, self.turning, self.speed = (_coarse(x) for x in (np.diff(measured) / record.dt, turning, speed))
        level, drag, held = _beside(log, speed)
        self.level, self.drag, self.held = _coarse(turning * level), _coarse(drag), _coarse(held)
        self.given = sum(self._parts(*([nominal[name]] for name in NOMINAL)))
        corners = [share * highest_frequency(setting) * record.dt * COARSE for share in bands]
        self.filters = _filters(len(speed) // COARSE, corners)
        course = log.course[part][:-1]
        # Stretches of half a window, at its start and at its middle; all of their samples must have a missing torque.
        known, half = _coarse(course), record.samples // 2 // COARSE - 1
        starts = np.concatenate([record.starts, record.starts + record.samples // 2]) - part.start
        # A part from the middle of a log begins with a shaft that was wound up as if it had rested: its first window is
        # of that.
        starts = -(-starts[starts >= (record.samples if part.start else 0)] // COARSE)
        inside = starts[starts + half <= len(known)]
        rows = inside[:, None] + np.arange(half)
        self.rows = rows[np.all(np.isfinite(known[rows]), axis=1)]
        self.usable = len(self.rows) > 0 and half > 1
        self.missing = _coarse(np.where(np.isfinite(course), course, 0.0))[None]
        if self.usable:
            self.floors = [FLOOR * np.mean(energy) for energy in self._energies(self.missing)]

    def scores(self, rows: Values, used: int | None = None) -> Values:
        """Mean logarithm of the torque's energy that is left, lower is better, shape (lanes,).

        A logarithm, so that a few stretches with large contacts do not decide alone.

        Args:
            rows: one column of parameters a lane, shape (parameters, lanes).
            used: number of bands that count, the lowest ones; None for all.
        """
        return np.concatenate([self._score(left) for left in self._left(rows, used)])

    def _score(self, left: Sequence[Values]) -> Values:
        """`scores` of what is left, by band (lanes, stretches, samples)."""
        energies = [np.mean(one**2, axis=2) for one in left]
        out = sum(np.mean(np.log(e + floor), axis=1) for e, floor in zip(energies, self.floors, strict=False))
        return np.where(np.isfinite(out), out, np.inf)

    def linearised(self, rows: Values, used: int) -> tuple[Values, Values, Values]:
        """(scores, half their gradients, Gauss-Newton matrices) by the logarithms of the parameters, of each column.

        Args:
            rows: shape (parameters, points).
            used: number of bands that count, the lowest ones.

        Returns:
            Shapes (points,), (points, parameters) and (points, parameters, parameters).
        """
        names, points = rows.shape
        changed = [np.where(np.arange(names) == k, np.exp(CHANGE), 1.0)[:, None] * rows for k in range(names)]
        lanes = np.concatenate([rows, *changed], axis=1)
        parts = zip(*self._left(lanes, used), strict=True)  # by band, of all lanes
        gradient, matrix = np.zeros((points, names)), np.zeros((points, names, names))
        joined = [np.concatenate(part) for part in parts]
        for part, floor in zip(joined, self.floors, strict=False):
            shaped = part.reshape(names + 1, points, *part.shape[1:])
            with np.errstate(invalid="ignore", over="ignore"):
                here, slope = shaped[0], (shaped[1:] - shaped[0]) / CHANGE
            slope = np.where(np.abs(slope) < DIVERGED, slope, 0.0)  # of a neighbour that diverges nothing is known
            weight = 1.0 / (np.mean(here**2, axis=2) + floor) / here.shape[1] / here.shape[2]
            gradient += np.einsum("kpsn,psn,ps->pk", slope, here, weight)
            matrix += np.einsum("kpsn,lpsn,ps->pkl", slope, slope, weight, optimize=True)
        return self._score([part[:points] for part in joined]), np.nan_to_num(gradient), np.nan_to_num(matrix)

    def _left(self, rows: Values, used: int | None) -> Iterator[list[Values]]:
        """What a shaft leaves of the torque in each stretch, by band (lanes, stretches, samples); chunks of lanes."""
        log = self.log
        family = log.hidden_states.family
        base = family.neutral(log.setting)
        base[family.index("load_side")] = self.side
        base[family.index("shaft_inertia")] = 0.0  # resonances are meant with the inertia of each column
        places = [family.index(name) for name in NAMES]
        for first in range(0, rows.shape[1], LANES):
            some = rows[:, first : first + LANES]
            vectors = np.repeat(base[:, None], some.shape[1], axis=1)
            vectors[places] = some
            shaft = np.ascontiguousarray(_coarse(log.hidden_states.shafts(vectors, log.which, log.part)).T)
            share, (level, smooth), (inertia, coulomb, viscous) = some[1, :, None], some[4:6, :, None], some[6:]
            parts = self._parts(inertia, coulomb, viscous)
            # What the load side takes: its inertia, its share of the friction, a known load.
            taken = share * parts[0] + level * parts[1] + smooth * parts[2] + self.held
            if self.side > 0.5:
                # The load takes what the shaft gives, as the simulated motor winds it up; the rest as a torque at the
                # command, which reaches the shaft through the motor alone: else a weak spring would leave hardly any.
                yield self._stretches(taken - shaft, self._lost(some), used)
            else:
                # One mass: J a = u - friction + missing. The motor: (1 - share) J a = u - its friction - shaft.
                # Their difference is the missing torque that this shaft would explain, beside other numbers.
                missing = self.missing + sum(parts) - self.given
                yield self._stretches(missing - (taken - shaft), self._moved_more(some), used)

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

    def _moved_more(self, rows: Values) -> Values:
        """Motion of a motor with a load on its shaft under a torque over that of one rigid mass, (lanes, frequencies).

        Behind a shaft the speed's noise is noise of the motor's torque alone, and less of it: a light motor would leave
        least without this.
        """
        dt, (share, hertz) = self.log.record.dt, rows[1:3, :, None]
        own = 2.0 * np.pi * hertz * np.sqrt(1.0 - share)  # of the load on a held motor [rad/s]
        s = 2j * np.pi * np.fft.rfftfreq(2 * (len(self.filters[0]) - 1), COARSE * dt)
        turned = 2.0 * HELD_RATIO * own * s
        return 1.0 / np.abs(1.0 - share + share * (own**2 + turned) / (s**2 + own**2 + turned))

    def _energies(self, course: Values) -> list[Values]:
        """For each band, variance of a coarse course in each stretch, (lanes, stretches)."""
        return [np.mean(one**2, axis=2) for one in self._stretches(course)]

    def _stretches(self, course: Values, lost: Values | None = None, used: int | None = None) -> list[Values]:
        """For each band, a coarse course times `lost` by frequency in each stretch, (lanes, stretches, samples).

        About the stretch's mean, since slow errors come from other causes. A lane whose course has a NaN keeps it: as
        zero, a load whose simulation diverged would score best.
        """
        with np.errstate(invalid="ignore", over="ignore"):
            parts = [passed[:, self.rows] for passed in _passed(course, self.filters[:used], lost)]
            return [part - np.mean(part, axis=2, keepdims=True) for part in parts]


def _beside(log: ImposedMotion, speed: Values) -> tuple[Values, Values, Values]:
    """What the nominal model has beside its numbers, in the measured motion: (level, drag, load) [N m], (samples,)."""
    machine, angle = log.hidden_states.family.machine, log.record.angle[log.part]
    torque, time = (jnp.asarray(column[log.part][:-1]) for column in (log.record.torque, log.record.time))
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
