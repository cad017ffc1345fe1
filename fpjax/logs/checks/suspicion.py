"""A suspicion about a log, and the nominal model that a log is compared with."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal, Protocol, runtime_checkable

import numpy as np

# factor by which a column is too large when it was read as SI: (unit of a rotary axis, of a linear axis)
UNITS = {
    180.0 / np.pi: ("deg/s", ""),
    30.0 / np.pi: ("rpm", ""),
    0.5 / np.pi: ("rev/s", ""),
    1000.0: ("mrad/s", "mm/s"),
    100.0: ("", "cm/s"),
    0.001: ("krad/s", "km/s"),
}
# the same of a velocity against the rate of a position, where both columns are in other units
PAIRS = {
    1.0 / 6.0: ("rpm", "deg"),
    60.0: ("rpm", "rev"),
    1.0 / 360.0: ("rev/s", "deg"),
    360.0: ("deg/s", "rev"),
}
LIKE_PAIR = 0.02  # relative deviation from such a factor: 1 / 6 is 5 % beside that of rev/s
LIKE = 0.08  # relative deviation from such a factor: a regression on noisy data finds it to a few percent


@runtime_checkable
class Expected(Protocol):
    """The nominal parameters that a log is compared with: a machine model, or `Numbers`.

    It may have a `load`: known load torque that the motor must hold [N m], a function of (velocity, position, time).
    """

    @property
    def inertia(self) -> float:
        """J [kg m^2]."""
        ...

    @property
    def coulomb(self) -> float:
        """k [N m]; 0 where it is not to be compared."""
        ...

    @property
    def viscous(self) -> float:
        """b [N m s/rad]; 0 where it is not to be compared."""
        ...


@dataclass(frozen=True)
class Numbers:
    """Numbers to compare a log with.

    Attributes:
        inertia: J [kg m^2].
        coulomb: k [N m]; 0 where it is not to be compared.
        viscous: b [N m s/rad]; 0 where it is not to be compared.
        load: known load torque that the motor must hold [N m], a function of (velocity, position, time); None without.
    """

    inertia: float
    coulomb: float = 0.0
    viscous: float = 0.0
    load: Callable[[np.ndarray, np.ndarray, np.ndarray], np.ndarray] | None = None


@dataclass(frozen=True)
class Suspicion:
    """One thing that looks wrong.

    Attributes:
        sentence: what it is, with the number, and what to do; the log's name first.
        severity: "stop" where nothing can be computed from the log, else "warn".
        kind: one of unit, sign, swapped, still, one_way, short, machine, nominal, clipped, repeated, clock, stamps,
            missing, inconsistent, compensated, counts, magnitude, scale, time, reference.
    """

    sentence: str
    severity: Literal["stop", "warn"]
    kind: str


def pair_of(factor: float) -> tuple[str, str] | None:
    """The units of a velocity and a position of a rotary axis whose ratio to its rate is this factor, or None."""
    return next((units for size, units in PAIRS.items() if abs(factor / size - 1.0) < LIKE_PAIR), None)


def unit_of(factor: float, *, linear: bool) -> str | None:
    """The unit in which a column must have been recorded to be this factor too large as SI, or None."""
    for size, names in UNITS.items():
        name = names[linear]
        if name and abs(factor / size - 1.0) < LIKE:
            return name
    return None
