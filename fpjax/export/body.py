"""The machine in the parameters of rigid-body simulators, and the effects that a target format cannot express.

Each effect that is left out comes with a function that removes it alone, so that its cost can be simulated.
"""

import dataclasses
import math
from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from ..blocks.actuators import Actuator, IdealActuator
from ..blocks.friction import (
    AbstractStaticFriction,
    CoulombViscous,
    CoulombViscousStiction,
    Dahl,
    LuGre,
    NoFriction,
    SmoothCoulomb,
)
from ..blocks.friction.bristles import Bristles
from ..blocks.learned import LearnedTorque
from ..blocks.loads import NoLoad, Unbalance
from ..blocks.plants import OneMass, SeriesTwoMass, TwoMass
from ..blocks.plants.transmission import Transmission
from ..blocks.position_torque import ConstantTorque, Loads, PositionTorque
from ..errors import InputError
from ..model_file.body import flat_loads
from ..simulation.loop import ClosedLoop

# (amplitude [N m], periods [1/rev], phase [rad]) of the torque amplitude sin(periods q + phase).
Wave = tuple[float, float, float]


@dataclasses.dataclass(frozen=True)
class Leftover:
    """An effect that a target format cannot express.

    Attributes:
        name: of the effect.
        without: the loop without it.
        solver: of the simulation without it; "" for the model's own.
    """

    name: str
    without: Callable[[ClosedLoop], ClosedLoop]
    solver: str = ""


@dataclasses.dataclass
class Body:
    """The parameters of a machine in the terms of rigid-body simulators, with the signs of fpjax.

    Attributes:
        inertia: of motor and load [kg m^2]; the load's is 0 for one mass.
        coulomb: on motor and load [N m].
        viscous: on motor and load [N m s/rad].
        shaft: (stiffness [N m/rad], damping [N m s/rad], backlash width [rad]); None for one mass.
        lugre: (bristle stiffness, bristle damping, coulomb, static, Stribeck velocity) on the load; None without.
        gain: applied = gain x commanded [1].
        limit: of the torque [N m]; None for none.
        lag: first-order time constant of the torque [s].
        delay: dead time of the torque [s].
        offset: constant torque added by the actuator, less the constant load torque [N m].
        waves: torques on the motor that repeat with its position, positive where they drive it.
        load_waves: torques on the load that repeat with its position, likewise.
        leftovers: the effects that these parameters do not express.
    """

    inertia: tuple[float, float]
    coulomb: tuple[float, float] = (0.0, 0.0)
    viscous: tuple[float, float] = (0.0, 0.0)
    shaft: tuple[float, float, float] | None = None
    lugre: tuple[float, float, float, float, float] | None = None
    gain: float = 1.0
    limit: float | None = None
    lag: float = 0.0
    delay: float = 0.0
    offset: float = 0.0
    waves: list[Wave] = dataclasses.field(default_factory=list)
    load_waves: list[Wave] = dataclasses.field(default_factory=list)
    leftovers: list[Leftover] = dataclasses.field(default_factory=list)


def body_of(loop: ClosedLoop, *, shaft: bool, lugre: bool, dry: bool = True) -> Body:
    """The body of a loop.

    Args:
        loop: its plant and actuator.
        shaft: whether the target can express two masses with a spring; if not, they become one, and the spring is a
            leftover.
        lugre: whether the target can express LuGre friction.
        dry: whether the loop's own simulation resolves sticking, and so uses no steepness: the friction of the targets
            is dry.

    Raises:
        InputError: for a plant or a friction law that is not one of fpjax' own.
    """
    plant: Any = loop.plant
    if isinstance(plant, OneMass):
        body, share, smooth = Body((_number(plant.inertia), 0.0)), 0.0, 0.0
    elif isinstance(plant, TwoMass | Transmission | SeriesTwoMass):
        share, smooth = (_number(each) for each in plant.on_load) if isinstance(plant, Transmission) else (1.0, 1.0)
        gap = _number(plant.gap) if isinstance(plant, Transmission) else 0.0
        body = Body((_number(plant.motor_inertia), _number(plant.load_inertia)))
        body.shaft = (_number(plant.stiffness), _number(plant.damping), gap)
        if not shaft or isinstance(plant, SeriesTwoMass):
            # One joint with the total inertia: all friction acts on it, the motor's place (share 0).
            body, share, smooth = Body((sum(body.inertia), 0.0)), 0.0, 0.0
            body.leftovers.append(Leftover("two masses: spring, damper and backlash", _as_one_mass))
        elif isinstance(plant, Transmission) and _number(plant.hardening) != 0.0:
            body.leftovers.append(Leftover("the hardening of the shaft", _with_even_spring))
    else:
        raise InputError(
            f"{type(plant).__name__} cannot be expressed in another simulator: export one mass, two masses or a "
            f"transmission."
        )
    _friction(body, plant.friction, share, smooth, lugre, dry)
    _actuator(body, loop.actuator)
    _load(body, plant.load)
    return body


