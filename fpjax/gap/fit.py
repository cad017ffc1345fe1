# pyright: reportCallIssue=false
"""The fit: multiple shooting in windows, start states eliminated, Levenberg-Marquardt for many candidates at once."""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from .effect import Effect, Setting
from .family import Family, Runner, window_fields
from .record import Record

DAMPINGS = (1e-6, 1e-2, 1.0, 100.0)  # tried at once, times the candidate's own damping
PRIOR = 0.02  # standard deviation of the nominal inertia, Coulomb and viscous friction, relative
BOUND = 0.04  # and the hard bound


@dataclass
class Candidate:
    """A set of effects from one start, and where its fit stands.

    Attributes:
        effects: in the model.
        family: that holds them.
        vector: all parameters, shape (parameters,).
        free: indices of those that are fitted.
        low: bounds of the free ones.
        high: bounds of the free ones.
        center: of the prior of the free ones.
        weight: 1 / prior standard deviation, 0 for none.
        scale: typical size of the free ones.
        states: start values of all windows of all records, a list of arrays (states, windows), as deviations.
        hidden: centre of the hidden states, a list of arrays (2, windows).
        cost: chi-square and priors on the fitted windows.
        chi_square: without priors, over the fitted windows.
        damping: of Levenberg-Marquardt.
        normal: the last normal matrix of the free parameters, states eliminated.
        converged: no step lowers the cost any more.
        robust: a window counts by the logarithm of its chi-square, so that the windows that fit can lead the search.
        prior: what the priors add to chi-square.
        occam: half the log determinant of the start states' posterior precision over their prior's, on the fitted
            windows: what
            more start states cost in evidence.
        blur: by how much shorter steps of the simulation have moved the free parameters; empty where nobody has looked.
        window_cost: chi-square of each fitted window, one array a record.
    """

    effects: tuple[Effect, ...]
    family: Family
    vector: np.ndarray
    free: np.ndarray
    low: np.ndarray
    high: np.ndarray
    center: np.ndarray
    weight: np.ndarray
    scale: np.ndarray
    states: list[np.ndarray]
    hidden: list[np.ndarray]
    cost: float = np.inf
    chi_square: float = np.inf
    damping: float = 1.0
    normal: np.ndarray | None = None
    converged: bool = False
    robust: bool = False
    prior: float = 0.0
    occam: float = 0.0
    blur: np.ndarray = field(default_factory=lambda: np.zeros(0))
    window_cost: list[np.ndarray] = field(default_factory=list)

    @property
    def names(self) -> tuple[str, ...]:
        """Of the effects."""
        return tuple(effect.name for effect in self.effects)

    def values(self) -> dict[str, float]:
        """All parameters by name."""
        return {p.name: float(v) for p, v in zip(self.family.parameters, self.vector, strict=True)}


def make_candidate(
    effects: Sequence[Effect],
    family: Family,
    setting: Setting,
    records: list[Record],
    start: dict[str, float],
    nominal: str = "prior",
) -> Candidate:
    """A candidate at its start.

    Args:
        effects: in the model.
        family: that holds them.
        setting: sizes for bounds.
        records: of the logs.
        start: values that are not neutral.
        nominal: "prior" frees inertia, Coulomb and viscous friction under a tight prior, "fixed" does not.
    """
    names = [p.name for p in family.parameters]
    vector = family.neutral(setting)
    neutral = vector.copy()
    for name, value in start.items():
        if name in names:
            vector[names.index(name)] = value
    chosen = [p for effect in effects for p in effect.parameters]
    wanted = list(dict.fromkeys(p.name for p in chosen))
    own = set(wanted)
    if nominal == "prior":
        wanted = [n for n in ("inertia", "coulomb", "viscous") if n not in own] + wanted
    if setting.unknown_origin:
        wanted = ["origin", *wanted]
        own.add("origin")
    free = np.array([names.index(n) for n in wanted], int)
    parameters = [family.parameters[i] for i in free]
    low = np.array([p.low(setting) for p in parameters])
    high = np.array([p.high(setting) for p in parameters])
    center = neutral[free].copy()
    deviation = np.array([p.prior(setting) for p in parameters])
    scale = np.array([p.scale(setting) for p in parameters])
    for i, p in enumerate(parameters):
        if p.name in own:
            continue
        size = max(abs(center[i]), 0.05 * setting.friction / setting.speed if p.name == "viscous" else 0.0)
        size = max(size, 0.05 * setting.friction if p.name == "coulomb" else 0.0)
        low[i], high[i] = max(center[i] - BOUND * size, 0.0), center[i] + BOUND * size
        deviation[i], scale[i] = PRIOR * size, PRIOR * size
    weight = np.where(deviation > 0, 1.0 / np.where(deviation > 0, deviation, 1.0), 0.0)
    vector[free] = np.clip(vector[free], low, high)
    states = [np.zeros((family.states, len(record.starts))) for record in records]
    hidden = [np.zeros((2, len(record.starts))) for record in records]
    return Candidate(tuple(effects), family, vector, free, low, high, center, weight, scale, states, hidden)


