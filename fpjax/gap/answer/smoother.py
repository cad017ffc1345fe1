"""A missing torque as penalised tables of recorded variables, fitted in the modes of the windows.

The coefficients of a window are c = sqrt(lambda) V' d + S e + n: d is the missing torque of each period, S e the
contribution of the start state, and n noise of variance s^2 + q^2 lambda. A law d = Phi(x) beta is linear in beta, and
the fit is one weighted least-squares problem. The tables are B-splines of degree one, whose coefficients are the
torques at the points, penalised by second differences (Eilers, Marx, "Flexible smoothing with B-splines and
penalties", 1996):
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
from ...logs.arrays import Values
from ...simulation.precision import double_precision
from ..data.tables import TAPS
from ..effects.effect import Effect, EffectParameter
from ..fit.candidate import Candidate
from ..fit.least_squares import Fitter, Linear
from ..fit.modes import Modes
from ..fit.search import Search
from ..machine import Machine
from ..simulate.family import window_fields
from ..simulate.held_motion import held_in_motion
from ..simulate.replay import assembled
from .smooth_tables import Table, resting

# Standard deviations of the departure of a point from its neighbours' line that are tried, over the size of friction:
# from a straight line to a table without smoothing.
PENALTIES = np.geomspace(1e-4, 3.0, 10)
FOLDS = 5  # of the cross-validation
BLOCK = 2  # adjacent windows that are left out together: neighbours are alike, and would predict each other
PASSES = 2  # iterations of the weights, which depend on what the tables leave
CENTRED = (
    1e-3  # standard deviation of the mean of a further table, over the size of friction: a constant belongs to one
)


# --- the windows


@dataclass(frozen=True)
class Windows:
    """The fitted windows as one linear problem; withheld windows are not used.

    Attributes:
        fitter: of the fit.
        modes: of a window, for the mass of the fit.
        which: (index of the record, indices of its windows), one for each record.
        c: coefficients at start states zero, shape (windows, modes).
        start: change of c by the start states in prior units, shape (windows, modes, states).
        noise: s^2 [1], shape (windows,).
        fold: number of the fold of cross-validation, shape (windows,).
        weight: of a squared coefficient in the missing torque [N^2 m^2], shape (windows, modes), as of `Measure`.
        real_noise: measured over assumed variance of the noise [1].
    """

    fitter: Fitter
    modes: Modes
    which: tuple[tuple[int, Values], ...]
    c: Values
    start: Values
    noise: Values
    fold: Values
    weight: Values
    real_noise: float

    def design(self, table: Table) -> Values:
        """Change of c by the torques at a table's points, shape (windows, modes, points)."""
        modes, found = self.modes, []
        way = (modes.torque * np.sqrt(modes.gain)) @ modes.turn
        for which, windows in self.which:
            record = self.fitter.records[which]
            rows = record.rows(windows)
            columns = table.columns[which][rows.T].reshape(record.samples, -1)  # one matrix product for all windows
            found.append((way.T @ columns).reshape(len(modes.gain), len(windows), -1).transpose(1, 0, 2))
        return np.concatenate(found)