def _friction(body: Body, law: Any, share: float, smooth: float, lugre: bool, dry: bool) -> None:
    """Write a friction law into the body, `share` of it and `smooth` of its viscous part on the load.

    What does not fit becomes a leftover.
    """
    if isinstance(law, Bristles):
        dry = True  # with bristles the level needs no steepness, and uses none
        body.leftovers.append(Leftover("bristles (presliding)", lambda loop: _with_law(loop, lambda each: each.law)))
        law = law.law
    if isinstance(law, NoFriction):
        return
    if isinstance(law, CoulombViscousStiction):
        if _there(law.static - law.coulomb):
            name = "stiction (static friction above Coulomb friction)"
            body.leftovers.append(Leftover(name, lambda loop: _with_law(loop, _inside(_sliding))))
        law = _sliding(law)
    if isinstance(law, LuGre | Dahl):
        # MuJoCo's lugre has a Gaussian Stribeck curve. Dahl's law of exponent 1 is LuGre without a Stribeck peak.
        fits = _number(law.exponent) == (2.0 if isinstance(law, LuGre) else 1.0)
        if isinstance(law, LuGre):
            static, speed = _number(law.static), _number(law.stribeck_velocity)
            found = (_number(law.bristle_stiffness), _number(law.bristle_damping), _number(law.coulomb), static, speed)
        else:
            # (sigma_0, sigma_1, F_c, F_s, v_s): with F_s = F_c the Stribeck curve is flat, and v_s has no effect
            found = (_number(law.stiffness), 0.0, _number(law.coulomb), _number(law.coulomb), 1.0)
        viscous = _number(law.viscous)
        body.viscous = ((1.0 - smooth) * viscous, smooth * viscous)
        if lugre and fits:
            body.lugre = found
            return
        # without bristles, sliding friction is the nearest law: the check then reports what the missing bristles cost
        body.coulomb = ((1.0 - share) * found[2], share * found[2])
        name = "bristle friction (LuGre, Dahl)"
        body.leftovers.append(Leftover(name, lambda loop: _with_law(loop, _plain)))
        return
    if not isinstance(law, AbstractStaticFriction):
        raise InputError(
            f"The friction law {type(law).__name__} cannot be expressed in another simulator: export a static law, "
            "dahl or lugre."
        )
    general: Any = law.general()
    coulomb, viscous = _number(general.coulomb), _number(general.viscous)
    body.coulomb = ((1.0 - share) * coulomb, share * coulomb)
    body.viscous = ((1.0 - smooth) * viscous, smooth * viscous)
    terms = {
        "friction by direction": ("coulomb_difference", "viscous_difference"),
        "Stribeck friction": ("stribeck_torque",),
        "friction by position": ("position_cosine", "position_sine"),
        "friction that drifts with time": ("drift_amplitude",),
        "friction that grows with the torque": ("load_coefficient",),
        "drag by the square of the speed": ("drag_coefficient",),
    }
    for name, fields in terms.items():
        if any(_there(getattr(general, field, None)) for field in fields):
            body.leftovers.append(Leftover(name, lambda loop, fields=fields: _with_law(loop, _neutral(fields))))
    if not dry and coulomb and general.steepness is not None:
        name = f"friction that is smooth at reversals (steepness {_number(general.steepness):.4g})"
        body.leftovers.append(Leftover(name, lambda loop: _with_law(loop, _without_steepness), solver="exact"))


def _actuator(body: Body, actuator: Any) -> None:
    if isinstance(actuator, IdealActuator):
        return
    if not isinstance(actuator, Actuator):
        name = f"the actuator {type(actuator).__name__}"
        body.leftovers.append(Leftover(name, lambda loop: _replaced(loop, "actuator", IdealActuator())))
        return

    def value(name: str, default: float) -> float:
        found = getattr(actuator, name)
        return default if found is None else _number(found)

    body.gain, body.lag, body.delay = value("gain", 1.0), value("lag", 0.0), value("delay", 0.0)
    body.limit = None if actuator.limit is None else _number(actuator.limit)
    body.offset += value("offset", 0.0)
    if value("cogging_amplitude", 0.0):
        wave = (value("cogging_amplitude", 0.0), value("cogging_periods", 1.0), value("cogging_phase", 0.0))
        body.waves.append(wave)
    if value("dead_zone", 0.0):
        body.leftovers.append(Leftover("the actuator's dead zone", without_actuator_field("dead_zone")))


