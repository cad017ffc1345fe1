"""Plants: one mass (2.4), two masses with a spring (3.1)-(3.14), and the thesis' series form (3.27)-(3.28)."""

from abc import abstractmethod
from typing import TYPE_CHECKING

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, PyTree

from ...errors import InputError
from ..block import Block, as_parameter, require_not_negative, require_positive
from ..friction import AbstractFriction
from ..loads import AbstractLoad, NoLoad
from ..signals import Motion, PlantOutput


class AbstractPlant(Block):
    """A body, or two, driven by a torque and held back by friction; its state holds the friction law's."""

    # For a type checker properties: read as fields they would come first among the constructor's arguments.
    if TYPE_CHECKING:

        @property
        def inertia(self) -> Array:
            """Total moment of inertia [kg m^2]."""
            ...

        @property
        def friction(self) -> AbstractFriction:
            """The friction law."""
            ...

        @property
        def load(self) -> AbstractLoad:
            """A known load."""
            ...
    else:
        friction: eqx.AbstractVar[AbstractFriction]
        load: eqx.AbstractVar[AbstractLoad]

    @abstractmethod
    def init(self) -> PyTree:
        """The state at rest at position zero."""

    @abstractmethod
    def rubbing_inertia(self) -> Array:
        """Inertia of the body on which the friction acts [kg m^2]; with the friction's slope it limits the step."""

    @abstractmethod
    def derivative(self, state: PyTree, torque: Array, time: Array) -> PyTree:
        """Time derivative of the state under an applied torque [N m] at time [s]."""

    @abstractmethod
    def readout(self, state: PyTree, torque: Array, time: Array) -> PlantOutput:
        """Velocities [rad/s], positions [rad] and friction torque [N m]."""

    def advance(self, state: PyTree, torque: Array, time: Array, dt: Array) -> PyTree:
        """The state dt [s] later under a held torque [N m], with sticking resolved exactly.

        For one mass one step is enough: under a held torque only its friction changes over the step. A plant with a
        spring needs several steps per control period.

        Args:
            state: at `time`.
            torque: applied over the step [N m].
            time: start of the step [s].
            dt: length of the step [s].

        Raises:
            InputError: for a plant or a law that has no exact step.
        """
        del state, torque, time, dt
        raise InputError(
            f"{type(self).__name__} has no exact sticking step: use one mass or a Transmission with a static friction "
            "law, or a solver such as rk4 with a steepness."
        )


class OneMassState(eqx.Module):
    """State of `OneMass`: velocity w [rad/s], position [rad], the friction law's own state."""

    velocity: Array
    position: Array
    friction: PyTree


class OneMass(AbstractPlant):
    """J dw/dt = torque - friction - load (2.4).

    Attributes:
        inertia: J [kg m^2].
        friction: the law that acts on the mass.
        load: a known load.
    """

    inertia: Array = eqx.field(converter=as_parameter)
    friction: AbstractFriction
    load: AbstractLoad = NoLoad()

    def __check_init__(self) -> None:
        require_positive(self, "inertia", "kg m^2")

    def rubbing_inertia(self) -> Array:
        """J [kg m^2]."""
        return self.inertia

    def init(self) -> OneMassState:
        """At rest at position zero."""
        zero = jnp.zeros_like(self.inertia)
        return OneMassState(zero, zero, self.friction.init())

    def derivative(self, state: OneMassState, torque: Array, time: Array) -> OneMassState:
        """(dw/dt [rad/s^2], w [rad/s], the friction law's derivative)."""
        motion = Motion(state.velocity, state.position, time, torque)
        free = torque - self.load.readout(motion)
        friction = self.friction.readout(state.friction, motion, free)
        return OneMassState(
            (free - friction) / self.inertia, state.velocity, self.friction.derivative(state.friction, motion)
        )

    def readout(self, state: OneMassState, torque: Array, time: Array) -> PlantOutput:
        """The one velocity and position, for motor and load alike."""
        motion = Motion(state.velocity, state.position, time, torque)
        free = torque - self.load.readout(motion)
        friction = self.friction.readout(state.friction, motion, free)
        return PlantOutput(state.velocity, state.position, state.velocity, state.position, friction)

    def advance(self, state: OneMassState, torque: Array, time: Array, dt: Array) -> OneMassState:
        """The state dt [s] later, by the friction law's own step."""
        start = Motion(state.velocity, state.position, time, torque)
        return OneMassState(
            *self.friction.advance_body(state.friction, start, torque, self.load.readout, self.inertia, dt)
        )


class TwoMassState(eqx.Module):
    """State of a two-mass plant: velocities [rad/s], positions [rad], the friction law's own state."""

    motor_velocity: Array
    motor_position: Array
    load_velocity: Array
    load_position: Array
    friction: PyTree


