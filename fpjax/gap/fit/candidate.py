"""Candidate: a set of causes on its way through a fit; Fit: where it ended."""

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from ..data.record import Record
from ..data.setting import Setting
from ..effects.effect import Effect
from ..simulate.family import Family

SPIKE = 0.02  # standard deviation of a nominal value that is taken to be right, relative
SLAB = 0.6  # and of one that may be wrong, relative: a guess, or a regression on a poor log
SPIKE_RANGE = 0.05  # a nominal value that is taken to be right stays within this of what was given
NOMINAL = ("inertia", "coulomb", "viscous")
LEAST_COULOMB = 0.25  # of the friction's size: what a nominal Coulomb level near zero may be wrong by
LEAST_VISCOUS = 0.25  # likewise, at the top speed

Values = np.ndarray


@dataclass
class Candidate:
    """A set of effects from one start, and where its fit stands; only `fpjax.gap.fit` changes it.

    Attributes:
        effects: in the model, the nominal values' errors not among them.
        wide: nominal values (of `NOMINAL`) that may be wrong; the others are right within `SPIKE`.
        family: that holds the effects.
        vector: all parameters, shape (parameters,).
        free: indices of those that are fitted.
        low: bounds of the free ones.
        high: bounds of the free ones.
        center: of the prior of the free ones.
        spread: standard deviation of that prior.
        scale: typical size of a step of the free ones.
        reach: largest step of the free ones.
        states: start values of all windows of all records, a list of arrays (states, windows), as deviations.
        hidden: centre of the hidden states, a list of arrays (2, windows).
        level: q of the missing torque by octave [N m], shape (bands,).
        white: whether all octaves have one level, and a window one burst.
        cost: twice the negative log posterior on the fitted windows, at `level`.
        normal: of the free parameters in prior units, start states eliminated, without the prior.
        occam: log determinant of the start states' posterior precision over their prior's, fitted windows.
        damping: of Levenberg-Marquardt.
        converged: no step lowers the cost any more.
    """

    effects: tuple[Effect, ...]
    wide: frozenset[str]
    family: Family
    vector: Values
    free: Values
    low: Values
    high: Values
    center: Values
    spread: Values
    scale: Values
    reach: Values
    states: list[Values]
    hidden: list[Values]
    level: Values = field(default_factory=lambda: np.zeros(0))
    white: bool = True
    cost: float = np.inf
    normal: Values = field(default_factory=lambda: np.zeros((0, 0)))
    occam: float = 0.0
    damping: float = 1.0
    converged: bool = False

    @property
    def names(self) -> tuple[str, ...]:
        """Of the causes: the effects, then the nominal values that may be wrong."""
        return (*(e.name for e in self.effects), *(f"{name}_error" for name in NOMINAL if name in self.wide))

    @property
    def structural(self) -> tuple[str, ...]:
        """Of the effects alone."""
        return tuple(e.name for e in self.effects)

    def values(self) -> dict[str, float]:
        """All parameters by name."""
        return {p.name: float(v) for p, v in zip(self.family.parameters, self.vector, strict=True)}

    def at_bound(self) -> list[str]:
        """Names of the free parameters that ended at a bound."""
        edge = 1e-6 * self.scale
        value = self.vector[self.free]
        out = (value <= self.low + edge) | (value >= self.high - edge)
        return [self.family.parameters[i].name for i in self.free[out]]


def nominal_sizes(setting: Setting) -> dict[str, float]:
    """By what the nominal values' errors are measured: themselves, or a share of the friction where they are small."""
    return {
        "inertia": setting.inertia,
        "coulomb": max(setting.coulomb, LEAST_COULOMB * setting.friction),
        "viscous": max(setting.viscous, LEAST_VISCOUS * setting.friction / setting.speed),
    }


def make_candidate(
    effects: Sequence[Effect],
    wide: Sequence[str],
    family: Family,
    setting: Setting,
    records: list[Record],
    start: dict[str, float],
    *,
    exact: bool = False,
) -> Candidate:
    """A candidate at its start.

    Args:
        effects: in the model.
        wide: nominal values that may be wrong.
        family: that holds the effects.
        setting: sizes for bounds.
        records: of the logs.
        start: values that are not neutral.
        exact: nothing is free but the origin, where no sensor tells it; the nominal model as it was given.
    """
    names = [p.name for p in family.parameters]
    vector = family.neutral(setting)
    neutral = vector.copy()
    for name, value in start.items():
        if name in names:
            vector[names.index(name)] = value
    own = dict.fromkeys(p.name for effect in effects for p in effect.parameters)
    wanted = [*(n for n in NOMINAL if n not in own), *own]
    if setting.unknown_origin:
        wanted = ["origin", *wanted]
    if exact:
        wanted = [n for n in wanted if n == "origin"]  # no number of the model: where the log happened to start
    free = np.array([names.index(n) for n in wanted], int)
    # What effects share, each bounds as it needs it.
    bounded = {p.name: p for effect in effects for p in effect.parameters}
    parameters = [bounded[names[i]] if names[i] in bounded else family.parameters[i] for i in free]
    low = np.array([p.low(setting) for p in parameters])
    high = np.array([p.high(setting) for p in parameters])
    scale = np.array([p.scale(setting) for p in parameters])
    reach = np.array([p.reach(setting) for p in parameters])
    center, spread = np.clip(neutral[free], low, high), 0.25 * (high - low)
    sizes = nominal_sizes(setting)
    for i, p in enumerate(parameters):
        if p.name not in sizes:
            continue
        if p.name in wide or p.name in own:
            spread[i], scale[i] = SLAB * sizes[p.name], 0.2 * sizes[p.name]
        else:
            spread[i] = scale[i] = SPIKE * sizes[p.name]
            low[i] = max(center[i] - SPIKE_RANGE * sizes[p.name], low[i])
            high[i] = min(center[i] + SPIKE_RANGE * sizes[p.name], high[i])
    vector[free] = np.clip(vector[free], low, high)
    states = [np.zeros((family.states, len(record.starts))) for record in records]
    hidden = [np.zeros((2, len(record.starts))) for record in records]
    return Candidate(
        tuple(effects), frozenset(wide) - set(own), family, vector, free, low, high, center, spread, scale, reach,
        states, hidden,
    )  # fmt: skip


@dataclass(frozen=True)
class Start:
    """A set of causes and the values that its fit starts from.

    Attributes:
        effects: in the model.
        wide: nominal values that may be wrong.
        values: that are not neutral, by name.
        like: a fit whose windows' start states are taken over.
    """

    effects: tuple[Effect, ...]
    wide: tuple[str, ...]
    values: dict[str, float]
    like: Candidate | None = None


@dataclass(frozen=True)
class Fit:
    """A finished candidate and its scores; nothing changes it.

    Attributes:
        candidate: the fit.
        evidence: log evidence of the fitted windows and log likelihood of the withheld ones [1].
        missing: mean square of the missing torque in each window, noise's share taken out [N^2 m^2], one array a
            record, in the nominal model's band.
        level: q of all octaves together, rms over the modes of the nominal model's band [N m].
    """

    candidate: Candidate
    evidence: float
    missing: tuple[Values, ...]
    level: float

    @property
    def names(self) -> tuple[str, ...]:
        """Of the causes."""
        return self.candidate.names

    def missing_rms(self, windows: Sequence[Values]) -> float:
        """Missing torque [N m], rms over windows given as one array of indices a record; not below zero."""
        chosen = np.concatenate([m[w] for m, w in zip(self.missing, windows, strict=True)])
        return float(np.sqrt(max(np.mean(chosen), 0.0))) if len(chosen) else float("nan")
