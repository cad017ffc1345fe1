"""Dominant: the one recorded variable that the missing torque is a law of, if there is one, whatever the law's name."""

from collections.abc import Iterable, Mapping
from dataclasses import asdict, dataclass

from ...output.json_object import JsonObject
from ..thresholds import THRESHOLDS, Thresholds


@dataclass(frozen=True)
class Curve:
    """What a table of one recorded variable holds of what the nominal model lacks, its numbers free.

    Attributes:
        share: of the energy of the missing torque, as far as it moves the machine [1].
        evidence: on windows left out of its fit, of the median fold for all of them [nats].
    """

    share: float
    evidence: float


@dataclass(frozen=True)
class DominantVariable:
    """The one recorded variable that the missing torque is a law of.

    Shares are of the energy of what the nominal model lacks with its numbers free, at the measured motion, each
    frequency weighed by how far it moves the machine.

    Attributes:
        of: "velocity", "position", "torque" or "time".
        share: that a table of it holds alone [1].
        next: that a table of any other variable holds at most [1].
        named: that the named causes hold [1].
    """

    of: str
    share: float
    next: float
    named: float = 0.0

    def to_dict(self) -> JsonObject:
        """All of it, by name."""
        return asdict(self)


def dominant(curves: Mapping[str, Curve], t: Thresholds = THRESHOLDS) -> DominantVariable | None:
    """The variable whose table alone holds most of the missing torque, and far more than any other's; None for none."""
    ordered = sorted(curves.items(), key=lambda item: -item[1].share)
    if not ordered:
        return None
    (first, own), rest = ordered[0], max((curve.share for _, curve in ordered[1:]), default=0.0)
    sure = own.evidence > t.decisive and own.share > t.curve and own.share - rest > t.curve_ahead
    return DominantVariable(first, own.share, rest) if sure else None


def believed(curves: Mapping[str, Curve], followed: Iterable[str], t: Thresholds = THRESHOLDS) -> float:
    """What a name keeps of its worth [1]: all, but where another variable than those it follows is dominant.

    A name that says nothing of what it follows, or follows what no table could be made of, keeps it too.
    """
    found, followed = dominant(curves, t), [variable for variable in followed if variable in curves]
    if found is None or not followed or found.of in followed:
        return 1.0
    return max(max(curves[variable].share for variable in followed) / found.share, 1.0 - found.share)
