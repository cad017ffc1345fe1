"""[plant], [transmission], [load], [actuator] and [sensor] <-> their blocks."""

from typing import Any

import numpy as np

from ..blocks.actuators import AbstractActuator, Actuator, IdealActuator
from ..blocks.friction import AbstractFriction, Dahl, LuGre
from ..blocks.friction.bristles import Bristles
from ..blocks.learned import LearnedTorque
from ..blocks.loads import AbstractLoad, NoLoad, Unbalance
from ..blocks.plants import AbstractPlant, OneMass, SeriesTwoMass, TwoMass
from ..blocks.plants.transmission import Transmission
from ..blocks.position_torque import ConstantTorque, Loads, PositionTorque
from ..blocks.sensors import AbstractSensor, Encoder, Gyro, IdealSensor, KalmanFusion
from ..blocks.servo_sensor import ServoSensor
from ..errors import InputError
from ..output.json_object import JsonObject, TomlTable
from ..simulation.histories import periods_of
from .block_types import Form, form_for, form_of, number, numbers, pick
from .keys import Key, Units, check_keys, choose, read_number, read_values

_TWO_MASS = (
    Key("motor_inertia", "kg m^2", "positive"),
    Key("load_inertia", "kg m^2", "positive"),
    Key("stiffness", "N m/rad", "positive"),
    Key("damping", "N m s/rad", "not negative", 0.0),
)
PLANTS = (
    Form("one_mass", OneMass, (Key("inertia", "kg m^2", "positive"),)),
    Form("two_mass", TwoMass, _TWO_MASS),
    Form("series_two_mass", SeriesTwoMass, _TWO_MASS),
)
TRANSMISSION = (
    Key("stiffness", "N m/rad", "positive"),
    Key("damping", "N m s/rad", "not negative", 0.0),
    Key("backlash", "rad", "not negative", 0.0, "gap"),
    Key("load_share", "1", "positive", 0.5),
    Key("friction_share", "1", "share", 1.0),
    Key("hardening", "N m/rad^3", "not negative", 0.0),
    Key("viscous_share", "1", "share", None),
)
ACTUATOR = (
    Key("gain", "1", "positive", None),
    Key("lag", "s", "not negative", None),
    Key("delay", "s", "not negative", None),
    Key("limit", "N m", "positive", None),
    Key("dead_zone", "N m", "not negative", None),
    Key("offset", "N m", "any", None),
    Key("cogging_amplitude", "N m", "any", None),
    Key("cogging_periods", "1/rev", "positive", None),
    Key("cogging_phase", "rad", "any", None),
)
SIDES = ("load", "motor")
_SERVO = (
    Key("scale", "1", "positive", 1.0),
    Key("bias", "rad/s", "any", 0.0),
    Key("lag", "s", "not negative", 0.0),
    Key("delay", "s", "not negative", 0.0),
    Key("noise", "rad/s", "not negative", 0.0),
    Key("step", "rad/s", "not negative", 0.0, "step_size"),
    Key("position_noise", "rad", "not negative", 0.0),
    Key("position_step", "rad", "not negative", 0.0),
)
_LOAD_SIDE = Key("load_side", "1", "share", 1.0)
_GYRO = (
    Key("noise", "rad/s", "not negative", 0.0),
    Key("bias", "rad/s", "any", 0.0),
    Key("random_walk", "rad/s/sqrt(s)", "not negative", 0.0),
    Key("scale", "1", "positive", 1.0),
)
_ENCODER = (
    Key("step", "rad", "not negative", 0.0, "step_size"),
    Key("position_noise", "rad", "not negative", 0.0, "noise"),
    Key("filter_time", "s", "not negative", 0.0),
)
_FUSION = Key("angle_noise", "rad", "positive")
SENSORS = ("ideal", "servo", "gyro", "encoder", "kalman")


def build_plant(
    plant: TomlTable,
    transmission: TomlTable | None,
    friction: AbstractFriction,
    load: AbstractLoad,
    units: Units,
) -> AbstractPlant:
    """The plant of [plant] and [transmission].

    Raises:
        InputError: for invalid keys or values.
    """
    name = form_of("plant", plant, PLANTS)
    body = pick(PLANTS, name).build("plant", plant, units, friction=friction, load=load)
    if transmission is None:
        return body
    if name != "one_mass":
        raise InputError(
            f'[transmission] and [plant] type = "{name}" both describe two masses: write type = "one_mass" with the '
            f"total inertia, or drop [transmission]."
        )
    if isinstance(friction, Bristles | Dahl | LuGre):
        raise InputError(
            "[transmission] shares the friction between two bodies, which is not possible for a law with bristles: "
            'write a static law in [friction], or [plant] type = "two_mass" instead.'
        )
    check_keys("transmission", transmission, [key.name for key in TRANSMISSION])
    values = read_values("transmission", transmission, TRANSMISSION, units)
    if not values["load_share"] < 1.0:
        raise InputError(
            f"[transmission] load_share must be below 1, got {values['load_share']:g}: it is the load's share of the "
            f"total inertia."
        )
    return Transmission(
        inertia=body.inertia,
        friction=friction,
        load=load,
        **{key.attribute: values[key.name] for key in TRANSMISSION},
    )


