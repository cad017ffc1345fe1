"""The corrected model: the nominal one with the causes in, as a loop and as servo.toml text."""

import dataclasses

from ...errors import InputError
from ...model_file import Model, dump_model, simplified
from ...simulation.loop import ClosedLoop
from ..machine import Machine


def corrected_loop(model: Model, machine: Machine, step: float = 0.0) -> ClosedLoop:
    """The model's loop around a fitted machine.

    Args:
        model: the nominal one.
        machine: as fitted.
        step: rounding step of the rate reading [rad/s] where it is seen; 0 to keep the sensor as fitted.
    """
    sensor = machine.sensor if step == 0 else dataclasses.replace(machine.sensor, step_size=step)
    return dataclasses.replace(model.loop, plant=machine.plant, actuator=machine.actuator, sensor=sensor)


def corrected_model(model: Model, machine: Machine, step: float = 0.0) -> tuple[str, str]:
    """(servo.toml text of the corrected model, ""), or ("", why it cannot be written as servo.toml).

    Args:
        model: the nominal one: stepping, units, controller and reference are kept.
        machine: as fitted.
        step: as for `corrected_loop`.
    """
    try:
        return dump_model(simplified(model, corrected_loop(model, machine, step))), ""
    except InputError as error:
        return "", f"The corrected model cannot be written as servo.toml: {error}"
