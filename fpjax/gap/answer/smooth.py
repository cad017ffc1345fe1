"""Smooth: a missing torque as penalised tables of what was recorded, fitted in the modes.

The coefficients of a window are c = sqrt(lambda) V' d + S e + n, with d the missing torque of each period, S e what
its start state adds, and n of the variance s^2 + q^2 lambda. A law d = Phi(x) beta is linear in beta, so that all of
it is one weighted least squares problem. The tables are B-splines of degree one, whose coefficients are the torques at
the points, penalised by second differences (Eilers, Marx, "Flexible smoothing with B-splines and penalties", 1996):
what is fitted is what a `LearnedTorque` simulates.
"""

import functools
import itertools
from collections.abc import Sequence
from dataclasses import dataclass, replace

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from ...blocks.signals import Motion
from ..effects.effect import Effect, Parameter
from ..fit.candidate import Candidate
from ..fit.least_squares import Fitter, Linear
from ..fit.search import Search
from ..machine import Machine
from ..precision import double_precision
from ..simulate.family import window_fields
from ..simulate.replay import assembled
from .smooth_tables import Table, resting

Values = np.ndarray

PENALTIES = np.geomspace(1e-4, 3.0, 10)  # departures from a straight line that are tried, of the friction's size
FOLDS = 5
BLOCK = 2  # windows in a row that are left out together
PASSES = 2  # times that the level and the penalty are looked up again
CENTRED = 1e-3  # of the friction: how well the mean of a table beside another one is held at zero


# --- the windows


@dataclass(frozen=True)
class Windows:
    """All windows of a fit as one linear problem.

    Attributes:
        fitter: of the fit.
        candidate: the fit.
        which: (record, its windows, place of the first) of each record.
        c: coefficients at start states zero, shape (windows, modes).
        start: change of c by the start states in prior units, shape (windows, modes, states).
        noise: s^2 [1], shape (windows,).
        fitted: bool, shape (windows,).
        fold: of cross-validation, shape (windows,); -1 for withheld windows.
    """

    fitter: Fitter
    candidate: Candidate
    which: tuple[tuple[int, Values, int], ...]
    c: Values
    start: Values
    noise: Values
    fitted: Values
    fold: Values

    def design(self, table: Table) -> Values:
        """Change of c by the torques at a table's points, shape (windows, modes, points)."""
        modes, found = self.fitter.modes, []
        way = (modes.torque * np.sqrt(modes.gain)) @ modes.turn
        for which, windows, _ in self.which:
            record = self.fitter.records[which]
            rows = record.starts[windows][:, None] + np.arange(record.samples)
            columns = table.columns[which][rows.T].reshape(record.samples, -1)  # one product, not one a window
            found.append((way.T @ columns).reshape(len(modes.gain), len(windows), -1).transpose(1, 0, 2))
        return np.concatenate(found)


