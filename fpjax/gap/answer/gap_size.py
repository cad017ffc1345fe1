"""How far the gap shrinks: missing torque before, after, and after each cause, on withheld windows, with intervals."""

from collections.abc import Sequence

import numpy as np

from ...logs.arrays import Numbers, Values
from ..fit.candidate import NOMINAL, Fit, Start
from ..fit.search import Search
from ..select.decision import Decision
from ..select.shares import without_effect
from ..select.statement import is_number
from .gap import Gap, Step, closed

DRAWS = 2000  # of the bootstrap: the 5 % quantile then rests on 100 draws
SEED = 0
NINETY = (0.05, 0.95)  # quantiles of a 90 % interval


def gap_of(search: Search, decision: Decision, unit: str) -> Gap:
    """The gap before and after the causes, with intervals.

    Args:
        search: of the logs.
        decision: on its fits.
        unit: of the missing torque.
    """
    before, after = (withheld(search, fit) for fit in (decision.exact, decision.chosen.fit))
    floor = noise_floor(search)
    # The same windows are drawn for both, so that the interval of `closed` is that of paired differences.
    which = draws(len(before))
    many_before, many_after = _root(np.mean(before[which], 1)), _root(np.mean(after[which], 1))
    small = float(_root(np.mean(before))), float(_root(np.mean(after)))
    return Gap(
        unit=unit,
        before=small[0],
        after=small[1],
        noise_floor=floor,
        closed=float(closed(*small, floor)),
        before_interval=interval(many_before),
        after_interval=interval(many_after),
        noise_floor_interval=(floor, floor),
        closed_interval=interval(closed(many_before, many_after, floor)),
    )


def steps_of(
    search: Search, decision: Decision, causes: Sequence[str], undecided: Sequence[str] = ()
) -> tuple[Step, ...]:
    """The gap after each cause, from the nominal model to the chosen one, its details beside the causes included.

    Args:
        search: of the logs.
        decision: its `path` holds the models between, each with one cause more.
        causes: asserted causes of the machine, the most important first.
        undecided: causes of the chosen model that are not asserted and take a part of the gap too: they come last.
    """
    causes = (*causes, *undecided)
    # The models that were tried on the way had other causes first, or all numbers free.
    if undecided or (len(causes) > 1 and any(map(is_number, causes))):
        return _one_by_one(search, decision, causes)
    chosen = decision.chosen.fit
    steps: list[Step] = []
    last = decision.exact
    for fit in [
        *(f for f in decision.path[1:] if set(f.candidate.structural) < set(chosen.candidate.structural)),
        chosen,
    ]:
        added = [name for name in causes if name not in [s.added for s in steps]]
        if fit is not chosen:
            added = [name for name in added if name in fit.candidate.structural]
        if not added:
            continue
        steps += [_step(name, withheld(search, fit)) for name in added]
        last = fit
    if steps and last is not chosen:
        # What is told of the whole holds the details too: the last step must be that number.
        details = [name for name in chosen.candidate.structural if name not in causes]
        steps += [_step(name, withheld(search, chosen)) for name in details]
    return tuple(steps)


def _one_by_one(search: Search, decision: Decision, causes: Sequence[str]) -> tuple[Step, ...]:
    """The causes one by one, in their order, each number as it was given until it is its turn.

    The models that were tried on the way have all numbers free, so that the first effect would be credited with them.
    """
    c = decision.chosen.fit.candidate
    starts = []
    for count in range(1, len(causes)):
        rest = tuple(effect for effect in c.effects if effect.name in causes[:count])
        numbers = tuple(name.removesuffix("_error") for name in causes[:count] if is_number(name))
        values = c.values()
        for effect in c.effects:
            values = values if effect in rest else without_effect(values, effect, rest)
        given = set(NOMINAL) - set(numbers) - {p.name for effect in rest for p in effect.parameters}
        starts.append(Start(rest, numbers, {k: v for k, v in values.items() if k not in given}, c))
    fits = [*search.fitted(starts, alone=True), decision.chosen.fit]
    return tuple(_step(name, withheld(search, fit)) for name, fit in zip(causes, fits, strict=True))


def with_readings(steps: Sequence[Step], causes: Sequence[str], readings: Sequence[str], gap: Gap) -> tuple[Step, ...]:
    """The steps with those of the reading's errors, each behind as many causes as in the verdict.

    They make no torque: what is missing after them is what was missing before.

    Args:
        steps: of the machine's causes, then of details.
        causes: of the verdict.
        readings: those of them that are errors of the reading.
        gap: before the first step.
    """
    found = list(steps)
    for place, name in enumerate(causes):
        if name in readings:
            left = found[place - 1] if place else Step("", gap.before, gap.before_interval)
            found.insert(place, Step(name, left.gap_after, left.interval))
    return tuple(found)


def withheld(search: Search, fit: Fit) -> Values:
    """Mean square of the missing torque in the withheld windows [N^2 m^2], shape (windows,)."""
    return np.concatenate([m[w] for m, w in zip(fit.missing, search.withheld, strict=True)])


def noise_floor(search: Search, windows: Sequence[Values] | None = None) -> float:
    """Missing torque that noise alone would exceed in one log out of twenty [N m].

    The mean square of a course under noise alone is a weighted sum of squares of standard normals, minus its mean. Its
    95 % quantile is that of a scaled chi-square with the same mean and variance (Satterthwaite, "An approximate
    distribution of estimates of variance components", 1946).

    Args:
        search: of the logs.
        windows: one array of indices for each log; None for the withheld ones.
    """
    from scipy.special import chdtri  # scipy.stats takes a second to import

    modes, windows = search.modes, search.withheld if windows is None else windows
    fitter = search.fitters[search.exact.family.key]
    noise = np.concatenate([n[w] for n, w in zip(fitter.noise, windows, strict=True)])
    if not len(noise):
        return float("nan")
    weight = search.measure.weight(noise, np.ones(len(modes.gain)))
    weight = weight * modes.variance(search.real_noise * noise) / len(noise)
    mean, square = float(np.sum(weight)), float(np.sum(weight**2))
    if not square > 0.0:
        return 0.0
    # scale x chi-square of `degrees`: mean = scale x degrees, variance = 2 square = 2 scale^2 x degrees. chdtri inverts
    # the upper tail.
    scale, degrees = square / mean, mean**2 / square
    return float(np.sqrt(max(scale * float(chdtri(degrees, 0.05)) - mean, 0.0)))


def _step(name: str, squares: Values) -> Step:
    return Step(name, *rms_of(squares))


def rms_of(squares: Values) -> tuple[float, tuple[float, float]]:
    """(root of the mean, its 90 % interval by a bootstrap over windows) of mean squares, shape (windows,)."""
    return float(_root(np.mean(squares))), interval(_root(np.mean(squares[draws(len(squares))], 1)))


def draws(count: int) -> Values:
    """Windows of each draw of the bootstrap, shape (draws, windows); the same for every model of a log."""
    return np.random.default_rng(SEED).integers(0, count, (DRAWS, count))


def _root(values: Numbers) -> Values:
    return np.asarray(np.sqrt(np.maximum(values, 0.0)))


def interval(values: Values) -> tuple[float, float]:
    """The middle 90 % of the bootstrap's values, shape (draws,)."""
    low, high = np.quantile(values, NINETY)
    return float(low), float(high)
