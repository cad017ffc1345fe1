"""Machine: the simulator's blocks without the controller, driven by the recorded torque (open loop)."""

import dataclasses
from typing import Literal

import equinox as eqx
import jax
import jax.numpy as jnp
from jax.core import Tracer
from jax.typing import DTypeLike
from jaxtyping import Array, PyTree

from ..blocks.actuators import AbstractActuator, Actuator
from ..blocks.block import as_parameter
from ..blocks.friction import AbstractFriction
from ..blocks.friction.bristles import Bristles
from ..blocks.friction.general import GeneralFriction
from ..blocks.loads import AbstractLoad, Unbalance
from ..blocks.plants import AbstractPlant, OneMass, TwoMass
from ..blocks.plants.transmission import Transmission
from ..blocks.position_torque import ConstantTorque, Loads, PositionTorque
from ..blocks.sensors import AbstractSensor
from ..blocks.servo_sensor import ServoSensor
from ..errors import InputError

Structure = Literal["rigid", "bristles", "transmission"]
Feature = Literal["shape", "ripple", "torque"]  # Stribeck and drift; friction and torque that depend on the position
# Groups of terms that are compiled into the loop only where an effect wants them: a term at its neutral value
# changes nothing but costs its share of every step.
FEATURES: tuple[Feature, ...] = ("shape", "ripple", "torque")
NO_LIMIT = 1e30  # a torque limit that is never reached [N m]; finite, so that no sum or product of it is NaN


class Machine(eqx.Module):
    """Actuator, plant and sensor: the path from the commanded torque to the readings in the log.

    Attributes:
        plant: `OneMass` under `GeneralFriction` or `Bristles`, or `Transmission`.
        actuator: every effect at its neutral value unless an effect has set it.
        sensor: every effect at its neutral value, likewise.
        origin: position [rad] at the log's start where no sensor measures it; neutral 0.
    """

    plant: OneMass | Transmission
    actuator: Actuator
    sensor: ServoSensor
    origin: Array = eqx.field(converter=as_parameter, default=0.0)

    @property
    def law(self) -> GeneralFriction:
        """The static friction law, under the bristles if there are any."""
        friction = self.plant.friction
        law = friction.law if isinstance(friction, Bristles) else friction
        assert isinstance(law, GeneralFriction)
        return law


def has_bristles(machine: Machine) -> bool:
    """Whether the static law is `plant.friction.law`, under bristles, and not `plant.friction` itself."""
    return isinstance(machine.plant.friction, Bristles)


def structure_of(machine: Machine) -> Structure:
    """Which of the three structures a machine has."""
    if isinstance(machine.plant, Transmission):
        return "transmission"
    return "bristles" if has_bristles(machine) else "rigid"


def nominal_machine(
    plant: AbstractPlant,
    actuator: AbstractActuator | None = None,
    sensor: AbstractSensor | None = None,
    features: tuple[Feature, ...] = FEATURES,
) -> Machine:
    """The nominal model as a `Machine` with every effect of the features present and neutral.

    Args:
        plant: one mass or two, under any friction law of the package.
        actuator: of the nominal model; its values are taken as known.
        sensor: of the nominal model, likewise.
        features: groups of terms to have in the machine; those left out cost no time.

    Raises:
        InputError: for a plant other than one mass or two.
    """
    law, bristle = general_law(plant.friction)
    law = _with_features(law, features)
    # An unbalance repeats once a revolution: one harmonic. Cogging may have any number of periods: it starts at six
    # (three pole pairs) with two harmonics, and `cogging_periods` is fitted.
    extra = (_neutral_torque(1.0, 1), _neutral_torque(6.0, 2)) if "torque" in features else ()
    load = Loads((_known(plant.load), *extra))
    if isinstance(plant, TwoMass):
        total = plant.motor_inertia + plant.load_inertia
        body: OneMass | Transmission = Transmission(
            inertia=total,
            load_share=plant.load_inertia / total,
            stiffness=plant.stiffness,
            damping=plant.damping,
            friction=law,
            load=load,
            viscous_share=1.0,
        )
    elif isinstance(plant, Transmission):
        # Its own shares of both kinds of friction, which an effect may set.
        body = dataclasses.replace(plant, friction=law, load=load, viscous_share=plant.on_load.drag)
    elif isinstance(plant, OneMass):
        body = OneMass(plant.inertia, law if bristle is None else eqx.tree_at(lambda at: at.law, bristle, law), load)
    else:
        raise InputError(
            f"{type(plant).__name__} cannot be the nominal model of a diagnosis: use one_mass or two_mass in [plant]."
        )
    if not isinstance(sensor, ServoSensor):
        sensor = ServoSensor(load_side=0.0 if getattr(sensor, "side", "load") == "motor" else 1.0)
    return Machine(body, _full_actuator(actuator), sensor)


