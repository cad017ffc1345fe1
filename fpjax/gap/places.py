"""Places: where the gap of a fit lies, and the experiment that would tell its rivals apart."""

from typing import Any

from . import assemble
from .attribute import Fitted, Search
from .diagnosis import Ranked
from .record import Record


def places(log: Any, search: Search, fitted: Fitted, warnings: list[str]) -> Any:
    """Where what a fit leaves of a log lies."""
    from .diagnosis import Where
    from .locate import locate
    from .machine import nominal_machine
    from .rigid import rigid_body

    try:
        if fitted.names:
            body = rigid_body(_full(assemble.machine_of(fitted.candidate)))
        else:
            nominal = search.nominal
            body = rigid_body(nominal_machine(nominal.plant, nominal.actuator, nominal.sensor))
        return locate(log, body)
    except Exception as error:
        warnings.append(f"The map of where the gap lies could not be drawn ({type(error).__name__}: {error}).")
        return Where()


def _full(machine: Any) -> Any:
    from .machine import nominal_machine

    full = nominal_machine(machine.plant, machine.actuator, machine.sensor)
    return full


def experiments(ranking: tuple[Ranked, ...], record: Record) -> tuple[Any, ...]:
    """For the effects that this log cannot tell apart."""
    try:
        from .experiment import next_experiment
    except ImportError:
        return ()
    pairs = [(entry.effect, other) for entry in ranking[:3] for other in entry.indistinguishable_from]
    unique = [pair for i, pair in enumerate(pairs) if set(pair) not in [set(p) for p in pairs[:i]]]
    return tuple(next_experiment(unique))
