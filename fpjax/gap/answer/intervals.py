"""Covariance of fitted parameters, and 90 % intervals of the reported ones."""

from collections.abc import Collection
from dataclasses import replace

import numpy as np

from ...analysis.verdicts import PARALLEL_POSTERIOR, traded_with
from ...logs.arrays import Values
from ...model_file import Units
from ..data.setting import Setting
from ..effects.effect import Effect
from ..effects.estimate import NINETY, Estimate
from ..effects.parameters import HARDENING
from ..fit.candidate import NOMINAL, Candidate, Fit
from ..fit.search import Search
from ..select.readings import Reading
from ..thresholds import THRESHOLDS
from .findings import FittedParameter


def covariance(search: Search, fit: Fit) -> Values:
    """Covariance of the free parameters, in their own units, shape (free, free); those at a bound count as known.

    The inverse curvature of the cost, or the scatter of the windows' own gradients where that gives more (the sandwich
    estimator of White, "Maximum likelihood estimation of misspecified models", 1982): under a law of another form the
    windows disagree by more than noise. Moreover the missing torque that remains is not noise: it is a function of the
    same few states in every window and does not average out over a log. So the modes that hold missing torque count as
    `THRESHOLDS.pieces` observations at most; without missing torque this changes nothing. Priors keep their weight: a
    gain whose only doubt is how well the nominal numbers are known is known as well as they. The blur of a parameter by
    sampling (its `blur`) is added.
    """
    c = fit.candidate
    right = _counts_as_right(c)
    # A detail that the law does without is taken as none: free, it would widen whatever it is traded off with.
    inside = ~at_bound(c) & ~_are(c, c.absent())
    found = np.zeros((len(c.free), len(c.free)))
    index = np.flatnonzero(inside)
    if not len(index):
        return found
    block = np.ix_(index, index)
    # In units of `scale`: normal is J^T W J of the cost, the prior has the standard deviation `spread`.
    unit = c.scale[index] / c.spread[index]
    # What bends one nominal number that counts as right may bend the others alike: together they tell as much as one.
    unit = np.where(right[index], unit / np.sqrt(max(np.sum(right), 1)), unit)
    prior = np.diag(unit**2)
    inverse = _inverse(c.normal[block] + prior)
    # Sandwich A^-1 B A^-1: A the curvature, B the sum of outer products of the windows' gradients.
    scores = _scores(search, c)[:, index]
    meat = scores.T @ scores
    sandwich = np.diag(inverse @ meat @ inverse)
    variance = np.maximum(np.diag(inverse), 1e-300)
    # A factor on every standard deviation that comes from the data; what the priors know they know all the same.
    wider = np.sqrt(np.maximum(np.maximum(sandwich / variance, 1.0), _observations(search, c) / THRESHOLDS.pieces))
    inverse = _inverse(c.normal[block] / wider[:, None] / wider + prior)
    found[block] = inverse * c.scale[index][:, None] * c.scale[index]
    found[index, index] += np.square([c.family.parameters[c.free[i]].blur(search.setting) for i in index])
    return found


def _observations(search: Search, c: Candidate) -> float:
    """Effective number of coefficients of the fitted windows that hold missing torque and not noise (Wiener shares)."""
    noise = search.fitters[c.family.key].noise
    return float(sum(np.sum(search.modes.wiener(c.level, n[w])) for n, w in zip(noise, search.train, strict=True)))


def at_bound(c: Candidate) -> Values:
    """Which free parameters ended at a bound of the search, shape (free,).

    A nominal number that counts as right ends at a bound of that, and is known no better for it.
    """
    return _are(c, c.at_bound()) & ~_counts_as_right(c)


def _counts_as_right(c: Candidate) -> Values:
    """Which free parameters are nominal numbers with a narrow prior, shape (free,)."""
    return _are(c, set(NOMINAL) - c.wide - {p.name for effect in c.effects for p in effect.parameters})


def _are(c: Candidate, names: Collection[str]) -> Values:
    """Which free parameters have one of some names, shape (free,)."""
    return np.array([c.family.parameters[i].name in names for i in c.free], bool)


