"""Curves: what one recorded variable alone would hold of the missing torque, as rivals of names.

A table of velocity, position, torque or time knows no name. Where it holds half of what the nominal model lacks and no
other variable does, the missing torque is a law of that variable, whatever else the machine does; where it holds more
than named causes of other variables, those names bend after it.
"""

from dataclasses import dataclass

import numpy as np

from ..fit.candidate import Fit
from ..fit.search import Search
from ..select.dominant import Curve
from .smooth import Smooth, Smoother, smoother_of
from .smooth_tables import make_tables

Values = np.ndarray


@dataclass(frozen=True)
class Curves:
    """The best table of each variable, beside the nominal model with its numbers free.

    Attributes:
        by: {variable: what its table holds}.
        whole: energy of the missing torque without a table [N^2 m^2], noise's share taken out; 0 for noise alone.
    """

    by: dict[str, Curve]
    whole: float


def curves_of(search: Search) -> Curves:
    """What each recorded variable would hold alone; only fitted windows are looked at."""
    smoother, base = smoother_of(search, search.base)
    whole, found = _energy(search, smoother, base), {}
    if not whole > 0.0:
        return Curves({}, 0.0)  # noise alone
    for variable, tables in make_tables(search.records, search.setting.periods.get("torque", ())[:1]).items():
        for table in tables:
            gains, penalty = smoother.gains(base, table)
            after = smoother.fit((table,), (penalty,), base.weight)
            share = 1.0 - _energy(search, smoother, after) / whole
            one = Curve(float(np.clip(share, 0.0, 1.0)), float(np.sum(gains)))
            if variable not in found or found[variable].share < one.share:
                found[variable] = one
    return Curves(found, whole)


def named_share(search: Search, fit: Fit, curves: Curves) -> float:
    """What the named causes of a fit hold [1], in the measure of the curves: at the measured motion."""
    if not curves.whole > 0.0:
        return 0.0
    return 1.0 - _energy(search, *smoother_of(search, fit.candidate)) / curves.whole


def _energy(search: Search, smoother: Smoother, fit: Smooth) -> float:
    """Mean square of the missing torque [N^2 m^2], each frequency weighed by how far it moves the machine."""
    return smoother.energy(fit, search.moves * search.band**2)