def state_scales(family: Family, record: Record, setting: Setting) -> tuple[np.ndarray, np.ndarray]:
    """(prior standard deviations, steps of the differences) of a window's start values; 0 where a value is not free."""
    if record.velocity is None:  # the motion is imposed, and nothing of it is free
        return np.zeros(family.states), np.zeros(family.states)
    rate = 10.0 * record.velocity.noise
    angle = 0.0 if record.position is None else 10.0 * record.position.noise
    deviations = [rate, angle]
    if family.key[0] == "bristles":
        deviations.append(0.5)
    if family.key[0] == "transmission":
        deviations += [2e-3 * setting.speed, 0.05 * setting.speed]
    found = np.array(deviations)
    return found, np.where(found > 0, 1e-3 * found, 0.0)


class Fitter:
    """Fits candidates of one family on chosen windows."""

    def __init__(self, runner: Runner, setting: Setting):
        self.runner = runner
        self.setting = setting
        self.family = runner.family
        self._even = 3.0 * runner.samples * runner.channels  # chi-square at which a window counts half
        self.scales = [state_scales(self.family, record, setting) for record in runner.records]

    def fit(self, candidates: list[Candidate], windows: list[np.ndarray], iterations: int) -> None:
        """Levenberg-Marquardt on the windows (indices, one array a record), in place, all candidates side by side."""
        for candidate in candidates:
            candidate.converged = False
            candidate.cost = np.inf
        self.go_on(candidates, windows, iterations)

    def go_on(self, candidates: list[Candidate], windows: list[np.ndarray], iterations: int) -> None:
        """`fit` from where the candidates stand."""
        for _ in range(iterations):
            active = [c for c in candidates if not c.converged]
            if not active:
                return
            self._iterate(active, windows)

    def score(self, candidates: list[Candidate], windows: list[np.ndarray], iterations: int = 3) -> list[np.ndarray]:
        """Chi-square of each window with the parameters fixed and the start states fitted, shape (candidates,
        windows).
        """
        frozen = []
        for c in candidates:
            frozen.append(
                Candidate(
                    c.effects, c.family, c.vector.copy(), np.zeros(0, int), *(np.zeros(0) for _ in range(5)),
                    c.states, c.hidden,
                )
            )  # fmt: skip
        self.fit(frozen, windows, iterations)
        for c, scored in zip(candidates, frozen, strict=True):
            c.states = scored.states
        return [np.concatenate(c.window_cost) for c in frozen]

    def residuals(self, candidate: Candidate, which: int, windows: np.ndarray, stride: int = 0) -> np.ndarray:
        """In standard deviations, shape (channels, samples, windows); `stride` as for `Runner.run`."""
        vector = np.repeat(candidate.vector[:, None], len(windows), 1)
        fields = window_fields(self.runner.records[which], windows, candidate.hidden[which])
        return self.runner.run(which, vector, candidate.states[which][:, windows], fields, stride)[0]

    def window_costs(self, candidates: list[Candidate], which: int, windows: np.ndarray) -> list[np.ndarray]:
        """Chi-square of each window with the prior of its start values, as the candidates stand."""
        vectors = [np.repeat(c.vector[:, None], len(windows), 1) for c in candidates]
        states = [c.states[which][:, windows] for c in candidates]
        fields = [window_fields(self.runner.records[which], windows, c.hidden[which]) for c in candidates]
        deviation = self.scales[which][0]
        live = deviation > 0
        found = []
        for s, out in zip(states, self._run(which, vectors, states, fields), strict=True):
            found.append(np.sum(out * out, axis=(0, 1)) + np.sum((s[live] / deviation[live][:, None]) ** 2, 0))
        return found

    def robust_cost(self, chi_square: np.ndarray) -> np.ndarray:
        """What windows count in a search that the windows which fit shall lead."""
        return self._even * np.log1p(chi_square / self._even)

    def ends(self, candidate: Candidate, which: int, windows: np.ndarray) -> np.ndarray:
        """Hidden states at the ends of windows, as the candidate stands, shape (2, windows)."""
        vector = np.repeat(candidate.vector[:, None], len(windows), 1)
        fields = window_fields(self.runner.records[which], windows, candidate.hidden[which])
        return self.runner.run(which, vector, candidate.states[which][:, windows], fields)[1]

    def linearise(self, candidates: list[Candidate], windows: list[np.ndarray]) -> list[list[tuple]]:
        """For each candidate and record: (J^T J, J^T r, r^T r) of each window; parameters first, then the free
        states.
        """
        found: list[list[tuple]] = [[] for _ in candidates]
        for which, chosen in enumerate(windows):
            if not len(chosen):
                continue
            for index, (r, jacobian) in enumerate(self.jacobians(candidates, which, chosen)):
                transposed = jacobian.transpose(0, 2, 1)
                found[index].append(
                    (transposed @ jacobian, (transposed @ r[:, :, None])[:, :, 0], np.sum(r * r, axis=1))
                )
        return found

    def jacobians(
        self, candidates: list[Candidate], which: int, windows: np.ndarray
    ) -> list[tuple[np.ndarray, np.ndarray]]:
        """For each candidate (residuals, their Jacobian) in windows of one record, in standard deviations.

        Returns:
            Residuals of shape (windows, channels x samples), Jacobians of shape (windows, channels x samples, free
            parameters + free states); by differences, every change a lane.
        """
        deviation, step = self.scales[which]
        live = np.flatnonzero(deviation > 0)
        vectors, states, fields, steps = [], [], [], []
        for c in candidates:
            h = 1e-4 * c.scale
            h = np.where(c.vector[c.free] + h > c.high, -h, h)
            count = 1 + len(c.free) + len(live)
            v = np.repeat(c.vector[:, None], count, 1)
            v[c.free, 1 + np.arange(len(c.free))] += h
            s = np.repeat(c.states[which][:, windows][:, :, None], count, 2)
            for place, row in enumerate(live):
                s[row, :, 1 + len(c.free) + place] += step[row]
            vectors.append(np.tile(v, (1, len(windows))))
            states.append(s.reshape(s.shape[0], -1))
            f = window_fields(self.runner.records[which], windows, c.hidden[which])
            fields.append({name: np.repeat(value, count, axis=-1) for name, value in f.items()})
            steps.append(np.concatenate([h, step[live]]))
        found = []
        for block, size in zip(self._run(which, vectors, states, fields), steps, strict=True):
            # (channels, samples, windows, 1 + free + live) -> (windows, channels * samples, ...)
            shaped = block.reshape(-1, len(windows), 1 + len(size)).transpose(1, 0, 2)
            found.append((shaped[:, :, 0], (shaped[:, :, 1:] - shaped[:, :, :1]) / size))
        return found

    def _run(self, which: int, vectors: list, states: list, fields: list) -> list[np.ndarray]:
        merged = {name: np.concatenate([f[name] for f in fields], axis=-1) for name in fields[0]}
        out, _ = self.runner.run(which, np.concatenate(vectors, 1), np.concatenate(states, 1), merged)
        ends = np.cumsum([v.shape[1] for v in vectors])[:-1]
        return np.split(out, ends, axis=2)

    def _iterate(self, active: list[Candidate], windows: list[np.ndarray]) -> None:
        used = [(which, chosen) for which, chosen in enumerate(windows) if len(chosen)]
        trials: list[Candidate] = []
        for c, parts in zip(active, self.linearise(active, windows), strict=True):
            c.window_cost = [part[2] for part in parts]
            self._add_priors(c, used)
            trials += self.steps(c, parts, used, c.damping * np.array(DAMPINGS))
        self._evaluate(trials, used)
        for index, c in enumerate(active):
            options = trials[index * len(DAMPINGS) : (index + 1) * len(DAMPINGS)]
            best = min(options, key=lambda option: option.cost)
            gain = c.cost - best.cost
            if not gain > 0:
                c.damping *= 1e3
                c.converged = c.damping > 1e5
                continue
            c.vector, c.states = best.vector, best.states
            c.cost, c.chi_square, c.window_cost = best.cost, best.chi_square, best.window_cost
            c.damping = float(np.clip(best.damping, 1e-5, 1e4))
            c.converged = gain < 0.02 + 1e-6 * c.cost

    def steps(self, c: Candidate, parts: list[tuple], used: list, dampings: np.ndarray) -> list[Candidate]:
        """The candidate after one Gauss-Newton step for each damping; the start states of each window are eliminated.

        Args:
            c: the candidate; its `occam`, and `normal` by the last damping, are set.
            parts: its (J^T J, J^T r, r^T r) of each record, from `linearise`.
            used: (index of the record, its windows) of each of them.
            dampings: of Levenberg-Marquardt, shape (dampings,).

        Returns:
            One candidate a damping, not evaluated.
        """
        count = len(c.free)
        matrices = np.repeat(np.diag((c.weight * c.scale) ** 2)[None], len(dampings), 0)
        slopes = np.repeat((c.weight**2 * (c.vector[c.free] - c.center) * c.scale)[None], len(dampings), 0)
        kept = []
        c.occam = 0.0
        for (which, chosen), (products, gradient, square) in zip(used, parts, strict=True):
            if c.robust:
                weight = 1.0 / (1.0 + square / self._even)
                products, gradient = products * weight[:, None, None], gradient * weight[:, None]
            deviation = self.scales[which][0]
            live = np.flatnonzero(deviation > 0)
            size = np.concatenate([c.scale, deviation[live]])
            products = products * size[:, None] * size
            gradient = gradient * size
            own = products[:, count:, count:]
            index = np.arange(len(live))
            own[:, index, index] += 1.0
            c.occam += 0.5 * float(np.sum(np.linalg.slogdet(own)[1]))
            damped = np.repeat(own[None], len(dampings), 0)
            damped[:, :, index, index] *= 1.0 + dampings[:, None, None]
            pull = gradient[:, count:] + (c.states[which][live][:, chosen] / deviation[live][:, None]).T
            cross = products[:, count:, :count]
            solved = np.linalg.solve(damped, np.concatenate([cross, pull[:, :, None]], 2)[None])
            across = cross.transpose(0, 2, 1) @ solved
            matrices += np.sum(products[:, :count, :count] - across[..., :count], 1)
            slopes += np.sum(gradient[:, :count] - across[..., count], 1)
            kept.append((which, chosen, live, solved, deviation))
        c.normal = matrices[-1]
        stepped = []
        for place, damping in enumerate(dampings):
            step = self._bounded(c, matrices[place], slopes[place], damping) if count else np.zeros(0)
            vector = c.vector.copy()
            vector[c.free] = np.clip(vector[c.free] + step * c.scale, c.low, c.high)
            step = (vector[c.free] - c.vector[c.free]) / c.scale
            states = [value.copy() for value in c.states]
            for which, chosen, live, solved, deviation in kept:
                move = -solved[place, :, :, count] - solved[place, :, :, :count] @ step
                states[which][np.ix_(live, chosen)] += (move * deviation[live]).T
            stepped.append(replace(c, vector=vector, states=states, damping=float(damping)))
        return stepped

    def _bounded(self, c: Candidate, matrix: np.ndarray, slope: np.ndarray, damping: float) -> np.ndarray:
        """Solve the damped normal equations; a parameter at its bound that wants out stays there."""
        value = c.vector[c.free]
        edge = 1e-9 * c.scale
        held = np.zeros(len(value), bool)
        step = np.zeros(len(value))
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

    def _evaluate(self, trials: list[Candidate], used: list) -> None:
        """Costs of candidates as they stand, in place."""
        for c in trials:
            c.window_cost = []
        for which, chosen in used:
            vectors = [np.repeat(c.vector[:, None], len(chosen), 1) for c in trials]
            states = [c.states[which][:, chosen] for c in trials]
            fields = [window_fields(self.runner.records[which], chosen, c.hidden[which]) for c in trials]
            for c, out in zip(trials, self._run(which, vectors, states, fields), strict=True):
                c.window_cost.append(np.sum(out * out, axis=(0, 1)))
        for c in trials:
            self._add_priors(c, used)

    def _add_priors(self, c: Candidate, used: list) -> None:
        c.chi_square = float(sum(np.sum(part) for part in c.window_cost))
        prior = float(np.sum(((c.vector[c.free] - c.center) * c.weight) ** 2)) if len(c.free) else 0.0
        for which, chosen in used:
            deviation = self.scales[which][0]
            live = deviation > 0
            prior += float(np.sum((c.states[which][live][:, chosen] / deviation[live][:, None]) ** 2))
        c.prior = prior
        total = c.chi_square
        if c.robust:
            total = float(sum(np.sum(self.robust_cost(part)) for part in c.window_cost))
        c.cost = total + prior if np.isfinite(c.chi_square) else np.inf
