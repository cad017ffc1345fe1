"""Whether a log may be diagnosed: `fpjax.logs.suspicions`, and long enough for windows to fit and to withhold."""

from collections.abc import Iterator
from typing import Any

from ..errors import InputError
from ..logs.suspicions import Suspicion
from ..logs.suspicions import suspicions as looks_wrong
from .rigid import RigidBody

SHORTEST = 256  # samples


def suspicions(log: Any, model: RigidBody | None = None) -> list[Suspicion]:
    """What speaks against a diagnosis of this log with this model; the worst first.

    Args:
        log: a `fpjax.logs.Log`, or anything with its fields.
        model: the nominal model (`fpjax.gap.rigid.rigid_body`); None to look at the log alone.
    """
    found = [*_short(log)]
    return found or looks_wrong(log, model)


def check(log: Any, model: RigidBody | None = None) -> tuple[str, ...]:
    """The warnings, as sentences.

    Raises:
        InputError: for the first suspicion that makes a diagnosis pointless.
    """
    found = suspicions(log, model)
    if found and found[0].severity == "stop":
        raise InputError(found[0].sentence)
    return tuple(suspicion.sentence for suspicion in found)


def _short(log: Any) -> Iterator[Suspicion]:
    count = len(log.time)
    if count < SHORTEST:
        yield Suspicion(
            f"{log.name}: {count} samples ({count * log.dt:.3g} s) are too few for a diagnosis, which needs at least "
            f"{SHORTEST}: record for longer.",
            "stop",
            "short",
        )
