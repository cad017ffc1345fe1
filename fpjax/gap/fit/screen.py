"""Screen: a few steps of every start on a few windows, which of them are worth more, and what these windows hide."""

from collections.abc import Callable, Mapping, Sequence
from typing import Protocol, runtime_checkable

import numpy as np

from ...logs.arrays import Values
from ..effects.effect import Effect
from ..effects.parameters import AMPLITUDES, SHAPES
from ..simulate.family import Key
from .candidate import NOMINAL, Candidate, Start
from .least_squares import Fitter
from .measure import Measure
from .modes import Modes

WINDOWS = 6
STEPS = 3
# Beside fitted causes the first step tells much already: after it the better half of each set's starts go on, of so
# many times the sets that will be left after screening [1]. (Those of one cause alone still change places after it.)
SETS = 1.5
MODES = (10, 30)  # the lowest ones of a window, to which a new shaft is fitted before all
COARSE_STEPS = 6  # on each of these
LEAST = 4  # starts of a set that go on from them to more
COARSE = 0.3  # share of the screening's run time that this takes [1]; for the progress display alone
SCREENED = 0.45  # share of an exploration's run time that is over then [1]; for the progress display alone
SMALL = 0.1  # of an effect's own start, with which it begins beside a fit whose valley must not be left at once [1]
HEAVY = 3.0  # run time of a candidate with a transmission over that of a rigid one


@runtime_checkable
class Screening(Protocol):
    """The part of `fpjax.gap.fit.search.Search` that screening uses; as there."""

    train: list[Values]
    exact: Candidate
    modes: Modes
    measure: Measure
    fitters: dict[Key, Fitter]
    tick: Callable[[float], None]

    def screening(self) -> list[Values]:
        """The few fitted windows on which starts are screened, one array a record."""
        ...

    def candidate(self, start: Start) -> Candidate:
        """A candidate at its start."""
        ...

    def go_on(
        self, candidates: Sequence[Candidate], windows: Sequence[Values], steps: int, *, white: bool, modes: int = 0
    ) -> None:
        """More steps for candidates of any families."""
        ...


