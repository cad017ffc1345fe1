"""Corrected: the model with the causes in, as servo.toml text."""

import dataclasses
from typing import Any

from ..errors import InputError


def corrected_model(model: Any, machine: Any, step: float, warnings: list[str]) -> str:
    """The nominal model's file with the fitted machine in its place; "" where servo.toml has no words for it."""
    from ..model_file import dump_model, simplified

    sensor = machine.sensor if step == 0 else dataclasses.replace(machine.sensor, step_size=step)
    loop = dataclasses.replace(model.loop, plant=machine.plant, actuator=machine.actuator, sensor=sensor)
    try:
        return dump_model(simplified(model, loop))
    except InputError as error:
        warnings.append(f"The corrected model has no words in servo.toml: {error}")
        return ""
