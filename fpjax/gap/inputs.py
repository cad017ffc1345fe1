"""Inputs: logs and model as they are given, read and looked at before anything is fitted."""

import os
from collections.abc import Sequence
from typing import Any

from ..errors import InputError
from .record import Record


def read_logs(logs: Any) -> list[Any]:
    """One log or several, each a `Log`, a path or a mapping of arrays."""
    from ..logs import read_log

    if logs is None:
        return []
    several = isinstance(logs, Sequence) and not isinstance(logs, (str, os.PathLike))
    return [
        one if hasattr(one, "torque") and hasattr(one, "dt") else read_log(one) for one in (logs if several else [logs])
    ]


def read_model(model: Any) -> Any:
    """A `Model`, or the path or text of one."""
    from ..model_file import load_model

    return model if hasattr(model, "loop") else load_model(model)


def look_at(logs: list[Any], model: Any) -> list[str]:
    """Warnings about the logs.

    Raises:
        InputError: for a log that makes a diagnosis pointless.
    """
    from .machine import nominal_machine
    from .rigid import rigid_body
    from .suspicion import check

    body = rigid_body(nominal_machine(model.loop.plant, model.loop.actuator, model.loop.sensor))
    return [sentence for one in logs for sentence in check(one, body)]


def check_alike(records: list[Record]) -> None:
    """Logs of one machine have the same columns and one period.

    Raises:
        InputError: where they do not.
    """
    first = records[0]
    for record in records[1:]:
        if (record.velocity is None) != (first.velocity is None) or (record.position is None) != (
            first.position is None
        ):
            raise InputError(
                f"{record.name} and {first.name} do not have the same columns: give both velocity, or "
                f"position, or both."
            )
        if abs(record.dt / first.dt - 1.0) > 1e-3:
            raise InputError(
                f"{record.name} has a period of {record.dt:g} s and {first.name} of {first.dt:g} s: logs of "
                f"one machine "
                "need one period; diagnose them apart with --each."
            )
