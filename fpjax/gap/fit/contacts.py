"""Contacts: where fits of a backlash start from, found with the motor's motion imposed.

A load that meets the faces of a gap makes the motion of a whole window hang on every contact before, so that a fit
from afar ends in the next valley. With the measured motion imposed on the motor nothing diverges: only the load is
simulated, all of the log at once, and what its shaft would ask of the motor is compared with the missing torque.
"""

import numpy as np

from ..data.record import Record
from ..data.setting import Setting
from ..effects.parameters import highest_contact, highest_frequency
from ..simulate.hidden import Observer
from ..simulate.replay import LANES

Values = np.ndarray

NAMES = ("gap", "load_share", "frequency", "damping_ratio", "friction_share")  # of a row of parameters
GAPS = np.geomspace(3e-4, 2e-2, 16)  # of the way at top speed in a second
SHARES = (0.15, 0.35, 0.6)  # of the inertia, on the load
RATIOS = (0.15, 0.8)  # of a face's damping to its critical one
FRICTIONS = (0.2, 0.7)  # shares on the load
ROUNDS = 3  # in which the best are varied
BEST, VARIED = 8, 128  # that are varied, and how many variations
SPREAD = (0.3, 0.3, 0.4, 0.5, 0.3)  # of a variation, logarithms, in the first round
STARTS = 3
APART = 0.25  # least difference of two starts in gap, share or frequency, a logarithm
FLOOR = 0.02  # of the missing torque's mean square: below it a stretch counts as explained
BANDS = (0.12, 0.5)  # of the highest resonance: up to the first, what a contact gives in all counts, not its course
ORDER = 3  # of the low-passes
EDGE = 512  # samples that the course is continued by at either end
LIVELY = 0.2  # of the damping found: noise in when a face is met looks like damping, so that less is tried too
MOVING = 0.01  # of the top speed: friction turns round within it


def contact_starts(
    observer: Observer, which: int, record: Record, course: Values, nominal: dict[str, float], setting: Setting
) -> tuple[dict[str, float], ...]:
    """Values that fits of a backlash start from, the most likely first.

    Args:
        observer: of a family with a transmission.
        which: index of the record.
        record: the log.
        course: the missing torque of the nominal model [N m], NaN where unknown, shape (samples,).
        nominal: its parameters by name.
        setting: sizes.
    """
    look = _Look(observer, which, record, course, nominal, setting)
    if not look.usable:
        return ()
    rng = np.random.default_rng(0)
    low, high = (np.log(side) for side in _bounds(setting))
    tried = np.log(_grid(setting))
    scores = look.scores(np.exp(tried))
    for shrink in 0.6 ** np.arange(ROUNDS):
        best = tried[:, np.argsort(scores)[:BEST]]
        size = shrink * np.array(SPREAD)[:, None]
        more = best[:, rng.integers(0, best.shape[1], VARIED)] + size * rng.standard_normal((len(size), VARIED))
        more = np.clip(more, low[:, None], high[:, None])
        tried = np.concatenate([tried, more], axis=1)
        scores = np.concatenate([scores, look.scores(np.exp(more))])
    chosen: list[Values] = []
    for index in np.argsort(scores):
        if all(np.max(np.abs(tried[:, index] - other)[:3]) > APART for other in chosen):
            chosen.append(tried[:, index])
        if len(chosen) == STARTS:
            break
    found = [_values(np.exp(one)) for one in chosen]
    return (*found, *(one | {"damping_ratio": LIVELY * one["damping_ratio"]} for one in found))


def _values(row: Values) -> dict[str, float]:
    return {name: float(value) for name, value in zip(NAMES, row, strict=True)} | {"load_side": 0.0}


def _grid(setting: Setting) -> Values:
    """Shape (parameters, lanes)."""
    frequencies = 0.35 * highest_frequency(setting), highest_frequency(setting)
    axes = np.meshgrid(GAPS * setting.speed, SHARES, frequencies, RATIOS, FRICTIONS, indexing="ij")
    return np.stack([axis.ravel() for axis in axes])


