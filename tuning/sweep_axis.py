"""One axis of a sweep."""

import dataclasses
from collections.abc import Mapping, Sequence

import numpy as np

from fpjax.errors import InputError

from .parameters import Scale

Paths = Mapping[str, Mapping[str, Sequence[float]]]  # method -> parameter name -> its value after each iteration


@dataclasses.dataclass(frozen=True)
class Axis:
    """One axis of a sweep.

    Attributes:
        name: dotted name of a parameter, as "observer.gain_1".
        low: first value, in the parameter's unit.
        high: last value, in the parameter's unit.
        count: number of values.
        scale: "log" or "linear" spacing.
    """

    name: str
    low: float
    high: float
    count: int
    scale: Scale = "log"

    @property
    def values(self) -> np.ndarray:
        """The values, in the parameter's unit, shape (count,)."""
        if self.scale == "log":
            return np.geomspace(self.low, self.high, self.count)
        return np.linspace(self.low, self.high, self.count)

    def check(self) -> None:
        """Raise `InputError` for an invalid axis."""
        if self.scale not in ("log", "linear"):
            raise InputError(f"{self.name}: scale = {self.scale!r} is not known: choose 'log' or 'linear'.")
        if self.count < 1:
            raise InputError(f"{self.name}: count = {self.count} leaves nothing to sweep: give at least 1.")
        if not (np.isfinite(self.low) and np.isfinite(self.high)):
            raise InputError(f"{self.name}: from {self.low:g} to {self.high:g} is not finite: give two numbers.")
        if self.scale == "log" and not self.low > 0.0:
            raise InputError(
                f"{self.name}: low must be above zero on a log scale, got {self.low:g}; or take a linear scale "
                "(scale='linear', or :linear at the end of --axis)."
            )
        if not (self.low < self.high or (self.count == 1 and self.low == self.high)):
            raise InputError(
                f"{self.name}: the range from {self.low:g} to {self.high:g} is empty: give a low below the high."
            )
