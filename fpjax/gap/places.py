"""Places: where what a fit leaves of a log lies."""

import equinox as eqx

from ..errors import InputError
from . import assemble
from .attribute import Fitted
from .diagnosis import Where
from .locate import locate
from .machine import Machine, nominal_machine
from .rigid import RigidBody, rigid_body


def places(log, fitted: Fitted, warnings: list[str]) -> Where:
    """Where the gap between a log and a fitted machine lies.

    Args:
        log: a `fpjax.logs.Log`.
        fitted: the nominal model or one with causes in.
        warnings: grows by a sentence where no map can be made.
    """
    try:
        return locate(log, body_of(assemble.machine_of(fitted.candidate)))
    except InputError as error:
        warnings.append(f"There is no map of where the gap lies: {error}")
        return Where()


def body_of(machine: Machine) -> RigidBody:
    """The numbers of any machine of the search, whichever terms it was compiled with."""
    whole = nominal_machine(machine.plant, machine.actuator, machine.sensor)
    return rigid_body(eqx.tree_at(lambda at: at.origin, whole, machine.origin))
