"""What a machine may have beside its causes: wrong numbers, a known load that is wrong, a torque recorded late."""

from .effect import Effect
from .parameters import NOMINAL, TORQUE_LATE, UNBALANCE
from .vocabulary import EFFECTS

LATE_TORQUE = Effect("late_torque", (TORQUE_LATE,), features=(), starts=lambda s: [{"actuator_delay": -0.8 * s.dt}])
"""A torque recorded after it acted, as one that the drive measures and filters: a dead time below zero.

It is an error of the log and no cause of a gap, so that it is not among `EFFECTS` (`fpjax.gap.select.late_torque`).
"""


NOMINAL_VALUES = Effect("nominal", NOMINAL, features=())
"""The nominal model's own numbers, which every family holds."""

LOAD_ERROR = Effect("load_error", UNBALANCE, features=("torque",))
"""The error of a known load that turns, which the families of such a machine hold."""


def names_of_own(effects: tuple[Effect, ...]) -> tuple[str, ...] | None:
    """Names of effects that are all the package's, so that the name tells the effect; None where one is a user's."""
    own = {effect.name: effect for effect in (*EFFECTS, LATE_TORQUE, NOMINAL_VALUES, LOAD_ERROR)}
    return tuple(e.name for e in effects) if all(own.get(e.name) is e for e in effects) else None
