"""Settle: other hidden states for the windows that do not fit, where one wrong state throws a whole window off track.

What no sensor sees (the side of a play, the speed of a load in flight, the load on the bristles) comes from the
observer at first, from measured motion that is smoothed. Two better sources: the end of the window before, once that
fits, and a search in the window itself.
"""

from dataclasses import replace

import numpy as np

from .fit import Candidate, Fitter

BAD = 1.5  # times the median window's chi-square, and times the noise
TRIED = 4  # options of a window that are finished
STEPS = 3
FEW = 8  # so few windows are searched more finely
FACTORS = (0.5, 0.65, 0.76, 0.83, 0.88, 0.92, 0.95, 0.97, 0.982, 0.99, 0.995)  # of the play, and their inverses
CONTINUED = 3  # times that the end of a window is passed on to the next


def settle(fitter: Fitter, candidate: Candidate, windows: list[np.ndarray], per_window: int) -> bool:
    """Better hidden states for windows that do not fit, in place; whether any was found.

    Args:
        fitter: of the candidate's family.
        candidate: with its parameters fixed meanwhile.
        windows: indices, one array a record.
        per_window: residuals in a window.
    """
    better = False
    for which, chosen in enumerate(windows):
        if not len(chosen):
            continue
        for _ in range(CONTINUED):
            gained = _continue(fitter, candidate, which, chosen, per_window)
            better |= gained
            if not gained:
                break
        better |= _search(fitter, candidate, which, chosen, per_window)
    return better


def scan_gap(fitter: Fitter, candidate: Candidate, windows: list[np.ndarray], per_window: int) -> bool:
    """Another size of the play, all else as it is, in place; whether one fits better.

    Only windows in which the play is crossed tell its size, and a wrong size throws all of them off track: what a
    descent cannot find, a scan does.
    """
    place = fitter.family.index("gap")
    size = float(candidate.vector[place])
    if size <= 0.0 or place not in candidate.free:
        return False
    trials = []
    for factor in (1.0, *FACTORS, *(1.0 / factor for factor in FACTORS)):
        trial = candidate
        for which, chosen in enumerate(windows):
            twist, relative = candidate.hidden[which][:, chosen] + candidate.states[which][2:, chosen]
            grown = 0.5 * size * (factor - 1.0) * np.clip(2.0 * twist / size, -1.0, 1.0)
            trial = _with_hidden(trial, which, chosen, np.stack([twist + grown, relative]))
        trial.vector = candidate.vector.copy()
        trial.vector[place] = factor * size
        trial.robust = True
        trials.append(trial)
    fitter.fit(trials, windows, STEPS)
    best = min(trials, key=lambda trial: trial.cost)
    low, high = (float(edge[list(candidate.free).index(place)]) for edge in (candidate.low, candidate.high))
    if not best.cost < trials[0].cost - 1.0 or not low < best.vector[place] < high:
        return False
    candidate.vector, candidate.hidden, candidate.states = best.vector, best.hidden, best.states
    return True


def bad_windows(costs: np.ndarray, per_window: int) -> np.ndarray:
    """Places of windows that fit worse than the rest and than noise."""
    return np.flatnonzero(costs > BAD * max(float(np.median(costs)), per_window))


def _continue(fitter: Fitter, candidate: Candidate, which: int, chosen: np.ndarray, per_window: int) -> bool:
    costs = fitter.window_costs([candidate], which, chosen)[0]
    bad = chosen[bad_windows(costs, per_window)]
    bad = bad[np.isin(bad - 1, chosen)]
    if not len(bad):
        return False
    return _adopt(fitter, candidate, which, bad, [fitter.ends(candidate, which, bad - 1)])


def _search(fitter: Fitter, candidate: Candidate, which: int, chosen: np.ndarray, per_window: int) -> bool:
    costs = fitter.window_costs([candidate], which, chosen)[0]
    bad = chosen[bad_windows(costs, per_window)]
    if not len(bad):
        return False
    fine = len(bad) <= FEW
    options = [np.repeat(np.array(option)[:, None], len(bad), 1) for option in _grid(fitter, candidate, fine)]
    trials = [_with_hidden(candidate, which, bad, option) for option in options]
    scores = np.stack(fitter.window_costs(trials, which, bad))
    order = np.argsort(scores, axis=0)[: TRIED * (2 if fine else 1)]
    table = np.stack(options)  # (options, 2, windows)
    columns = np.arange(len(bad))
    return _adopt(fitter, candidate, which, bad, [table[row, :, columns].T for row in order])


def _grid(fitter: Fitter, candidate: Candidate, fine: bool) -> list[tuple[float, float]]:
    if fitter.family.key[0] == "bristles":
        return [(share, 0.0) for share in (-1.0, -0.6, -0.2, 0.2, 0.6, 1.0)]
    values, speed = candidate.values(), fitter.setting.speed
    press = fitter.setting.friction * values["friction_share"] / values["stiffness"]
    half = 0.5 * values.get("gap", 0.0)
    inside = np.linspace(-1.0, 1.0, 9 if fine else 3)[1:-1] * half if half > 0.0 else np.zeros(1)
    places = [half + press, *inside, -half - press]
    rates = [0.02, 0.05, 0.1, 0.2, 0.4] if fine else [0.05, 0.2]
    return [(place, rate * speed) for place in places for rate in [0.0, *rates, *(-rate for rate in rates)]]


def _with_hidden(candidate: Candidate, which: int, chosen: np.ndarray, option: np.ndarray) -> Candidate:
    """A copy whose parameters are fixed and whose windows start from other hidden states."""
    hidden = [value.copy() for value in candidate.hidden]
    states = [value.copy() for value in candidate.states]
    hidden[which][:, chosen] = option
    states[which][2:, chosen] = 0.0
    nothing = np.zeros(0)
    return replace(
        candidate, free=np.zeros(0, int), low=nothing, high=nothing, center=nothing, weight=nothing, scale=nothing,
        hidden=hidden, states=states, converged=False, robust=False, damping=1.0, cost=np.inf,
    )  # fmt: skip


def _adopt(fitter: Fitter, candidate: Candidate, which: int, chosen: np.ndarray, options: list[np.ndarray]) -> bool:
    """Finish the start values from each option and keep, window by window, what fits best."""
    trials = [_with_hidden(candidate, which, chosen, option) for option in options]
    windows = [chosen if index == which else np.zeros(0, int) for index in range(len(candidate.states))]
    fitter.fit(trials, windows, STEPS)
    best = fitter.window_costs([candidate], which, chosen)[0]
    found = False
    for trial, costs in zip(trials, fitter.window_costs(trials, which, chosen), strict=True):
        better = costs < best - 1.0
        places = chosen[better]
        candidate.hidden[which][:, places] = trial.hidden[which][:, places]
        candidate.states[which][:, places] = trial.states[which][:, places]
        best = np.where(better, costs, best)
        found |= bool(np.any(better))
    return found
