"""Candidate: a set of causes while it is fitted; Fit: the finished one with its scores."""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from ...logs.arrays import Values
from ..data.record import Record
from ..data.setting import Setting
from ..effects.effect import Effect
from ..effects.parameters import UNBALANCE
from ..simulate.family import Family

# Priors of the nominal values, a spike and a slab as in George and McCulloch, "Variable selection via Gibbs sampling"
# (1993): a narrow normal law about the given value where it counts as right; where it may be wrong, because it was
# guessed or never entered, one as wide as that of any other parameter.
SPIKE = 0.02  # standard deviation of a nominal value that counts as right, relative
WIDE = 0.25  # of any parameter, over its range
SPIKE_RANGE = 0.05  # bound of a nominal value that counts as right, relative to `nominal_sizes`
NOMINAL = ("inertia", "coulomb", "viscous")
# Least sizes of the nominal friction, so that a value of zero may be wrong too: shares of the setting's friction.
LEAST_COULOMB = 0.25  # of the Coulomb level
LEAST_VISCOUS = 0.25  # of the viscous torque at top speed


@dataclass
class Candidate:
    """A set of effects fitted from one start, in its present state; only `fpjax.gap.fit` changes it.

    Attributes:
        effects: in the model; errors of nominal values are in `wide`.
        wide: nominal values (of `NOMINAL`) with the prior `WIDE`; the others have `SPIKE`.
        family: that holds the effects.
        vector: all parameters, shape (parameters,).
        free: indices into `vector` of the fitted parameters, shape (free,), as the six arrays after it.
        low: lower bounds.
        high: upper bounds.
        center: means of the normal prior.
        spread: standard deviations of the prior.
        scale: typical step, by which the least squares are scaled.
        reach: largest step of one iteration.
        states: start values of every window as deviations from their estimates, one array (states, windows) a record.
        hidden: estimates of the hidden states there, one array (2, windows) a record.
        level: q of the missing torque by octave [N m], shape (bands,).
        white: whether all octaves share one level, and all tiles of a window one burst.
        cost: twice the negative log posterior on the fitted windows, at `level`.
        normal: normal matrix J' W J of the free parameters in units of `scale`, start values eliminated, without the
            prior, shape (free, free).
        occam: log determinant of the start values' posterior precision over that of their prior, fitted windows.
        damping: of Levenberg-Marquardt, for the next iteration.
        converged: whether no step lowers the cost any more, by what counts beside `beside`.
        beside: cost of the fit that it is compared with; infinite for none.
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
    beside: float = np.inf

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the causes: the effects, then the errors of the nominal values that may be wrong."""
        return (*(e.name for e in self.effects), *(f"{name}_error" for name in NOMINAL if name in self.wide))

    @property
    def structural(self) -> tuple[str, ...]:
        """Names of the effects alone."""
        return tuple(e.name for e in self.effects)

    def values(self) -> dict[str, float]:
        """All parameters by name."""
        return {p.name: float(v) for p, v in zip(self.family.parameters, self.vector, strict=True)}

    def known_to(self, other: "Candidate") -> dict[str, float]:
        """Its values by name that mean something to another candidate: of what both fit, or a start of both set.

        Nominal values only where the other may find them wrong too; else it has them as they were given.
        """
        set_by_both = {p.name for e in self.effects if e in other.effects for p in e.fixed}
        own = {self.family.parameters[i].name for i in self.free}
        others = {other.family.parameters[i].name for i in other.free}
        held = set(NOMINAL) - other.wide - {p.name for e in other.effects for p in e.parameters}
        known = (own & others - held) | set_by_both
        return {name: value for name, value in self.values().items() if name in known}

    @property
    def load_error(self) -> tuple[str, ...]:
        """Parameters of it that are the error of a known load, and not an unbalance of their own."""
        own = {p.name for effect in self.effects for p in effect.parameters}
        held = {p.name for p in UNBALANCE} - own
        return tuple(name for i in self.free if (name := self.family.parameters[i].name) in held)

    @property
    def strain(self) -> float:
        """What the nominal numbers that count as right lose of the log density of their priors [nats].

        Half the sum of their squared deviations from the given values, in standard deviations. Torque that is off by a
        factor makes all numbers wrong by the same share; guesses are so by chance alone, and beside one factor they
        end some per cent off, on either side.
        """
        own = {p.name for effect in self.effects for p in effect.parameters}
        names = [self.family.parameters[i].name for i in self.free]
        right = np.array([name in NOMINAL and name not in self.wide | own for name in names], bool)
        return 0.5 * float(np.sum(((self.vector[self.free] - self.center) / self.spread)[right] ** 2))

    def at_bound(self) -> list[str]:
        """Names of the free parameters that ended at a bound of the search."""
        least, most = self._ends()
        return self._named((least & ~self._plain()) | most)

    def absent(self) -> list[str]:
        """Names of the free parameters that ended where the law is the plain one, without their detail."""
        return self._named(self._ends()[0] & self._plain())

    def _ends(self) -> tuple[Values, Values]:
        """Which free parameters ended at their lower, and at their upper bound, each of shape (free,)."""
        value, edge = self.vector[self.free], 1e-6 * self.scale
        return value <= self.low + edge, value >= self.high - edge

    def _plain(self) -> Values:
        return np.array([self.family.parameters[i].plain for i in self.free], bool)

    def _named(self, chosen: Values) -> list[str]:
        return [self.family.parameters[i].name for i in self.free[chosen]]


