"""[[learned]] <-> tables of a learned torque."""

from typing import Any

import numpy as np

from ..blocks.learned import INTERPOLATIONS, PERIODIC, VARIABLES, LearnedTorque, split_jump
from ..blocks.loads import AbstractLoad, NoLoad
from ..blocks.position_torque import Loads
from ..errors import InputError
from ..output.json_object import JsonObject, TomlTable
from .block_types import number
from .keys import Key, Units, check_keys, choose, read_values

SECTION = "learned"
UNIT_OF = {"velocity": "rad/s", "position": "rad", "torque": "N m", "time": "s"}


def build_learned(tables: Any, units: Units) -> tuple[tuple[LearnedTorque, ...], float]:
    """(the tables of [[learned]], the Coulomb level [N m] that their jumps at zero velocity amount to).

    Raises:
        InputError: for invalid keys or values.
    """
    tables = tables if isinstance(tables, list) else [] if tables is None else [tables]
    blocks, coulomb = [], 0.0
    for table in tables:
        if "of" not in table:
            raise InputError(f'[{SECTION}] of is missing: write of = "velocity", or one of {", ".join(VARIABLES)}.')
        of = choose(SECTION, "of", table["of"], VARIABLES)
        unit = UNIT_OF[of]
        keys = (Key("at", unit, many=True), Key("torque", "N m", many=True), Key("period", unit, "positive", None))
        check_keys(SECTION, table, ["of", "interpolation", *(key.name for key in keys)])
        values = read_values(SECTION, table, keys, units)
        if values["period"] is not None and of not in PERIODIC:
            raise InputError(f'[{SECTION}] of = "{of}" has no period: drop it; position and time may have one.')
        at, torque, half = values["at"], values["torque"], 0.0
        if len(at) != len(torque):
            raise InputError(
                f"[{SECTION}] at and torque have {len(at)} and {len(torque)} entries: give one torque for each point."
            )
        try:
            if of == "velocity":
                at, torque, half = split_jump(at, torque)
            written = choose(SECTION, "interpolation", table.get("interpolation", "linear"), INTERPOLATIONS)
            blocks.append(LearnedTorque(of, at, torque, values["period"], written))  # type: ignore[arg-type]
        except InputError as error:
            raise InputError(f"[{SECTION}] {str(error).removeprefix('LearnedTorque: ')}") from None
        coulomb += half
    return tuple(blocks), coulomb


def join_load(load: AbstractLoad, learned: tuple[LearnedTorque, ...]) -> AbstractLoad:
    """The known load and the learned torques as one load."""
    # a joined load is flat, so that it can be taken apart again when the model is written
    parts = () if isinstance(load, NoLoad) else load.parts if isinstance(load, Loads) else (load,)
    parts = (*parts, *learned)
    if not parts:
        return load
    return parts[0] if len(parts) == 1 else Loads(parts)


def more_coulomb(table: TomlTable, extra: float, notes: list[str], units: Units) -> TomlTable:
    """The [friction] section with a learned jump at zero velocity added to its Coulomb level.

    Args:
        table: the section.
        extra: half the jump [N m].
        notes: gets a sentence about the change.
        units: of the machine.

    Raises:
        InputError: where the Coulomb level would become negative.
    """
    if extra == 0.0:
        return table
    unit = units.name("N m")
    names = [name for name in ("coulomb", "coulomb_positive", "coulomb_negative", "static") if name in table]
    if table.get("type") == "none":
        table, names = {"type": "coulomb_viscous", "coulomb": 0.0, "viscous": 0.0}, ["coulomb"]
    table = dict(table)
    for name in names:
        value = table[name]
        if isinstance(value, bool) or not isinstance(value, int | float):
            return table  # not a number: the section's own check refuses it, with its own message
        table[name] = float(value) + extra
        if table[name] < 0.0:
            raise InputError(
                f"[{SECTION}] the torque jumps down by {-2.0 * extra:g} {unit} at zero velocity, more than twice "
                f"[friction] {name} = {value:g} {unit}: the remaining friction would be negative; check both."
            )
    if names:
        notes.append(
            f"[{SECTION}] jumps by {2.0 * extra:g} {unit} at zero velocity. That is Coulomb friction, which sticks: it "
            f"was added to [friction], now {', '.join(f'{name} = {table[name]:g} {unit}' for name in names)}."
        )
    return table


def describe_learned(parts: tuple[AbstractLoad, ...]) -> list[JsonObject]:
    """The [[learned]] tables of a load's parts."""
    tables = []
    for part in parts:
        if not isinstance(part, LearnedTorque):
            continue
        table: JsonObject = {"of": part.of}
        for name in ("at", "torque"):
            table[name] = [number(value, name) for value in getattr(part, name)]
        if part.period is not None:
            table["period"] = number(part.period, "period")
        if part.interpolation != "linear":
            table["interpolation"] = part.interpolation
        tables.append(table)
    return tables


def is_empty(part: LearnedTorque) -> bool:
    """Whether a table is zero everywhere."""
    return all(not np.any(np.asarray(value)) for value in part.torque)
