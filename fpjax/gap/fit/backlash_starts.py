"""Start values of fits of a backlash, found with the measured motion imposed on the motor.

The motion of a load that crosses a backlash depends on every contact before, so that the cost of a window has many
local minima and a fit from rule-of-thumb values ends in the nearest one: so it was in four of five development logs
with a backlash. With the measured motion imposed on the motor nothing diverges: only the load is simulated, over the
whole log at once, and the shaft's torque on the motor is compared with the missing torque of the nominal model.
"""

import numpy as np

from ...logs.arrays import Values
from ..data.record import Record
from ..data.setting import Setting
from ..effects.parameters import highest_contact, highest_frequency
from ..simulate.hidden_states import HiddenStates
from ..simulate.lane_kernel import LANES

# A grid over the five parameters, then a random search around its best points, in logarithms of the parameters.
NAMES = ("gap", "load_share", "frequency", "damping_ratio", "friction_share")  # rows of an array of parameters
GAPS = np.geomspace(3e-4, 2e-2, 16)  # clearances, as the time to cross them at top speed [s]
SHARES = (0.15, 0.35, 0.6)  # of the inertia that is on the load [1]
RATIOS = (0.15, 0.8)  # damping ratios of a face in contact [1]
FRICTIONS = (0.2, 0.7)  # of the friction that is on the load [1]
ROUNDS = 3  # of the random search
BEST, VARIED = 8, 128  # points that are varied in a round, and variations of them together: two chunks of lanes
SPREAD = (0.3, 0.3, 0.4, 0.5, 0.3)  # standard deviation of a variation in the first round, of the natural logarithm
STARTS = 3  # returned, and as many with less damping
APART = 0.25  # least difference of two starts in clearance, share or frequency, of the natural logarithm
FLOOR = 0.02  # of the missing torque's mean square: a stretch with less left counts as explained
# Corners of two low-passes over the highest resonance. Behind the lower one only a contact's impulse is left, which is
# right before the course of its torque is: it leads the search from afar.
BANDS = (0.12, 0.5)
ORDER = 3  # of the Butterworth low-passes
EDGE = 512  # samples of padding at either end of a filtered course
LIVELY = 0.2  # of the damping found: errors of the contacts' times look like damping, so that less of it is tried too
MOVING = 0.01  # of the top speed: width of the reversal of friction


def contact_starts(
    hidden_states: HiddenStates, which: int, record: Record, course: Values, nominal: dict[str, float], setting: Setting
) -> tuple[dict[str, float], ...]:
    """Start values of fits of a backlash, the most likely first; () where no stretch of the log can be used.

    Args:
        hidden_states: of a family with a transmission.
        which: index of the record.
        record: the log.
        course: the missing torque of the nominal model [N m], NaN where unknown, shape (samples,).
        nominal: that model's parameters by name.
        setting: sizes.
    """
    objective = _Objective(hidden_states, which, record, course, nominal, setting)
    if not objective.usable:
        return ()
    rng = np.random.default_rng(0)
    low, high = (np.log(side) for side in _bounds(setting))
    tried = np.log(_grid(setting))
    scores = objective.scores(np.exp(tried))
    for shrink in 0.6 ** np.arange(ROUNDS):
        best = tried[:, np.argsort(scores)[:BEST]]
        size = shrink * np.array(SPREAD)[:, None]
        more = best[:, rng.integers(0, best.shape[1], VARIED)] + size * rng.standard_normal((len(size), VARIED))
        more = np.clip(more, low[:, None], high[:, None])
        tried = np.concatenate([tried, more], axis=1)
        scores = np.concatenate([scores, objective.scores(np.exp(more))])
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
    """The points of the grid, shape (parameters, lanes)."""
    frequencies = 0.35 * highest_frequency(setting), highest_frequency(setting)
    axes = np.meshgrid(GAPS * setting.speed, SHARES, frequencies, RATIOS, FRICTIONS, indexing="ij")
    return np.stack([axis.ravel() for axis in axes])


