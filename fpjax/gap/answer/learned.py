"""Learned: what no named effect says, as tables over what was recorded, measured by simulating with them.

Tables are added while they predict fitted windows that were left out of their own fit. What is told is what a
simulation gains by them: the tables become blocks of the machine, and what is then missing on withheld windows, which
had no say so far, is measured as for every other model. A law that does not lower it there, interval and all, is not
told. (The regression's own evidence was tried as a judge and was wrong on logs without a gap: it takes the model's
friction at the measured motion, which is noise at every reversal.)
"""

import copy
from collections.abc import Sequence
from dataclasses import dataclass, replace

import equinox as eqx
import numpy as np

from ...blocks.learned import LearnedTorque, split_jump
from ...model_file.learned import join_load
from ..fit.candidate import Fit
from ..fit.search import Search, Start
from .diagnosis import Learned
from .shrink import draws, interval, withheld
from .smooth import Smooth, smoother_of
from .smooth_tables import make_tables

SURE = 5.0  # nats on windows left out, without the best fold: four variables, one in forty by chance
ERRORS = 2.0  # standard errors by which the mean gain of a fold is above zero
HARMLESS = -1.0  # nats that the worst fold may lose where the gains differ too much for a standard error
LEAST = 0.02  # of the missing torque's energy: a table that takes less is not worth its points
CHORD = 1.0 / 6.0  # of a point's departure from its neighbours' line: what a parabola is off the best straight lines
BAND = 1.645  # standard deviations of a 90 % band

Values = np.ndarray


@dataclass(frozen=True)
class Simulated:
    """Learned laws in the machine.

    Attributes:
        laws: the largest share first; the shares are of the energy that is missing on withheld windows without them.
        fit: the model with the laws beside its causes, of which nothing was fitted again.
    """

    laws: tuple[Learned, ...]
    fit: Fit


def learn(search: Search, fit: Fit) -> Simulated | None:
    """What a fit's missing torque follows of what was recorded; None where no law lowers it on withheld windows.

    Args:
        search: that the fit is from.
        fit: a finished one; it is not changed.
    """
    laws = proposed(search, fit)
    for count in dict.fromkeys((len(laws), 1)):
        if not laws[:count]:
            return None
        beside = simulated(search, fit, laws[:count])
        taken = _taken(withheld(search, fit), withheld(search, beside))
        if taken[1] > LEAST:
            whole = sum(law.share for law in laws[:count])
            shares = [replace(law, share=taken[0] * law.share / whole) for law in laws[:count]]
            return Simulated(tuple(sorted(shares, key=lambda law: -law.share)), beside)
    return None


def _taken(before: Values, after: Values) -> tuple[float, float]:
    """(share of the energy that is gone [1], lower end of its 90 % interval), of the same windows before and after."""
    which = draws(len(before))
    many = 1.0 - np.mean(np.maximum(after, 0.0)[which], 1) / np.maximum(np.mean(before[which], 1), 1e-300)
    return float(1.0 - np.mean(np.maximum(after, 0.0)) / max(np.mean(before), 1e-300)), interval(many)[0]


def simulated(search: Search, fit: Fit, laws: Sequence[Learned]) -> Fit:
    """A fit with laws in its machine; only the windows' start states are looked up again."""
    values = fit.candidate.values()
    tables, coulomb = blocks(laws, values["coulomb"])
    values["coulomb"] += coulomb
    other, plant = copy.copy(search), search.nominal.plant
    other.nominal = replace(search.nominal, plant=eqx.tree_at(lambda p: p.load, plant, join_load(plant.load, tables)))
    other.fitters, other.observers = {}, {}
    c = other.candidate(Start(fit.candidate.effects, (), values), exact=True)
    for own, was in ((c.states, fit.candidate.states), (c.hidden, fit.candidate.hidden)):
        own[:] = [each.copy() for each in was]
    return other.finish([c])[0]


def blocks(laws: Sequence[Learned], level: float) -> tuple[tuple[LearnedTorque, ...], float]:
    """(loads without a jump; the jump at zero velocity, which sticks and belongs in the Coulomb level [N m]).

    Args:
        laws: at most one of velocity.
        level: the Coulomb level that is there [N m]. A friction of less than nothing would push: what a jump down takes
            beyond it is a slope between the table's innermost points.
    """
    tables, coulomb = [], 0.0
    for law in laws:
        at, torque = law.at, law.torque
        if law.of == "velocity":
            at, torque, jump = split_jump(at, torque)
            coulomb = max(jump, -level)
            torque = [value + float(np.sign(x)) * (jump - coulomb) for x, value in zip(at, torque, strict=True)]
        tables.append(LearnedTorque(law.of, at, torque, law.period))  # type: ignore[arg-type]
    return tuple(tables), coulomb


def proposed(search: Search, fit: Fit) -> tuple[Learned, ...]:
    """Laws that predict fitted windows which were left out of their fit, in the order in which they were found.

    No withheld window is looked at: they are to judge. A share is of the energy on the fitted windows, what was found
    before in, as the linear model has it.
    """
    smoother, current = smoother_of(search, fit.candidate)
    tables = make_tables(search.records, search.setting.periods.get("torque", ())[:1])
    band = search.band**2
    energies = [smoother.energy(current, band)]
    while tables:
        tried = [(table, *smoother.gains(current, table)) for some in tables.values() for table in some]
        sure = [one for one in tried if _sure(one[1])]
        if not sure:
            break
        table, _, penalty = max(sure, key=lambda one: np.sum(one[1]))
        after = smoother.fit((*current.tables, table), (*current.penalties, penalty), current.weight)
        energies.append(smoother.energy(after, band))
        if energies[-2] - energies[-1] < LEAST * energies[0]:
            energies.pop()
            break
        current = after
        del tables[table.of]
    return _laws(current, np.maximum(-np.diff(energies), 0.0) / max(energies[0], 1e-300))


def _sure(gains: Values) -> bool:
    """Whether windows left out are better predicted, and not in one fold only."""
    if len(gains) < 2 or np.sum(gains) - np.max(gains) < SURE:
        return False
    error = np.std(gains, ddof=1) / np.sqrt(len(gains))
    return bool(np.mean(gains) > ERRORS * error or np.min(gains) > HARMLESS)


def _laws(fit: Smooth, shares: Values) -> tuple[Learned, ...]:
    found = []
    for table, part, share in zip(fit.tables, fit.parts(), shares, strict=True):
        torque = fit.torque[part]
        # A smooth curve lies off the straight lines that stand for it.
        half = BAND * fit.deviation[part] + CHORD * table.departures(torque)
        columns = (table.at, torque, torque - half, torque + half)
        at, middle, low, high = (tuple(float(x) for x in column) for column in columns)
        found.append(Learned(table.of, float(share), at, middle, low, high, table.period))
    return tuple(found)
