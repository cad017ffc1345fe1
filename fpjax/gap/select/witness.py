"""Witness: the one recorded variable that the missing torque is a law of, if there is one, whatever its name."""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass

from .thresholds import THRESHOLDS, Thresholds


@dataclass(frozen=True)
class Curve:
    """What a table of one recorded variable holds of what the nominal model lacks, its numbers free.

    Attributes:
        share: of the energy of the missing torque, as far as it moves the machine [1].
        evidence: on windows left out of its fit [nats].
    """

    share: float
    evidence: float


def witness(curves: Mapping[str, Curve], t: Thresholds = THRESHOLDS) -> str:
    """The variable whose curve alone holds most of the missing torque, and far more than any other's; "" for none."""
    if not curves:
        return ""
    first = max(curves, key=lambda variable: curves[variable].share)
    rest = max((curve.share for variable, curve in curves.items() if variable != first), default=0.0)
    own = curves[first]
    sure = own.evidence > t.decisive and own.share > t.curve and own.share - rest > t.curve_ahead
    return first if sure else ""


def believed(curves: Mapping[str, Curve], followed: Iterable[str], t: Thresholds = THRESHOLDS) -> float:
    """What a name keeps of its worth [1]: all, but where a witness speaks for a variable that it does not follow.

    A name that says nothing of what it follows, or follows what no table could be made of, keeps it too.
    """
    first, followed = witness(curves, t), [variable for variable in followed if variable in curves]
    if not first or not followed or first in followed:
        return 1.0
    best = max(curves[variable].share for variable in followed)
    return max(best / curves[first].share, 1.0 - curves[first].share)