class TwoMass(AbstractPlant):
    """Motor and load joined by a spring and a damper (3.1)-(3.2); friction acts on the load.

    Attributes:
        motor_inertia: J_m [kg m^2].
        load_inertia: J_l [kg m^2].
        stiffness: k_s [N m/rad].
        damping: k_cv [N m s/rad].
        friction: the law that acts on the load.
        load: a known load on the load side.
    """

    motor_inertia: Array = eqx.field(converter=as_parameter)
    load_inertia: Array = eqx.field(converter=as_parameter)
    stiffness: Array = eqx.field(converter=as_parameter)
    damping: Array = eqx.field(converter=as_parameter)
    friction: AbstractFriction
    load: AbstractLoad = NoLoad()

    def __check_init__(self) -> None:
        _check_two_mass(self)

    @property
    def inertia(self) -> Array:
        """Total inertia J_m + J_l [kg m^2]."""
        return self.motor_inertia + self.load_inertia

    def resonance(self) -> Array:
        """Free-free resonance [Hz] (3.15)."""
        return resonance_frequency(self.motor_inertia, self.load_inertia, self.stiffness)

    def rubbing_inertia(self) -> Array:
        """J_l [kg m^2]."""
        return self.load_inertia

    def init(self) -> TwoMassState:
        """At rest at position zero, the spring relaxed."""
        zero = jnp.zeros_like(self.motor_inertia)
        return TwoMassState(zero, zero, zero, zero, self.friction.init())

    def derivative(self, state: TwoMassState, torque: Array, time: Array) -> TwoMassState:
        """Accelerations [rad/s^2], velocities [rad/s], the friction law's derivative."""
        shaft = self._shaft(state)
        motion = Motion(state.load_velocity, state.load_position, time, shaft)
        free = shaft - self.load.readout(motion)
        friction = self.friction.readout(state.friction, motion, free)
        return TwoMassState(
            (torque - shaft) / self.motor_inertia,
            state.motor_velocity,
            (free - friction) / self.load_inertia,
            state.load_velocity,
            self.friction.derivative(state.friction, motion),
        )

    def readout(self, state: TwoMassState, torque: Array, time: Array) -> PlantOutput:
        """Load and motor velocity and position, friction on the load."""
        del torque
        shaft = self._shaft(state)
        motion = Motion(state.load_velocity, state.load_position, time, shaft)
        friction = self.friction.readout(state.friction, motion, shaft - self.load.readout(motion))
        return PlantOutput(
            state.load_velocity, state.load_position, state.motor_velocity, state.motor_position, friction
        )

    def _shaft(self, state: TwoMassState) -> Array:
        twist = state.motor_position - state.load_position
        return self.stiffness * twist + self.damping * (state.motor_velocity - state.load_velocity)


class SeriesTwoMassState(eqx.Module):
    """State of `SeriesTwoMass`: velocity [rad/s], position [rad], P_HO's two states, the friction law's own."""

    velocity: Array
    position: Array
    filtered: Array
    filter_rate: Array
    friction: PyTree


class SeriesTwoMass(AbstractPlant):
    """The thesis' Fig 3.5: the torque passes P_HO (3.28), then friction and P_LO = 1 / ((J_m + J_l) s) (3.27).

    Not the same as `TwoMass`: here the friction does not act back on the spring. Chapter 3 of the thesis is drawn this
    way; where its compensation enters is discussed on the documentation page that reproduces the thesis.

    Attributes:
        motor_inertia: J_m [kg m^2].
        load_inertia: J_l [kg m^2].
        stiffness: k_s [N m/rad].
        damping: k_cv [N m s/rad].
        friction: the law that acts behind the filter.
        load: a known load.
    """

    motor_inertia: Array = eqx.field(converter=as_parameter)
    load_inertia: Array = eqx.field(converter=as_parameter)
    stiffness: Array = eqx.field(converter=as_parameter)
    damping: Array = eqx.field(converter=as_parameter)
    friction: AbstractFriction
    load: AbstractLoad = NoLoad()

    def __check_init__(self) -> None:
        _check_two_mass(self)

    @property
    def inertia(self) -> Array:
        """Total inertia J_m + J_l [kg m^2]."""
        return self.motor_inertia + self.load_inertia

    def rubbing_inertia(self) -> Array:
        """J_m + J_l [kg m^2]."""
        return self.inertia

    def init(self) -> SeriesTwoMassState:
        """At rest at position zero."""
        zero = jnp.zeros_like(self.motor_inertia)
        return SeriesTwoMassState(zero, zero, zero, zero, self.friction.init())

    def derivative(self, state: SeriesTwoMassState, torque: Array, time: Array) -> SeriesTwoMassState:
        """Derivative of every state; the filter is in controllable form."""
        transmitted = self._transmitted(state)
        motion = Motion(state.velocity, state.position, time, transmitted)
        free = transmitted - self.load.readout(motion)
        friction = self.friction.readout(state.friction, motion, free)
        rate, acceleration = high_order_derivative(state.filtered, state.filter_rate, torque, self)
        return SeriesTwoMassState(
            (free - friction) / self.inertia,
            state.velocity,
            rate,
            acceleration,
            self.friction.derivative(state.friction, motion),
        )

    def readout(self, state: SeriesTwoMassState, torque: Array, time: Array) -> PlantOutput:
        """The one velocity and position (this form has no motor side of its own)."""
        del torque
        transmitted = self._transmitted(state)
        motion = Motion(state.velocity, state.position, time, transmitted)
        free = transmitted - self.load.readout(motion)
        friction = self.friction.readout(state.friction, motion, free)
        return PlantOutput(state.velocity, state.position, state.velocity, state.position, friction)

    def _transmitted(self, state: SeriesTwoMassState) -> Array:
        return high_order_output(state.filtered, state.filter_rate, self)


