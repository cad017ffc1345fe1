"""[friction] <-> a friction law: the plain laws, and the general law with the terms that a corrected model may add."""

from typing import Any

import numpy as np

from ..blocks.friction import (
    AbstractFriction,
    AsymmetricCoulombViscous,
    Coulomb,
    CoulombViscous,
    CoulombViscousStiction,
    Dahl,
    LuGre,
    NoFriction,
    SmoothCoulomb,
    Stribeck,
    Viscous,
)
from ..blocks.friction.bristles import Bristles
from ..blocks.friction.general import GeneralFriction
from ..errors import InputError
from ..output.json_object import JsonObject, TomlTable
from .admissible import check_levels
from .block_types import Form, form_for, form_of, number, numbers, pick
from .keys import Key, Units, check_keys, missing, read_number, read_values

SECTION = "friction"
COULOMB = Key("coulomb", "N m", "not negative")
VISCOUS = Key("viscous", "N m s/rad", "not negative")
_STATIC = Key("static", "N m", "not negative")
_STEEP = Key("steepness", "s/rad", "positive", None)

FORMS = (
    Form("coulomb_viscous", CoulombViscous, (COULOMB, VISCOUS, _STEEP)),
    Form(
        "stribeck",
        Stribeck,
        (
            COULOMB,
            _STATIC,
            Key("stribeck_velocity", "rad/s", "positive"),
            Key("viscous", "N m s/rad", "not negative", 0.0),
            Key("exponent", "1", "positive", 2.0),
            _STEEP,
        ),
    ),
    Form(
        "stiction",
        CoulombViscousStiction,
        (
            COULOMB,
            _STATIC,
            Key("viscous", "N m s/rad", "not negative", 0.0),
            Key("stick_velocity", "rad/s", "positive", 1e-3),
            _STEEP,
        ),
    ),
    Form(
        "dahl",
        Dahl,
        (
            Key("coulomb", "N m", "positive"),
            Key("stiffness", "N m/rad", "positive"),
            Key("exponent", "1", "positive", 1.0),
            Key("viscous", "N m s/rad", "not negative", 0.0),
        ),
    ),
    Form(
        "lugre",
        LuGre,
        (
            Key("coulomb", "N m", "positive"),
            Key("static", "N m", "positive"),
            Key("stribeck_velocity", "rad/s", "positive"),
            Key("bristle_stiffness", "N m/rad", "positive"),
            Key("bristle_damping", "N m s/rad", "not negative", 0.0),
            Key("viscous", "N m s/rad", "not negative", 0.0),
            Key("exponent", "1", "positive", 2.0),
        ),
    ),
    Form("none", NoFriction, ()),
)

DIRECTION = (
    Key("coulomb_positive", "N m", "not negative"),
    Key("coulomb_negative", "N m", "not negative"),
    Key("viscous_positive", "N m s/rad", "not negative"),
    Key("viscous_negative", "N m s/rad", "not negative"),
    _STEEP,
)
# The terms that a corrected model may add to coulomb_viscous, each at its neutral value by default.
GENERAL = (
    COULOMB,
    VISCOUS,
    Key("coulomb_difference", "N m", default=0.0),
    Key("viscous_difference", "N m s/rad", default=0.0),
    Key("stribeck_torque", "N m", default=None),
    Key("stribeck_velocity", "rad/s", "positive", 1.0),
    Key("stribeck_exponent", "1", "positive", 2.0),
    Key("position_cosine", "N m", default=(), many=True),
    Key("position_sine", "N m", default=(), many=True),
    Key("position_periods", "1/rev", "positive", 1.0),
    Key("drift_amplitude", "N m", default=None),
    Key("drift_time", "s", "positive", 1.0),
    Key("drag_coefficient", "N m s^2/rad^2", default=0.0),
    Key("load_coefficient", "1", "share", None),
    _STEEP,
)
BRISTLES = (
    Key("bristle_deflection", "rad", "positive", field="deflection"),
    Key("bristle_damping", "N m s/rad", "not negative", 0.0, "damping"),
    Key("bristle_exponent", "1", "positive", 1.0, "exponent"),
)
OFFSET = Key("offset", "N m", "any", 0.0)
_PLAIN = ("coulomb", "viscous", "steepness")
_ADDED = [key.name for key in GENERAL if key.name not in _PLAIN]


