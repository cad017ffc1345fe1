"""What a suspicion is, and what a log is compared with."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal, Protocol

import numpy as np

UNITS = {  # factor by which a column is too large: (rotary name, linear name)
    180.0 / np.pi: ("deg/s", ""),
    30.0 / np.pi: ("rpm", ""),
    0.5 / np.pi: ("rev/s", ""),
    1000.0: ("mrad/s", "mm/s"),
    100.0: ("", "cm/s"),
    0.001: ("krad/s", "km/s"),
}
LIKE = 0.08  # relative


class Expected(Protocol):
    """What the nominal model says: `fpjax.gap.rigid.RigidBody`, or `Numbers`.

    It may have a `load`: known torque that the motor must hold [N m] by (velocity, position, time).
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
        load: known torque that the motor must hold [N m] by (velocity, position, time); None without.
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
        severity: "stop" or "warn".
        kind: a word for it: unit, sign, swapped, still, one_way, short, nominal, clipped, repeated, clock, missing,
            inconsistent, compensated.
    """

    sentence: str
    severity: Literal["stop", "warn"]
    kind: str


def unit_of(factor: float, *, linear: bool) -> str | None:
    """The unit whose size is this factor, or None."""
    for size, names in UNITS.items():
        name = names[linear]
        if name and abs(factor / size - 1.0) < LIKE:
            return name
    return None