def _bounds(setting: Setting) -> tuple[Values, Values]:
    """(lowest, highest) values of the search, each of shape (parameters,)."""
    frequencies = 0.1 * highest_frequency(setting), highest_contact(setting)
    low = [0.1 * GAPS[0] * setting.speed, 0.05, frequencies[0], 0.02, 0.02]
    return np.array(low), np.array([2.0 * GAPS[-1] * setting.speed, 0.9, frequencies[1], 1.5, 0.98])


class _Objective:
    """The objective of the search: how much of the missing torque a backlash leaves unexplained."""

    def __init__(
        self, hidden_states: HiddenStates, which: int, record: Record, course: Values, nominal: dict[str, float],
        setting: Setting,
    ):  # fmt: skip
        self.hidden_states, self.which, self.setting = hidden_states, which, setting
        self.nominal = nominal
        speed = 0.5 * (record.speed[1:] + record.speed[:-1])
        # A smooth sign: at a reversal the sign of a measured speed is uncertain by a few samples.
        turning = np.tanh(speed / (MOVING * setting.speed))
        self.inertial = nominal["inertia"] * np.diff(record.speed) / record.dt
        self.friction = nominal["coulomb"] * turning + nominal["viscous"] * speed
        self.filters = _filters(len(speed), [share * highest_frequency(setting) * record.dt for share in BANDS])
        course = course[:-1]
        # Stretches of half a window, at its start and at its middle; all of their samples must have a missing torque.
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
        """Mean logarithm of the missing torque's energy that is left, lower is better, shape (lanes,).

        A logarithm, so that a few stretches with large contacts do not decide alone.

        Args:
            rows: one column of parameters a lane, shape (parameters, lanes).
        """
        family, found = self.hidden_states.family, []
        base = family.neutral(self.setting)
        for name, value in self.nominal.items():
            base[family.index(name)] = value
        places = [family.index(name) for name in NAMES]
        for first in range(0, rows.shape[1], LANES):
            some = rows[:, first : first + LANES]
            vectors = np.repeat(base[:, None], some.shape[1], axis=1)
            vectors[places] = some
            shaft = self.hidden_states.shafts(vectors, self.which)
            share, on_load = some[1], some[4]
            # One mass: J a = u - friction + missing. The motor: (1 - share) J a = u - (1 - on_load) friction - shaft.
            # Their difference is the missing torque that this backlash would explain.
            explained = share * self.inertial[:, None] + on_load * self.friction[:, None] - shaft
            left = self._energies(self.missing[:, None] - explained)
            found.append(sum(np.mean(np.log(e + floor), axis=0) for e, floor in zip(left, self.floors, strict=True)))
        out = np.concatenate(found)
        return np.where(np.isfinite(out), out, np.inf)

    def _energies(self, course: Values) -> list[Values]:
        """For each band, variance in each stretch, shape (stretches, lanes).

        About the stretch's mean, since slow errors come from other causes. A lane whose course has a NaN keeps it: as
        zero, a load whose simulation diverged would score best.
        """
        with np.errstate(invalid="ignore", over="ignore"):
            return [np.var(passed[self.rows], axis=1) for passed in _passed(course, self.filters)]


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


def _passed(course: Values, filters: list[Values]) -> list[Values]:
    """A course of shape (samples, lanes) through each filter, as by scipy.signal.filtfilt (whose import is slow).

    The ends are continued by an odd reflection, so that a slope at an end does not ring.
    """
    edge, size = min(EDGE, len(course) - 1), 2 * (len(filters[0]) - 1)
    before, after = 2.0 * course[0] - course[edge:0:-1], 2.0 * course[-1] - course[-2 : -2 - edge : -1]
    spectrum = np.fft.rfft(np.concatenate([before, course, after]), size, axis=0)
    inside = slice(edge, edge + len(course))
    return [np.fft.irfft(spectrum * one[:, None], size, axis=0)[inside] for one in filters]
