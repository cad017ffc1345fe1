"""Model -> servo.toml: the sections with their numbers, and the text."""

import dataclasses
from collections.abc import Mapping

from ..output import toml_text
from ..output.json_object import JsonObject
from . import body
from .bounds import describe_bounds
from .controller import describe_controller, describe_feedforward
from .friction import describe_friction
from .keys import Units
from .learned import describe_learned
from .model import Model
from .observer import describe_observer
from .reference import describe_reference


def dump_model(model: Model, *, comments: Mapping[tuple[str, str], str] | None = None) -> str:
    """A model as servo.toml text; `load_model` of it gives the same numbers to the last bit.

    The log of a recorded reference is named by its absolute path, so that the text may be saved in any folder.

    Args:
        model: the model, its loop perhaps replaced (`dataclasses.replace(model, loop=...)`).
        comments: by (section, key), a comment after the value.

    Raises:
        InputError: for a block that the file cannot hold.
    """
    return toml_text.write(describe_model(model), comments)


def describe_model(model: Model) -> JsonObject:
    """A model's sections with their numbers, in the order of the file.

    Raises:
        InputError: for a block that the file cannot hold.
    """
    loop, written = model.loop, model.sections
    folder = None if model.path is None else model.path.parent
    loads, offset = body.describe_load(loop.plant.load)
    friction = describe_friction(loop.plant.friction)
    if offset:
        friction["offset"] = offset
    plants = body.describe_plant(loop.plant)
    actuator = body.describe_actuator(loop.actuator)
    controller = loop.controller if model.controller_known else None
    # keys at their default value are left out, so that a written file is as short as a hand-made one
    simulation: JsonObject = {"dt": model.dt}
    if model.duration is not None:
        simulation["duration"] = model.duration
    simulation |= {"stepping": model.stepping, "solver": model.solver}
    if model.substeps != 1:
        simulation["substeps"] = model.substeps
    sections: JsonObject = {
        "units": _write_units(model.units),
        "plant": plants["plant"],
        "transmission": plants.get("transmission"),
        "friction": friction,
        "load": loads[0] if len(loads) == 1 else loads,
        "learned": describe_learned(body.flat_loads(loop.plant.load)),
        "actuator": actuator,
        "sensor": body.describe_sensor(loop.sensor),
        "controller": describe_controller(controller, written.get("controller", {})),
        "feedforward": describe_feedforward(controller),
        "observer": describe_observer(loop.observer),
        "reference": describe_reference(model.reference, written.get("reference", {}), folder),
        "simulation": simulation,
        "bounds": describe_bounds(model.bounds),
        "limits": dict(model.limits),
    }
    return {name: table for name, table in sections.items() if table}


def _write_units(units: Units) -> dict[str, str]:
    default = Units(torque="N" if units.motion == "linear" else "N m")
    return {key: value for key, value in dataclasses.asdict(units).items() if value != getattr(default, key)}
