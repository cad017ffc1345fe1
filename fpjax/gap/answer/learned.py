"""Learned: what no named effect says, as tables over what was recorded, measured by simulating with them.

Tables are added while they predict windows that no fit has seen. What is told is what a simulation gains by them: the
tables become blocks of the machine, and what is then missing on withheld windows is measured as for every other model.
A law that does not lower it there, interval and all, is not told.
"""

import copy
from collections.abc import Sequence
from dataclasses import dataclass, replace

import equinox as eqx
import numpy as np

from ...blocks.learned import LearnedTorque, split_jump
from ...errors import InputError
from ...model_file.learned import join_load
from ..fit.candidate import Fit
from ..fit.search import Search, Start
from .diagnosis import Learned
from .shrink import draws, interval, withheld
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
        try:
            beside = simulated(search, fit, laws[:count])
        except InputError:  # less than no friction would be left
            continue
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
    """A fit with laws in its machine; only the windows' start states are looked up again.

    Raises:
        InputError: where a jump at zero velocity leaves less than no Coulomb friction.
    """
    tables, coulomb = blocks(laws)
    values = fit.candidate.values()
    values["coulomb"] += coulomb
    if values["coulomb"] < 0.0:
        raise InputError(f"The learned law leaves a Coulomb friction of {values['coulomb']:.3g} N m: it would push.")
    other, plant = copy.copy(search), search.nominal.plant
    other.nominal = replace(search.nominal, plant=eqx.tree_at(lambda p: p.load, plant, join_load(plant.load, tables)))
    other.fitters, other.observers = {}, {}
    c = other.candidate(Start(fit.candidate.effects, (), values), exact=True)
    for own, was in ((c.states, fit.candidate.states), (c.hidden, fit.candidate.hidden)):
        own[:] = [each.copy() for each in was]
    return other.finish([c])[0]


def blocks(laws: Sequence[Learned]) -> tuple[tuple[LearnedTorque, ...], float]:
    """(loads without a jump; the jump at zero velocity, which sticks and belongs in the Coulomb level [N m])."""
    tables, coulomb = [], 0.0
    for law in laws:
        at, torque, jump = split_jump(law.at, law.torque) if law.of == "velocity" else (law.at, law.torque, 0.0)
        coulomb += jump
        tables.append(LearnedTorque(law.of, at, torque, law.period))  # type: ignore[arg-type]
    return tuple(tables), coulomb


def proposed(search: Search, fit: Fit) -> tuple[Learned, ...]:
    """Laws that seem to predict withheld windows, fitted on the other ones, in the order in which they were found.

    Their shares are what each takes of the energy, the others before it in, as the linear model has it.
    """
    setting = search.setting
    smoother = Smoother(make_windows(search, fit.candidate), setting.friction, max(setting.effort, setting.torque))
    tables = make_tables(search.records, setting.periods.get("torque", ())[:1])
    current = smoother.base()
    energies = [_energy(search, smoother, current)]
    while tables:
        found: dict[Variable, Smooth] = {name: _best(smoother, current, some) for name, some in tables.items() if some}
        sure: list[Variable] = [name for name in found if _sure(smoother, current, found[name])]
        if not sure:
            break
        best: Variable = max(sure, key=lambda name: found[name].evidence)
        energy = _energy(search, smoother, found[best])
        if energies[-1] - energy < LEAST * energies[0]:
            break
        current = found[best]
        energies.append(energy)
        del tables[best]
    return _laws(current, np.maximum(-np.diff(energies), 0.0) / max(energies[0], 1e-300))


def _best(smoother: Smoother, current: Smooth, tables: Sequence[Table]) -> Smooth:
    """The best of a variable's tables by the evidence."""
    return max((smoother.add(current, table) for table in tables), key=lambda fit: fit.evidence)


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
    square = (modes.plain(fit.left) ** 2 - w.noise[:, None])[~w.fitted] @ weight
    return float(np.mean(square)) / search.records[0].samples if len(square) else 0.0


def _laws(fit: Smooth, shares: Values) -> tuple[Learned, ...]:
    deviation = fit.deviation() if fit.tables else np.zeros(0)
    found = []
    for table, part, share in zip(fit.tables, fit.parts(), shares, strict=True):
        torque = fit.torque[part]
        # A smooth curve lies off the straight lines that stand for it.
        half = BAND * deviation[part] + CHORD * table.departures(torque)
        columns = (table.at, torque, torque - half, torque + half)
        at, middle, low, high = (tuple(float(x) for x in column) for column in columns)
        found.append(Learned(table.of, float(share), at, middle, low, high, table.period))
    return tuple(found)
