"""Levenberg-Marquardt in the modes of the missing torque, start states eliminated, many candidates side by side.

L = sum over windows and modes of c^2 / (s^2 + q^2 lambda) + log(s^2 + q^2 lambda), and the priors. q is set to its
most likely value at the start of every iteration: far from the truth it is large and the problem is nearly a
regression; it falls as the fit improves.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from ..data.record import Record
from ..data.setting import Setting
from ..effects.vocabulary import stiffness_of
from ..simulate.family import Runner, window_fields
from .candidate import Candidate
from .modes import Modes

DAMPINGS = (1e-6, 1e-2, 1.0, 100.0)  # tried at once, times the candidate's own damping
LOADED = 0.05  # of the friction: how well the torque in a spring at a window's start is known beforehand
BRISTLE = 0.1  # how well the bristles' share is known beforehand [1]
MOVED = 0.02  # of the top speed: how well a speed from positions is known, beside its noise
RESPONSE = ("inertia", "viscous", "gain", "actuator_lag", "drag_coefficient", "load_coefficient")
LEAST_PASSED = 0.05  # of a torque: less of it than this reaches no machine that is driven
GAINED = 0.02  # fall of twice the negative log posterior below which a fit has converged

Values = np.ndarray
Windows = Sequence[Values]


@dataclass(frozen=True)
class Linear:
    """A record's windows around a candidate: coefficients and their Jacobian.

    Attributes:
        which: index of the record.
        windows: indices, shape (windows,).
        c: coefficients, (windows, modes).
        slope: their Jacobian by free parameters, then free start states, (windows, modes, columns).
    """

    which: int
    windows: Values
    c: Values
    slope: Values


class Fitter:
    """Fits candidates of one family on chosen windows.

    Args:
        runner: of the family.
        setting: sizes.
        modes: of a window.
    """

    def __init__(self, runner: Runner, setting: Setting, modes: Modes):
        self.runner, self.family, self.setting, self.modes = runner, runner.family, setting, modes
        self.records: list[Record] = runner.records
        speed = np.concatenate([record.speed for record in self.records])
        torque = np.concatenate([record.torque for record in self.records])
        self.speed, self.effort = float(np.sqrt(np.mean(speed**2))), np.sort(np.abs(torque))
        self.driving = float(np.clip(np.mean(np.sign(torque) * np.sign(speed)), 0.0, 1.0))
        self.inertial = self._inertial()
        guide = runner.tables[0].guide
        self.guide = float(guide.stiffness), float(guide.damping)
        self._nominal = self._response(self.family.neutral(setting))
        # Windows whose readings repeat have more noise.
        self.noise = [2.0 ** np.round(np.log2(record.runs)) for record in self.records]

    def _inertial(self) -> Values:
        """Mean square of the inertial torque in each mode [N^2 m^2], by octave, shape (modes,)."""
        modes, squares = self.modes, []
        for record in self.records:
            rows = record.starts[:, None] + np.arange(record.samples)
            squares.append((self.setting.inertia * record.acceleration[rows] @ modes.torque) ** 2)
        each = np.mean(np.concatenate(squares), axis=0)
        found = np.zeros(len(each))
        for band in np.unique(modes.band[~modes.sensor]):
            own = (modes.band == band) & ~modes.sensor
            found[own] = np.mean(each[own])
        return found

    def deviations(self, c: Candidate, which: int, *, hidden: bool = True) -> Values:
        """Prior standard deviations of a window's start values, shape (states,); 0 where one is not free.

        Args:
            c: a candidate; the stiffness says what twist an unknown torque leaves.
            which: record.
            hidden: also of the states that no sensor sees.
        """
        record = self.records[which]
        if record.velocity is not None:
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
            values = c.values()
            twist = LOADED * self.setting.friction / float(stiffness_of(values))
            found += [twist, twist * 2.0 * np.pi * values["frequency"]] if hidden else [0.0, 0.0]
        return np.array(found)

    # --- running

    def coefficients(self, candidates: Sequence[Candidate], which: int, windows: Values) -> list[Values]:
        """c of each candidate as it stands, each of shape (windows, modes)."""
        vectors = [np.repeat(c.vector[:, None], len(windows), 1) for c in candidates]
        states = [c.states[which][:, windows] for c in candidates]
        fields = [window_fields(self.records[which], windows, c.hidden[which]) for c in candidates]
        return [out.T for out in self._run(which, vectors, states, fields)]

    def _run(self, which: int, vectors: list, states: list, fields: list) -> list[Values]:
        merged = {name: np.concatenate([f[name] for f in fields], axis=-1) for name in fields[0]}
        out, _ = self.runner.run(which, np.concatenate(vectors, 1), np.concatenate(states, 1), merged)
        ends = np.cumsum([v.shape[1] for v in vectors])[:-1]
        return np.split(self.modes.coefficients(out), ends, axis=1)

    def ends(self, c: Candidate, which: int, windows: Values) -> Values:
        """Hidden states at the ends of windows, as the candidate stands, shape (2, windows)."""
        vector = np.repeat(c.vector[:, None], len(windows), 1)
        fields = window_fields(self.records[which], windows, c.hidden[which])
        return self.runner.run(which, vector, c.states[which][:, windows], fields)[1]

    def linearise(
        self, candidates: Sequence[Candidate], windows: Windows, *, hidden: bool = True
    ) -> list[list[Linear]]:
        """Of each candidate, one `Linear` a record with windows; Jacobians by differences, every change a lane."""
        found: list[list[Linear]] = [[] for _ in candidates]
        for which, chosen in enumerate(windows):
            if not len(chosen):
                continue
            vectors, states, fields, steps = [], [], [], []
            for c in candidates:
                deviation = self.deviations(c, which, hidden=hidden)
                live = np.flatnonzero(deviation > 0)
                h = 1e-4 * c.scale
                h = np.where(c.vector[c.free] + h > c.high, -h, h)
                count = 1 + len(c.free) + len(live)
                v = np.repeat(c.vector[:, None], count, 1)
                v[c.free, 1 + np.arange(len(c.free))] += h
                s = np.repeat(c.states[which][:, chosen][:, :, None], count, 2)
                for place, row in enumerate(live):
                    s[row, :, 1 + len(c.free) + place] += 1e-3 * deviation[row]
                vectors.append(np.tile(v, (1, len(chosen))))
                states.append(s.reshape(s.shape[0], -1))
                field = window_fields(self.records[which], chosen, c.hidden[which])
                fields.append({name: np.repeat(value, count, axis=-1) for name, value in field.items()})
                steps.append(np.concatenate([h, 1e-3 * deviation[live]]))
            blocks = self._run(which, vectors, states, fields)
            for index, (block, size) in enumerate(zip(blocks, steps, strict=True)):
                shaped = block.reshape(len(block), len(chosen), 1 + len(size)).transpose(1, 0, 2)
                slope = (shaped[:, :, 1:] - shaped[:, :, :1]) / size
                found[index].append(Linear(which, chosen, shaped[:, :, 0], slope))
        return found

    # --- levels and costs

    def best_level(self, parts: Sequence[tuple[int, Values, Values]], *, white: bool) -> Values:
        """The most likely q by octave for (record, windows, coefficients) of one candidate."""
        return self.modes.best_level(*self._together(parts), white=white)

    def best_noise(self, parts: Sequence[tuple[int, Values, Values]]) -> float:
        """The most likely factor on the sensors' noise, likewise."""
        return self.modes.best_noise(*self._together(parts))

    def _together(self, parts: Sequence[tuple[int, Values, Values]]) -> tuple[Values, Values]:
        """(noise, coefficients) of all windows."""
        noise = np.concatenate([self.noise[which][windows] for which, windows, _ in parts])
        return noise, np.concatenate([c for _, _, c in parts])

    def window_costs(self, c: Candidate, which: int, windows: Values, coefficients: Values) -> Values:
        """Twice the negative log likelihood of windows, shape (windows,)."""
        return self.modes.cost(c.level, self.noise[which][windows], coefficients, white=c.white)

    def state_prior(self, c: Candidate, which: int, windows: Values, *, hidden: bool) -> Values:
        """Twice the negative log prior of the start states of windows, shape (windows,)."""
        deviation = self.deviations(c, which, hidden=hidden)
        live = deviation > 0
        return np.sum((c.states[which][live][:, windows] / deviation[live][:, None]) ** 2, axis=0)

    def parameter_prior(self, c: Candidate) -> float:
        """Twice the negative log prior of the free parameters."""
        return float(np.sum(((c.vector[c.free] - c.center) / c.spread) ** 2))

    def torques(self, c: Candidate, windows: Windows) -> Values:
        """How many coefficients of each mode show a torque that the model knows less of than of its own motion.

        A torque that is seen above the noise counts as far as it is not small beside the inertial torque: where that is
        the larger, torque makes the motion, and the motion is not imposed.

        Returns:
            Shape (modes,) [1].
        """
        noise = np.concatenate([self.noise[which][chosen] for which, chosen in enumerate(windows)])
        seen = np.sum(self.modes.wiener(c.level, noise), axis=0)
        missing = c.level[self.modes.band] ** 2
        return seen * missing / np.maximum(missing + self.inertial, 1e-300)

    def torque_scale(self, c: Candidate, vector: Values | None = None) -> Values:
        """By how much a torque at a candidate's command is larger than its residual says through the nominal mass.

        The ratio of the nominal model's frequency response to its own, at least 1. Under a stiff position loop the
        motion is imposed and the torque follows from it. A model that hardly moves whatever acts on it (a heavy mass,
        much damping, a lag, a limit) then leaves small residuals without knowing the torque. A model that moves more
        than the nominal one is not scaled: a light mass or a large gain would shrink what it is judged by likewise.

        Returns:
            Shape (modes,) [1]; 1 for modes without torque.
        """
        own = self._response(c.vector if vector is None else vector)
        return np.where(self.modes.sensor, 1.0, np.maximum(self._nominal / own, 1.0))

    def _response(self, vector: Values) -> Values:
        """Of a machine with these parameters, shape (modes,) (`Modes.response`)."""
        found = dict(zip([p.name for p in self.family.parameters], vector, strict=True))
        viscous = found["viscous"] + 2.0 * found.get("drag_coefficient", 0.0) * self.speed
        above, within = found.get("dead_zone", 0.0), found.get("limit", np.inf)
        count = np.searchsorted(self.effort, within, "right") - np.searchsorted(self.effort, above, "left")
        passed = max(count, 0) / len(self.effort)
        gain = found.get("gain", 1.0) * max(1.0 - found.get("load_coefficient", 0.0) * self.driving, LEAST_PASSED)
        lag = max(found.get("actuator_lag", 0.0), 0.0)
        return self.modes.response(
            found["inertia"], max(viscous, 0.0), gain * max(passed, LEAST_PASSED), lag, self.guide
        )

    def log_volume(self, c: Candidate, torques: Values, vector: Values | None = None) -> float:
        """Twice the negative log of the Jacobian from torques to motion, of so many coefficients a mode."""
        if not np.any(torques > 0.0):
            return 0.0
        return 2.0 * float(torques @ np.log(self.torque_scale(c, vector)))

    # --- the iteration

    def go_on(
        self, candidates: Sequence[Candidate], windows: Windows, iterations: int, *, white: bool, hidden: bool = True,
        adapt: bool = True,
    ) -> None:  # fmt: skip
        """More steps from where the candidates stand, in place.

        Args:
            candidates: of this family.
            windows: indices, one array a record.
            iterations: at most.
            white: one level of the missing torque, and one burst, for all octaves.
            hidden: start values that no sensor sees are free too.
            adapt: set the level; else it stays as it is.
        """
        for _ in range(iterations):
            active = [c for c in candidates if not c.converged]
            if not active:
                return
            self._iterate(active, windows, white=white, hidden=hidden, adapt=adapt)

    def _iterate(self, active: list[Candidate], windows: Windows, *, white: bool, hidden: bool, adapt: bool) -> None:
        trials: list[list[Candidate]] = []
        shown: list[Values] = []
        for c, parts in zip(active, self.linearise(active, windows, hidden=hidden), strict=True):
            if adapt:
                c.white = white
                c.level = self.best_level([(p.which, p.windows, p.c) for p in parts], white=white)
            c.cost = sum(float(np.sum(self.window_costs(c, p.which, p.windows, p.c))) for p in parts)
            c.cost += sum(float(np.sum(self.state_prior(c, p.which, p.windows, hidden=hidden))) for p in parts)
            torques = self.torques(c, windows)
            shown.append(torques)
            c.cost += self.parameter_prior(c) + self.log_volume(c, torques)
            trials.append(self._steps(c, parts, c.damping * np.array(DAMPINGS), torques, hidden=hidden))
        everything = [trial for group in trials for trial in group]
        costs = np.array(
            [
                self.parameter_prior(c) + self.log_volume(c, torques)
                for group, torques in zip(trials, shown, strict=True)
                for c in group
            ]
        )
        for which, chosen in enumerate(windows):
            if len(chosen):
                found = self.coefficients(everything, which, chosen)
                tries = len(DAMPINGS)
                for place, c in enumerate(active):  # whose trials have one level
                    some = slice(place * tries, (place + 1) * tries)
                    own = self.window_costs(c, which, np.tile(chosen, tries), np.concatenate(found[some]))
                    costs[some] += np.sum(own.reshape(tries, -1), axis=1)
                for index, trial in enumerate(everything):
                    costs[index] += np.sum(self.state_prior(trial, which, chosen, hidden=hidden))
        costs = np.where(np.isfinite(costs), costs, np.inf).reshape(len(active), -1)
        for c, group, cost in zip(active, trials, costs, strict=True):
            best = int(np.argmin(cost))
            gain = c.cost - cost[best]
            if not gain > 0:
                c.damping *= 1e3
                c.converged = c.damping > 1e5
                continue
            c.vector, c.states, c.cost = group[best].vector, group[best].states, float(cost[best])
            c.damping = float(np.clip(group[best].damping, 1e-5, 1e4))
            c.converged = gain < GAINED

    def _steps(
        self, c: Candidate, parts: list[Linear], dampings: Values, torques: Values, *, hidden: bool
    ) -> list[Candidate]:
        """The candidate after one step for each damping; each window's start states are eliminated."""
        count = len(c.free)
        matrix, slope, kept = self.reduced(c, parts, dampings, hidden=hidden)
        c.normal = matrix[-1]
        unit = c.scale / c.spread
        prior = np.diag(unit**2)
        pull = (c.vector[c.free] - c.center) / c.spread * unit + self._log_volume_slope(c, torques)
        stepped = []
        for place, damping in enumerate(dampings):
            step = _bounded(c, matrix[place] + prior, slope[place] + pull, damping) if count else np.zeros(0)
            vector = c.vector.copy()
            move = np.clip(step * c.scale, -c.reach, c.reach)
            vector[c.free] = np.clip(vector[c.free] + move, c.low, c.high)
            step = (vector[c.free] - c.vector[c.free]) / c.scale
            states = [value.copy() for value in c.states]
            for part, live, solved, deviation in kept:
                move = -solved[place, :, :, count] - solved[place, :, :, :count] @ step
                states[part.which][np.ix_(live, part.windows)] += (move * deviation[live]).T
            stepped.append(replace(c, vector=vector, states=states, damping=float(damping)))
        return stepped

    def _log_volume_slope(self, c: Candidate, torques: Values) -> Values:
        """Half the slope of `log_volume` by the free parameters in units of their scale, shape (free,)."""
        found, here = np.zeros(len(c.free)), self.log_volume(c, torques)
        for place, index in enumerate(c.free):
            if c.family.parameters[index].name in RESPONSE:
                step = 1e-4 * c.scale[place]
                moved = c.vector.copy()
                moved[index] += step
                found[place] = 0.5 * (self.log_volume(c, torques, moved) - here) / 1e-4
        return found

    def reduced(self, c: Candidate, parts: list[Linear], dampings: Values, *, hidden: bool = True) -> tuple:
        """(normal matrices, gradients) of the free parameters in units of `scale`, by damping; and what steps need."""
        count = len(c.free)
        matrix = np.zeros((len(dampings), count, count))
        gradient = np.zeros((len(dampings), count))
        kept = []
        c.occam = 0.0
        for part in parts:
            products, pull, deviation, live = self._products(c, part, hidden=hidden)
            own = products[:, count:, count:]
            index = np.arange(len(live))
            own[:, index, index] += 1.0
            c.occam += float(np.sum(np.linalg.slogdet(own)[1]))
            damped = np.repeat(own[None], len(dampings), 0)
            damped[:, :, index, index] *= 1.0 + dampings[:, None, None]
            cross = products[:, count:, :count]
            solved = np.linalg.solve(damped, np.concatenate([cross, pull[:, count:, None]], 2)[None])
            across = cross.transpose(0, 2, 1) @ solved
            matrix += np.sum(products[:, :count, :count] - across[..., :count], 1)
            gradient += np.sum(pull[:, :count] - across[..., count], 1)
            kept.append((part, live, solved, deviation))
        return matrix, gradient, kept

    def _products(self, c: Candidate, part: Linear, *, hidden: bool) -> tuple[Values, Values, Values, Values]:
        """(J' W J, J' W c with the start states' prior, their deviations, which are free), in scaled units."""
        deviation = self.deviations(c, part.which, hidden=hidden)
        live = np.flatnonzero(deviation > 0)
        size = np.concatenate([c.scale, deviation[live]])
        weight = self.modes.precision(c.level, self.noise[part.which][part.windows], part.c, white=c.white)
        slope = part.slope * size
        weighted = slope * weight[:, :, None]
        products = slope.transpose(0, 2, 1) @ weighted
        pull = (weighted.transpose(0, 2, 1) @ part.c[:, :, None])[:, :, 0]
        pull[:, len(c.free) :] += (c.states[part.which][live][:, part.windows] / deviation[live][:, None]).T
        return products, pull, deviation, live


def _bounded(c: Candidate, matrix: Values, slope: Values, damping: float) -> Values:
    """Solve the damped normal equations; a parameter at its bound that wants out stays there."""
    value, edge = c.vector[c.free], 1e-9 * c.scale
    held, step = np.zeros(len(value), bool), np.zeros(len(value))
    damped = matrix + np.diag(damping * np.diag(matrix) + 1e-12)
    for _ in range(4):
        go = ~held
        step[:] = 0.0
        if not np.any(go):
            break
        step[go] = np.linalg.lstsq(damped[np.ix_(go, go)], -slope[go], rcond=1e-13)[0]
        out = ((value <= c.low + edge) & (step < 0)) | ((value >= c.high - edge) & (step > 0))
        if not np.any(out & go):
            break
        held |= out
    return step
