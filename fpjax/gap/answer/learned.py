"""Learned: what no named effect says, as tables over what was recorded, and what follows none of it.

Tables are added while they predict windows that no fit has seen. That is an honest "where": of what is left, this
share follows the velocity, that one the position, the rest nothing that was recorded. It is also a guard for named
effects: a cause that a table of another variable explains as well is not sure.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from ...blocks.learned import LearnedTorque, split_jump
from ..fit.candidate import Fit
from ..fit.search import Search
from .smooth import Smooth, Smoother, make_windows
from .smooth_tables import Table, Variable, make_tables

SURE = 5.0  # nats on withheld windows, without the best of them: five variables, one in thirty by chance
ERRORS = 2.0  # standard errors by which the mean gain of a withheld window is above zero
HARMLESS = -1.0  # nats that the worst withheld window may lose where the gains differ too much for a standard error
LEAST = 0.02  # of the missing torque's energy: a table that takes less is not worth its points
CHORD = 1.0 / 6.0  # of a point's departure from its neighbours' line: what a parabola is off the best straight lines
BAND = 1.645  # standard deviations of a 90 % band

Values = np.ndarray


@dataclass(frozen=True)
class LearnedLaw:
    """A torque that opposes, as friction does, as a table of one variable.

    Attributes:
        of: "velocity" [rad/s], "position" [rad], "torque" [N m], "load" [N m] or "time" [s]. A load is the size of
            the commanded torque; its torque has the direction of the motion.
        at: points, in the variable's unit, increasing; a velocity has 0 twice, once for each direction.
        torque: at each point [N m].
        low: lower end of the 90 % band [N m].
        high: upper end of it [N m].
        period: of the variable, in its unit; None where nothing repeats.
        share: of the missing torque's energy on withheld windows that it takes [1], 0 to 1.
    """

    of: Variable
    at: tuple[float, ...]
    torque: tuple[float, ...]
    low: tuple[float, ...]
    high: tuple[float, ...]
    period: float | None
    share: float

    def curve(self, x: Values) -> tuple[Values, Values, Values]:
        """(torque, low, high) [N m] at x in the variable's unit, each of x's shape.

        Args:
            x: where; at a velocity of exactly zero the mean of both directions.
        """
        lines = np.stack([self.torque, self.low, self.high])
        at = np.asarray(self.at)
        x = np.asarray(x, float)
        if self.period is not None:
            at, lines = np.append(at, at[0] + self.period), np.concatenate([lines, lines[:, :1]], axis=1)
            x = at[0] + np.mod(x - at[0], self.period)
        twice = np.flatnonzero(np.diff(at) == 0.0)
        if not len(twice):
            torque, low, high = (np.interp(x, at, line) for line in lines)
            return torque, low, high
        cut = int(twice[0]) + 1
        found = []
        for line in lines:
            below, above = np.interp(x, at[:cut], line[:cut]), np.interp(x, at[cut:], line[cut:])
            found.append(np.where(x < 0.0, below, np.where(x > 0.0, above, 0.5 * (below + above))))
        return found[0], found[1], found[2]


@dataclass(frozen=True)
class LearnedBlocks:
    """What the corrected model takes of the learned laws.

    Attributes:
        tables: loads without a jump, to be put beside the known one.
        coulomb: to be added to the friction law's Coulomb level [N m]: the jump at zero velocity, which sticks.
        load_coefficient: to be added to that of the friction law [1].
    """

    tables: tuple[LearnedTorque, ...]
    coulomb: float
    load_coefficient: float


@dataclass(frozen=True)
class Learned:
    """The laws that a fit's missing torque follows.

    Attributes:
        laws: in the order in which they were found.
        nothing: share of the missing torque's energy on withheld windows that follows nothing recorded [1]; 1 where
            nothing was learned.
        before: missing torque on withheld windows [N m], rms, as the fit leaves it.
        after: as the fit and the laws leave it [N m].
        gain: evidence [nats] that the laws add to the fit.
        gains: evidence [nats] that the best law of each variable adds alone.
        level: q of all octaves together beside the laws, as `Fit.level` [N m].
    """

    laws: tuple[LearnedLaw, ...]
    nothing: float
    before: float
    after: float
    gain: float
    gains: Mapping[Variable, float]
    level: float

    def gain_of(self, variable: Variable) -> float:
        """Evidence [nats] that the best law of a variable adds alone, comparable with differences of `Fit.evidence`.

        Returns:
            0 for a variable that the logs do not show.
        """
        return self.gains.get(variable, 0.0)

    def law(self, variable: Variable) -> LearnedLaw | None:
        """The law of a variable, or None."""
        return next((law for law in self.laws if law.of == variable), None)

    def blocks(self) -> LearnedBlocks:
        """The laws for a simulation."""
        tables, coulomb, load = [], 0.0, 0.0
        for law in self.laws:
            if law.of == "load":
                load += law.torque[-1] / law.at[-1]
                continue
            at, torque, jump = split_jump(law.at, law.torque) if law.of == "velocity" else (law.at, law.torque, 0.0)
            coulomb += jump
            tables.append(LearnedTorque(law.of, at, torque, law.period))
        return LearnedBlocks(tuple(tables), coulomb, load)


def learn(search: Search, fit: Fit) -> Learned:
    """What a fit's missing torque follows of what was recorded.

    Args:
        search: that the fit is from.
        fit: a finished one; it is not changed.

    Returns:
        Laws that predict withheld windows, fitted on the other ones; none where nothing is sure.
    """
    setting = search.setting
    smoother = Smoother(make_windows(search, fit.candidate), setting.friction, max(setting.effort, setting.torque))
    tables = make_tables(search.records, setting.periods.get("torque", ())[:1])
    base = current = smoother.base()
    energies = [_energy(search, smoother, base)]
    gains: dict[Variable, float] = {}
    names: list[Variable] = list(tables)
    while names:
        found: dict[Variable, Smooth] = {
            name: one for name in names if (one := _best(smoother, current, tables[name])) is not None
        }
        if current is base:
            gains = {name: found[name].evidence - base.evidence for name in found}
        sure: list[Variable] = [name for name in found if _sure(smoother, current, found[name])]
        if not sure:
            break
        best: Variable = max(sure, key=lambda name: found[name].evidence)
        energy = _energy(search, smoother, found[best])
        if energies[-1] - energy < LEAST * energies[0]:
            break
        current = found[best]
        energies.append(energy)
        names.remove(best)
    shares, nothing = _shares(energies)
    level = smoother.windows.fitter.modes.mean_level(current.level, search.band)
    return Learned(
        _laws(current, shares), nothing, _rms(energies[0]), _rms(energies[-1]), current.evidence - base.evidence, gains,
        level,
    )  # fmt: skip


def _best(smoother: Smoother, current: Smooth, tables: Sequence[Table]) -> Smooth | None:
    """The best of a variable's tables by the evidence."""
    fits = [smoother.add(current, table) for table in tables]
    return max(fits, key=lambda f: f.evidence, default=None)


