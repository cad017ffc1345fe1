"""The share of the missing torque that a curve of one recorded variable accounts for, to compare named causes with.

A table of velocity, position, torque or time needs no named law. If one accounts for half of what the nominal model
lacks and no other variable does, the missing torque is a function of that variable, whatever its cause. If it accounts
for more than the named causes, which are functions of other variables, those have only adapted to it.
"""

from dataclasses import dataclass

import numpy as np

from ..fit.candidate import Fit
from ..fit.search import Search
from ..select.dominant import Curve
from ..thresholds import THRESHOLDS
from .smooth_tables import inertia_table, make_tables
from .smoother import Smooth, Smoother, smoother_of


@dataclass(frozen=True)
class Curves:
    """The best table of each variable, beside the nominal model with its numbers free.

    Attributes:
        by: the best table's share and evidence, by variable.
        whole: mean square of the missing torque without a table [N^2 m^2], noise's share taken out; 0 for noise alone.
    """

    by: dict[str, Curve]
    whole: float


def curves_of(search: Search) -> Curves:
    """The share that a table of each recorded variable accounts for alone, on the fitted windows only."""
    smoother, base = smoother_of(search, search.base)
    whole, found = _energy(search, smoother, base), {}
    if not whole > 0.0:
        return Curves({}, 0.0)  # noise alone
    # A missing law bends the nominal model's inertia, which would hide the law from its own table; and a free inertia
    # takes what a weight does to a machine that swings freely. So a table is tried beside either. Beside one of the
    # torque the inertia stays: with it free, what drives less what accelerates is the missing torque by definition.
    free = smoother.fit((inertia_table(search.records),), (0.0,), base.weight)
    tried = make_tables(search.records, search.setting.periods[:1])
    if _unfelt(search) > THRESHOLDS.unfelt:
        tried.pop("torque", None)
    for variable, tables in tried.items():
        for before in (base,) if variable == "torque" else (base, free):
            energy = max(_energy(search, smoother, before), 1e-300)
            for table in tables:
                gains, penalty = smoother.gains(before, table)
                after = smoother.fit((*before.tables, table), (*before.penalties, penalty), before.weight)
                # `gains` are cross-validated; `share` is not, as the share of named causes is of fitted windows too.
                share = 1.0 - _energy(search, smoother, after) / energy
                # Of the median fold: one that lies where no other does is extrapolated to, and would outweigh all.
                one = Curve(float(np.clip(share, 0.0, 1.0)), float(np.median(gains)) * len(gains))
                if variable not in found or found[variable].share < one.share:
                    found[variable] = one
    return Curves(found, whole)


def _unfelt(search: Search) -> float:
    """Slope of the missing torque against the commanded one [1], at most what a machine that does not feel it has.

    Where hardly anything but the missing torque holds the motor back (a weight that is turned slowly), the missing
    torque *is* the commanded one, and a table of the torque repeats it without being a law of the machine.
    """
    pairs = [
        (course[known], record.torque[known])
        for course, record in zip(search.missing_course(search.base), search.records, strict=True)
        if np.any(known := np.isfinite(course))
    ]
    missing, torque = (np.concatenate(part) for part in zip(*pairs, strict=True))
    return -float(missing @ torque) / max(float(torque @ torque), 1e-300)


def named_share(search: Search, fit: Fit, curves: Curves) -> float:
    """The share that the named causes of a fit account for [1], computed as for the curves: at the measured motion."""
    if not curves.whole > 0.0:
        return 0.0
    return 1.0 - _energy(search, *smoother_of(search, fit.candidate)) / curves.whole


def _energy(search: Search, smoother: Smoother, fit: Smooth) -> float:
    """Mean square of the missing torque [N^2 m^2], each frequency weighted by how far it moves the machine.

    Without this weight, noise of differentiation at high frequencies would decide which variable is dominant.
    """
    return smoother.energy(fit, search.moves)