def make_windows(search: Search, candidate: Candidate) -> Windows:
    """The windows of a fit around where it stands; hidden states stay where they are."""
    empty = np.zeros(0)
    c = replace(candidate, free=np.zeros(0, int), low=empty, high=empty, center=empty, spread=empty, scale=empty)
    fitter = search.fitters[c.family.key]
    windows = [np.arange(len(record.starts)) for record in search.records]
    which, coefficients, starts, noise, fitted, fold = [], [], [], [], [], []
    for part in fitter.linearise([c], windows, hidden=False)[0]:
        deviation = fitter.deviations(c, part.which, hidden=False)
        live = np.flatnonzero(deviation > 0)
        states = c.states[part.which][live][:, part.windows].T
        zero = part.c - (part.slope @ states[:, :, None])[:, :, 0] + _misread(search, c, part)
        which.append((part.which, part.windows, sum(len(each) for each in coefficients)))
        coefficients.append(zero)
        starts.append(part.slope * deviation[live])
        noise.append(fitter.noise[part.which][part.windows])
        train = ~search.records[part.which].withheld[part.windows]
        fitted.append(train)
        block = np.cumsum(train) - 1
        fold.append(np.where(train, block // BLOCK % FOLDS, -1))
    return Windows(
        fitter, c, tuple(which), np.concatenate(coefficients), np.concatenate(starts), np.concatenate(noise),
        np.concatenate(fitted), np.concatenate(fold),
    )  # fmt: skip


def _misread(search: Search, c: Candidate, part: Linear) -> Values:
    """What c lacks because the model's own torques are taken at the simulated motion, shape (windows, modes).

    The simulation goes its own way from the measured motion until the window ends. The modes know no friction, so that
    J r' = d - (F(simulated) - F(measured)): the difference is added, and what remains is the missing torque alone.
    """
    fitter, record = search.fitters[c.family.key], search.records[part.which]
    vector = np.repeat(c.vector[:, None], len(part.windows), 1)
    fields = window_fields(record, part.windows, c.hidden[part.which])
    residual = fitter.runner.run(part.which, vector, c.states[part.which][:, part.windows], fields)[0][0].T
    rows = record.starts[part.windows][:, None] + np.arange(record.samples)
    if record.velocity is not None:
        simulated = record.velocity.values[rows] + record.velocity.noise * residual
    else:
        assert record.position is not None
        simulated = np.gradient(record.position.values[rows] + record.position.noise * residual, record.dt, axis=1)
    measured, angle = record.speed[rows], record.angle[rows]
    away = np.cumsum(simulated - measured, axis=1) * record.dt
    family = fitter.family
    padded = 1024
    while padded < rows.size:
        padded *= 2  # logs of similar length share one compiled function
    times = record.time[rows] - record.time[0]
    found = []
    with double_precision():
        for speed, position in ((simulated, angle + away), (measured, angle)):
            columns = [np.resize(each, padded) for each in (speed, position, times, record.torque[rows])]
            torque = _own_torque(
                family.machine, family.effects, family.parameters, c.vector[:, None], Motion(*columns),  # type: ignore[arg-type]
                resting(record),
            )  # fmt: skip
            found.append(np.asarray(torque)[: rows.size].reshape(rows.shape))
    modes = fitter.modes
    return (found[0] - found[1]) @ (modes.torque * np.sqrt(modes.gain)) @ modes.turn


@functools.partial(jax.jit, static_argnums=(1, 2))
def _own_torque(
    nominal: Machine, effects: tuple[Effect, ...], parameters: tuple[Parameter, ...], vector: Array, motion: Motion,
    rest: float,
) -> Array:  # fmt: skip
    """Friction and load of a model [N m] along a motion; at rest, friction holds what it is given, up to its level."""
    machine = assembled(nominal, effects, parameters, vector)
    load = machine.plant.load.readout(motion)
    most = machine.law.breakaway(motion)
    assert motion.torque is not None
    held = jnp.clip(motion.torque - load, -most, most)
    moving = machine.law.readout((), motion, motion.torque)  # type: ignore[arg-type]
    return load + jnp.where(jnp.abs(motion.velocity) > rest, moving, held)


# --- the fit


@dataclass(frozen=True)
class Smooth:
    """Tables fitted together.

    Attributes:
        tables: in the order in which they were added.
        penalties: of each [1 / (N m)^2].
        torque: at all points, shape (points,) [N m].
        precision: of the torques, their prior included [1 / (N m)^2].
        robust: covariance of the torques from the windows' own scatter [N^2 m^2].
        level: q by octave [N m].
        weight: 1 / variance of each coefficient, shape (windows, modes).
        cost: twice the negative log likelihood of each window, shape (windows,).
        evidence: log evidence of the fitted windows and log likelihood of the withheld ones [1].
        left: coefficients that are left, shape (windows, modes).
        score: of cross-validation at the last table's penalty; lower is better.
    """

    tables: tuple[Table, ...]
    penalties: tuple[float, ...]
    torque: Values
    precision: Values
    robust: Values
    level: Values
    weight: Values
    cost: Values
    evidence: float
    left: Values
    score: float

    def parts(self) -> list[slice]:
        """Where each table's points lie in `torque`."""
        ends = np.cumsum([0, *(len(t.at) for t in self.tables)])
        return [slice(a, b) for a, b in itertools.pairwise(ends)]

    def deviation(self) -> Values:
        """Standard deviation of the torques [N m]: the model's, or the windows' scatter where that is larger."""
        own = np.diag(np.linalg.inv(self.precision))
        return np.sqrt(np.maximum(own, np.diag(self.robust)))


class Smoother:
    """Fits tables to windows.

    Args:
        windows: of a fit.
        size: a torque to compare with [N m].
        largest: that a table may hold, one standard deviation [N m].
    """

    def __init__(self, windows: Windows, size: float, largest: float):
        self.windows, self.size, self.largest = windows, size, largest
        self.designs: dict[int, Values] = {}

    def base(self) -> Smooth:
        """Without a table."""
        start = self.windows.candidate
        weight = self._weight(start.level, self.windows.c)
        zero = np.zeros(0)
        empty = Smooth((), (), zero, np.zeros((0, 0)), np.zeros((0, 0)), start.level, weight, zero, 0.0, zero, 0.0)
        return self._fit(empty, (), ())

    def add(self, before: Smooth, table: Table) -> Smooth:
        """One more table beside those of a fit; its penalty by cross-validation."""
        return self._fit(before, (*before.tables, table), before.penalties)

    def _fit(self, before: Smooth, tables: tuple[Table, ...], penalties: tuple[float, ...]) -> Smooth:
        w = self.windows
        design = [self._design(table) for table in tables]
        x = np.concatenate([np.zeros((*w.c.shape, 0)), *design], axis=2)
        weight, found = before.weight, []
        for _ in range(PASSES):
            score, chosen, normal = 0.0, penalties, self._products(x, weight)[0]
            if len(tables) > len(penalties):
                score, chosen = self._penalty(normal, tables, penalties)
            prior = self._prior(tables, chosen)
            left = self._left(x, _solve(np.sum(normal[w.fitted], axis=0), prior), weight)
            level = w.fitter.modes.best_level(w.noise[w.fitted], left[w.fitted], white=False)
            weight = self._weight(level, left)
            found.append(self._weighed(x, tables, chosen, level, weight, score))
        # A penalty that was chosen at a lower level may leave whole windows to the heavy tails.
        return max(found, key=lambda fit: fit.evidence)

    def _weighed(
        self, x: Values, tables: tuple[Table, ...], penalties: tuple[float, ...], level: Values, weight: Values,
        score: float,
    ) -> Smooth:  # fmt: skip
        """The tables at given weights and penalties."""
        w, prior = self.windows, self._prior(tables, penalties)
        normal, determinant = self._products(x, weight)
        total = np.sum(normal[w.fitted], axis=0)
        torque = _solve(total, prior)
        beta = np.concatenate([[1.0], -torque])
        left = self._left(x, torque, weight)
        # The weights are those of normal laws; what heavy tails change is added.
        tails = w.fitter.modes.cost(level, w.noise, left, white=False) - np.sum(weight * left**2, axis=1)
        cost = np.einsum("wij,i,j->w", normal, beta, beta) + determinant + tails
        precision = total[1:, 1:] + prior
        for row in np.flatnonzero(~w.fitted):
            cost[row] += _predicted(normal[row], torque, precision)
        occam = np.linalg.slogdet(precision)[1] - np.linalg.slogdet(prior)[1] if len(tables) else 0.0
        evidence = -0.5 * float(np.sum(cost) + torque @ prior @ torque + occam)
        scores = normal[w.fitted][:, 1:] @ beta  # of each window, shape (windows, points)
        inverse = np.linalg.inv(precision)
        robust = inverse @ (scores.T @ scores) @ inverse
        return Smooth(tables, penalties, torque, precision, robust, level, weight, cost, evidence, left, score)

    def _design(self, table: Table) -> Values:
        if id(table) not in self.designs:
            self.designs[id(table)] = self.windows.design(table)
        return self.designs[id(table)]

    def _prior(self, tables: Sequence[Table], penalties: Sequence[float]) -> Values:
        """Precision of the torques before the logs are seen."""
        count = sum(len(t.at) for t in tables)
        prior = np.eye(count) / self.largest**2
        place = 0
        for index, (table, penalty) in enumerate(zip(tables, penalties, strict=True)):
            own = slice(place, place + len(table.at))
            prior[own, own] += penalty * table.bend.T @ table.bend
            if index and table.of in ("position", "time", "torque"):
                # A constant torque belongs to one table: this one's mean along the logs is zero.
                prior[own, own] += np.outer(table.mean, table.mean) / (CENTRED * self.size) ** 2
            place = own.stop
        return prior

    def _penalty(
        self, normal: Values, tables: tuple[Table, ...], penalties: tuple[float, ...]
    ) -> tuple[float, tuple[float, ...]]:
        """(error of what is predicted, penalties) with the last table's one chosen by cross-validation."""
        w = self.windows
        kinds = [k for k in np.unique(w.fold) if k >= 0]
        tried = (self.size * PENALTIES) ** -2.0 if len(tables[-1].bend) else np.zeros(1)
        if len(kinds) < 2:
            return 0.0, (*penalties, float(tried[0]))
        parts = [np.sum(normal[w.fold == k], axis=0) for k in kinds]
        total = np.sum(parts, axis=0)
        errors = []
        for penalty in tried:
            prior, error = self._prior(tables, (*penalties, penalty)), 0.0
            for part in parts:
                beta = np.concatenate([[1.0], -_solve(total - part, prior)])
                error += float(beta @ part @ beta)
            errors.append(error)
        best = int(np.argmin(errors))
        return errors[best], (*penalties, float(tried[best]))

    def _weight(self, level: Values, left: Values) -> Values:
        return self.windows.fitter.modes.precision(level, self.windows.noise, left, white=False)

    def _inner(self, weight: Values) -> Values:
        """Precision of the start states in prior units, shape (windows, states, states)."""
        start = self.windows.start
        return np.eye(start.shape[2]) + start.transpose(0, 2, 1) @ (start * weight[:, :, None])

    def _products(self, x: Values, weight: Values) -> tuple[Values, Values]:
        """([c x]' P [c x], log determinants of the start states' precision) of each window.

        P is the inverse of the covariance of c, the start states integrated out.
        """
        w = self.windows
        both = np.concatenate([w.c[:, :, None], x], axis=2)
        weighted = (both * weight[:, :, None]).transpose(0, 2, 1)
        inner = self._inner(weight)
        cross = weighted @ w.start
        normal = weighted @ both - cross @ np.linalg.solve(inner, cross.transpose(0, 2, 1))
        return normal, np.linalg.slogdet(inner)[1]

    def _left(self, x: Values, torque: Values, weight: Values) -> Values:
        """Coefficients without the tables' torque, at the most likely start states."""
        w = self.windows
        left = w.c - x @ torque
        pull = w.start.transpose(0, 2, 1) @ (left * weight)[:, :, None]
        return left - (w.start @ np.linalg.solve(self._inner(weight), pull))[:, :, 0]


def _predicted(normal: Values, torque: Values, precision: Values) -> float:
    """What a window that was not fitted costs more or less, its torques being known as well as `precision` says."""
    if not len(torque):
        return 0.0
    pull = normal[1:, 0] - normal[1:, 1:] @ torque  # at the torques that were fitted
    moved = np.linalg.solve(precision + normal[1:, 1:], pull)
    wider = np.linalg.slogdet(precision + normal[1:, 1:])[1] - np.linalg.slogdet(precision)[1]
    return float(wider - pull @ moved)


def _solve(normal: Values, prior: Values) -> Values:
    """Torques that minimise [1 -t] normal [1 -t]' + t' prior t."""
    if not len(prior):
        return np.zeros(0)
    return np.linalg.solve(normal[1:, 1:] + prior, normal[1:, 0])
