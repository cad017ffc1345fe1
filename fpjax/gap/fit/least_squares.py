"""Levenberg-Marquardt in the modes of the missing torque, start values eliminated, many candidates at once.

The cost is the sum over windows and modes of c^2 / (s^2 + q^2 lambda) + log(s^2 + q^2 lambda), plus the priors
(`fpjax.gap.fit.modes`). The start values of the windows are free, as in multiple shooting (Bock, 1983), but windows are
not tied to each other: each window's own are eliminated from the normal equations by a Schur complement. q is set to
its most likely value before every iteration. Far from the solution it is large and the problem is nearly a regression
of the torque, which has fewer local minima; it falls as the fit improves.
"""

import copy
import functools
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from ...blocks.plants.transmission import Transmission
from ...logs.arrays import Values
from ..data.setting import Setting
from ..effects.shaft import resonance_of, stiffness_of
from ..simulate.family import Runner, window_fields
from .bounded import bounded_steps
from .candidate import Candidate
from .modes import COMPARED, Modes
from .response import Response, Windows

DAMPINGS = (1e-6, 1e-2, 1.0, 100.0)  # tried side by side, times the candidate's own damping
# Prior standard deviations of start values about their estimates.
LOADED = 0.05  # of the torque in a spring, over the friction [1]
BRISTLE = 0.1  # of the bristles' deflection, over that at sliding [1]
MOVED = 0.02  # of a speed from positions, over the top speed, beside its noise [1]
# A fit has converged when an iteration lowers the cost, twice the negative log posterior, by less than this, or than a
# share of what it is behind the fit that it is compared with: what is 1,000 nats behind needs no last digit.
GAINED = 0.02
SLIGHT = 0.01  # [1]

Known = dict[int, dict[int, Values]]
"""Coefficients of candidates (by `id`) on the chosen windows of each record (by its index), shape (windows, modes)."""


@dataclass(frozen=True)
class Linear:
    """The coefficients of a record's windows, linearised about a candidate.

    Attributes:
        which: index of the record.
        windows: indices, shape (windows,).
        c: coefficients (`Modes.coefficients`), (windows, modes).
        slope: their Jacobian by the free parameters, then by the window's free start values, (windows, modes, columns).
    """

    which: int
    windows: Values
    c: Values
    slope: Values