def estimates(
    search: Search, fit: Fit, effect: Effect, spread: Values | None, setting: Setting | None = None
) -> dict[str, Estimate]:
    """The reported parameters of one effect with 90 % intervals, by the delta method.

    Args:
        search: of the logs.
        fit: with the effect in.
        effect: whose parameters are reported.
        spread: covariance of the free parameters; None for no intervals.
        setting: what the parameters are reported for; None for that of the search.
    """
    c, setting = fit.candidate, setting or search.setting
    if effect.structure == "transmission" and c.values().get(HARDENING.name, 0.0) > 0.0:
        setting = replace(setting, shaft=_shaft_torque(search, c))
    values, units = c.values(), setting.units
    center = effect.describe(values, setting)
    if spread is None:
        return {key: Estimate(value, unit=units.name(unit)) for key, (value, unit) in center.items()}
    names = [c.family.parameters[i].name for i in c.free]
    gradients = {name: np.zeros(len(names)) for name in center}
    for j, name in enumerate(names):
        h = 1e-4 * c.scale[j]  # forward difference; `describe` is smooth, and 1e-4 is far above rounding
        moved = effect.describe(values | {name: values[name] + h}, setting)
        for key in center:
            gradients[key][j] = (moved[key][0] - center[key][0]) / h
    bounded = at_bound(c)
    result = {}
    for key, (value, unit) in center.items():
        half = NINETY * float(np.sqrt(max(gradients[key] @ spread @ gradients[key], 0.0)))
        touches = bool(np.any(bounded & (gradients[key] != 0.0)))
        # A parameter at its bound has no curvature there: its uncertainty is not known.
        half = float("nan") if touches else half
        result[key] = Estimate(value, value - half, value + half, units.name(unit), touches)
    return result


def read_estimates(reading: Reading, units: Units) -> dict[str, Estimate]:
    """Parameters of an error of the velocity column, as found by comparison with the encoder, with 90 % intervals."""
    return {
        name: Estimate(value, value - NINETY * deviation, value + NINETY * deviation, units.name(unit))
        for name, (value, deviation, unit) in reading.values.items()
    }


def identifiability(search: Search, fit: Fit, spread: Values) -> tuple[FittedParameter, ...]:
    """Value, standard deviation and identifiability verdict of each free parameter."""
    c = fit.candidate
    deviation = np.sqrt(np.maximum(np.diag(spread), 0.0))
    safe = np.where(deviation > 0, deviation, 1.0)
    correlation = spread / safe[:, None] / safe
    found, absent = [], c.absent()
    for j, index in enumerate(c.free):
        parameter = c.family.parameters[index]
        if parameter.name in absent:
            verdict = "absent"
        elif deviation[j] == 0.0:
            verdict = "at a bound"
        elif deviation[j] > c.scale[j]:  # not known within a typical change of it
            verdict = "flat"
        else:
            others = traded_with(correlation, j, limit=PARALLEL_POSTERIOR)
            verdict = f"traded off with {c.family.parameters[c.free[others[0]]].name}" if others else "pinned"
        unit = search.setting.units.name(parameter.unit)
        name = parameter.name.replace("unbalance", "load_error") if parameter.name in c.load_error else parameter.name
        found.append(FittedParameter(name, float(c.vector[index]), float(deviation[j]), unit, verdict))
    return tuple(found)


def _scores(search: Search, c: Candidate) -> Values:
    """Gradient of half the cost of each fitted window in units of `scale`, start states eliminated, (windows, free)."""
    fitter = search.fitters[c.family.key]
    copy = replace(c)  # `reduced` writes its determinant into the candidate
    rows = []
    for part in fitter.linearise([c], search.train)[0]:
        for i in range(len(part.windows)):
            one = replace(part, windows=part.windows[i : i + 1], c=part.c[i : i + 1], slope=part.slope[i : i + 1])
            rows.append(fitter.reduced(copy, [one], np.zeros(1))[1][0])
    return np.array(rows).reshape(-1, len(c.free))


def _inverse(matrix: Values) -> Values:
    """Inverse of a positive semidefinite matrix, scaled to a unit diagonal first: its entries have mixed units."""
    size = np.sqrt(np.maximum(np.diag(matrix), 1e-30))
    return np.linalg.pinv(matrix / size[:, None] / size, rcond=1e-12, hermitian=True) / size[:, None] / size


def _shaft_torque(search: Search, c: Candidate) -> Values:
    """Torque of a candidate's shaft [N m] along all logs, the measured motion imposed on the side that has the sensor,
    shape (samples of all logs,); a zero where it diverges.
    """
    shafts = search.hidden_states[c.family.key].shafts
    torque = np.concatenate([shafts(c.vector[:, None], which)[:, 0] for which in range(len(search.records))])
    return torque if np.all(np.isfinite(torque)) else np.zeros(1)
