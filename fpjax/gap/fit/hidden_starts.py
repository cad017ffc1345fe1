"""Hidden starts: what no sensor sees (bristles, the load behind a spring) at the start of each window."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from ...logs.arrays import Values
from ..data.record import Record
from ..simulate.hidden_states import HiddenStates
from .candidate import Candidate
from .least_squares import Fitter

FACES = (1.0, -1.0)  # of a backlash: places of the load in its gap, in halves of it from its middle [1]
BETWEEN = (-0.75, -0.5, -0.25, 0.0, 0.25, 0.5, 0.75)


def estimate_hidden_states(
    fitter: Fitter, hidden_states: HiddenStates, records: Sequence[Record], candidates: Sequence[Candidate],
    windows: Sequence[Values], *, afresh: bool = False,
) -> None:  # fmt: skip
    """Estimate the hidden states at the windows' starts, and keep in each window the estimate that fits best.

    Tried are the present one, the estimate from the past, the end of the window before, either face of a backlash, and
    where no window is before, places between them (a log begins at rest, with the load anywhere in its gap); each
    beside the rate and the angle as they are fitted, and where asked for as the readings have them. (A window that
    fits its speed to the wrong phase of a shaft's vibration does not find out by itself; its misfit then raised the
    level, and with it every other window's.)

    Args:
        fitter: of the candidates' family.
        hidden_states: likewise.
        records: the logs.
        candidates: of one family; their hidden states are changed.
        windows: indices of the windows, one array a record.
        afresh: whether the rate and the angle as the readings have them are tried too.
    """
    for which, chosen in enumerate(windows):
        if not len(chosen):
            continue
        options = _options(fitter, hidden_states, records[which], candidates, which, chosen)
        best = _costs(fitter, candidates, which, chosen)
        trials = [
            [_started(c, which, chosen, at, first) for c, at in zip(candidates, one, strict=True)]
            for one in options
            for first in ((0, 2) if afresh else (2,))
        ]
        # All of them in one run: alone most have fewer lanes than the loop runs at once.
        costs = iter(_costs(fitter, [trial for one in trials for trial in one], which, chosen))
        for one in trials:
            for i, (c, trial) in enumerate(zip(candidates, one, strict=True)):
                best[i] = _kept(c, trial, which, chosen, best[i], next(costs))


def fit_hidden_states(
    fitter: Fitter, hidden_states: HiddenStates, records: Sequence[Record], candidates: Sequence[Candidate],
    windows: Sequence[Values], steps: int,
) -> None:  # fmt: skip
    """Fit the start states of windows alone, and keep in each window the fit that is best, or the states as they are.

    Fitted is from each of the hidden states that `estimate_hidden_states` tries. (Which of them a fit ends best from
    is not the one that fits best before it: two windows of a right backlash cost 400 nats each.)

    Args:
        fitter: of the candidates' family.
        hidden_states: likewise.
        records: the logs.
        candidates: of one family, without free parameters; their start states are changed.
        windows: indices of the windows, one array a record.
        steps: of each fit, at most.
    """
    for which, chosen in enumerate(windows):
        if not len(chosen):
            continue
        alone = [chosen if i == which else np.zeros(0, int) for i in range(len(windows))]
        options = _options(fitter, hidden_states, records[which], candidates, which, chosen)
        trials = [[_started(c, which, chosen, at, 2) for c, at in zip(candidates, one, strict=True)] for one in options]
        every = [trial for one in trials for trial in one]
        fitter.go_on(every, alone, steps, white=False, adapt=False)
        best = _costs(fitter, candidates, which, chosen)
        costs = iter(_costs(fitter, every, which, chosen))
        for one in trials:
            for i, (c, trial) in enumerate(zip(candidates, one, strict=True)):
                best[i] = _kept(c, trial, which, chosen, best[i], next(costs))


def _options(
    fitter: Fitter, hidden_states: HiddenStates, record: Record, candidates: Sequence[Candidate], which: int,
    chosen: Values,
) -> list[list[Values]]:  # fmt: skip
    """What the hidden states of windows of a record may be, (2, windows) of each candidate."""
    count = len(chosen)
    vectors = np.concatenate([np.repeat(c.vector[:, None], count, 1) for c in candidates], 1)
    centers = hidden_states.centers(vectors, which, np.tile(chosen, len(candidates)))
    follows = _follows(record, chosen)
    options = [
        [centers[:, i * count : (i + 1) * count] for i in range(len(candidates))],
        _continued(fitter, candidates, which, chosen, follows),
    ]
    if any(p.name == "gap" for c in candidates for e in c.effects for p in e.parameters):
        between = BETWEEN if not np.all(follows) else ()
        for place in (*FACES, *between):
            rests = [np.stack([np.full(count, 0.5 * place * c.values()["gap"]), np.zeros(count)]) for c in candidates]
            if place in between:
                now = [c.hidden[which][:, chosen] for c in candidates]
                rests = [np.where(follows, own, at) for own, at in zip(now, rests, strict=True)]
            options.append(rests)
    return options


def _kept(c: Candidate, trial: Candidate, which: int, chosen: Values, before: Values, after: Values) -> Values:
    """The lower costs (windows,), the candidate's start states those of the trial where its are the lower ones."""
    better = chosen[after < before]
    c.hidden[which][:, better] = trial.hidden[which][:, better]
    c.states[which][:, better] = trial.states[which][:, better]
    return np.minimum(before, after)


def _started(c: Candidate, which: int, chosen: Values, at: Values, first: int) -> Candidate:
    """A copy of a candidate whose chosen windows start from hidden states of shape (2, windows).

    States from the index `first` on start from their estimates again: 2 the hidden ones, 0 the rate and the angle too.
    """
    hidden, states = list(c.hidden), list(c.states)
    hidden[which], states[which] = c.hidden[which].copy(), c.states[which].copy()
    hidden[which][:, chosen] = at
    states[which][first:, chosen] = 0.0
    return replace(c, hidden=hidden, states=states)


def _follows(record: Record, chosen: Values) -> Values:
    """Whether the window before each of them ends where it starts, shape (windows,)."""
    before = chosen - 1
    return (before >= 0) & (record.starts[chosen] - record.starts[np.maximum(before, 0)] == record.samples)


def _continued(
    fitter: Fitter, candidates: Sequence[Candidate], which: int, chosen: Values, follows: Values
) -> list[Values]:
    """Hidden states at the end of the window before, (2, windows) of each candidate; unchanged where none is before."""
    found = [c.hidden[which][:, chosen].copy() for c in candidates]
    if np.any(follows):
        for own, ends in zip(found, fitter.ends(candidates, which, chosen[follows] - 1), strict=True):
            own[:, follows] = ends
    return [np.where(np.isfinite(own), own, 0.0) for own in found]


def _costs(fitter: Fitter, candidates: Sequence[Candidate], which: int, chosen: Values) -> list[Values]:
    """Costs of windows at the candidates' present values, (windows,) each; one without a level is given one."""
    found = []
    for c, out in zip(candidates, fitter.coefficients(candidates, which, chosen), strict=True):
        if not len(c.level):
            c.level, c.white = fitter.best_level([(which, chosen, out)], white=True), True
        cost = fitter.window_costs(c, which, chosen, out) + fitter.state_prior(c, which, chosen)
        found.append(np.where(np.isfinite(cost), cost, np.inf))
    return found