def describe_plant(plant: AbstractPlant) -> dict[str, JsonObject]:
    """The [plant] and [transmission] sections of a plant."""
    if isinstance(plant, Transmission):
        inertia = {"type": "one_mass", "inertia": number(plant.inertia, "inertia")}
        return {"plant": inertia, "transmission": numbers(plant, TRANSMISSION)}
    return {"plant": form_for(plant, PLANTS, "plant").describe(plant)}


# -------------------------------------------------------------------------------------------------- load

_UNBALANCE = (Key("amplitude", "N m"), Key("phase", "rad", "any", 0.0))
_HARMONICS = (
    Key("cosine", "N m", many=True),
    Key("sine", "N m", many=True),
    Key("periods", "1/rev", "positive", 1.0),
)
LOADS = ("none", "unbalance", "position_torque")


def build_load(tables: Any, offset: float, units: Units) -> AbstractLoad:
    """The load of [load] (or of several [[load]]) with the known offset of [friction].

    Raises:
        InputError: for invalid keys or values.
    """
    tables = tables if isinstance(tables, list) else [] if tables is None else [tables]
    parts: list[AbstractLoad] = []
    for table in tables:
        name = choose("load", "type", table.get("type", "unbalance"), LOADS)
        if name == "unbalance":
            check_keys("load", table, ["type", *(key.name for key in _UNBALANCE)])
            values = read_values("load", table, _UNBALANCE, units)
            # The first unbalance also carries the offset of [friction]; one without an unbalance gets a block of its
            # own below.
            parts.append(Unbalance(values["amplitude"], values["phase"], 0.0 if any_offset(parts) else offset))
        elif name == "position_torque":
            parts.append(_position_torque(table, units))
        else:
            check_keys("load", table, ["type"])
    if offset != 0.0 and not any(isinstance(part, Unbalance) for part in parts):
        parts.append(Unbalance(0.0, 0.0, offset))
    if not parts:
        return NoLoad()
    return parts[0] if len(parts) == 1 else Loads(tuple(parts))


def any_offset(parts: list[AbstractLoad]) -> bool:
    """Whether one of the parts carries the offset already."""
    return any(isinstance(part, Unbalance) for part in parts)


def _position_torque(table: TomlTable, units: Units) -> PositionTorque:
    from ..blocks.block import as_parameter

    check_keys("load", table, ["type", *(key.name for key in _HARMONICS)])
    values = read_values("load", table, _HARMONICS, units)
    if len(values["cosine"]) != len(values["sine"]):
        raise InputError(
            f"[load] cosine and sine have {len(values['cosine'])} and {len(values['sine'])} entries: give each "
            f"harmonic one of both (0.0 where there is none)."
        )
    cosine, sine = (tuple(as_parameter(each) for each in values[part]) for part in ("cosine", "sine"))
    return PositionTorque(cosine, sine, values["periods"])


def flat_loads(load: AbstractLoad) -> tuple[AbstractLoad, ...]:
    """The parts of a load as one flat tuple: parts that are sums themselves are resolved too."""
    if not isinstance(load, Loads):
        return (load,)
    return tuple(part for each in load.parts for part in flat_loads(each))


def describe_load(load: AbstractLoad) -> tuple[list[JsonObject], float]:
    """([load] tables, offset of [friction])."""
    parts = tuple(part for part in flat_loads(load) if not isinstance(part, LearnedTorque))  # [[learned]] has those
    tables: list[JsonObject] = []
    offset = 0.0
    for part in parts:
        if isinstance(part, Unbalance):
            amplitude, phase = number(part.amplitude, "amplitude"), number(part.phase, "phase")
            own = number(part.offset, "offset")
            offset += own
            # `build_load` puts an offset without a load into a last unbalance of amplitude zero. Only that one needs no
            # [load] table, because [friction] offset brings it back.
            alone = part is parts[-1] and sum(isinstance(other, Unbalance) for other in parts) == 1
            if amplitude != 0.0 or phase != 0.0 or not own or not alone:
                tables.append({"type": "unbalance", "amplitude": amplitude} | ({"phase": phase} if phase else {}))
        elif isinstance(part, ConstantTorque):
            offset += number(part.torque, "torque")
        elif isinstance(part, PositionTorque):
            harmonics = {name: [number(value, name) for value in getattr(part, name)] for name in ("cosine", "sine")}
            if part.cosine:
                tables.append({"type": "position_torque", **harmonics, "periods": number(part.periods, "periods")})
        elif not isinstance(part, NoLoad):
            raise InputError(f"servo.toml cannot hold the load {type(part).__name__}: keep such a loop in Python.")
    return tables, offset


