"""Learned laws: the torque that named causes leave, as tables over recorded variables, judged by simulation.

Tables are added as long as they predict fitted windows that were left out of their own fit. Then the tables become
blocks of the machine, and the missing torque on withheld windows, which took no part so far, is measured as for every
other model. A law is reported only if it lowers that torque with its whole 90 % interval. (The evidence of the
regression was tried as the criterion and was wrong on logs without a gap: it evaluates the model's friction at the
measured motion, whose sign is noise at every reversal.)
"""

import copy
from collections.abc import Sequence
from dataclasses import dataclass, replace

import equinox as eqx
import numpy as np

from ...blocks.learned import LearnedTorque, split_jump
from ...logs.arrays import Values
from ...model_file.learned import join_load
from ..effects.estimate import NINETY
from ..fit.candidate import Fit, Start
from ..fit.search import Search
from ..thresholds import THRESHOLDS
from .findings import Learned
from .gap_size import draws, interval, withheld
from .smooth_tables import make_tables
from .smoother import Smooth, smoother_of

# Largest error of the best piecewise linear fit to a parabola, as a share of how far a point lies off the line between
# its neighbours; added to the band, as the true law is smooth.
CHORD = 1.0 / 6.0


@dataclass(frozen=True)
class Simulated:
    """Learned laws and the machine that holds them.

    Attributes:
        laws: the largest share first; shares are of the missing energy on withheld windows without the laws.
        fit: the model with the laws beside its causes; nothing was fitted again.
    """

    laws: tuple[Learned, ...]
    fit: Fit


def learn(search: Search, fit: Fit) -> Simulated | None:
    """Laws of recorded variables for the missing torque of a fit; None where none lowers it on withheld windows.

    Args:
        search: that the fit comes from.
        fit: finished; it is not changed.
    """
    laws = proposed(search, fit)
    # All proposed laws together, or else the first one alone.
    for count in dict.fromkeys((len(laws), 1)):
        if not laws[:count]:
            return None
        beside = simulated(search, fit, laws[:count])
        taken = _taken(withheld(search, fit), withheld(search, beside))
        if taken[1] > THRESHOLDS.learned_share:
            whole = sum(law.share for law in laws[:count])
            shares = [replace(law, share=taken[0] * law.share / whole) for law in laws[:count]]
            return Simulated(tuple(sorted(shares, key=lambda law: -law.share)), beside)
    return None


def _taken(before: Values, after: Values) -> tuple[float, float]:
    """(share of the energy that is removed [1], lower end of its 90 % interval); the same bootstrap draws for both."""
    which = draws(len(before))
    many = 1.0 - np.mean(np.maximum(after, 0.0)[which], 1) / np.maximum(np.mean(before[which], 1), 1e-300)
    return float(1.0 - np.mean(np.maximum(after, 0.0)) / max(np.mean(before), 1e-300)), interval(many)[0]


def simulated(search: Search, fit: Fit, laws: Sequence[Learned]) -> Fit:
    """A fit with laws in its machine; only the start states of the windows are estimated again."""
    values = fit.candidate.values()
    # The Coulomb part goes into the level, where it sticks; the rest acts as loads.
    tables, coulomb = blocks(laws, values["coulomb"])
    values["coulomb"] += coulomb
    # A shallow copy of the search with another nominal plant; its compiled fitters belong to the old plant.
    other, plant = copy.copy(search), search.nominal.plant
    other.nominal = replace(search.nominal, plant=eqx.tree_at(lambda p: p.load, plant, join_load(plant.load, tables)))
    # Caches of compiled programs of the nominal plant without the laws.
    other.fitters, other.hidden_states = {}, {}
    c = other.candidate(Start(fit.candidate.effects, (), values), exact=True)
    # Start states and hidden states begin where the fit left them, so that few steps are needed.
    for own, was in ((c.states, fit.candidate.states), (c.hidden, fit.candidate.hidden)):
        own[:] = [each.copy() for each in was]
    return other.finish([c])[0]


def blocks(laws: Sequence[Learned], level: float) -> tuple[tuple[LearnedTorque, ...], float]:
    """Laws as blocks: (loads that are continuous, change of the Coulomb level [N m]).

    A jump of a velocity law at zero velocity is Coulomb friction: only there does it stick in simulation.

    Args:
        laws: at most one of velocity.
        level: Coulomb level of the machine [N m]. A negative sum would be a friction that drives: what a downward jump
            takes beyond the level becomes a slope between the two innermost points of the table.
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
    """Laws that predict fitted windows left out of their own fit, in the order in which they were found.

    No withheld window is used: they judge later. A share is of the energy on the fitted windows, by the linear model,
    with the laws found before already in.
    """
    smoother, current = smoother_of(search, fit.candidate)
    tables = make_tables(search.records, search.setting.periods[:1])
    energies = [smoother.energy(current)]
    while tables:
        tried = [(table, *smoother.gains(current, table)) for some in tables.values() for table in some]
        # One more table at a time, the one with the largest cross-validated gain; a variable is used once.
        sure = [one for one in tried if _sure(one[1])]
        if not sure:
            break
        table, _, penalty = max(sure, key=lambda one: np.sum(one[1]))
        after = smoother.fit((*current.tables, table), (*current.penalties, penalty), current.weight)
        energies.append(smoother.energy(after))
        if energies[-2] - energies[-1] < THRESHOLDS.learned_share * energies[0]:
            # A certain but negligible gain: not worth a table.
            energies.pop()
            break
        current = after
        del tables[table.variable]
    return _laws(current, np.maximum(-np.diff(energies), 0.0) / max(energies[0], 1e-300))


def _sure(gains: Values) -> bool:
    """Whether windows left out are predicted better, and not in one fold only; gains [nats] of shape (folds,)."""
    if len(gains) < 2 or np.sum(gains) - np.max(gains) < THRESHOLDS.learned_gain:
        return False
    error = np.std(gains, ddof=1) / np.sqrt(len(gains))
    return bool(np.mean(gains) > THRESHOLDS.learned_errors * error or np.min(gains) > THRESHOLDS.harmless)


def _laws(fit: Smooth, shares: Values) -> tuple[Learned, ...]:
    """The tables of a fit as `Learned`, each with its share [1] and its 90 % band."""
    found = []
    for table, part, share in zip(fit.tables, fit.parts(), shares, strict=True):
        torque = fit.torque[part]
        # The true curve is smooth and departs from the straight lines of the table.
        half = NINETY * fit.deviation[part] + CHORD * table.departures(torque)
        columns = (table.at, torque, torque - half, torque + half)
        at, middle, low, high = (tuple(float(x) for x in column) for column in columns)
        found.append(Learned(table.variable, float(share), at, middle, low, high, table.period))
    return tuple(found)