def _load(body: Body, load: Any) -> None:
    # A load is a torque that the motor must hold; offset and waves drive. So the signs turn.
    for index, part in enumerate(flat_loads(load)):
        if isinstance(part, Unbalance):
            if _number(part.amplitude):
                body.load_waves.append((-_number(part.amplitude), 1.0, _number(part.phase)))
            body.offset -= _number(part.offset)
        elif isinstance(part, ConstantTorque):
            body.offset -= _number(part.torque)
        elif isinstance(part, PositionTorque):
            for place, (cosine, sine) in enumerate(zip(part.cosine, part.sine, strict=True), start=1):
                # c cos x + s sin x = hypot(c, s) sin(x + atan2(c, s)).
                size, phase = math.hypot(_number(cosine), _number(sine)), math.atan2(_number(cosine), _number(sine))
                if size:
                    body.load_waves.append((-size, place * _number(part.periods), phase))
        elif not isinstance(part, NoLoad):
            learned = isinstance(part, LearnedTorque)
            name = f"the learned torque over the {part.of}" if learned else f"the load {type(part).__name__}"
            body.leftovers.append(Leftover(name, lambda loop, index=index: _without_part(loop, index)))


def without_waves(loop: ClosedLoop) -> ClosedLoop:
    """The loop without torques that repeat with the position."""
    loop = _without_load(loop, Unbalance | PositionTorque)
    if isinstance(loop.actuator, Actuator) and loop.actuator.cogging_amplitude is not None:
        loop = without_actuator_field("cogging_amplitude", "cogging_periods", "cogging_phase")(loop)
    return loop


def without_offset(loop: ClosedLoop) -> ClosedLoop:
    """The loop without constant torques."""
    parts = []
    for part in flat_loads(loop.plant.load):
        if isinstance(part, Unbalance):
            part = Unbalance(part.amplitude, part.phase, 0.0)
        if not isinstance(part, ConstantTorque):
            parts.append(part)
    loop = _replaced(loop, "plant", _replaced(loop.plant, "load", Loads(tuple(parts))))
    if isinstance(loop.actuator, Actuator) and loop.actuator.offset is not None:
        loop = without_actuator_field("offset")(loop)
    return loop


def _as_one_mass(loop: ClosedLoop) -> ClosedLoop:
    plant: Any = loop.plant
    return _replaced(loop, "plant", OneMass(plant.inertia, plant.friction, plant.load))


def _with_even_spring(loop: ClosedLoop) -> ClosedLoop:
    return _replaced(loop, "plant", _replaced(loop.plant, "hardening", jnp.zeros(())))


def _plain(law: Any) -> Any:
    """The Coulomb and viscous part of a law with memory."""
    return CoulombViscous(law.coulomb, law.viscous)


def _sliding(law: Any) -> Any:
    """A law with stiction without it."""
    return CoulombViscous(law.coulomb, law.viscous, law.steepness)


def _without_steepness(law: Any) -> Any:
    """A static law with sign in place of tanh."""
    law = law.general() if isinstance(law, SmoothCoulomb) else law  # its steepness is not optional
    return dataclasses.replace(law, steepness=None)


def _inside(change: Callable[[Any], Any]) -> Callable[[Any], Any]:
    """The change of a law, or of the law within bristles."""
    return lambda law: dataclasses.replace(law, law=change(law.law)) if isinstance(law, Bristles) else change(law)


def _neutral(fields: tuple[str, ...]) -> Callable[[Any], Any]:
    """A function that sets fields of a law's general form to their neutral values."""

    def change(law: Any) -> Any:
        general = law.general()
        empty = {"position_cosine": (), "position_sine": ()}
        optional = {"stribeck_torque", "drift_amplitude", "load_coefficient"}
        values = {
            name: empty.get(name, None if name in optional else jnp.zeros_like(general.coulomb)) for name in fields
        }
        return dataclasses.replace(general, **values)

    return _inside(change)


def _with_law(loop: ClosedLoop, change: Callable[[Any], Any]) -> ClosedLoop:
    return _replaced(loop, "plant", _replaced(loop.plant, "friction", change(loop.plant.friction)))


def without_actuator_field(*names: str) -> Callable[[ClosedLoop], ClosedLoop]:
    """A function that takes a loop and gives it without these fields of its actuator."""

    def change(loop: ClosedLoop) -> ClosedLoop:
        actuator = dataclasses.replace(loop.actuator, **dict.fromkeys(names))
        return _replaced(loop, "actuator", actuator)

    return change


def _without_load(loop: ClosedLoop, kinds: Any) -> ClosedLoop:
    parts = []
    for part in flat_loads(loop.plant.load):
        if not isinstance(part, kinds):
            parts.append(part)
        elif isinstance(part, Unbalance):
            parts.append(ConstantTorque(part.offset))
    return _replaced(loop, "plant", _replaced(loop.plant, "load", Loads(tuple(parts))))


def _without_part(loop: ClosedLoop, index: int) -> ClosedLoop:
    parts = list(flat_loads(loop.plant.load))
    del parts[index]
    return _replaced(loop, "plant", _replaced(loop.plant, "load", Loads(tuple(parts))))


def _replaced(block: Any, name: str, value: Any) -> Any:
    return dataclasses.replace(block, **{name: value})


def _there(value: Any) -> bool:
    return any(np.any(np.asarray(leaf) != 0.0) for leaf in jax.tree.leaves(value))


def _number(value: Any) -> float:
    return float(np.asarray(value))
