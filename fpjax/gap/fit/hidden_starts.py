"""Hidden starts: what no sensor sees (bristles, the load behind a spring) at the start of each window."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from ...logs.arrays import Values
from ..data.record import Record
from ..data.setting import Setting
from ..effects.shaft import stiffness_of
from ..simulate.hidden_states import HiddenStates
from .candidate import Candidate, held
from .imposed_motion import MOVING
from .least_squares import Fitter

FACES = (1.0, -1.0)  # of a backlash: places of the load in its gap, in halves of it from its middle [1]
BETWEEN = (-0.75, -0.5, -0.25, 0.0, 0.25, 0.5, 0.75)
SHAFT = {"frequency", "load_share", "friction_share", "viscous_share"}  # what a twist is found with


def estimate_hidden_states(
    fitter: Fitter, hidden_states: HiddenStates, records: Sequence[Record], candidates: Sequence[Candidate],
    windows: Sequence[Values], *, afresh: bool = False,
) -> None:  # fmt: skip
    """Estimate the hidden states at the windows' starts, and keep in each window the estimate that fits best.

    Tried are the present one, the estimate from the past, the end of the window before, either face of a backlash, and
    where no window is before, places between them (many logs begin at rest, the load anywhere in its gap) and the twist
    of a shaft that carries its load (others begin in motion); each beside the rate and the angle as they are fitted,
    and where asked for as the readings have them. (A window that fits its speed to the wrong phase of a shaft's
    vibration does not find out by itself; its misfit then raised the level, and with it every other window's.)

    Args:
        fitter: of the candidates' family.
        hidden_states: likewise.
        records: the logs.
        candidates: of one family; their hidden states are changed.
        windows: indices of the windows, one array a record.
        afresh: whether the rate and the angle as the readings have them are tried too.
    """
    for which, chosen in enumerate(windows):
        for some, options in _options(fitter, hidden_states, records[which], candidates, which, chosen):
            best = _costs(fitter, candidates, which, some)
            trials = [
                [_started(c, which, some, at, first) for c, at in zip(candidates, one, strict=True)]
                for one in options
                for first in ((0, 2) if afresh else (2,))
            ]
            _keep_best(fitter, candidates, trials, which, some, best)


def fit_hidden_states(
    fitter: Fitter, hidden_states: HiddenStates, records: Sequence[Record], candidates: Sequence[Candidate],
    windows: Sequence[Values], steps: int,
) -> None:  # fmt: skip
    """Fit the start states of windows alone, and keep in each window the fit that is best, or the states as they are.

    Fitted is on from the present states, and from each of the hidden states that `estimate_hidden_states` tries beside
    the rate and the angle as they are. (Which of them a fit ends best from is not the one that fits best before it: two
    windows of a right backlash cost 400 nats each.)

    Args:
        fitter: of the candidates' family.
        hidden_states: likewise.
        records: the logs.
        candidates: of one family; their start states are changed, their parameters are not.
        windows: indices of the windows, one array a record.
        steps: of each fit, at most.
    """
    for which, chosen in enumerate(windows):
        for some, options in _options(fitter, hidden_states, records[which], candidates, which, chosen):
            best = _costs(fitter, candidates, which, some)
            trials = [[held(c) for c in candidates]] + [
                [_started(held(c), which, some, at, 2) for c, at in zip(candidates, one, strict=True)]
                for one in options
            ]
            for one in trials[1:]:
                # A window that diverges from where it starts would hold up all others, which share its steps.
                for c, trial, cost in zip(candidates, one, _costs(fitter, one, which, some), strict=True):
                    lost = some[~np.isfinite(cost)]
                    trial.hidden[which][:, lost] = c.hidden[which][:, lost]
                    trial.states[which][:, lost] = c.states[which][:, lost]
            alone = [some if i == which else np.zeros(0, int) for i in range(len(windows))]
            fitter.go_on([trial for one in trials for trial in one], alone, steps, white=False, adapt=False)
            _keep_best(fitter, candidates, trials, which, some, best)


def _options(
    fitter: Fitter, hidden_states: HiddenStates, record: Record, candidates: Sequence[Candidate], which: int,
    chosen: Values,
) -> list[tuple[Values, list[list[Values]]]]:  # fmt: skip
    """(windows, what their hidden states may be: of each option (2, windows) of each candidate) of a record."""
    if not len(chosen):
        return []
    count = len(chosen)
    vectors = np.concatenate([np.repeat(c.vector[:, None], count, 1) for c in candidates], 1)
    centers = hidden_states.centers(vectors, which, np.tile(chosen, len(candidates)))
    follows = _follows(record, chosen)
    options = [
        [centers[:, i * count : (i + 1) * count] for i in range(len(candidates))],
        _continued(fitter, candidates, which, chosen, follows),
    ]
    clearance = any(p.name == "gap" for c in candidates for e in c.effects for p in e.parameters)
    if clearance:
        options += [_resting(candidates, place, count) for place in FACES]
    first, alone = chosen[~follows], []
    if len(first) and all(c.values().keys() >= SHAFT for c in candidates):
        alone.append([_wound_up(c.values(), fitter.setting, record, first) for c in candidates])
    if len(first) and clearance:
        alone += [_resting(candidates, place, len(first)) for place in BETWEEN]
    return [(chosen, options), *([(first, alone)] if alone else [])]


def _wound_up(values: dict[str, float], setting: Setting, record: Record, windows: Values) -> Values:
    """Twist [rad] and relative speed [rad/s], (2, windows), of a shaft that carries what its load's motion asks for."""
    rows = record.starts[windows]
    speed = record.speed[rows]
    rubbing = values["friction_share"] * values["coulomb"] * np.tanh(speed / (MOVING * setting.speed))
    rubbing = rubbing + values["viscous_share"] * values["viscous"] * speed
    torque = values["load_share"] * values["inertia"] * record.acceleration[rows] + rubbing
    twist = torque / float(stiffness_of(values)) + 0.5 * values.get("gap", 0.0) * np.sign(torque)
    return np.stack([twist, np.zeros(len(rows))])


def _resting(candidates: Sequence[Candidate], place: float, count: int) -> list[Values]:
    """Hidden states of windows that begin with the load at a place in its gap, moving with the motor."""
    halves = [0.5 * c.values()["gap"] for c in candidates]
    return [np.stack([np.full(count, place * half), np.zeros(count)]) for half in halves]


def _keep_best(
    fitter: Fitter, candidates: Sequence[Candidate], trials: Sequence[Sequence[Candidate]], which: int, chosen: Values,
    best: list[Values],
) -> None:  # fmt: skip
    """Give each window of the candidates the start states of the trial that fits it best; `best`: the present costs."""
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
