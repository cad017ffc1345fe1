"""A model without the effects that are at their neutral value, as a corrected model should be written to a file."""

import cmath
import dataclasses
from typing import Any

from ..blocks.actuators import AbstractActuator, Actuator, IdealActuator
from ..blocks.block import as_parameter
from ..blocks.friction import AbstractFriction, AsymmetricCoulombViscous, CoulombViscous
from ..blocks.friction.bristles import Bristles
from ..blocks.friction.general import GeneralFriction
from ..blocks.learned import LearnedTorque
from ..blocks.loads import AbstractLoad, NoLoad, Unbalance
from ..blocks.position_torque import ConstantTorque, Loads, PositionTorque, first_harmonic
from ..blocks.sensors import AbstractSensor, IdealSensor
from ..blocks.servo_sensor import ServoSensor
from ..simulation.loop import ClosedLoop
from ..simulation.solvers import get_solver
from .body import flat_loads
from .friction import Steepness, largest_level
from .learned import is_empty
from .model import Model

UNREACHED = 1e29  # [N m] from here on a torque limit stands for no limit


def simplified(model: Model, loop: ClosedLoop | None = None, *, smooth: bool = True) -> Model:
    """The model with every neutral effect dropped, ready for `dump_model`.

    Args:
        model: gives stepping, units, controller and reference.
        loop: used instead of the model's own loop; its controller and observer are kept as they are.
        smooth: whether a set-valued friction law gets a steepness that the model's step can follow.

    Returns:
        A `Model` with the same behaviour; stepping becomes "sampled" where a sensor or a delay needs it.
    """
    loop = model.loop if loop is None else loop
    friction = simple_friction(loop.plant.friction)
    plant = _with(loop.plant, friction=friction, load=simple_load(loop.plant.load))
    actuator, sensor = simple_actuator(loop.actuator), simple_sensor(loop.sensor)
    # a delay and a sensor's sampling exist in sampled stepping only
    delayed = isinstance(actuator, Actuator) and actuator.delay is not None
    stepping = "sampled" if delayed or not isinstance(sensor, IdealSensor) else model.stepping
    if smooth and not isinstance(friction, Bristles) and getattr(friction, "steepness", 0.0) is None:
        step = model.dt / model.substeps if stepping == "sampled" else model.dt
        chooser = Steepness(float(plant.rubbing_inertia()), step, get_solver(model.solver), model.units)
        if largest_level(friction) > 0.0:
            plant = _with(plant, friction=chooser.into(friction))
    loop = ClosedLoop(plant, loop.controller, loop.observer, actuator, sensor)
    return dataclasses.replace(model, loop=loop, stepping=stepping)


def simple_friction(law: AbstractFriction) -> AbstractFriction:
    """The plainest law with the same torque."""
    if isinstance(law, Bristles):  # a file writes bristles within the general law only
        inner = law.law.general() if isinstance(law.law, CoulombViscous) else law.law
        return _with(law, law=_trimmed(inner) if isinstance(inner, GeneralFriction) else inner)
    if not isinstance(law, GeneralFriction):
        return law
    law = _trimmed(law)
    extras = (law.stribeck_torque, law.drift_amplitude, law.drag_coefficient, law.load_coefficient)
    if law.position_cosine or not all(_zero(extra) for extra in extras):
        return law
    if _zero(law.coulomb_difference) and _zero(law.viscous_difference):
        return CoulombViscous(law.coulomb, law.viscous, law.steepness)
    sides = (
        law.coulomb + law.coulomb_difference,
        law.coulomb - law.coulomb_difference,
        law.viscous + law.viscous_difference,
        law.viscous - law.viscous_difference,
    )
    if min(float(side) for side in sides) < 0.0:
        return law  # a level by direction must not be negative; the general law may have such differences
    return AsymmetricCoulombViscous(*sides, law.steepness)


def _trimmed(law: GeneralFriction) -> GeneralFriction:
    """The law without the terms that are zero, and with the defaults for numbers that only those terms use."""
    pairs = list(zip(law.position_cosine, law.position_sine, strict=True))
    while pairs and _zero(pairs[-1][0]) and _zero(pairs[-1][1]):
        pairs.pop()
    absent = {
        name: None for name in ("stribeck_torque", "drift_amplitude", "load_coefficient") if _zero(getattr(law, name))
    }
    cosine, sine = (tuple(pair[part] for pair in pairs) for part in (0, 1))
    plain = GeneralFriction(coulomb=law.coulomb, viscous=law.viscous)
    companions = {"stribeck_torque": ("stribeck_velocity", "stribeck_exponent"), "drift_amplitude": ("drift_time",)}
    idle = [name for term in absent for name in companions.get(term, ())] + ([] if pairs else ["position_periods"])
    unused = {name: getattr(plain, name) for name in idle}
    return _with(law, position_cosine=cosine, position_sine=sine, **absent, **unused)