def nominal_sizes(setting: Setting) -> dict[str, float]:
    """Sizes relative to which nominal values may err: the values, or a share of the friction where that is larger."""
    return {
        "inertia": setting.inertia,
        "coulomb": max(setting.coulomb, LEAST_COULOMB * setting.given_friction),
        "viscous": max(setting.viscous, LEAST_VISCOUS * setting.given_friction / setting.speed),
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
        start: start values by name; parameters that are not in it start at their neutral value.
        exact: the nominal model as it was given: nothing is free but an `origin` that no sensor measures.
    """
    names = [p.name for p in family.parameters]
    vector = family.neutral(setting)
    neutral = vector.copy()
    for name, value in start.items():
        if name in names:
            vector[names.index(name)] = value
    own = dict.fromkeys(p.name for effect in effects for p in effect.parameters)
    # A known load that turns is as right as a nominal value that counts as right; more than that is an unbalance.
    load = [p.name for p in UNBALANCE] if setting.turning_load else []
    wanted = [*(n for n in (*NOMINAL, *load) if n not in own), *own]
    if setting.unknown_origin:
        wanted = ["origin", *wanted]
    if exact:
        wanted = [n for n in wanted if n == "origin"]  # a fact about the log's start, not a value of the model
    free = np.array([names.index(n) for n in wanted], int)
    # Effects that share a parameter may give it bounds of their own: those of an effect in the model hold.
    bounded = {p.name: p for effect in effects for p in effect.parameters}
    parameters = [bounded[names[i]] if names[i] in bounded else family.parameters[i] for i in free]
    low = np.array([p.low(setting) for p in parameters])
    high = np.array([p.high(setting) for p in parameters])
    scale = np.array([p.scale(setting) for p in parameters])
    reach = np.array([p.reach(setting) for p in parameters])
    center, spread = np.clip(neutral[free], low, high), WIDE * (high - low)
    sizes = nominal_sizes(setting) | dict.fromkeys(set(load) - set(own), abs(setting.turning_load))
    for i, p in enumerate(parameters):
        if p.name not in sizes:
            continue
        if p.name in wide or p.name in own:
            scale[i] = max(0.2 * sizes[p.name], 0.1 * spread[i])
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


def held(c: Candidate) -> Candidate:
    """A copy of a candidate with no parameter free, to fit the start values of windows alone."""
    none = np.zeros(0)
    return replace(
        c, free=np.zeros(0, int), low=none, high=none, center=none, spread=none, scale=none, reach=none,
        states=[s.copy() for s in c.states], hidden=[h.copy() for h in c.hidden], converged=False, damping=1e-3,
        beside=np.inf,
    )  # fmt: skip


@dataclass(frozen=True)
class Start:
    """A set of causes and the start values of its fit.

    Attributes:
        effects: in the model.
        wide: nominal values that may be wrong.
        values: start values by name; other parameters start at their neutral value.
        like: a fitted candidate whose start states of the windows are taken over.
        or_given: whether the nominal values as given are tried in the place of those in `values`, and the likelier
            start goes on; not of a machine with hidden states (a shaft, bristles), which no start alone is judged by.
    """

    effects: tuple[Effect, ...]
    wide: tuple[str, ...]
    values: dict[str, float]
    like: Candidate | None = None
    or_given: bool = False

    def as_given(self) -> "Start":
        """The same start from the nominal values as given."""
        return replace(self, values={n: v for n, v in self.values.items() if n not in NOMINAL}, or_given=False)


@dataclass(frozen=True)
class Fit:
    """A finished candidate and its scores; it is not changed any more.

    Attributes:
        candidate: its parameters and start values.
        evidence: log evidence of the fitted windows plus log likelihood of the withheld ones [nats].
        undrowned: `evidence` without the likelihood in what holds more noise than torque
            (`fpjax.gap.fit.measure.Measure.drowned`) [nats].
        missing: mean square of the missing torque in each window, noise's share taken out [N^2 m^2], one array
            (windows,) a record, weighed by `Search.measure`. A window may be below zero by chance.
        level: q of all octaves together, rms over the modes in the same frequencies [N m].
        moving: as `missing`, each frequency weighted by how far it moves the machine (`Search.moves`).
    """

    candidate: Candidate
    evidence: float
    undrowned: float
    missing: tuple[Values, ...]
    level: float
    moving: tuple[Values, ...] = ()

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the causes."""
        return self.candidate.names

    def missing_rms(self, windows: Sequence[Values], *, moving: bool = False) -> float:
        """Missing torque [N m], rms over windows given as one array of indices a record; not below zero.

        Args:
            windows: indices.
            moving: each frequency weighted by how far it moves the machine.
        """
        squares = self.moving if moving else self.missing
        chosen = np.concatenate([m[w] for m, w in zip(squares, windows, strict=True)])
        return float(np.sqrt(max(np.mean(chosen), 0.0))) if len(chosen) else float("nan")
