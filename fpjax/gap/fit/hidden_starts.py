"""Hidden starts: what no sensor sees (bristles, the load behind a spring) at the start of each window."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from ...logs.arrays import Values
from ..data.record import Record
from ..simulate.hidden_states import HiddenStates
from .candidate import Candidate
from .least_squares import Fitter


def estimate_hidden_states(
    fitter: Fitter, hidden_states: HiddenStates, records: Sequence[Record], candidates: Sequence[Candidate],
    windows: Sequence[Values], *, afresh: bool = False,
) -> None:  # fmt: skip
    """Estimate the hidden states at the windows' starts, and keep in each window the estimate that fits best.

    Tried are the present one, the estimate from the past, the end of the window before, and either face of a
    backlash; each beside the rate and the angle as they are fitted, and where asked for as the readings have them. (A
    window that fits its speed to the wrong phase of a shaft's vibration does not find out by itself; its misfit then
    raised the level, and with it every other window's.)

    Args:
        fitter: of the candidates' family.
        hidden_states: likewise.
        records: the logs.
        candidates: of one family; their hidden states are changed.
        windows: indices of the windows, one array a record.
        afresh: whether the rate and the angle as the readings have them are tried too.
    """
    backlash = any(p.name == "gap" for c in candidates for e in c.effects for p in e.parameters)
    for which, chosen in enumerate(windows):
        if not len(chosen):
            continue
        count = len(chosen)
        vectors = np.concatenate([np.repeat(c.vector[:, None], count, 1) for c in candidates], 1)
        centers = hidden_states.centers(vectors, which, np.tile(chosen, len(candidates)))
        options = [[centers[:, i * count : (i + 1) * count] for i in range(len(candidates))]]
        options.append(_continued(fitter, records[which], candidates, which, chosen))
        if backlash:
            halves = [0.5 * c.values()["gap"] for c in candidates]
            for side in (1.0, -1.0):
                options.append([np.stack([np.full(count, side * h), np.zeros(count)]) for h in halves])
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
                after = next(costs)
                better = chosen[after < best[i]]
                c.hidden[which][:, better] = trial.hidden[which][:, better]
                c.states[which][:, better] = trial.states[which][:, better]
                best[i] = np.minimum(best[i], after)


def _started(c: Candidate, which: int, chosen: Values, at: Values, first: int) -> Candidate:
    """A copy of a candidate whose chosen windows start from hidden states of shape (2, windows).

    States from the index `first` on start from their estimates again: 2 the hidden ones, 0 the rate and the angle too.
    """
    hidden, states = list(c.hidden), list(c.states)
    hidden[which], states[which] = c.hidden[which].copy(), c.states[which].copy()
    hidden[which][:, chosen] = at
    states[which][first:, chosen] = 0.0
    return replace(c, hidden=hidden, states=states)


def _continued(
    fitter: Fitter, record: Record, candidates: Sequence[Candidate], which: int, chosen: Values
) -> list[Values]:
    """Hidden states at the end of the window before, (2, windows) of each candidate; unchanged where none is before."""
    found = [c.hidden[which][:, chosen].copy() for c in candidates]
    before = chosen - 1
    follows = (before >= 0) & (record.starts[chosen] - record.starts[np.maximum(before, 0)] == record.samples)
    if np.any(follows):
        for own, ends in zip(found, fitter.ends(candidates, which, before[follows]), strict=True):
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