def make_windows(search: Search, candidate: Candidate) -> Windows:
    """The fitted windows, linearised at the candidate; hidden states are not changed."""
    empty = np.zeros(0)
    c = replace(candidate, free=np.zeros(0, int), low=empty, high=empty, center=empty, spread=empty, scale=empty)
    fitter = search.fitters[c.family.key]
    which, coefficients, starts, noise, fold = [], [], [], [], []
    # The modes are of the nominal mass, the residual of this one.
    heavier = c.values()["inertia"] / search.setting.inertia
    modes = replace(fitter.modes, unanswered=heavier * fitter.modes.unanswered)
    for part in fitter.linearise([c], search.train, hidden=False)[0]:
        deviation = fitter.deviations(c, part.which, hidden=False)
        live = np.flatnonzero(deviation > 0)
        states = c.states[part.which][live][:, part.windows].T
        which.append((part.which, part.windows))
        still = part.c - (part.slope @ states[:, :, None])[:, :, 0]
        coefficients.append(heavier * still + _misread(search, c, part))
        starts.append(heavier * part.slope * deviation[live])
        noise.append(heavier**2 * fitter.noise[part.which][part.windows])
        fold.append(np.arange(len(part.windows)) // BLOCK % FOLDS)
    recorded = np.concatenate([fitter.noise[record][windows] for record, windows in which])
    weight = search.measure.weight(recorded, np.ones(len(modes.gain)))
    every, start, noises, folds = (np.concatenate(each) for each in (coefficients, starts, noise, fold))
    return Windows(fitter, modes, tuple(which), every, start, noises, folds, weight, search.real_noise)


def _misread(search: Search, c: Candidate, part: Linear) -> Values:
    """Correction of c for the model's own torques, taken at the simulated motion, shape (windows, modes).

    Within a window the simulated motion departs from the measured one, and with it friction and load F. The modes are
    those of a mass without friction but for the nominal damping, which is taken off below: J r' = d - (F(simulated) -
    F(measured)). The difference is added, and what remains is the missing torque d at the measured motion. F(simulated)
    is what the replay took: torques of the position at the measured one where that is known, the friction's level as
    at the measured direction.
    """
    fitter, record = search.fitters[c.family.key], search.records[part.which]
    vector = np.repeat(c.vector[:, None], len(part.windows), 1)
    fields = window_fields(record, part.windows, c.hidden[part.which])
    residual = fitter.runner.run(part.which, vector, c.states[part.which][:, part.windows], fields)[0][0].T
    rows = record.rows(part.windows)
    if record.velocity is not None:
        simulated = record.velocity.values[rows] + record.velocity.noise * residual
    else:
        assert record.position is not None
        # Positions only: the simulated speed is the slope of measured position plus residual.
        simulated = np.gradient(record.position.values[rows] + record.position.noise * residual, record.dt, axis=1)
    measured, angle = record.speed[rows], record.angle[rows]
    simulated = measured + held_departure(simulated - measured, record.dt, *fitter.guide)
    tables = search.tables[part.which]
    away = (1.0 - float(tables.imposed)) * np.cumsum(simulated - measured, axis=1) * record.dt
    family = fitter.family
    padded = 1024
    while padded < rows.size:
        padded *= 2  # powers of two: logs of similar length share one compiled function
    times = record.elapsed[rows]
    found = []
    with double_precision():
        held = simulated + np.asarray(held_in_motion(jnp.asarray(simulated), tables.moving[TAPS + rows]))
        # Of one rigid mass the drag is that of its own speed.
        slower = simulated if family.key[0] == "rigid" else held
        for own, speed, position in ((slower, held, angle + away), (measured, measured, angle)):
            own, *columns = (
                jnp.asarray(np.resize(each, padded)) for each in (own, speed, position, times, record.torque[rows])
            )
            torque = _own_torque(
                family.machine, family.effects, family.parameters, c.vector[:, None], own, Motion(*columns),
                resting(record),
            )  # fmt: skip
            found.append(np.asarray(torque)[: rows.size].reshape(rows.shape))
    # The modes have the nominal model's damping already, of a mass of this inertia.
    found[0] = found[0] - c.values()["inertia"] * search.setting.damping * (simulated - measured)
    modes = fitter.modes
    return (found[0] - found[1]) @ (modes.torque * np.sqrt(modes.gain)) @ modes.turn


def held_departure(speed: Values, dt: float, stiffness: float, damping: float) -> Values:
    """What a guide leaves of a simulation's departure from the measured speed [rad/s], shape (windows, samples).

    Args:
        speed: departure of the prediction, from which the guide's own motion is taken off, of that shape.
        dt: control period [s].
        stiffness: of the guide [1/s^2].
        damping: of it [1/s].
    """
    if stiffness == 0.0 and damping == 0.0:
        return speed
    found = speed.copy()
    turned = further = np.zeros(len(speed))
    for k in range(1, speed.shape[1]):  # as the replay does it: a change of speed at the end of every period
        further = further + dt * found[:, k - 1]
        turned = turned - dt * (stiffness * further + damping * found[:, k - 1])
        found[:, k] = speed[:, k] + turned
    return found


@functools.partial(jax.jit, static_argnums=(1, 2))
def _own_torque(
    nominal: Machine, effects: tuple[Effect, ...], parameters: tuple[EffectParameter, ...], vector: Array,
    velocity: Array, motion: Motion, rest: Array,
) -> Array:  # fmt: skip
    """Friction and load of a model [N m] along a motion; at rest, friction balances the torque, up to its level.

    The friction's drag is that of `velocity` [rad/s], all else of the motion.
    """
    machine = assembled(nominal, effects, parameters, vector)
    load = machine.plant.load.readout(motion)
    most = machine.law.breakaway(motion)
    assert motion.torque is not None
    held = jnp.clip(motion.torque - load, -most, most)
    moving = machine.law.readout((), motion, motion.torque)  # type: ignore[arg-type]
    drag = machine.law.drag(replace(motion, velocity=velocity)) - machine.law.drag(motion)
    moving = moving + drag
    return load + jnp.where(jnp.abs(motion.velocity) > rest, moving, held)


# --- the fit


@dataclass(frozen=True)
class Smooth:
    """Tables fitted together.

    Attributes:
        tables: in the order in which they were added.
        penalties: of each [1 / (N m)^2].
        torque: at the points of all tables, shape (points,) [N m].
        deviation: standard deviation of `torque` by the model or by the scatter of the windows, the larger one, shape
            (points,) [N m].
        weight: 1 / variance of each coefficient, shape (windows, modes).
        left: coefficients without the torque of the tables, shape (windows, modes).
    """

    tables: tuple[Table, ...]
    penalties: tuple[float, ...]
    torque: Values
    deviation: Values
    weight: Values
    left: Values

    def parts(self) -> list[slice]:
        """Where each table's points lie in `torque`."""
        ends = np.cumsum([0, *(len(t.at) for t in self.tables)])
        return [slice(a, b) for a, b in itertools.pairwise(ends)]


class Smoother:
    """Fits tables to windows.

    Args:
        windows: of a fit.
        size: of the friction, with which penalties are scaled [N m].
        largest: prior standard deviation of a torque in a table [N m].
    """

    def __init__(self, windows: Windows, size: float, largest: float):
        self.windows, self.size, self.largest = windows, size, largest
        self.designs: dict[int, Values] = {}

    def base(self, level: Values) -> Smooth:
        """The fit without a table, from a level of the missing torque."""
        return self.fit((), (), self._weight(level, self.windows.c))

    def fit(self, tables: tuple[Table, ...], penalties: tuple[float, ...], weight: Values) -> Smooth:
        """Tables with their penalties, from weights that are iterated: the tables leave a lower level."""
        x, prior, modes = self._design(tables), self._prior(tables, penalties), self.windows.modes
        for _ in range(PASSES):
            left = self._left(x, _solve(np.sum(self._products(x, weight), axis=0), prior), weight)
            weight = self._weight(modes.best_level(self.windows.noise, left, white=False), left)
        normal = self._products(x, weight)
        total = np.sum(normal, axis=0)
        torque = _solve(total, prior)
        # Gradient of each window, shape (windows, points): the sandwich estimator, as in `intervals.covariance`.
        scores = normal[:, 1:] @ np.concatenate([[1.0], -torque])
        inverse = np.linalg.inv(total[1:, 1:] + prior)
        robust = inverse @ (scores.T @ scores) @ inverse
        deviation = np.sqrt(np.maximum(np.diag(inverse), np.diag(robust)))
        return Smooth(tables, penalties, torque, deviation, weight, self._left(x, torque, weight))

    def gains(self, before: Smooth, table: Table) -> tuple[Values, float]:
        """Cross-validated gain of one more table, at the weights before it.

        Returns:
            (gain in log likelihood of each fold left out [nats], shape (folds,); the penalty with the largest sum).
        """
        tables = (*before.tables, table)
        normal = self._products(self._design(tables), before.weight)
        parts = [np.sum(normal[self.windows.fold == k], axis=0) for k in np.unique(self.windows.fold)]
        total, own = np.sum(parts, axis=0), slice(0, 1 + len(before.torque))
        known = [part[own, own] for part in parts]
        without = self._errors(known, np.sum(known, axis=0), self._prior(before.tables, before.penalties))
        tried = (self.size * PENALTIES) ** -2.0
        found = [
            0.5 * (without - self._errors(parts, total, self._prior(tables, (*before.penalties, float(penalty)))))
            for penalty in tried
        ]
        best = int(np.argmax([np.sum(gain) for gain in found]))
        return found[best], float(tried[best])

    def energy(self, fit: Smooth, moves: Values | float = 1.0) -> float:
        """Mean square of the missing torque that is left [N^2 m^2], noise's share taken out.

        Args:
            fit: tables, or none.
            moves: further weight of each mode [1], shape (modes,).
        """
        modes, w = self.windows.modes, self.windows
        each = (modes.plain(fit.left) ** 2 - modes.variance(w.real_noise * w.noise)) * w.weight * moves
        return float(np.mean(np.sum(each, axis=1)))

    def _errors(self, parts: Sequence[Values], total: Values, prior: Values) -> Values:
        """Weighted squared prediction error of each fold, with the tables fitted to the others, shape (folds,)."""
        betas = [np.concatenate([[1.0], -_solve(total - part, prior)]) for part in parts]
        return np.array([beta @ part @ beta for beta, part in zip(betas, parts, strict=True)])

    def _design(self, tables: Sequence[Table]) -> Values:
        for table in tables:
            if id(table) not in self.designs:
                self.designs[id(table)] = self.windows.design(table)
        found = [self.designs[id(table)] for table in tables]
        return np.concatenate([np.zeros((*self.windows.c.shape, 0)), *found], axis=2)

    def _prior(self, tables: Sequence[Table], penalties: Sequence[float]) -> Values:
        """Prior precision of the torques: size, smoothness, and a zero mean of further tables."""
        count = sum(len(t.at) for t in tables)
        prior = np.eye(count) / self.largest**2
        place, laws = 0, 0
        for table, penalty in zip(tables, penalties, strict=True):
            own = slice(place, place + len(table.at))
            prior[own, own] += penalty * table.bend.T @ table.bend
            laws += table.of != "acceleration"
            if laws > 1 and table.of in ("position", "time", "torque"):
                # A constant torque could be in any table: the mean of this one along the logs is held at zero.
                prior[own, own] += np.outer(table.mean, table.mean) / (CENTRED * self.size) ** 2
            place = own.stop
        return prior

    def _weight(self, level: Values, left: Values) -> Values:
        return self.windows.modes.precision(level, self.windows.noise, left, white=False)

    def _inner(self, weight: Values) -> Values:
        """Precision of the start states in prior units, shape (windows, states, states)."""
        start = self.windows.start
        return np.eye(start.shape[2]) + start.transpose(0, 2, 1) @ (start * weight[:, :, None])

    def _products(self, x: Values, weight: Values) -> Values:
        """[c x]' P [c x] of each window; P is the inverse of the covariance of c, the start states integrated out."""
        w = self.windows
        both = np.concatenate([w.c[:, :, None], x], axis=2)
        weighted = (both * weight[:, :, None]).transpose(0, 2, 1)
        cross = weighted @ w.start
        return weighted @ both - cross @ np.linalg.solve(self._inner(weight), cross.transpose(0, 2, 1))

    def _left(self, x: Values, torque: Values, weight: Values) -> Values:
        """Coefficients without the tables' torque, at the most likely start states."""
        w = self.windows
        left = w.c - x @ torque
        pull = w.start.transpose(0, 2, 1) @ (left * weight)[:, :, None]
        return left - (w.start @ np.linalg.solve(self._inner(weight), pull))[:, :, 0]


def _solve(normal: Values, prior: Values) -> Values:
    """Torques that minimise [1 -t] normal [1 -t]' + t' prior t."""
    if not len(prior):
        return np.zeros(0)
    return np.linalg.solve(normal[1:, 1:] + prior, normal[1:, 0])


def smoother_of(search: Search, candidate: Candidate) -> tuple[Smoother, Smooth]:
    """(a smoother of a candidate's windows, its fit without a table)."""
    setting = search.setting
    smoother = Smoother(make_windows(search, candidate), setting.friction, max(setting.effort, setting.torque))
    return smoother, smoother.base(candidate.level)