def with_structure(machine: Machine, structure: Structure, frequency: float, deflection: float) -> Machine:
    """The machine with bristles or a transmission added, which have no neutral value.

    Args:
        machine: of any structure; returned as it is where it has that structure or a richer one.
        structure: the one wanted.
        frequency: free-free resonance [Hz] of a new transmission.
        deflection: of new bristles at the Coulomb level [rad].
    """
    plant = machine.plant
    if structure == "bristles" and structure_of(machine) == "rigid":
        return eqx.tree_at(lambda at: at.plant.friction, machine, Bristles(machine.law, deflection))
    if structure == "transmission" and not isinstance(plant, Transmission):
        # Two equal halves J / 2 on a spring c swing freely at w^2 = c (2 / J + 2 / J) = 4 c / J, so c = J w^2 / 4.
        # The damping 0.1 c / w is a damping ratio of 0.05: d (4 / J) = 2 zeta w.
        stiffness = 0.25 * plant.inertia * (2.0 * jnp.pi * frequency) ** 2
        damping = 0.1 * stiffness / (2.0 * jnp.pi * frequency)
        body = Transmission(
            plant.inertia, 0.5, stiffness, damping, machine.law, 0.0, 0.5, plant.load, viscous_share=0.5
        )
        return eqx.tree_at(lambda at: at.plant, machine, body)
    return machine


def general_law(law: AbstractFriction) -> tuple[GeneralFriction, Bristles | None]:
    """(the law as a `GeneralFriction` without a steepness, its bristles or None).

    Raises:
        InputError: for a law that `GeneralFriction` does not contain.
    """
    general = law.general()
    bristles = general if isinstance(general, Bristles) else None
    inner = general.law if isinstance(general, Bristles) else general
    assert isinstance(inner, GeneralFriction)
    # `advance_exact` sticks exactly: a sign function smoothed by a steepness would creep at rest instead.
    return eqx.tree_at(lambda at: at.steepness, inner, None, is_leaf=lambda leaf: leaf is None), bristles


def _with_features(law: GeneralFriction, features: tuple[Feature, ...]) -> GeneralFriction:
    """The law with a neutral term for each feature; terms that the nominal model has already stay."""

    def either(value: PyTree, feature: Feature, neutral: PyTree) -> PyTree:
        return neutral if feature in features and _absent(value) else value

    def fields(at: GeneralFriction) -> tuple[PyTree, ...]:
        return at.stribeck_torque, at.drift_amplitude, at.position_cosine, at.position_sine, at.load_coefficient

    new = (
        either(law.stribeck_torque, "shape", jnp.zeros(())),
        either(law.drift_amplitude, "shape", jnp.zeros(())),
        either(law.position_cosine, "ripple", _zeros(3)),
        either(law.position_sine, "ripple", _zeros(3)),
        either(law.load_coefficient, "shape", jnp.zeros(())),
    )
    return eqx.tree_at(fields, law, new, is_leaf=_absent)


def _absent(value: object) -> bool:
    return value is None or (isinstance(value, tuple) and not value)


def _known(load: AbstractLoad) -> AbstractLoad:
    """The nominal model's load; an unbalance of amplitude zero as a constant, which costs no sine in every step."""
    if isinstance(load, Unbalance) and not isinstance(load.amplitude, Tracer) and float(load.amplitude) == 0.0:
        return ConstantTorque(load.offset)
    return load


def lanes(machine: Machine, count: int, dtype: DTypeLike = float) -> Machine:
    """The machine with every leaf repeated for `count` lanes: scalars become arrays of shape (count,)."""
    return jax.tree.map(lambda leaf: jnp.broadcast_to(jnp.asarray(leaf, dtype), (count,)), machine)


def _neutral_torque(periods: float, harmonics: int) -> PositionTorque:
    return PositionTorque(_zeros(harmonics), _zeros(harmonics), periods)


def _zeros(count: int) -> tuple[Array, ...]:
    return tuple(jnp.zeros(()) for _ in range(count))


def _full_actuator(actuator: AbstractActuator | None) -> Actuator:
    known = actuator if isinstance(actuator, Actuator) else Actuator()

    def or_else(value: Array | None, neutral: float) -> Array | float:
        return neutral if value is None else value

    return Actuator(
        gain=or_else(known.gain, 1.0),
        lag=or_else(known.lag, 0.0),
        delay=or_else(known.delay, 0.0),
        limit=or_else(known.limit, NO_LIMIT),
        dead_zone=or_else(known.dead_zone, 0.0),
        offset=or_else(known.offset, 0.0),
        cogging_amplitude=known.cogging_amplitude,
        cogging_periods=known.cogging_periods,
        cogging_phase=known.cogging_phase,
    )