class Fitter(Response):
    """Fits candidates of one family on chosen windows.

    Args:
        runner: of the family.
        setting: sizes.
        modes: of a window.
    """

    def __init__(self, runner: Runner, setting: Setting, modes: Modes):
        self.runner = runner
        super().__init__(runner, setting, modes)

    def deviations(self, c: Candidate, which: int, *, hidden: bool = True) -> Values:
        """Prior standard deviations of a window's start values about their estimates, shape (states,); 0 if not free.

        Args:
            c: a candidate, whose stiffness turns an uncertain torque into an uncertain twist.
            which: index of the record.
            hidden: whether the hidden states are free too.
        """
        record = self.records[which]
        if record.velocity is not None:
            # Wide against the noise of the estimates, so that the readings of the window decide.
            rate = 10.0 * record.velocity.noise
            angle = 0.0 if record.position is None else 10.0 * record.position.noise
        else:
            assert record.position is not None
            rate = MOVED * self.setting.speed + 5.0 * record.speed_noise
            angle = 50.0 * record.position.noise
        found = [rate, angle]
        structure = c.family.key[0]
        if structure == "bristles":
            found.append(BRISTLE if hidden else 0.0)
        if structure == "transmission":
            stiffness, frequency = _shaft(c)
            twist = LOADED * self.setting.friction / stiffness
            found += [twist, twist * 2.0 * np.pi * frequency] if hidden else [0.0, 0.0]
        return np.array(found)

    @functools.cached_property
    def judging(self) -> "Fitter":
        """The same windows, weighed with the heavy tails by which models are compared."""
        other = copy.copy(self)
        other.modes = replace(self.modes, tails=COMPARED)
        return other

    # --- running

    def coefficients(self, candidates: Sequence[Candidate], which: int, windows: Values) -> list[Values]:
        """c of each candidate at its present values, each of shape (windows, modes)."""
        out, _ = self._simulated(candidates, which, windows)
        return [own.T for own in np.split(self.modes.coefficients(out), len(candidates), axis=1)]

    def residuals(self, c: Candidate, which: int, windows: Values) -> Values:
        """Simulated less measured readings of a candidate, in standard deviations, (channels, samples, windows)."""
        return self._simulated([c], which, windows)[0]

    def ends(self, candidates: Sequence[Candidate], which: int, windows: Values) -> list[Values]:
        """Hidden states at the ends of windows, of each candidate at its present values, each of shape (2, windows)."""
        return np.split(self._simulated(candidates, which, windows)[1], len(candidates), axis=1)

    def _simulated(self, candidates: Sequence[Candidate], which: int, windows: Values) -> tuple[Values, Values]:
        """What `Runner.run` gives of the same windows of all candidates, one candidate after the other."""
        vectors = np.concatenate([np.repeat(c.vector[:, None], len(windows), 1) for c in candidates], 1)
        states = np.concatenate([c.states[which][:, windows] for c in candidates], 1)
        fields = window_fields(self.records[which], windows, candidates[0].hidden[which])
        merged = {name: np.tile(value, len(candidates)) for name, value in fields.items() if name != "hidden"}
        merged["hidden"] = np.concatenate([c.hidden[which][:, windows] for c in candidates], 1)
        return self.runner.run(which, vectors, states, merged)

    def linearise(
        self, candidates: Sequence[Candidate], windows: Windows, *, hidden: bool = True, known: Known | None = None
    ) -> list[list[Linear]]:
        """For each candidate, one `Linear` a record with windows; Jacobians by one-sided differences.

        Args:
            candidates: of this family.
            windows: indices, one array a record.
            hidden: whether the hidden states are free too.
            known: coefficients at the present values of some candidates, which need not be simulated again.
        """
        known = known or {}
        found: list[list[Linear]] = [[] for _ in candidates]
        for which, chosen in enumerate(windows):
            if not len(chosen):
                continue
            vectors, states, fields, steps = [], [], [], []
            for c in candidates:
                deviation = self.deviations(c, which, hidden=hidden)
                live = np.flatnonzero(deviation > 0)
                # 1e-4 of a typical step: rounding of double precision (1e-16) stays far below, curvature is small.
                h = 1e-4 * c.scale
                h = np.where(c.vector[c.free] + h > c.high, -h, h)
                # Lanes of a window: unchanged, a change of each free parameter, a change of each free start value.
                plain = 0 if id(c) in known else 1
                count = plain + len(c.free) + len(live)
                v = np.repeat(c.vector[:, None], count, 1)
                v[c.free, plain + np.arange(len(c.free))] += h
                s = np.repeat(c.states[which][:, chosen][:, :, None], count, 2)
                for place, row in enumerate(live):
                    s[row, :, plain + len(c.free) + place] += 1e-3 * deviation[row]
                vectors.append(np.tile(v, (1, len(chosen))))
                states.append(s.reshape(s.shape[0], -1))
                field = window_fields(self.records[which], chosen, c.hidden[which])
                fields.append({name: np.repeat(value, count, axis=-1) for name, value in field.items()})
                steps.append(np.concatenate([h, 1e-3 * deviation[live]]))
            merged = {name: np.concatenate([f[name] for f in fields], axis=-1) for name in fields[0]}
            out, _ = self.runner.run(which, np.concatenate(vectors, 1), np.concatenate(states, 1), merged)
            last = np.cumsum([v.shape[1] for v in vectors])[:-1]
            blocks = np.split(self.modes.coefficients(out), last, axis=1)
            for c, block, size, parts in zip(candidates, blocks, steps, found, strict=True):
                # From (modes, windows x count) to (windows, modes, count).
                shaped = block.reshape(len(block), len(chosen), block.shape[1] // len(chosen)).transpose(1, 0, 2)
                here = known[id(c)][which] if id(c) in known else shaped[:, :, 0]
                slope = (shaped[:, :, shaped.shape[2] - len(size) :] - here[:, :, None]) / size
                parts.append(Linear(which, chosen, here, slope))
        return found

    # --- levels and costs

    def best_level(self, parts: Sequence[tuple[int, Values, Values]], *, white: bool) -> Values:
        """The most likely q by octave [N m], shape (bands,), of a candidate's parts (record, windows, coefficients)."""
        return self.modes.best_level(*self._joined(parts), white=white)

    def best_noise(self, parts: Sequence[tuple[int, Values, Values]]) -> float:
        """The most likely factor on the sensors' noise standard deviation [1], of the same arguments."""
        return self.modes.best_noise(*self._joined(parts))

    def _joined(self, parts: Sequence[tuple[int, Values, Values]]) -> tuple[Values, Values]:
        """(noise, coefficients) of all windows."""
        noise = np.concatenate([self.noise[which][windows] for which, windows, _ in parts])
        return noise, np.concatenate([c for _, _, c in parts])

    def window_costs(self, c: Candidate, which: int, windows: Values, coefficients: Values) -> Values:
        """Twice the negative log likelihood of windows, shape (windows,)."""
        return self.modes.cost(c.level, self.noise[which][windows], coefficients, white=c.white)

    def state_prior(self, c: Candidate, which: int, windows: Values) -> Values:
        """Twice the negative log prior of the start states of windows, shape (windows,)."""
        deviation = self.deviations(c, which)
        live = deviation > 0
        return np.sum((c.states[which][live][:, windows] / deviation[live][:, None]) ** 2, axis=0)

    def parameter_prior(self, c: Candidate) -> float:
        """Twice the negative log prior of the free parameters."""
        return float(np.sum(((c.vector[c.free] - c.center) / c.spread) ** 2))

    def _cost(self, c: Candidate, parts: Sequence[tuple[int, Values, Values]], torques: Values) -> float:
        """The cost of a candidate at its level, of its parts (record, windows, coefficients) and counted torques."""
        windows = sum(float(np.sum(self.window_costs(c, which, chosen, found))) for which, chosen, found in parts)
        return windows + self._beside_windows(c, [(which, chosen) for which, chosen, _ in parts], torques)

    def _beside_windows(self, c: Candidate, parts: Sequence[tuple[int, Values]], torques: Values) -> float:
        """The part of the cost that the readings have none in: priors of parameters and start values, the volume."""
        states = sum(float(np.sum(self.state_prior(c, which, chosen))) for which, chosen in parts)
        return states + self.parameter_prior(c) + self.log_volume(c, torques)

    def assess(self, candidates: Sequence[Candidate], windows: Windows, *, white: bool) -> None:
        """Level and cost of candidates at their present values, without a step; they are changed in place.

        Args:
            candidates: of this family.
            windows: indices, one array a record.
            white: one level of the missing torque for all octaves.
        """
        parts: list[list[tuple[int, Values, Values]]] = [[] for _ in candidates]
        for which, chosen in enumerate(windows):
            if len(chosen):
                for own, found in zip(parts, self.coefficients(candidates, which, chosen), strict=True):
                    own.append((which, chosen, found))
        for c, own in zip(candidates, parts, strict=True):
            c.white, c.level = white, self.best_level(own, white=white)
            cost = self._cost(c, own, self.torques(c, windows))
            c.cost = cost if np.isfinite(cost) else np.inf

    # --- the iteration

    def go_on(
        self, candidates: Sequence[Candidate], windows: Windows, iterations: int, *, white: bool, adapt: bool = True
    ) -> None:
        """More steps for the candidates, which are changed in place.

        Args:
            candidates: of this family.
            windows: indices, one array a record.
            iterations: at most.
            white: one level of the missing torque, and one burst, for all octaves.
            adapt: whether the level is estimated anew in each iteration.
        """
        known: Known = {}
        for _ in range(iterations):
            active = [c for c in candidates if not c.converged]
            if not active:
                return
            known = self._iterate(active, windows, known, white=white, adapt=adapt)

    def _iterate(self, active: list[Candidate], windows: Windows, known: Known, *, white: bool, adapt: bool) -> Known:
        """One iteration of each candidate: the best of its steps with all dampings, if that lowers the cost.

        Returns:
            The coefficients at the candidates' values after it; `known` are those before it.
        """
        linear = self.linearise(active, windows, known=known)
        trials: list[list[Candidate]] = []
        fell, costs = [], np.zeros(0)
        for c, parts in zip(active, linear, strict=True):
            if adapt:
                c.white = white
                c.level = self.best_level([(p.which, p.windows, p.c) for p in parts], white=white)
            torques = self.torques(c, windows)
            each = [(self.noise[p.which][p.windows], p.c) for p in parts]
            weighed = [self.modes.cost_and_precision(c.level, *one, white=c.white) for one in each]
            beside = self._beside_windows(c, [(p.which, p.windows) for p in parts], torques)
            cost = beside + sum(float(np.sum(own)) for own, _ in weighed)
            # The level's fall since the last step is a gain as well, and tells of more to come.
            fell.append(max(c.cost - cost, 0.0) if np.isfinite(c.cost) else 0.0)
            c.cost = cost if np.isfinite(cost) else np.inf  # a simulation that diverges
            own = self._steps(c, parts, [w for _, w in weighed], c.damping * np.array(DAMPINGS), torques)
            trials.append(own)
            priors = [self.parameter_prior(trial) for trial in own]
            costs = np.append(costs, priors + self.log_volumes(np.array([trial.vector for trial in own]), torques))
        # All trials run as one batch of lanes, each at its candidate's level and counted torques: costs compare.
        everything = [trial for group in trials for trial in group]
        tried: dict[int, list[Values]] = {}
        for which, chosen in enumerate(windows):
            if len(chosen):
                found = tried[which] = self.coefficients(everything, which, chosen)
                tries = len(DAMPINGS)
                for place, c in enumerate(active):  # its trials share its level
                    some = slice(place * tries, (place + 1) * tries)
                    own = self.window_costs(c, which, np.tile(chosen, tries), np.concatenate(found[some]))
                    costs[some] += np.sum(own.reshape(tries, -1), axis=1)
                for index, trial in enumerate(everything):
                    costs[index] += np.sum(self.state_prior(trial, which, chosen))
        costs = np.where(np.isfinite(costs), costs, np.inf).reshape(len(active), -1)
        after: Known = {}
        for place, (c, parts, group, cost) in enumerate(zip(active, linear, trials, costs, strict=True)):
            best = int(np.argmin(cost))
            gain = c.cost - cost[best] if np.isfinite(cost[best]) else 0.0
            if not gain > 0:
                # No trial was better: larger dampings in the next iteration; converged where they are of no use.
                c.damping *= 1e3
                c.converged = bool(c.damping > 1e5)
                after[id(c)] = {p.which: p.c for p in parts}
                continue
            after[id(c)] = {which: found[place * len(group) + best] for which, found in tried.items()}
            c.vector, c.states, c.cost = group[best].vector, group[best].states, float(cost[best])
            c.damping = float(np.clip(group[best].damping, 1e-5, 1e4))
            c.converged = bool(gain + fell[place] < max(GAINED, SLIGHT * (c.cost - c.beside)))
        return after

    def _steps(
        self, c: Candidate, parts: list[Linear], weights: list[Values], dampings: Values, torques: Values
    ) -> list[Candidate]:
        """Copies of the candidate after one step, one for each damping; `weights` are the parts' `Modes.precision`."""
        count = len(c.free)
        matrix, slope, kept = self.reduced(c, parts, dampings, weights)
        c.normal = matrix[-1]
        unit = c.scale / c.spread
        prior = np.diag(unit**2)
        pull = (c.vector[c.free] - c.center) / c.spread * unit + self.log_volume_slope(c, torques)
        stepped, steps = [], np.zeros((len(dampings), 0))
        if count:
            steps = bounded_steps(c, matrix + prior, slope + pull, dampings)
        for place, (damping, step) in enumerate(zip(dampings, steps, strict=True)):
            vector = c.vector.copy()
            move = np.clip(step * c.scale, -c.reach, c.reach)
            vector[c.free] = np.clip(vector[c.free] + move, c.low, c.high)
            step = (vector[c.free] - c.vector[c.free]) / c.scale
            # Back-substitution: each window's start values follow the parameters' step, as it was clipped.
            states = [value.copy() for value in c.states]
            for part, live, solved, deviation in kept:
                move = -solved[place, :, :, count] - solved[place, :, :, :count] @ step
                states[part.which][np.ix_(live, part.windows)] += (move * deviation[live]).T
            stepped.append(replace(c, vector=vector, states=states, damping=float(damping)))
        return stepped

    def reduced(
        self, c: Candidate, parts: list[Linear], dampings: Values, weights: Sequence[Values | None] | None = None
    ) -> tuple:
        """Normal equations of the free parameters with the start values of the windows eliminated.

        Args:
            c: a candidate; its `occam` is set.
            parts: its linearisation.
            dampings: shape (dampings,).
            weights: `Modes.precision` of each part, where it is known.

        Returns:
            (normal matrices (dampings, free, free), gradients (dampings, free), both in units of `scale` and without
            prior; for each part, what the step of its start values needs).
        """
        count = len(c.free)
        matrix = np.zeros((len(dampings), count, count))
        gradient = np.zeros((len(dampings), count))
        kept = []
        c.occam = 0.0
        for part, weight in zip(parts, weights or [None] * len(parts), strict=True):
            products, pull, deviation, live = self._products(c, part, weight)
            own = products[:, count:, count:]
            index = np.arange(len(live))
            own[:, index, index] += 1.0
            c.occam += float(np.sum(np.linalg.slogdet(own)[1]))
            # The start values are damped too. Shapes: own (windows, states, states), damped (dampings, *own).
            damped = np.repeat(own[None], len(dampings), 0)
            damped[:, :, index, index] *= 1.0 + dampings[:, None, None]
            cross = products[:, count:, :count]
            # Schur complement A_pp - A_ps A_ss^-1 A_sp, summed over windows; by the last column of the gradient too.
            solved = np.linalg.solve(damped, np.concatenate([cross, pull[:, count:, None]], 2)[None])
            across = cross.transpose(0, 2, 1) @ solved
            matrix += np.sum(products[:, :count, :count] - across[..., :count], 1)
            gradient += np.sum(pull[:, :count] - across[..., count], 1)
            kept.append((part, live, solved, deviation))
        return matrix, gradient, kept

    def _products(self, c: Candidate, part: Linear, weight: Values | None) -> tuple[Values, Values, Values, Values]:
        """(J' W J, J' W c plus the start values' prior, prior deviations, indices of the free ones), in scaled units.

        Of each window: shapes (windows, columns, columns) and (windows, columns), parameters first.
        """
        deviation = self.deviations(c, part.which)
        live = np.flatnonzero(deviation > 0)
        size = np.concatenate([c.scale, deviation[live]])
        # A window whose simulation diverged, here or at a neighbour, has no say in the step (its cost is infinite).
        known, found = np.isfinite(part.c), np.isfinite(part.slope)
        here, slope = np.where(known, part.c, 0.0), np.where(found, part.slope, 0.0) * size
        if weight is None:
            weight = self.modes.precision(c.level, self.noise[part.which][part.windows], here, white=c.white)
        weighted = slope * np.where(known, weight, 0.0)[:, :, None]
        products = slope.transpose(0, 2, 1) @ weighted
        pull = (weighted.transpose(0, 2, 1) @ here[:, :, None])[:, :, 0]
        pull[:, len(c.free) :] += (c.states[part.which][live][:, part.windows] / deviation[live][:, None]).T
        return products, pull, deviation, live


def _shaft(c: Candidate) -> tuple[float, float]:
    """(stiffness [N m/rad], resonance [Hz]) of a candidate's shaft: its own, or that of two nominal masses."""
    values, plant = c.values(), c.family.machine.plant
    if "frequency" in values:
        return float(stiffness_of(values)), float(resonance_of(values))
    assert isinstance(plant, Transmission)
    return float(plant.stiffness), float(plant.resonance())
