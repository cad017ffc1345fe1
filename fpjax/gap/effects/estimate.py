"""Estimate: one number with its 90 % interval and its unit."""

import math
from dataclasses import dataclass

from ...output.json_object import JsonObject

NINETY = 1.645  # half width of a 90 % interval of a normal distribution [standard deviations]


@dataclass(frozen=True)
class Estimate:
    """One number with its interval.

    Attributes:
        value: in `unit`; NaN where it is not known.
        low: lower end of the 90 % interval; NaN where it is not known.
        high: upper end of the 90 % interval; NaN where it is not known.
        unit: as in the contract (`N m s/rad`); "1" or "" for a pure number.
        at_bound: whether the fit ended at a bound of the search.
    """

    value: float
    low: float = math.nan
    high: float = math.nan
    unit: str = ""
    at_bound: bool = False

    @property
    def known(self) -> bool:
        """Whether there is a finite value."""
        return math.isfinite(self.value)

    @property
    def bounded(self) -> bool:
        """Whether both ends of the interval are finite."""
        return math.isfinite(self.low) and math.isfinite(self.high)

    def to_dict(self) -> JsonObject:
        """The contract's four keys."""
        return {"value": self.value, "low": self.low, "high": self.high, "unit": self.unit}