def few_windows(search: Screening) -> list[Values]:
    """A few fitted windows, one array a record: spread evenly, and those where the nominal model is worst."""
    found: list[Values] = []
    fitter = search.fitters[search.exact.family.key]
    for which, train in enumerate(search.train):
        if not len(train):
            found.append(train)
            continue
        few = max(2, WINDOWS // len(search.train))
        index = np.unique(np.linspace(0, len(train) - 1, max(few - 3, 1)).round().astype(int))
        plain = search.modes.plain(fitter.coefficients([search.exact], which, train)[0])
        noise = fitter.noise[which][train]
        worst = np.argsort(-np.sum((plain * search.measure.filter(noise)) ** 2, axis=1))
        extra = [i for i in worst if i not in index][: few - len(index)]
        found.append(train[np.unique(np.concatenate([index, np.array(extra, int)]))])
    return found


def screened(
    search: Screening, candidates: list[Candidate], most: int, fresh: Sequence[Candidate] = (), *, white: bool
) -> list[Candidate]:
    """One step of every candidate on a few windows, then the other steps of those that are still worth them.

    Args:
        search: that they belong to.
        candidates: at their starts.
        most: number of sets that will be left, beside fitted causes; 0 otherwise.
        fresh: those of them with a shaft that no fit has found yet.
        white: one level of the missing torque for all octaves.

    Returns:
        Those that were worth all steps.
    """
    begun = {id(c): _own_start(c) for c in candidates}
    left = {id(c) for c in _from_coarse(search, fresh, begun, white=white)}
    candidates = [c for c in candidates if id(c) in left or not any(c is other for other in fresh)]
    starts = [begun[id(c)] for c in candidates]
    _steps(search, candidates, 1, (COARSE * SCREENED, 0.5 * SCREENED), white=white)
    # Of one start beside the nominal numbers as given and beside fitted ones the better goes on.
    best = {start: c for c, start in sorted(zip(candidates, starts, strict=True), key=lambda pair: -pair[0].cost)}
    candidates = sorted(best.values(), key=lambda c: c.cost)
    if most:
        sets: dict[tuple[str, ...], list[Candidate]] = {}
        for c in candidates:
            sets.setdefault(c.names, []).append(c)
        leading = list(sets.values())[: int(SETS * most)]
        candidates = [c for group in leading for c in group[: -(-len(group) // 2)]]
    _steps(search, candidates, STEPS - 1, (0.5 * SCREENED, SCREENED), white=white)
    return candidates


def from_bases(search: Screening, candidates: Sequence[Candidate], begun: Mapping[int, Start]) -> list[Candidate]:
    """The same causes beside a shaft once more, each at the fit that it is tried beside.

    A few windows do not hold all that such a fit has learned, and steps on them may leave its valley: beside a backlash
    every further cause could end behind the backlash alone. (One rigid mass comes back in the next steps.) What is
    new begins small, so that the valley is not left at once, but not at none, where its shape has no gradient.

    Args:
        search: that they belong to.
        candidates: that go on from the few windows; they stay as they are.
        begun: all starts, by `id` of the candidates that began there.
    """
    bases: dict[tuple[tuple[Effect, ...], frozenset[str]], dict[int, Candidate]] = {}
    for start in begun.values():
        if start.like is not None and start.like.family.key[0] == "transmission":
            bases.setdefault((start.effects, frozenset(start.wide)), {})[id(start.like)] = start.like
    found: dict[tuple[object, ...], Start] = {}
    for c in candidates:
        own = begun[id(c)].values
        for base in bases.get((c.effects, c.wide), {}).values():
            new = {p.name for e in c.effects if e not in base.effects for p in e.parameters}
            begins = {name: SMALL * own[name] for name in new & AMPLITUDES & own.keys()}
            begins |= {name: own[name] for name in new & SHAPES & own.keys()}
            start = Start(c.effects, tuple(c.wide), base.known_to(c) | begins, base)
            found.setdefault((c.names, id(base), *sorted(begins.items())), start)
    return [search.candidate(start) for start in found.values()]


def _own_start(c: Candidate) -> tuple[object, ...]:
    """What tells starts apart beside the nominal numbers: the causes, and their own parameters' values."""
    values, own = c.values(), [p.name for effect in c.effects for p in (*effect.parameters, *effect.fixed)]
    return (c.names, *(values[name] for name in own if name not in NOMINAL))


def _from_coarse(
    search: Screening, candidates: Sequence[Candidate], begun: Mapping[int, tuple[object, ...]], *, white: bool
) -> list[Candidate]:
    """The better ones of some candidates with a shaft, fitted to the lowest modes first and then to more.

    The motion of a load depends on every contact and every swing before. Where its phase is off by half a period, or an
    impact comes a few milliseconds early, no step of a fit improves it: starts had to be right to a few per cent. The
    lowest frequencies hardly know phases of the higher ones; each fit begins where that on fewer modes ended (Bunks and
    others, "Multiscale seismic waveform inversion", 1995). From starts of a backlash that were off by 15 % 4 of 24 fits
    came within 30 nats of the truth on all modes at once, 9 so.

    Args:
        search: that they belong to.
        candidates: at their starts; they are changed in place.
        begun: their own starts, by `id`.
        white: one level of the missing torque for all octaves.
    """
    left = list(candidates)
    for place, modes in enumerate(MODES):
        _afresh(left)
        share = COARSE * SCREENED / len(MODES)
        _steps(search, left, COARSE_STEPS, (place * share, (place + 1) * share), white=white, modes=modes)
        left = _better_half(left, begun)
    _afresh(left)
    return left


def _afresh(candidates: Sequence[Candidate]) -> None:
    """Make candidates ready for other modes: level and damping are found anew."""
    for c in candidates:
        c.converged, c.damping, c.level = False, min(c.damping, 1.0), np.zeros(0)


def _better_half(candidates: Sequence[Candidate], begun: Mapping[int, tuple[object, ...]]) -> list[Candidate]:
    """Of each start the better candidate, of each set of causes the better half of these, `LEAST` at least."""
    best: dict[tuple[object, ...], Candidate] = {}
    for c in sorted(candidates, key=lambda c: c.cost):
        best.setdefault(begun[id(c)], c)
    sets: dict[tuple[str, ...], list[Candidate]] = {}
    for c in best.values():
        sets.setdefault(c.names, []).append(c)
    return [c for group in sets.values() for c in group[: max(LEAST, -(-len(group) // 2))]]


def _steps(
    search: Screening, candidates: Sequence[Candidate], steps: int, ticks: tuple[float, float], *, white: bool,
    modes: int = 0,
) -> None:  # fmt: skip
    """Steps on the few windows, family by family; `ticks` are the shares of the run time before and after [1]."""
    weights = dict.fromkeys((c.family.key for c in candidates), 0.0)
    for c in candidates:
        weights[c.family.key] += HEAVY if c.family.key[0] == "transmission" else 1.0
    done = 0.0
    for key, weight in weights.items():
        group = [c for c in candidates if c.family.key == key]
        search.go_on(group, search.screening(), steps, white=white, modes=modes)
        done += weight / sum(weights.values())
        search.tick(ticks[0] + (ticks[1] - ticks[0]) * done)