def _sure(smoother: Smoother, before: Smooth, after: Smooth) -> bool:
    """Whether the withheld windows are better predicted, and not by one of them only."""
    gain = -0.5 * (after.cost - before.cost)[~smoother.windows.fitted]
    if len(gain) < 2 or np.sum(gain) - np.max(gain) < SURE:
        return False
    error = np.std(gain, ddof=1) / np.sqrt(len(gain))
    return bool(np.mean(gain) > ERRORS * error or np.min(gain) > HARMLESS)


def _energy(search: Search, smoother: Smoother, fit: Smooth) -> float:
    """Mean square of the missing torque on withheld windows [N^2 m^2], in the nominal model's band, without noise's."""
    modes, w = smoother.windows.fitter.modes, smoother.windows
    weight = np.where(modes.sensor, 0.0, search.band**2 / np.where(modes.sensor, 1.0, np.maximum(modes.gain, 1e-300)))
    square = (fit.left**2 - w.noise[:, None])[~w.fitted] @ weight
    return float(np.mean(square)) / search.records[0].samples if len(square) else float("nan")


def _rms(energy: float) -> float:
    return float(np.sqrt(max(energy, 0.0))) if np.isfinite(energy) else float("nan")


def _shares(energies: Sequence[float]) -> tuple[list[float], float]:
    """(share of each law, share of nothing), which sum to one."""
    taken = np.maximum(-np.diff(energies), 0.0)
    left = max(energies[-1], 0.0) if np.isfinite(energies[-1]) else 0.0
    total = float(np.sum(taken)) + left
    if len(taken) == 0 or not total > 0.0:
        return [0.0] * len(taken), 1.0
    return [float(t / total) for t in taken], float(left / total)


def _laws(fit: Smooth, shares: Sequence[float]) -> tuple[LearnedLaw, ...]:
    if not fit.tables:
        return ()
    deviation = fit.deviation()
    found = []
    for table, part, share in zip(fit.tables, fit.parts(), shares, strict=True):
        at, torque = table.at, fit.torque[part]
        # A smooth curve lies off the straight lines that stand for it.
        half = BAND * deviation[part] + CHORD * table.departures(torque)
        if table.of == "load":  # through zero
            at, torque, half = (np.concatenate([[0.0], each]) for each in (at, torque, half))
        columns = (at, torque, torque - half, torque + half)
        a, t, low, high = (tuple(float(x) for x in column) for column in columns)
        found.append(LearnedLaw(table.of, a, t, low, high, table.period, share))
    return tuple(found)
