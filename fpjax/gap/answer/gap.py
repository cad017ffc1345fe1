"""The sim-to-real gap as numbers: the missing torque before and after, and after each cause, with intervals."""

import math
from dataclasses import dataclass, replace

import numpy as np

from ...logs.arrays import Numbers, Values
from ...output.json_object import JsonObject
from ..effects.estimate import Estimate
from ..thresholds import THRESHOLDS


def closed(before: Numbers | float, after: Numbers | float, floor: float) -> Values:
    """(before - after) / (before - floor) [1], at most 1, and 0 where `before` is not above the noise; elementwise."""
    room = np.asarray(before - floor)
    return np.where(room > 0.0, np.minimum((before - after) / np.where(room > 0.0, room, 1.0), 1.0), 0.0)


@dataclass(frozen=True)
class Gap:
    """The sim-to-real gap: rms of the missing torque over withheld windows, noise's share taken out; 90 % intervals.

    The missing torque is the torque that would have to be added to the command for the model to move as measured.


    Attributes:
        unit: of before, after and noise_floor: N m, or N of a linear axis.
        before: with the nominal model as it was given.
        after: with the causes in.
        noise_floor: the gap that noise alone would exceed in one log out of twenty.
        closed: (before - after) / (before - noise_floor) [1], at most 1; 0 where `before` is not above the noise.
        before_interval: (low, high), by a bootstrap over windows.
        after_interval: likewise.
        noise_floor_interval: both ends are the floor: it is computed, not measured.
        closed_interval: by the same bootstrap.
        learned: with the learned laws beside the causes; NaN where none was learned.
        learned_interval: by the same bootstrap.
        closed_moving: share closed [1] of the part that moves the machine: each frequency of the missing torque weighed
            by the speed that a torque there makes, so that vibration hardly counts; the smaller of that on all and that
            on withheld windows, noise not taken off; NaN where it is not known.
    """

    unit: str
    before: float
    after: float
    noise_floor: float
    closed: float
    before_interval: tuple[float, float]
    after_interval: tuple[float, float]
    noise_floor_interval: tuple[float, float]
    closed_interval: tuple[float, float]
    learned: float = math.nan
    learned_interval: tuple[float, float] = (math.nan, math.nan)
    closed_moving: float = math.nan

    @property
    def rest_vibrates(self) -> bool:
        """Whether most of what is left hardly moves the machine: far more is closed of the part that does."""
        return 1.0 - self.closed_moving < THRESHOLDS.part * (1.0 - self.closed)

    def unchanged(self) -> "Gap":
        """The same before, with nothing of the machine changed: what is wrong makes no torque."""
        return replace(
            self, after=self.before, after_interval=self.before_interval, closed=0.0, closed_interval=(0.0, 0.0),
            closed_moving=0.0,
        )  # fmt: skip

    def estimate(self, name: str) -> Estimate:
        """`before`, `after`, `learned`, `noise_floor` or `closed` with its interval."""
        unit = "" if name == "closed" else self.unit
        low, high = getattr(self, f"{name}_interval")
        return Estimate(getattr(self, name), low, high, unit)

    def to_dict(self) -> JsonObject:
        """The contract's keys, `learned`, `closed_moving`, and the intervals."""
        names = ("before", "after", "learned", "noise_floor", "closed")
        numbers = {name: getattr(self, name) for name in names}
        interval = {name: list(getattr(self, f"{name}_interval")) for name in names}
        moving = {"closed_moving": self.closed_moving}
        return {"signal": "torque", "unit": self.unit, **numbers, **moving, "interval": interval}


@dataclass(frozen=True)
class Step:
    """One step from the nominal to the corrected model: the gap with this effect added to those before it.

    Attributes:
        added: name of the effect: a cause, or, behind the causes, a detail that the corrected model holds.
        gap_after: missing torque on withheld windows, in the gap's unit.
        interval: 90 % bootstrap interval of gap_after.
    """

    added: str
    gap_after: float
    interval: tuple[float, float]

    def to_dict(self) -> JsonObject:
        """The contract's keys, and the interval."""
        return {"added": self.added, "gap_after": self.gap_after, "interval": list(self.interval)}