def simple_load(load: AbstractLoad) -> AbstractLoad:
    """The load without parts of zero torque; constant torques become one offset and several unbalances one."""
    kept: list[AbstractLoad] = []
    constant = 0.0
    for part in flat_loads(load):
        if isinstance(part, PositionTorque):
            if not all(_zero(value) for value in (*part.cosine, *part.sine)):
                kept.append(part)
        elif isinstance(part, Unbalance):
            constant += float(part.offset)
            if not _zero(part.amplitude):
                kept.append(Unbalance(part.amplitude, part.phase))
        elif isinstance(part, ConstantTorque):
            constant += float(part.torque)
        elif not isinstance(part, NoLoad | LearnedTorque):
            kept.append(part)
    kept = _one_unbalance(kept)
    if constant:
        place = next((at for at, part in enumerate(kept) if isinstance(part, Unbalance)), None)
        if place is None:
            kept.append(Unbalance(0.0, 0.0, constant))
        else:
            kept[place] = _with(kept[place], offset=as_parameter(constant))
    # Learned tables come last, in the order in which a file is read: a model read back is equal to this one.
    kept += [part for part in flat_loads(load) if isinstance(part, LearnedTorque) and not is_empty(part)]
    if not kept:
        return NoLoad()
    return kept[0] if len(kept) == 1 else Loads(tuple(kept))


def _one_unbalance(parts: list[AbstractLoad]) -> list[AbstractLoad]:
    """The parts with all that turn once a turn as one: a known unbalance and what a fit adds to it is one number."""
    turning = [part for part in parts if _is_unbalance(part)]
    if len(turning) < 2:
        return parts
    amplitude, phase = cmath.polar(first_harmonic(Loads(tuple(turning))))
    rest = [part for part in parts if not _is_unbalance(part)]
    return rest if amplitude == 0.0 else [Unbalance(amplitude, phase), *rest]


def _is_unbalance(part: AbstractLoad) -> bool:
    one = isinstance(part, PositionTorque) and len(part.cosine) == 1 and float(part.periods) == 1.0
    return one or isinstance(part, Unbalance)


def simple_actuator(actuator: AbstractActuator) -> AbstractActuator:
    """The actuator without the effects at their neutral value; an ideal one where none is left."""
    if not isinstance(actuator, Actuator):
        return actuator
    neutral = {"gain": 1.0, "lag": 0.0, "delay": 0.0, "dead_zone": 0.0, "offset": 0.0}
    gone: dict[str, None] = {
        name: None
        for name, value in neutral.items()
        if getattr(actuator, name) is not None and float(getattr(actuator, name)) == value
    }
    if actuator.limit is not None and float(actuator.limit) >= UNREACHED:
        gone["limit"] = None
    if actuator.cogging_amplitude is not None and _zero(actuator.cogging_amplitude):
        # the three belong together: period and phase mean nothing without an amplitude
        gone |= {"cogging_amplitude": None, "cogging_periods": None, "cogging_phase": None}
    kept = _with(actuator, **gone)
    names = (*neutral, "limit", "cogging_amplitude")
    return IdealActuator() if all(getattr(kept, name) is None for name in names) else kept


def simple_sensor(sensor: AbstractSensor) -> AbstractSensor:
    """An ideal sensor where every effect is at its neutral value; else the sensor itself."""
    if not isinstance(sensor, ServoSensor) or float(sensor.load_side) not in (0.0, 1.0):
        return sensor
    zeros = (sensor.bias, sensor.lag, sensor.delay, sensor.noise, sensor.step_size)
    # compared exactly: a diagnosis writes exact zeros and ones for the effects that it dropped
    nothing = all(_zero(each) for each in (*zeros, sensor.position_noise, sensor.position_step))
    if nothing and float(sensor.scale) == 1.0:
        return IdealSensor("load" if float(sensor.load_side) else "motor")
    return sensor


def _zero(value: Any) -> bool:
    return value is None or float(value) == 0.0


def _with(block: Any, **changes: Any) -> Any:
    return dataclasses.replace(block, **changes) if changes else block
