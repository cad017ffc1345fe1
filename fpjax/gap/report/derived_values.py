"""Values that a report derives from the fields of a diagnosis."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from ..effects.estimate import NINETY, Estimate
from .digits import scale_for, scaled

if TYPE_CHECKING:
    from ..answer.answer import Answer
    from ..answer.findings import FittedParameter, Ranked, Share, Where
    from ..answer.gap import Step

AXES = ("time", "velocity", "position", "frequency")
NEGLIGIBLE = 0.005  # probability below which an effect is shown on request only


def gap_scale(diagnosis: Answer) -> tuple[float, str]:
    """(factor, unit) in which all gaps are shown: those that suit the gap of the nominal model, and its noise floor."""
    gap = diagnosis.gap
    milli = scale_for(1e-3, gap.unit)
    # 0.127 A over a floor of 4.07e-4 A reads better as 127 mA over 0.407 mA.
    if 0.1 <= gap.before < 1.0 and 0.0 < gap.noise_floor < 1e-3:
        return milli
    return scale_for(gap.before, gap.unit)


def shown_gap(diagnosis: Answer, gap: Estimate) -> Estimate:
    """A gap in the unit of the report."""
    return scaled(gap, *gap_scale(diagnosis))


def step_gap(diagnosis: Answer, step: Step) -> Estimate:
    """The gap after one of the causes, with its interval."""
    return Estimate(step.gap_after, *step.interval, diagnosis.gap.unit)


def entry_gap(diagnosis: Answer, entry: Ranked) -> Estimate:
    """The gap that an effect of the ranking leaves."""
    return Estimate(entry.gap_after, unit=diagnosis.gap.unit)


def at_bound(entry: Ranked) -> tuple[str, ...]:
    """Parameters whose fit ended at a bound of the search."""
    return tuple(name for name, estimate in entry.parameters.items() if estimate.at_bound)


def places(where: Where, axis: str) -> tuple[Share, ...]:
    """The places of an axis that stand out, in ascending order."""
    return _drawable(getattr(where, axis))


def bins(where: Where, axis: str) -> tuple[Share, ...]:
    """Every bin of an axis, in ascending order."""
    return _drawable(where.maps.get(axis, ()))


def _drawable(shares: tuple[Share, ...]) -> tuple[Share, ...]:
    known = [s for s in shares if all(map(math.isfinite, (s.start, s.stop, s.share)))]
    return tuple(sorted(known, key=lambda share: share.start))


def main_regime(where: Where | None) -> tuple[float, str]:
    """(share, name) of the regime with the largest share; (0, "") where there is none."""
    shares = [] if where is None else [(s, r) for r, s in where.regime.items() if math.isfinite(s) and s > 0.0]
    return max(shares, default=(0.0, ""))


def twins_of(diagnosis: Answer, effect: str) -> tuple[str, ...]:
    """Effects that this log cannot distinguish from the given one."""
    return next((entry.indistinguishable_from for entry in diagnosis.ranking if entry.effect == effect), ())


def classes(diagnosis: Answer) -> list[tuple[str, ...]]:
    """The classes of effects that this log cannot distinguish, the most probable first.

    The relation is made transitive: effects joined by a chain of such pairs are one class. Classes of negligible
    probability are left out, unless a cause is in them.
    """
    groups: list[set[str]] = []
    for entry in diagnosis.ranking:
        twins = entry.indistinguishable_from
        if not twins or (entry.probability < NEGLIGIBLE and entry.effect not in diagnosis.causes):
            continue
        joined = {entry.effect, *twins}
        # All groups that the new pair touches become one.
        for group in [g for g in groups if g & joined]:
            joined |= group
            groups.remove(group)
        groups.append(joined)
    order = {entry.effect: i for i, entry in enumerate(diagnosis.ranking)}
    found = [tuple(sorted(g, key=lambda e: (order.get(e, len(order)), e))) for g in groups]
    return sorted(found, key=lambda group: order.get(group[0], len(order)))


def fixed(found: FittedParameter) -> Estimate:
    """A parameter with the 90 % interval of its standard deviation; none at a bound, where it counts as known."""
    deviation = found.standard_deviation
    half = NINETY * deviation if math.isfinite(deviation) and deviation > 0.0 else math.nan
    return Estimate(found.value, found.value - half, found.value + half, found.unit)


def tracking(diagnosis: Answer) -> dict[str, Estimate]:
    """The tracking error `measured`, `before` and `after`; empty where not known."""
    found = diagnosis.tracking
    if found is None:
        return {}
    pairs = (("measured", found.measured), ("before", found.before), ("after", found.after))
    return {name: Estimate(value, unit=found.unit) for name, value in pairs if math.isfinite(value)}