# ---------------------------------------------------------------------------------- actuator and sensor


def build_actuator(table: TomlTable | None, units: Units, dt: float) -> AbstractActuator:
    """The actuator of [actuator].

    Raises:
        InputError: for invalid keys or values.
    """
    if not table:
        return IdealActuator()
    check_keys("actuator", table, [key.name for key in ACTUATOR])
    values = read_values("actuator", table, ACTUATOR, units)
    if (values["cogging_amplitude"] is None) != (values["cogging_periods"] is None):
        raise InputError("[actuator] cogging needs both cogging_amplitude and cogging_periods: write both.")
    return Actuator(**values, longest_delay=periods_of(values["delay"], dt, 8, "[actuator] delay"))


def describe_actuator(actuator: AbstractActuator) -> JsonObject:
    """The [actuator] section; empty for an ideal one."""
    if isinstance(actuator, IdealActuator):
        return {}
    if not isinstance(actuator, Actuator):
        raise InputError(f"servo.toml cannot hold {type(actuator).__name__} in [actuator]: keep such a loop in Python.")
    return numbers(actuator, ACTUATOR)


def build_sensor(table: TomlTable | None, units: Units, dt: float) -> AbstractSensor:
    """The sensor of [sensor]; without a type it is the servo's: side, bias, scale, lag, delay, step, noise.

    Raises:
        InputError: for invalid keys or values.
    """
    if not table:
        return IdealSensor()
    name = choose("sensor", "type", table.get("type", "servo"), SENSORS)
    side = choose("sensor", "side", table.get("side", "load"), SIDES)
    own = {key: value for key, value in table.items() if key not in ("type", "side")}
    hint = f" for type = {name!r}"
    keys = {"servo": (*_SERVO, _LOAD_SIDE), "gyro": _GYRO, "encoder": _ENCODER, "ideal": ()}.get(name)
    if keys is None:  # kalman: the gyro's and the encoder's keys, and the noise that the filter assumes
        keys = (*_GYRO, *_ENCODER, _FUSION)
    check_keys("sensor", own, ["type", "side", *(key.name for key in keys)], hint)
    if name == "ideal":
        return IdealSensor(side)  # type: ignore[arg-type]
    if name == "gyro":
        return _of(Gyro, own, _GYRO, units, side=side)
    if name == "encoder":
        return _of(Encoder, own, _ENCODER, units, side=side)
    if name == "kalman":
        fusion = read_values("sensor", own, (_FUSION,), units)["angle_noise"]
        gyro, encoder = _of(Gyro, own, _GYRO, units, side=side), _of(Encoder, own, _ENCODER, units, side=side)
        return KalmanFusion(gyro, encoder, fusion)
    if "load_side" in own and "side" in table:
        raise InputError("[sensor] has both side and load_side: write one of them.")
    share = read_number("sensor", _LOAD_SIDE, own.get("load_side", 1.0 if side == "load" else 0.0), units)
    delay = read_values("sensor", own, _SERVO, units)["delay"]
    longest = periods_of(delay, dt, 16, "[sensor] delay")
    return _of(ServoSensor, own, _SERVO, units, load_side=share, longest_delay=longest)


def _of(block: type, table: TomlTable, keys: tuple[Key, ...], units: Units, **more: Any) -> Any:
    values = read_values("sensor", table, keys, units)
    return block(**{key.attribute: values[key.name] for key in keys}, **more)


def describe_sensor(sensor: AbstractSensor) -> JsonObject:
    """The [sensor] section; empty for an ideal one on the load."""
    if isinstance(sensor, IdealSensor):
        return {} if sensor.side == "load" else {"type": "ideal", "side": sensor.side}
    if isinstance(sensor, ServoSensor):
        share = number(sensor.load_side, "load_side")
        side: JsonObject = {"side": "load" if share else "motor"} if share in (0.0, 1.0) else {"load_side": share}
        return side | numbers(sensor, _SERVO)
    if isinstance(sensor, KalmanFusion):
        if sensor.gyro.side != sensor.encoder.side:
            raise InputError("servo.toml cannot hold a gyro and an encoder on different sides: keep it in Python.")
        angle = number(sensor.angle_noise, "angle_noise")
        both = numbers(sensor.gyro, _GYRO) | numbers(sensor.encoder, _ENCODER)
        return {"type": "kalman", "side": sensor.gyro.side, **both, "angle_noise": angle}
    for name, block, keys in (("gyro", Gyro, _GYRO), ("encoder", Encoder, _ENCODER)):
        if isinstance(sensor, block):
            return {"type": name, "side": sensor.side, **numbers(sensor, keys)}
    raise InputError(f"servo.toml cannot hold {type(sensor).__name__} in [sensor]: keep such a loop in Python.")


def total_inertia(plant: AbstractPlant) -> float:
    """The plant's total moment of inertia [kg m^2]."""
    return float(np.asarray(plant.inertia))
