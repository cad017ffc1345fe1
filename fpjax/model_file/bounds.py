"""[bounds]: the limits between which a gain may be tuned; and a gain's name in the file as a name in the loop."""

import math
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np

from ..blocks.controllers import Limited, PositionLoop, ProportionalIntegral
from ..blocks.feedforward import AbstractFeedforward
from ..blocks.parameters import get_parameter, parameter_names
from ..errors import InputError
from ..output.json_object import JsonObject, TomlTable
from ..simulation.loop import ClosedLoop
from .keys import Units, nearest
from .observer import known_to_observer

if TYPE_CHECKING:
    from .model import Model

SECTION = "bounds"
_NOT_TUNED = ("limit", "tracking_time", "lag", "coefficients")

Bounds = Mapping[str, tuple[float, float]]


def gain_names(loop: ClosedLoop) -> dict[str, str]:
    """Names in the loop of the numbers that may be tuned, by their names in the file: no limit, no time constant."""
    return {word: name for word, name in file_names(loop).items() if word.rpartition(".")[2] not in _NOT_TUNED}


def file_names(loop: ClosedLoop) -> dict[str, str]:
    """Names in the loop by names in the file: {"controller.kp": "controller.controller.kp"} within a feed-forward.

    Of the controller, the feed-forward and the observer.
    """
    names, found = parameter_names(loop), {}
    controller, path = loop.controller, "controller"
    if isinstance(controller, AbstractFeedforward):
        for key in ("velocity", "inertia", "coulomb", "viscous", "speed", "lag"):
            found[f"feedforward.{key}"] = f"{path}.{key}"
        controller, path = controller.controller, f"{path}.controller"
    own = {}
    while isinstance(controller, Limited):
        own = {"controller.limit": f"{path}.limit"} | own
        controller, path = controller.controller, f"{path}.controller"
    if isinstance(controller, PositionLoop):
        own["controller.kp"] = f"{path}.kp"
        controller, path = controller.velocity_controller, f"{path}.velocity_controller"
        own |= {"controller.kv": f"{path}.kp", "controller.ki": f"{path}.ki"}
    else:
        own |= {f"controller.{key}": f"{path}.{key}" for key in ("kp", "ki", "gain", "zero", "pole")}
    if isinstance(controller, ProportionalIntegral):
        own |= {f"controller.{key}": f"{path}.{key}" for key in ("limit", "tracking_time")}
    found |= own
    # An observer's gains may sit deeper in the loop (in its nonlinearity, or in a wrapped observer); the file knows
    # the last word.
    for name in names:
        if name.startswith("observer."):
            found[f"observer.{name.rpartition('.')[2]}"] = name
    return {word: name for word, name in found.items() if name in names}


def loop_names(loop: ClosedLoop, values: Mapping[str, float]) -> dict[str, float]:
    """Values by name in the loop, from values by name in the loop or in the file ("feedforward.coulomb").

    Raises:
        InputError: for two names of one number.
    """
    known, words = set(parameter_names(loop)), file_names(loop)
    found: dict[str, str] = {}
    for word in values:
        name = word if word in known else words.get(word, word)
        if name in found:
            raise InputError(f"{found[name]} and {word} are one number, {name}: give one of them.")
        found[name] = word
    return {name: values[word] for name, word in found.items()}


def beliefs_kept(before: "Model", after: "Model", changed: Mapping[str, float]) -> list[str]:
    """A note for every number of the plant that was changed by name while the observer keeps the old one.

    An observer's inertia, Coulomb and viscous friction that its section does not write are taken from the plant when
    the file is read, and are numbers of their own from then on, so that a plant can differ from what is believed of it.

    Args:
        before: as read.
        after: with the changes.
        changed: values by name in the loop.
    """
    words, written = file_names(after.loop), before.sections.get("observer", {})
    old, new = known_to_observer(before.loop.plant), known_to_observer(after.loop.plant)
    said = []
    for key, unit in (("inertia", "kg m^2"), ("coulomb", "N m"), ("viscous", "N m s/rad")):
        name = words.get(f"observer.{key}")
        if name is None or name in changed or key in written or old[key] == new[key]:
            continue
        own = float(np.asarray(get_parameter(after.loop, name)))
        said.append(
            f"the observer keeps its own {key}, {own:g} {after.units.name(unit)}, as if only the machine were "
            f"another; add --set observer.{key}={new[key]:g} for an observer that knows it, as in an edited file."
        )
    return said


def read_bounds(table: Any, loop: ClosedLoop, units: Units) -> dict[str, tuple[float, float]]:
    """The bounds of [bounds], by the names in the file.

    Args:
        table: the section, as `controller.kp = [low, high]`; None without one.
        loop: the loop with these gains.
        units: of the machine.

    Raises:
        InputError: for a gain that does not exist, or an empty interval.
    """
    del units
    found: dict[str, tuple[float, float]] = {}
    known = gain_names(loop)
    for word, value in _flat(table or {}).items():
        if word not in known:
            raise InputError(f"[{SECTION}] {word} is not a gain of this loop: {nearest(word, known)}.")
        numbers = value if isinstance(value, list) else []
        plain = [isinstance(one, int | float) and not isinstance(one, bool) for one in numbers]
        if len(numbers) != 2 or not all(plain):
            raise InputError(f"[{SECTION}] {word} = {str(value)[:40]} is not [low, high]: write two numbers.")
        low, high = float(numbers[0]), float(numbers[1])
        if not (math.isfinite(high) and 0.0 <= low < high):
            raise InputError(
                f"[{SECTION}] {word} = [{low:g}, {high:g}] is not an interval: low must be zero or more and below high."
            )
        found[word] = (low, high)
    return found


def describe_bounds(bounds: Bounds) -> dict[str, list[float]]:
    """The [bounds] section."""
    return {word: [float(low), float(high)] for word, (low, high) in bounds.items()}


def _flat(table: TomlTable) -> JsonObject:
    """`controller.kp = [1, 2]` is a table in a table to TOML; "controller.kp" in quotes is not."""
    found = {}
    for key, value in table.items():
        if isinstance(value, Mapping):
            found |= {f"{key}.{name}": each for name, each in value.items()}
        else:
            found[key] = value
    return found
