"""Score: evidence and missing torque of a finished candidate, on the fitted and on the withheld windows."""

from collections.abc import Sequence
from dataclasses import replace
from typing import Protocol, runtime_checkable

import numpy as np

from ...logs.arrays import Values
from ..data.record import Record
from ..simulate.family import Key
from ..simulate.hidden_states import HiddenStates
from .candidate import Candidate, Fit, held
from .hidden_starts import fit_hidden_states
from .least_squares import Fitter, Linear
from .measure import Measure
from .modes import Modes

# Steps for the start values of withheld windows, in two rounds, each from all the hidden states that they may have;
# together where there are none. (Three were too few: an exact model could lose 170,000 nats on one withheld window.)
PROPER = (4, 8)


@runtime_checkable
class Scoring(Protocol):
    """The part of `fpjax.gap.fit.search.Search` that scoring uses; attributes as there."""

    records: list[Record]
    train: list[Values]
    withheld: list[Values]
    modes: Modes
    fitters: dict[Key, Fitter]
    hidden_states: dict[Key, HiddenStates]
    measure: Measure
    moves: Values
    real_noise: float


def scores(search: Scoring, candidates: Sequence[Candidate]) -> list[Fit]:
    """The evidence of each candidate, its levels, and its missing torque in every window.

    Args:
        search: that they belong to.
        candidates: fitted on the fitted windows; their levels and the start values of the withheld windows are set
            here. Those of one family run side by side: the withheld windows of one would leave most lanes empty.
    """
    found: dict[int, Fit] = {}
    # By the faces of a backlash too: `fit_hidden_states` tries them for all of its candidates or for none.
    kinds = [(c.family.key, any(p.name == "gap" for e in c.effects for p in e.parameters)) for c in candidates]
    for kind in dict.fromkeys(kinds):
        some = [c for c, own in zip(candidates, kinds, strict=True) if own == kind]
        found |= {id(c): fit for c, fit in zip(some, _scores(search, some), strict=True)}
    return [found[id(c)] for c in candidates]


def _scores(search: Scoring, candidates: Sequence[Candidate]) -> list[Fit]:
    """`scores` of candidates of one family."""
    fitter = search.fitters[candidates[0].family.key]
    every = fitter.linearise(candidates, search.train)
    still = []
    for c, parts in zip(candidates, every, strict=True):
        c.level, c.white = fitter.best_level([(p.which, p.windows, p.c) for p in parts], white=False), False
        still.append(held(c))  # on withheld windows the start values alone are fitted
    left_out, fits, judge = _withheld_parts(search, still, fitter), [], fitter.judging
    for c, fixed, parts, withheld in zip(candidates, still, every, left_out, strict=True):
        # The level is not a parameter of the machine, so that all windows may determine it. If the fitted ones alone
        # set it to zero, a small missing torque in a withheld window would have to be sensor noise.
        everywhere = [(p.which, p.windows, p.c) for p in (*parts, *withheld)]
        c.level, level = fitter.best_level(everywhere, white=False), judge.best_level(everywhere, white=False)
        evidence = _log_evidence(search, replace(c, level=level), judge, parts)
        if withheld:
            evidence += _log_evidence(search, replace(fixed, level=level), judge, withheld)
        c.normal = fitter.reduced(c, parts, np.zeros(1))[0][0]
        c.states, c.hidden = fixed.states, fixed.hidden
        missing, moving = _missing(search, c, [*parts, *withheld], fitter)
        seen = search.measure.filter(np.ones(1))[0]
        drowned = 0.5 * sum(
            float(np.sum(judge.modes.cost_in(search.measure.drowned, level, judge.noise[which][chosen], found)))
            for which, chosen, found in everywhere
        )
        level_of_all = search.modes.mean_level(c.level, seen)
        fits.append(Fit(c, evidence, evidence + drowned, missing, level_of_all, moving))
    return fits


def _withheld_parts(search: Scoring, still: Sequence[Candidate], fitter: Fitter) -> list[list[Linear]]:
    """The withheld windows, linearised about each candidate after a fit of their start values."""
    if not any(len(chosen) for chosen in search.withheld):
        return [[] for _ in still]

    for fixed in still:
        for s, chosen in zip(fixed.states, search.withheld, strict=True):
            s[:, chosen] = 0.0
    own = search.hidden_states.get(still[0].family.key)
    if own is None:
        fitter.go_on(still, search.withheld, sum(PROPER), white=False, adapt=False)
    else:
        for steps in PROPER:  # twice: a window may follow another withheld one, whose end means nothing before
            fit_hidden_states(fitter, own, search.records, still, search.withheld, steps)
    return fitter.linearise(still, search.withheld)


def _log_evidence(search: Scoring, c: Candidate, fitter: Fitter, parts: list[Linear]) -> float:
    """Log evidence of windows by Laplace's method: parameters and start values integrated out about the fit.

    The fit is that under light tails, the cost that under heavy ones, whose least value is some nats lower. That is
    left out for all models alike.
    """
    cost = fitter.parameter_prior(c)
    chosen = [np.zeros(0, int) for _ in search.records]
    for p in parts:
        chosen[p.which] = p.windows
    cost += fitter.log_volume(c, fitter.torques(c, chosen))
    for p in parts:
        cost += float(np.sum(fitter.window_costs(c, p.which, p.windows, p.c)))
        cost += float(np.sum(fitter.state_prior(c, p.which, p.windows)))
    matrix, _, _ = fitter.reduced(c, parts, np.zeros(1))
    # log det of the posterior precision over the prior's, in prior units: det(I + S J' W J S).
    unit = c.spread / c.scale if len(c.free) else np.zeros(0)
    precision = np.eye(len(unit)) + matrix[0] * unit[:, None] * unit
    return -0.5 * (cost + c.occam + float(np.linalg.slogdet(precision)[1]))


def _missing(
    search: Scoring, c: Candidate, parts: list[Linear], fitter: Fitter
) -> tuple[tuple[Values, ...], tuple[Values, ...]]:
    """Mean square of the missing torque in each window [N^2 m^2], noise's share taken out, by record (windows,).

    Returns:
        (all of it, the same weighted by how far each frequency moves the machine).
    """
    found, moving = ([np.full(len(record.starts), np.nan) for record in search.records] for _ in range(2))
    # d = V diag(1 / sqrt(lambda)) c, filtered; V is orthonormal, so that squares of coefficients add up.
    scale, modes = fitter.torque_scale(c), search.modes
    still = modes.variance(np.zeros(1))[0]  # what no loop answers, shape (modes,)
    for p in parts:
        noise = fitter.noise[p.which][p.windows]
        weight = search.measure.weight(noise, scale)
        each = modes.plain(p.c) ** 2 - search.real_noise * noise[:, None]
        if np.any(still > 0.0):
            # What the nominal model leaves and no loop answers may be what this one explains (a load that rattles):
            # then it is no noise, and taken out it would hide what the model lacks in other octaves.
            rows = np.all(np.isfinite(each), axis=1)
            own, taken = (
                np.bincount(modes.band, np.sum(energy[rows] * weight[rows], axis=0), modes.bands)
                for energy in (each, np.broadcast_to(still, each.shape))
            )
            each -= np.clip(own / np.where(taken > 0.0, taken, 1.0), 0.0, 1.0)[modes.band] * still
        each *= weight
        found[p.which][p.windows] = np.sum(each, axis=1)
        moving[p.which][p.windows] = each @ search.moves
    return tuple(found), tuple(moving)