def high_order_derivative(filtered: Array, rate: Array, torque: Array, plant: PyTree) -> tuple[Array, Array]:
    """(x', x'') of P_HO (3.28): mu x'' + k_cv x' + k_s x = torque, with mu = J_m J_l / (J_m + J_l).

    `plant` is anything with the fields motor_inertia, load_inertia, stiffness and damping: a `SeriesTwoMass`, or the
    observer of one.
    """
    reduced = plant.motor_inertia * plant.load_inertia / (plant.motor_inertia + plant.load_inertia)
    return rate, (torque - plant.damping * rate - plant.stiffness * filtered) / reduced


def high_order_output(filtered: Array, rate: Array, plant: PyTree) -> Array:
    """Output of P_HO (3.28) [N m]: k_cv x' + k_s x."""
    return plant.damping * rate + plant.stiffness * filtered


def held_high_order(filtered: Array, rate: Array, torque: Array, plant: PyTree, dt: Array) -> tuple[Array, Array]:
    """(x, x') of P_HO (3.28) after dt [s] of a held torque [N m], exact for any damping.

    Args:
        filtered: x now [rad].
        rate: x' now [rad/s].
        torque: held over the step [N m].
        plant: gives motor_inertia, load_inertia, stiffness and damping.
        dt: step [s].
    """
    reduced = plant.motor_inertia * plant.load_inertia / (plant.motor_inertia + plant.load_inertia)
    # x - torque / k_s = e^(-d t) (A C(t) + B S(t)) with d the decay rate and r^2 = |k_s / mu - d^2|. C and S ("even"
    # and "odd", the decay included) are cos(r t) and sin(r t) / r where it swings, cosh and sinh / r where it is
    # overdamped, 1 and t where it is critically damped. All three are computed and one is selected, so that it batches.
    decay = 0.5 * plant.damping / reduced
    squared = plant.stiffness / reduced - decay * decay
    swings = squared > 0.0
    # Closer to critical damping than this the root has no digits; the ones in it keep gradients finite.
    distinct = jnp.abs(squared) > 1e-12 * decay * decay
    root = jnp.sqrt(jnp.where(distinct, jnp.abs(squared), jnp.ones_like(squared)))
    # The overdamped pair of exponentials. The minimum only matters where it swings and the pair is not used: root may
    # be larger than decay there, and the exponential could overflow.
    fast, slow = jnp.exp(-(decay + root) * dt), jnp.exp(jnp.minimum(root - decay, 0.0) * dt)
    fade = jnp.exp(-decay * dt)
    even = jnp.where(swings, fade * jnp.cos(root * dt), 0.5 * (slow + fast))
    odd = jnp.where(swings, fade * jnp.sin(root * dt) / root, 0.5 * (slow - fast) / root)
    even, odd = jnp.where(distinct, even, fade), jnp.where(distinct, odd, fade * dt)  # critically damped
    rest = torque / plant.stiffness  # the equilibrium under the held torque [rad]
    away = filtered - rest
    moved = rest + away * (even + decay * odd) + rate * odd
    return moved, rate * (even - decay * odd) - away * plant.stiffness / reduced * odd


def resonance_frequency(motor_inertia: Array, load_inertia: Array, stiffness: Array) -> Array:
    """Free-free resonance [Hz] (3.15): sqrt(k_s (J_l + J_m) / (J_l J_m)) / 2 pi.

    Args:
        motor_inertia: J_m [kg m^2].
        load_inertia: J_l [kg m^2].
        stiffness: k_s [N m/rad].
    """
    return jnp.sqrt(stiffness * (motor_inertia + load_inertia) / (motor_inertia * load_inertia)) / (2.0 * jnp.pi)


def _check_two_mass(plant: object) -> None:
    require_positive(plant, "motor_inertia", "kg m^2")
    require_positive(plant, "load_inertia", "kg m^2")
    require_positive(plant, "stiffness", "N m/rad")
    require_not_negative(plant, "damping", "N m s/rad")