def build_friction(table: TomlTable, units: Units, steepness: "Steepness") -> AbstractFriction:
    """The law of a [friction] section without its offset.

    Args:
        table: the section.
        units: of the machine.
        steepness: chooses one where none is written.

    Raises:
        InputError: for invalid keys or values.
    """
    # `offset` is a constant torque and no friction: the model keeps it as a load (friction depends on the direction
    # of motion)
    table = {key: value for key, value in table.items() if key != "offset"}
    name = form_of(SECTION, table, FORMS)
    sign = table.get("steepness") == "sign"
    if sign:
        table.pop("steepness")
    # One type for four laws: a corrected model adds keys to the section that the user wrote, without another type in
    # it.
    if name == "coulomb_viscous":
        law = _coulomb_viscous(table, units)
    else:
        if {"static", "coulomb"} <= set(table):  # checked here, where the message can name section, key and unit
            static, coulomb = (read_number(SECTION, key, table[key.name], units) for key in (_STATIC, COULOMB))
            check_levels(static, coulomb, units.name)
        law = pick(FORMS, name).build(SECTION, table, units)
    if sign and "steepness" not in type(law).__dataclass_fields__ and not isinstance(law, Bristles):
        raise InputError(f'[{SECTION}] steepness = "sign" has no meaning for type = {name!r}: drop it.')
    return law if sign else steepness.into(law)


def _coulomb_viscous(table: TomlTable, units: Units) -> AbstractFriction:
    """The plainest law that holds the keys written: by direction, general, or plain; within bristles if asked for."""
    bristles = [key.name for key in BRISTLES]
    every = ["type", *_PLAIN, *_ADDED, *(key.name for key in DIRECTION), *bristles, OFFSET.name]
    check_keys(SECTION, table, dict.fromkeys(every))
    own = {key: value for key, value in table.items() if key not in bristles}
    split = [key.name for key in DIRECTION if key.name != "steepness" and key.name in table]
    added = [key for key in _ADDED if key in own]
    hairy = bool(set(bristles) & set(table))
    if split and not added and not hairy:
        law: AbstractFriction = _directions(own, units)
    elif split or added or hairy:
        law = _general(own, units, split)
    else:
        law = pick(FORMS, "coulomb_viscous").build(SECTION, own, units)
    if hairy:
        values = read_values(SECTION, table, BRISTLES, units)
        law = Bristles(law, **{key.attribute: values[key.name] for key in BRISTLES})  # type: ignore[arg-type]
    return law


def _level(table: TomlTable, name: str, units: Units) -> tuple[float, float]:
    """(positive, negative) of coulomb or viscous, from the two directions or from the one value."""
    keys = {key.name: key for key in (*DIRECTION, COULOMB, VISCOUS)}
    sides = (f"{name}_positive", f"{name}_negative")
    given = [side for side in sides if side in table]
    if given and name in table:
        raise InputError(
            f"[{SECTION}] has both {name} and {given[0]}: write {name} alone, or {sides[0]} and {sides[1]}."
        )
    if not given:
        if name not in table:
            raise InputError(missing(SECTION, keys[name], table, units))
        value = read_number(SECTION, keys[name], table[name], units)
        return value, value
    for side in sides:
        if side not in table:
            raise InputError(missing(SECTION, keys[side], table, units))
    positive, negative = (read_number(SECTION, keys[side], table[side], units) for side in sides)
    return positive, negative


def _directions(table: TomlTable, units: Units) -> AsymmetricCoulombViscous:
    coulomb, viscous = _level(table, "coulomb", units), _level(table, "viscous", units)
    steepness = read_values(SECTION, table, (_STEEP,), units)["steepness"]
    return AsymmetricCoulombViscous(*coulomb, *viscous, steepness)


def _general(table: TomlTable, units: Units, split: list[str]) -> GeneralFriction:
    table = dict(table)
    for name in ("coulomb", "viscous"):
        if any(key.startswith(name) for key in split):
            if f"{name}_difference" in table:
                raise InputError(
                    f"[{SECTION}] has both {name}_difference and {name}_positive: write one of the two ways."
                )
            positive, negative = _level(table, name, units)
            table[name], table[f"{name}_difference"] = 0.5 * (positive + negative), 0.5 * (positive - negative)
    values = read_values(SECTION, table, GENERAL, units)
    cosine, sine = values["position_cosine"], values["position_sine"]
    if len(cosine) != len(sine):
        raise InputError(
            f"[{SECTION}] position_cosine and position_sine have {len(cosine)} and {len(sine)} entries: give each "
            f"harmonic one of both (0.0 where there is none)."
        )
    if "stribeck_torque" in table and "stribeck_velocity" not in table:
        raise InputError(missing(SECTION, Key("stribeck_velocity", "rad/s"), table, units))
    return general_friction(values)


def general_friction(values: TomlTable) -> GeneralFriction:
    """A `GeneralFriction` from values by name, its harmonics as array leaves."""
    from ..blocks.block import as_parameter

    fields = dict(values)
    for part in ("position_cosine", "position_sine"):
        fields[part] = tuple(as_parameter(value) for value in fields[part])
    return GeneralFriction(**fields)