def _bounds(setting: Setting) -> tuple[Values, Values]:
    frequencies = 0.1 * highest_frequency(setting), highest_contact(setting)
    low = [0.1 * GAPS[0] * setting.speed, 0.05, frequencies[0], 0.02, 0.02]
    return np.array(low), np.array([2.0 * GAPS[-1] * setting.speed, 0.9, frequencies[1], 1.5, 0.98])


class _Look:
    """The missing torque, and what a backlash would make of it."""

    def __init__(
        self, observer: Observer, which: int, record: Record, course: Values, nominal: dict[str, float],
        setting: Setting,
    ):  # fmt: skip
        self.observer, self.which, self.setting = observer, which, setting
        self.nominal = nominal
        speed = 0.5 * (record.speed[1:] + record.speed[:-1])
        turning = np.tanh(speed / (MOVING * setting.speed))
        self.inertial = nominal["inertia"] * np.diff(record.speed) / record.dt
        self.friction = nominal["coulomb"] * turning + nominal["viscous"] * speed
        self.filters = _filters(len(speed), [share * highest_frequency(setting) * record.dt for share in BANDS])
        course = course[:-1]
        half = record.samples // 2
        starts = np.concatenate([record.starts, record.starts + half])
        inside = starts[starts + half <= len(course)]
        rows = inside[:, None] + np.arange(half)
        self.rows = rows[np.all(np.isfinite(course[rows]), axis=1)]
        self.usable = len(self.rows) > 0
        self.missing = np.where(np.isfinite(course), course, 0.0)
        if self.usable:
            self.floors = [FLOOR * np.mean(energy) for energy in self._energies(self.missing[:, None])]

    def scores(self, rows: Values) -> Values:
        """Mean logarithm of what each row of parameters leaves of the missing torque, shape (lanes,).

        Args:
            rows: shape (parameters, lanes).
        """
        family, found = self.observer.family, []
        base = family.neutral(self.setting)
        for name, value in self.nominal.items():
            base[family.index(name)] = value
        places = [family.index(name) for name in NAMES]
        for first in range(0, rows.shape[1], LANES):
            some = rows[:, first : first + LANES]
            vectors = np.repeat(base[:, None], some.shape[1], axis=1)
            vectors[places] = some
            shaft = self.observer.shafts(vectors, self.which)
            share, on_load = some[1], some[4]
            # J a = u - friction + missing for one mass; the motor's own equation says what is missing of it.
            told = share * self.inertial[:, None] + on_load * self.friction[:, None] - shaft
            left = self._energies(self.missing[:, None] - told)
            found.append(sum(np.mean(np.log(e + floor), axis=0) for e, floor in zip(left, self.floors, strict=True)))
        out = np.concatenate(found)
        return np.where(np.isfinite(out), out, np.inf)

    def _energies(self, course: Values) -> list[Values]:
        """By band, mean square in each stretch about its mean, shape (stretches, lanes): slow errors are others'.

        NaN in a lane whose course has one: were it taken for nothing missing, a load that diverged would score best.
        """
        with np.errstate(invalid="ignore", over="ignore"):
            return [np.var(passed[self.rows], axis=1) for passed in _passed(course, self.filters)]


def _filters(samples: int, corners: list[float]) -> list[Values]:
    """Butterworth low-passes forwards and backwards, for `_passed`; corners in periods a sample [1]."""
    size = -(-(samples + 2 * EDGE) // 1024) * 1024  # small factors: a fast transform
    warped = np.tan(np.pi * np.minimum(np.fft.rfftfreq(size), 0.4999))
    return [1.0 / (1.0 + (warped / np.tan(np.pi * corner)) ** (2 * ORDER)) for corner in corners]


def _passed(course: Values, filters: list[Values]) -> list[Values]:
    """A course of shape (samples, lanes) through each filter, its ends turned over (scipy.signal is slow to import)."""
    edge, size = min(EDGE, len(course) - 1), 2 * (len(filters[0]) - 1)
    before, after = 2.0 * course[0] - course[edge:0:-1], 2.0 * course[-1] - course[-2 : -2 - edge : -1]
    spectrum = np.fft.rfft(np.concatenate([before, course, after]), size, axis=0)
    inside = slice(edge, edge + len(course))
    return [np.fft.irfft(spectrum * one[:, None], size, axis=0)[inside] for one in filters]
