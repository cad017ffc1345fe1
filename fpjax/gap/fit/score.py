"""Score: what a finished candidate is worth on the fitted and on the withheld windows."""

from collections.abc import Sequence
from dataclasses import replace
from typing import Protocol

import numpy as np

from ..data.record import Record
from ..simulate.family import Key
from ..simulate.hidden import Observer
from .candidate import Candidate, Fit
from .least_squares import Fitter, Linear
from .modes import Modes

Values = np.ndarray

PROPER = (4, 8)  # steps for the start states of withheld windows; hidden states are looked up before each round


class Scoring(Protocol):
    """What a score needs to know of a search (`fpjax.gap.fit.search.Search`)."""

    records: list[Record]
    train: list[Values]
    withheld: list[Values]
    modes: Modes
    fitters: dict[Key, Fitter]
    observers: dict[Key, Observer]
    band: Values
    real_noise: float

    def observe(self, candidates: Sequence[Candidate], windows: Sequence[Values]) -> None:
        """Look up the hidden states at the starts of windows."""
        ...


def score(search: Scoring, c: Candidate) -> Fit:
    """A finished candidate's levels, its evidence, and the missing torque of every window.

    Args:
        search: that it belongs to.
        c: on the fitted windows; its level and the start states of the withheld windows are set.
    """
    fitter = search.fitters[c.family.key]
    parts = fitter.linearise([c], search.train)[0]
    c.level, c.white = fitter.best_level([(p.which, p.windows, p.c) for p in parts], white=False), False
    fixed = replace(
        c, free=np.zeros(0, int), low=np.zeros(0), high=np.zeros(0), center=np.zeros(0), spread=np.ones(0),
        scale=np.zeros(0), reach=np.zeros(0), states=[s.copy() for s in c.states], hidden=[h.copy() for h in c.hidden],
        converged=False, damping=1e-3,
    )  # fmt: skip
    withheld = _withheld_parts(search, fixed, fitter)
    # The level is no law of the machine: it is that of all windows. A level that the fitted ones find zero would
    # leave nothing for what a withheld one holds beside the model.
    c.level = fitter.best_level([(p.which, p.windows, p.c) for p in (*parts, *withheld)], white=False)
    fixed.level = c.level
    evidence = _log_evidence(search, c, fitter, parts)
    if withheld:
        evidence += _log_evidence(search, fixed, fitter, withheld, hidden=False)
    c.states, c.hidden = fixed.states, fixed.hidden
    missing = _missing(search, c, [*parts, *withheld], fitter)
    return Fit(c, evidence, missing, search.modes.mean_level(c.level, search.band))


def _withheld_parts(search: Scoring, fixed: Candidate, fitter: Fitter) -> list[Linear]:
    """The withheld windows as a candidate leaves them, whose start states alone are free."""
    if not any(len(chosen) for chosen in search.withheld):
        return []
    for s, chosen in zip(fixed.states, search.withheld, strict=True):
        s[:, chosen] = 0.0
    for steps in PROPER:
        if fixed.family.key in search.observers:
            search.observe([fixed], search.withheld)
            for s, chosen in zip(fixed.states, search.withheld, strict=True):
                s[2:, chosen] = 0.0
        fixed.converged = False
        fitter.go_on([fixed], search.withheld, steps, white=False, hidden=False, adapt=False)
    return fitter.linearise([fixed], search.withheld, hidden=False)[0]


def _log_evidence(search: Scoring, c: Candidate, fitter: Fitter, parts: list[Linear], *, hidden: bool = True) -> float:
    cost = fitter.parameter_prior(c)
    chosen = [np.zeros(0, int) for _ in search.records]
    for p in parts:
        chosen[p.which] = p.windows
    cost += fitter.log_volume(c, fitter.torques(c, chosen))
    for p in parts:
        cost += float(np.sum(fitter.window_costs(c, p.which, p.windows, p.c)))
        cost += float(np.sum(fitter.state_prior(c, p.which, p.windows, hidden=hidden)))
    matrix, _, _ = fitter.reduced(c, parts, np.zeros(1), hidden=hidden)
    unit = c.spread / c.scale if len(c.free) else np.zeros(0)
    c.normal = matrix[0]
    precision = np.eye(len(unit)) + matrix[0] * unit[:, None] * unit
    return -0.5 * (cost + c.occam + float(np.linalg.slogdet(precision)[1]))


def _missing(search: Scoring, c: Candidate, parts: list[Linear], fitter: Fitter) -> tuple[Values, ...]:
    """Mean square of the missing torque in each window [N^2 m^2], noise's share taken out."""
    found = [np.full(len(record.starts), np.nan) for record in search.records]
    weight = np.where(search.modes.sensor, 0.0, search.band**2 / np.where(search.modes.sensor, 1.0, search.modes.gain))
    weight = weight * search.fitters[c.family.key].torque_scale(c) ** 2
    for p in parts:
        noise = search.real_noise * fitter.noise[p.which][p.windows]
        found[p.which][p.windows] = (
            (search.modes.plain(p.c) ** 2 - noise[:, None]) @ weight / search.records[p.which].samples
        )
    return tuple(found)