class Steepness:
    """Chooses a steepness where the file gives none, and keeps a note about it.

    Attributes:
        inertia: of the body on which the friction acts [kg m^2].
        dt: solver step [s].
        solver: the solver.
        largest: torque limit of the actuator [N m], for a level that grows with the torque; None where there is none.
        note: a sentence for the user, once a steepness was chosen.
    """

    LARGEST = 1e6  # [s/rad] where there is no Coulomb friction, and so no limit by the solver's step

    def __init__(self, inertia: float, dt: float, solver: Any, units: Units, largest: float | None = None) -> None:
        self.largest = largest
        self.inertia, self.dt, self.solver, self.units = inertia, dt, solver, units
        self.note: str | None = None

    def into(self, law: AbstractFriction) -> AbstractFriction:
        """The law with a steepness."""
        import equinox as eqx

        if self.solver.name == "exact":
            return law  # the exact solver takes the set-valued law
        if isinstance(law, Bristles):
            return law  # its level builds up with travel, so there is no sign function to smooth
        if "steepness" not in type(law).__dataclass_fields__ or getattr(law, "steepness", 1.0) is not None:
            return law
        return eqx.tree_at(
            lambda at: at.steepness,
            law,
            _leaf(self.choose(largest_level(law, self.largest))),
            is_leaf=lambda x: x is None,
        )

    def choose(self, coulomb: float) -> float:
        """A safe one [s/rad], to three digits."""
        from ..simulation.stability import safe_steepness

        chosen = min(safe_steepness(self.inertia, coulomb, self.dt, self.solver), self.LARGEST)
        chosen = float(f"{chosen:.3g}")
        self.note = (
            f"[friction] steepness is not given: {chosen:g} {self.units.name('s/rad')} was chosen, half of what "
            f"{self.solver.name} can follow at a step of {self.dt:g} s."
        )
        return chosen


def largest_level(law: Any, torque: float | None = None) -> float:
    """Largest set-valued torque [N m] of a law, for its steepness.

    Args:
        law: the law.
        torque: the largest torque through the gear [N m]; None for the torque that moves it at constant speed.
    """
    if isinstance(law, GeneralFriction):
        level = abs(float(law.coulomb)) + abs(float(law.coulomb_difference))
        pairs = zip(law.position_cosine, law.position_sine, strict=True)
        ripple = sum(float(np.hypot(float(c), float(s))) for c, s in pairs)
        extras = (law.stribeck_torque, law.drift_amplitude)
        level += ripple + sum(abs(float(each)) for each in extras if each is not None)
        share = 0.0 if law.load_coefficient is None else abs(float(law.load_coefficient))
        # At constant speed T = level + mu T, so the level with its load-dependent part is level / (1 - mu).
        return level / (1.0 - share) if torque is None else level + share * torque
    names = ("coulomb", "static", "coulomb_positive", "coulomb_negative")
    return max((float(getattr(law, name)) for name in names if hasattr(law, name)), default=0.0)


def describe_friction(law: AbstractFriction) -> JsonObject:
    """The [friction] section of a law.

    Raises:
        InputError: for a law that servo.toml cannot hold.
    """
    plain: dict[type, Any] = {
        Coulomb: lambda at: CoulombViscous(coulomb=at.coulomb, viscous=0.0),
        SmoothCoulomb: lambda at: CoulombViscous(coulomb=at.coulomb, viscous=0.0, steepness=at.steepness),
        Viscous: lambda at: CoulombViscous(coulomb=0.0, viscous=at.viscous),
    }
    if type(law) in plain:
        law = plain[type(law)](law)
    if isinstance(law, Bristles):
        table = describe_friction(law.law)
        if not isinstance(law.law, GeneralFriction | CoulombViscous | AsymmetricCoulombViscous):
            raise InputError(
                f"servo.toml cannot hold bristles within {type(law.law).__name__}: keep such a loop in Python."
            )
        if table.get("steepness") == "sign":  # the default with bristles
            del table["steepness"]
        return table | numbers(law, BRISTLES)
    if isinstance(law, AsymmetricCoulombViscous):
        table = {"type": "coulomb_viscous", **numbers(law, DIRECTION)}
    elif isinstance(law, GeneralFriction):
        table = {"type": "coulomb_viscous", **numbers(law, [key for key in GENERAL if not key.many])}
        if "stribeck_torque" in table:
            table["stribeck_velocity"] = number(law.stribeck_velocity, "stribeck_velocity")
        harmonics = (law.position_cosine, law.position_sine)
        if law.position_cosine:
            for part, values in zip(("position_cosine", "position_sine"), harmonics, strict=True):
                table[part] = [number(value, part) for value in values]
    else:
        table = form_for(law, FORMS, SECTION).describe(law)
    if getattr(law, "steepness", 1.0) is None:
        table["steepness"] = "sign"
    return table


def _leaf(value: float) -> Any:
    from ..blocks.block import as_parameter

    return as_parameter(value)
