"""Inputs: logs and model as they are given, read and looked at before anything is fitted."""

import os
from collections.abc import Sequence
from typing import Any

from ...errors import InputError
from ...logs import Log, read_log
from ...logs.suspicions import Numbers, suspicions
from ...model_file import Model, load_model
from .setting import turns_with_position

SAME_PERIOD = 1e-3  # relative


def read_logs(logs: Any) -> list[Log]:
    """One log or several, each a `Log`, a path or a mapping of arrays."""
    if logs is None:
        return []
    several = isinstance(logs, Sequence) and not isinstance(logs, (str, os.PathLike))
    return [one if isinstance(one, Log) else read_log(one) for one in (logs if several else [logs])]


def read_model(model: Any) -> Model:
    """A `Model`, or the path or text of one."""
    return model if isinstance(model, Model) else load_model(model)


def look_at(logs: Sequence[Log], model: Model) -> list[str]:
    """Warnings about the logs.

    Raises:
        InputError: for a log that nothing can be computed from.
    """
    # A load that turns with the position looks like an inertia to a regression without it.
    numbers = None
    if not turns_with_position(model.loop.plant.load):
        inertia, coulomb, viscous = (model.nominal.get(name, 0.0) for name in ("inertia", "coulomb", "viscous"))
        numbers = Numbers(inertia, coulomb, viscous)
    found = [one for log in logs for one in suspicions(log, numbers)]
    for one in found:
        if one.severity == "stop":
            raise InputError(one.sentence)
    late = [
        f"{log.name} has a period of {log.dt:g} s and the model [simulation] dt = {model.dt:g} s: the corrected model "
        f"keeps the model's; write dt = {log.dt:g} there to simulate the loop as it ran."
        for log in logs
        if abs(log.dt / model.dt - 1.0) > SAME_PERIOD
    ]
    return [*(one.sentence for one in found), *late]
