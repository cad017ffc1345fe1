"""Attribute: which effects, alone and together, make the simulation agree with the log."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from .effect import Effect, Setting
from .family import FINE, Family, Key, Nominal, Runner, key_for, make_family
from .fit import Candidate, Fitter, make_candidate
from .observer import Observer
from .precision import double_precision
from .record import Record, make_record, stride_of, tables_of, window_seconds, with_common_noise
from .settle import scan_gap, settle

SCREEN = 12  # windows that a start is screened on
SCREEN_STEPS = 5
HOPELESS = 1000.0  # a second start of one effect is not worth finishing at so many times the lowest cost
STAGES = ((3, 100.0), (4, 20.0), (8, 5.0), (12, 2.0))  # steps on all windows, and who goes on after them
SHORTER = 0.4  # length of the windows in which a play is searched for, of the usual ones
SETTLED = 2  # leading candidates of a family whose windows are searched for better hidden states
ROUNDS = 24  # of the polishing of a play
POLISHED = 30.0  # times the lowest cost up to which a play is polished
STUCK = 8.0  # mean chi-square of a window in which a hidden state is wrong
REFINED = 6  # steps of the fit in shorter steps of the simulation, twice
LOST = 1.2  # times the cost before, from which on a fit in shorter steps has lost its way
NEAR = 300.0  # chi-square per residual above which no search of hidden states is worth its time
Progress = Callable[[str, float], None]
Options = list[tuple[tuple[Effect, ...], dict[str, float]]]


@dataclass
class Fitted:
    """A finished candidate and its scores.

    Attributes:
        candidate: the fit.
        train: chi-square of each fitted window.
        withheld: chi-square of each withheld window.
        evidence: log evidence [1].
        colour: integrated autocorrelation time of its residual [samples]; 0 while nobody has asked.
    """

    candidate: Candidate
    train: np.ndarray
    withheld: np.ndarray
    evidence: float = -np.inf
    colour: float = 0.0

    @property
    def names(self) -> tuple[str, ...]:
        """Of the effects."""
        return self.candidate.names

    @property
    def total(self) -> float:
        """Chi-square on all windows, with the priors."""
        return float(np.sum(self.train) + np.sum(self.withheld)) + self.candidate.prior


@dataclass
class Search:
    """Everything that is fitted on one machine's logs.

    Attributes:
        records: the logs.
        nominal: the model.
        effects: the vocabulary, the user's own effects included.
        setting: sizes.
        logs: the records' logs, where short windows may be cut from them.
        short: the search in short windows, made when it is first needed.
        fitters: by family.
        observers: by family.
        corners: what a perfect model leaves of the torque, from a made log [N m]; None while nobody has asked.
    """

    records: list[Record]
    nominal: Nominal
    effects: tuple[Effect, ...]
    setting: Setting
    logs: list[Any] | None = None
    short: Any = None
    fitters: dict[Key, Fitter] = field(default_factory=dict)
    observers: dict[Key, Observer] = field(default_factory=dict)
    corners: float | None = None

    def __post_init__(self) -> None:
        with double_precision():
            self.tables: list[Any] = [tables_of(record) for record in self.records]
        self.train = [np.flatnonzero(~record.withheld) for record in self.records]
        self.withheld = [np.flatnonzero(record.withheld) for record in self.records]
        first = self.records[0]
        self.colour = 1.0  # autocorrelation time by which evidence is divided [samples]
        self.imposed = first.velocity is None  # the motion is; the gap is told in torque
        self.per_window = first.samples * ((first.velocity is not None) + (first.position is not None))
        if self.imposed:
            self.per_window = first.samples // stride_of(first.half)
        self.count = self.per_window * sum(len(record.starts) for record in self.records)

    @property
    def spent(self) -> float:
        """What was simulated so far, in seconds of one core as `fpjax.gap.family.COSTS` counts them."""
        own = sum(fitter.runner.spent for fitter in {id(f): f for f in self.fitters.values()}.values())
        return own + (self.short.spent if self.short is not None else 0.0)

    def family(self, effects: Sequence[Effect]) -> Family:
        """The smallest family that holds the effects, compiled when it is first needed."""
        return self.fitter(key_for(tuple(effects))).family

    def fitter(self, key: Key) -> Fitter:
        """The fitter of a family."""
        if key not in self.fitters:
            family = make_family(key, self.nominal, self.effects, self.setting)
            if family.key not in self.fitters:
                runner = Runner(family, self.records, self.tables)
                self.fitters[family.key] = Fitter(runner, self.setting)
                if family.key[0] != "rigid" and not runner.imposed:
                    self.observers[family.key] = Observer(family, self.records, self.tables)
            self.fitters[key] = self.fitters[family.key]
        return self.fitters[key]

    def candidate(self, effects: Sequence[Effect], start: dict[str, float], nominal: str = "prior") -> Candidate:
        """A candidate at a start."""
        return make_candidate(effects, self.family(effects), self.setting, self.records, start, nominal)

    def screening(self, reference: np.ndarray | None) -> list[np.ndarray]:
        """A few fitted windows: spread over the log, and those where the nominal model is worst."""
        chosen = []
        offset = 0
        for train in self.train:
            if len(train) == 0:  # a log that is only scored
                chosen.append(train)
                continue
            few = max(2, SCREEN // len(self.train))
            index = np.unique(np.linspace(0, len(train) - 1, max(few - 2, 1)).round().astype(int))
            if reference is not None:
                worst = np.argsort(-reference[offset : offset + len(train)])
                extra = [i for i in worst if i not in index][: few - len(index)]
                index = np.unique(np.concatenate([index, np.array(extra, int)]))
            chosen.append(train[index])
            offset += len(train)
        return chosen

    def fit(self, candidates: list[Candidate], windows: list[np.ndarray], iterations: int) -> None:
        """Fit candidates of any families."""
        for key in dict.fromkeys(c.family.key for c in candidates):
            group = [c for c in candidates if c.family.key == key]
            fitter = self.fitters[key]
            if key not in self.observers:
                fitter.fit(group, windows, iterations)
                continue
            done = 0
            for c in group:
                c.converged, c.cost = False, np.inf
            while done < iterations:
                active = [c for c in group if not c.converged]
                if not active:
                    break
                self.observe(active, windows)
                part = min(3, iterations - done)
                fitter.go_on(active, windows, part)
                done += part

    def observe(self, candidates: list[Candidate], windows: list[np.ndarray]) -> None:
        """Take other hidden states in every window where they fit better: the observer's, and the two sides of a
        play.
        """
        key = candidates[0].family.key
        observer, fitter = self.observers[key], self.fitters[key]
        for which, chosen in enumerate(windows):
            if not len(chosen):
                continue
            vectors = np.concatenate([np.repeat(c.vector[:, None], len(chosen), 1) for c in candidates], 1)
            centers = observer.centers(vectors, which, np.tile(chosen, len(candidates)))
            options = [centers]
            if key[0] == "transmission":
                half = 0.5 * vectors[candidates[0].family.index("gap")] if self.plays(key) else 0.0 * centers[0]
                options += [
                    np.stack([side * half, 0.0 * half]) for side in ((1.0, -1.0) if np.any(half > 0) else (0.0,))
                ]
            best = fitter.window_costs(candidates, which, chosen)
            for option in options:
                kept = [(c.hidden[which].copy(), c.states[which].copy()) for c in candidates]
                for index, c in enumerate(candidates):
                    c.hidden[which][:, chosen] = option[:, index * len(chosen) : (index + 1) * len(chosen)]
                    c.states[which][2:, chosen] = 0.0
                after = fitter.window_costs(candidates, which, chosen)
                for index, (c, (hidden, states)) in enumerate(zip(candidates, kept, strict=True)):
                    better = after[index] < best[index]
                    worse = chosen[~better]
                    c.hidden[which][:, worse] = hidden[:, worse]
                    c.states[which][:, worse] = states[:, worse]
                    best[index] = np.where(better, after[index], best[index])

    def plays(self, key: Key) -> bool:
        """Whether a family has a play."""
        return any(p.name == "gap" for p in self.fitters[key].family.parameters)

    def finish(self, candidates: list[Candidate]) -> list[Fitted]:
        """Scores on fitted and withheld windows."""
        found = []
        for key in dict.fromkeys(c.family.key for c in candidates):
            group = [c for c in candidates if c.family.key == key]
            if key in self.observers:
                self.observe(group, self.withheld)
                everything = [np.arange(len(record.starts)) for record in self.records]
                for c in self.leading(group):
                    settle(self.fitters[key], c, everything, self.per_window)
            scores = self.fitters[key].score(group, self.withheld)
            found += [Fitted(c, np.concatenate(c.window_cost), s) for c, s in zip(group, scores, strict=True)]
        return found

    def best_of(
        self,
        options: Options,
        screen: list[np.ndarray],
        keep: tuple[int, ...] = (99, 99, 10, 5),
    ) -> list[Fitted]:
        """Every set of effects from all its starts: screened on a few windows, the best start of each finished on all.

        Args:
            options: sets of effects and the values that each starts from.
            screen: windows for the screening.
            keep: how many sets of effects go on after the screening and after each stage but the last.
        """
        options = self.searched(options)
        candidates = [self.candidate(effects, start) for effects, start in options]
        for c in candidates:
            c.robust = c.family.key[0] != "rigid"
        self.fit(candidates, screen, SCREEN_STEPS)

        def height(c: Candidate) -> float:
            return c.chi_square + c.prior if np.isfinite(c.chi_square) else np.inf

        lowest = min((height(c) for c in candidates), default=0.0)
        best: dict[tuple[str, ...], list[Candidate]] = {}
        for c in sorted(candidates, key=height):
            group = best.setdefault(c.names, [])
            # A start that is hopeless on a few windows stays as it is; the best start of every effect is kept.
            if not group or (c.robust and len(group) < 2 and height(c) < HOPELESS * lowest):
                group.append(c)
        chosen = [c for group in list(best.values())[: keep[0]] for c in group]
        going = chosen
        for c in chosen:
            c.damping = min(c.damping, 1.0)
        for stage, ((size, ratio), most) in enumerate(zip(STAGES, (*keep[1:], 0), strict=True)):
            if stage == 0:
                self.fit(going, self.train, size)
            else:
                self.resume(going, size)
            for c in going:
                if c.robust and stage == 1:
                    c.robust, c.converged = False, False
            lowest = min(height(c) for c in chosen)
            leading = sorted(chosen, key=height)[:most]
            going = [c for c in leading if (not c.converged or c.robust) and height(c) < ratio * lowest]
            if not going:
                break
        plays = [c for c in sorted(chosen, key=height) if c.free.size and self.has_play(c) and not self.imposed]
        for c in plays[:SETTLED]:
            if height(c) < POLISHED * min(height(other) for other in chosen):
                self.polish(c)
        finished: dict[tuple[str, ...], Candidate] = {}
        for c in sorted(chosen, key=height):
            c.robust = c.robust and self.has_play(c)
            finished.setdefault(c.names, c)
        return self.finish(list(finished.values()))

    def searched(self, options: Options) -> Options:
        """Better starts for transmissions: a search in short windows that the windows which fit may lead.

        A play throws a long window off track unless its size is nearly right; in short ones with a robust cost the grid
        of starts finds it. What comes back are the fitted values of the best few starts. A transmission that is there
        already, beside a newcomer, starts from where it stands.
        """
        hard = [option for option in options if option[0][-1].structure == "transmission"]
        if not hard or self.logs is None or self.imposed:
            return options
        if self.short is None:
            window = SHORTER * window_seconds(self.logs)
            records = [
                make_record(log, withhold="all" if np.all(record.withheld) else "none", window=window)
                for log, record in zip(self.logs, self.records, strict=True)
            ]
            records = with_common_noise(records)
            self.short = Search(records, self.nominal, self.effects, self.setting)
        short = self.short
        short.setting = self.setting
        candidates = [short.candidate(effects, start) for effects, start in hard]
        for c in candidates:
            c.robust = True
        few = [chosen[:: max(1, len(chosen) // 24)] for chosen in short.train]
        more = [chosen[:: max(1, len(chosen) // 60)] for chosen in short.train]
        short.fit(candidates, few, 6)
        found: Options = [option for option in options if option[0][-1].structure != "transmission"]
        for names in dict.fromkeys(c.names for c in candidates):
            group = sorted((c for c in candidates if c.names == names), key=lambda c: c.cost)[:3]
            short.fit(group, more, 12)
            found += [(c.effects, c.values()) for c in sorted(group, key=lambda c: c.cost)[:2]]
        return found

    def has_play(self, c: Candidate) -> bool:
        """Whether a play is among the candidate's causes."""
        return any(p.name == "gap" for effect in c.effects for p in effect.parameters)

    def polish(self, c: Candidate) -> None:
        """Bring a play to the noise: better hidden states, another size, a few steps, in turn; the windows that fit
        lead until all do.
        """
        fitter = self.fitters[c.family.key]
        everything = [np.arange(len(record.starts)) for record in self.records]
        best, stalled = np.inf, 0
        for _ in range(ROUNDS):
            worst = max(float(np.max(costs)) for costs in c.window_cost if len(costs)) / self.per_window
            if worst < STUCK and c.converged:
                return
            c.robust = worst >= STUCK
            found = settle(fitter, c, everything, self.per_window)
            if c.robust:
                found |= scan_gap(fitter, c, self.train, self.per_window)
            if not found and c.converged:
                return
            c.converged, c.damping, c.cost = False, min(c.damping, 1.0), np.inf
            fitter.go_on([c], self.train, 4)
            stalled = stalled + 1 if c.cost > 0.98 * best else 0
            best = min(best, c.cost)
            if stalled == 2:
                return

    def refined(self, fitted: Fitted) -> Fitted:
        """The same model in shorter steps, fitted on; what its parameters move by is what a step's length blurs.

        A contact and a spring are simulated in steps of finite length, which biases a fit by more than the noise does.
        """
        c = fitted.candidate
        structure, features = c.family.key
        key = (structure, (*features, FINE))
        if key not in self.fitters:
            runner = Runner(replace(c.family, key=key), self.records, self.tables)
            self.fitters[key], self.observers[key] = Fitter(runner, self.setting), self.observers[c.family.key]
        fitter = self.fitters[key]
        states, hidden = [value.copy() for value in c.states], [value.copy() for value in c.hidden]
        fine = replace(c, family=fitter.family, vector=c.vector.copy(), states=states, hidden=hidden)
        fitter.fit([fine], self.train, REFINED)
        settle(fitter, fine, self.train, self.per_window)
        fine.converged, fine.damping = False, min(fine.damping, 1.0)
        fitter.go_on([fine], self.train, REFINED)
        fine.blur = fine.vector[fine.free] - c.vector[c.free]
        found = self.finish([fine])[0]
        return replace(found, evidence=fitted.evidence) if found.total < LOST * fitted.total else fitted

    def leading(self, group: list[Candidate]) -> list[Candidate]:
        """Those of one family that a search of hidden states may bring to the noise."""
        fitted = self.per_window * sum(len(chosen) for chosen in self.train)
        near = [c for c in group if c.chi_square < NEAR * fitted]
        return sorted(near, key=lambda c: c.chi_square)[:SETTLED]

    def resume(self, candidates: list[Candidate], iterations: int) -> None:
        """More steps on the fitted windows."""
        for key in dict.fromkeys(c.family.key for c in candidates):
            group = [c for c in candidates if c.family.key == key]
            if key in self.observers:
                self.observe(group, self.train)
                for c in self.leading(group):
                    if settle(self.fitters[key], c, self.train, self.per_window):
                        c.converged, c.damping = False, min(c.damping, 1.0)
            self.fitters[key].go_on(group, self.train, iterations)
