"""Attribute: which effects, alone and together, make the simulation agree with the log."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from .effect import Effect, Setting
from .family import Family, Key, Nominal, Runner, double_precision, key_for, make_family
from .fit import Candidate, Fitter, make_candidate
from .observer import Observer
from .record import Record, tables_of

SCREEN = 6  # windows that a start is screened on
SCREEN_STEPS = 5
HOPELESS = 1000.0  # a second start of one effect is not worth finishing at so many times the lowest cost
STAGES = ((3, 100.0), (4, 20.0), (8, 5.0), (12, 2.0))  # steps on all windows, and who goes on after them
Progress = Callable[[str, float], None]


@dataclass
class Fitted:
    """A finished candidate and its scores.

    Attributes:
        candidate: the fit.
        train: chi-square of each fitted window.
        withheld: chi-square of each withheld window.
        evidence: log evidence [1].
    """

    candidate: Candidate
    train: np.ndarray
    withheld: np.ndarray
    evidence: float = -np.inf

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
    """

    records: list[Record]
    nominal: Nominal
    effects: tuple[Effect, ...]
    setting: Setting
    fitters: dict[Key, Fitter] = field(default_factory=dict)
    observers: dict[Key, Observer] = field(default_factory=dict)

    def __post_init__(self) -> None:
        with double_precision():
            self.tables: list[Any] = [tables_of(record) for record in self.records]
        self.train = [np.flatnonzero(~record.withheld) for record in self.records]
        self.withheld = [np.flatnonzero(record.withheld) for record in self.records]
        first = self.records[0]
        self.per_window = first.samples * ((first.velocity is not None) + (first.position is not None))
        self.count = self.per_window * sum(len(record.starts) for record in self.records)

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
                if family.key[0] != "rigid":
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
        """Take the observer's hidden states in every window where they fit better than those at hand."""
        key = candidates[0].family.key
        observer, fitter = self.observers[key], self.fitters[key]
        for which, chosen in enumerate(windows):
            if not len(chosen):
                continue
            vectors = np.concatenate([np.repeat(c.vector[:, None], len(chosen), 1) for c in candidates], 1)
            centers = observer.centers(vectors, which, np.tile(chosen, len(candidates)))
            before = fitter.window_costs(candidates, which, chosen)
            kept = [(c.hidden[which].copy(), c.states[which].copy()) for c in candidates]
            for index, c in enumerate(candidates):
                c.hidden[which][:, chosen] = centers[:, index * len(chosen) : (index + 1) * len(chosen)]
                c.states[which][2:, chosen] = 0.0
            after = fitter.window_costs(candidates, which, chosen)
            for c, (hidden, states), old, new in zip(candidates, kept, before, after, strict=True):
                worse = chosen[~(new < old)]
                c.hidden[which][:, worse] = hidden[:, worse]
                c.states[which][:, worse] = states[:, worse]

    def finish(self, candidates: list[Candidate]) -> list[Fitted]:
        """Scores on fitted and withheld windows."""
        found = []
        for key in dict.fromkeys(c.family.key for c in candidates):
            group = [c for c in candidates if c.family.key == key]
            if key in self.observers:
                self.observe(group, self.withheld)
            scores = self.fitters[key].score(group, self.withheld)
            found += [Fitted(c, np.concatenate(c.window_cost), s) for c, s in zip(group, scores, strict=True)]
        return found

    def best_of(
        self,
        options: list[tuple[tuple[Effect, ...], dict[str, float]]],
        screen: list[np.ndarray],
        keep: tuple[int, ...] = (99, 99, 10, 5),
    ) -> list[Fitted]:
        """Every set of effects from all its starts: screened on a few windows, the best start of each finished on all.

        Args:
            options: sets of effects and the values that each starts from.
            screen: windows for the screening.
            keep: how many sets of effects go on after the screening and after each stage but the last.
        """
        candidates = [self.candidate(effects, start) for effects, start in options]
        self.fit(candidates, screen, SCREEN_STEPS)
        lowest = min((c.cost for c in candidates), default=0.0)
        best: dict[tuple[str, ...], list[Candidate]] = {}
        for c in sorted(candidates, key=lambda c: c.cost):
            group = best.setdefault(c.names, [])
            # A start that is hopeless on a few windows stays as it is; the best start of every effect is kept.
            if not group or (c.family.key[0] != "rigid" and len(group) < 2 and c.cost < HOPELESS * lowest):
                group.append(c)
        chosen = [c for group in list(best.values())[: keep[0]] for c in group]
        steps = 0
        for c in chosen:
            c.damping = min(c.damping, 1.0)
        going = chosen
        for (size, ratio), most in zip(STAGES, (*keep[1:], 0), strict=True):
            if steps == 0:
                self.fit(going, self.train, size)
            else:
                self.resume(going, size)
            steps += size
            lowest = min(c.cost for c in chosen)
            leading = sorted(chosen, key=lambda c: c.cost)[:most]
            going = [c for c in leading if not c.converged and c.cost < ratio * lowest]
            if not going:
                break
        finished: dict[tuple[str, ...], Candidate] = {}
        for c in sorted(chosen, key=lambda c: c.cost):
            finished.setdefault(c.names, c)
        return self.finish(list(finished.values()))

    def resume(self, candidates: list[Candidate], iterations: int) -> None:
        """More steps on the fitted windows."""
        for key in dict.fromkeys(c.family.key for c in candidates):
            group = [c for c in candidates if c.family.key == key]
            if key in self.observers:
                self.observe(group, self.train)
            self.fitters[key].go_on(group, self.train, iterations)
