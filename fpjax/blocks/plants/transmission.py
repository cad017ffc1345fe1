"""A transmission: motor and load joined by backlash, a spring and a damper, with friction on both sides."""

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array

from ...compiled.native import once
from ...errors import InputError
from ..block import as_optional, as_parameter, require_below, require_not_negative, require_positive, require_share
from ..friction import AbstractFriction, AbstractStaticFriction, NoFriction
from ..friction.base import Shares
from ..loads import AbstractLoad, NoLoad
from ..signals import Motion, PlantOutput
from .masses import AbstractPlant, TwoMassState, resonance_frequency

_SMALLEST = 1e-30  # [rad], in place of a zero divisor


class Transmission(AbstractPlant):
    """Two masses (3.1)-(3.2) with backlash between them, and the friction law shared between motor and load.

    Within the backlash the shaft carries no torque. In contact it carries that of a spring at the twist beyond the
    backlash + damping x relative speed, and the contact never pulls (Nordin, Gutman, "Controlling mechanical systems
    with backlash - a survey", 2002: contact ends as soon as the torque would change its sign). Without backlash it is a
    plain spring. Gears, couplings and above all strain wave gears get stiffer as they are wound up: the spring's torque
    is a cubic of its twist (Kircanski, Goldenberg, "An experimental study of nonlinear stiffness, hysteresis, and
    friction effects in robot joints with harmonic drives and torque sensors", 1997).

    Attributes:
        inertia: total inertia J [kg m^2].
        load_share: J_l / J [1], between 0 and 1.
        stiffness: k_s [N m/rad], at small twists.
        damping: k_cv [N m s/rad].
        gap: total backlash width [rad]; neutral 0.
        friction_share: share of the friction that acts on the load [1]; the rest acts on the motor.
        friction: the law, of the whole friction.
        load: a known load on the load side.
        hardening: c [N m/rad^3] of the spring's torque k_s twist + c twist^3; neutral 0.
        viscous_share: share of the law's smooth part (viscous friction, drag) that acts on the load [1], where it is
            divided otherwise than the rest: the back-EMF of a motor under a voltage is viscous friction of the motor
            alone. None: as `friction_share`.
    """

    inertia: Array = eqx.field(converter=as_parameter)
    load_share: Array = eqx.field(converter=as_parameter)
    stiffness: Array = eqx.field(converter=as_parameter)
    damping: Array = eqx.field(converter=as_parameter)
    friction: AbstractFriction
    gap: Array = eqx.field(converter=as_parameter, default=0.0)
    friction_share: Array = eqx.field(converter=as_parameter, default=1.0)
    load: AbstractLoad = NoLoad()
    hardening: Array = eqx.field(converter=as_parameter, default=0.0)
    viscous_share: Array | None = eqx.field(converter=as_optional, default=None)

    def __check_init__(self) -> None:
        require_positive(self, "inertia", "kg m^2")
        require_positive(self, "load_share", "1")
        require_positive(self, "stiffness", "N m/rad")
        require_not_negative(self, "damping", "N m s/rad")
        require_not_negative(self, "gap", "rad")
        require_share(self, "friction_share")
        require_not_negative(self, "hardening", "N m/rad^3")
        require_share(self, "viscous_share")
        require_below(self, "load_share", 1.0)
        if jax.tree.leaves(self.friction.init()):
            raise InputError(
                f"Transmission: {type(self.friction).__name__} has a state of its own, and the friction here is "
                "shared by two bodies: use a static law, or TwoMass for a law with memory on the load."
            )
        if self.viscous_share is not None and not isinstance(self.friction, AbstractStaticFriction | NoFriction):
            raise InputError(
                f"Transmission: {type(self.friction).__name__} has no smooth part of its own, which a viscous_share "
                "would divide: leave it out, or use a law such as CoulombViscous or GeneralFriction."
            )

    @property
    def load_inertia(self) -> Array:
        """J_l [kg m^2]."""
        return self.load_share * self.inertia

    @property
    def motor_inertia(self) -> Array:
        """J_m [kg m^2]."""
        return (1.0 - self.load_share) * self.inertia

    @property
    def on_load(self) -> Shares:
        """Shares of the friction that act on the load; the rest acts on the motor."""
        return Shares(self.friction_share, self.friction_share if self.viscous_share is None else self.viscous_share)

    def rubbing_inertia(self) -> Array:
        """The smaller of both sides' inertia over the larger share of friction on it [kg m^2]."""

        def per_share(inertia: Array, shares: Shares) -> Array:
            return inertia / jnp.maximum(jnp.maximum(shares.level, shares.drag), 1e-9)

        on_load = self.on_load
        return jnp.minimum(per_share(self.load_inertia, on_load), per_share(self.motor_inertia, on_load.others()))

    def resonance(self) -> Array:
        """Free-free resonance [Hz] (3.15) in contact, of small twists."""
        return resonance_frequency(self.motor_inertia, self.load_inertia, self.stiffness)

    def init(self) -> TwoMassState:
        """At rest at position zero, in the middle of the backlash."""
        zero = jnp.zeros_like(self.inertia)
        return TwoMassState(zero, zero, zero, zero, self.friction.init())

    def spring(self, twist: Array) -> Array:
        """Torque [N m] of the spring at a twist beyond the backlash [rad]."""
        return (self.stiffness + self.hardening * twist * twist) * twist

    def shaft(self, state: TwoMassState) -> Array:
        """Torque [N m] that the motor puts on the load."""
        twist = state.motor_position - state.load_position
        half = 0.5 * self.gap
        beyond = twist - jnp.clip(twist, -half, half)
        relative = state.motor_velocity - state.load_velocity
        spring, damper = self.spring(beyond), self.damping * relative
        # The damper may take from the spring's torque, but not turn it around: the faces do not stick together.
        pressing = jnp.sign(beyond) * jnp.maximum(jnp.sign(beyond) * (spring + damper), 0.0)
        return jnp.where(self.gap > 0.0, pressing, spring + damper)

    def derivative(self, state: TwoMassState, torque: Array, time: Array) -> TwoMassState:
        """Accelerations [rad/s^2], velocities [rad/s]; friction without a state only."""
        shaft = self.shaft(state)
        motor = Motion(state.motor_velocity, state.motor_position, time, torque)
        load = Motion(state.load_velocity, state.load_position, time, shaft)
        on_load = shaft - self.load.readout(load)
        motor_friction = self._rubbing(self.on_load.others(), motor, torque - shaft)
        load_friction = self._rubbing(self.on_load, load, on_load)
        return TwoMassState(
            (torque - shaft - motor_friction) / self.motor_inertia,
            state.motor_velocity,
            (on_load - load_friction) / self.load_inertia,
            state.load_velocity,
            (),
        )

    def readout(self, state: TwoMassState, torque: Array, time: Array) -> PlantOutput:
        """Both sides' velocities and positions; friction is that of both."""
        shaft = self.shaft(state)
        motor = Motion(state.motor_velocity, state.motor_position, time, torque)
        load = Motion(state.load_velocity, state.load_position, time, shaft)
        friction = self._rubbing(self.on_load.others(), motor, torque - shaft)
        friction = friction + self._rubbing(self.on_load, load, shaft - self.load.readout(load))
        return PlantOutput(
            state.load_velocity, state.load_position, state.motor_velocity, state.motor_position, friction
        )

    def _rubbing(self, shares: Shares, motion: Motion, applied: Array) -> Array:
        """Friction torque [N m] of one side, under its shares of the law."""
        torque: Array = shares.level * self.friction.readout((), motion, applied)
        if self.viscous_share is None or not isinstance(self.friction, AbstractStaticFriction):
            return torque
        return torque + (shares.drag - shares.level) * self.friction.drag(motion)

    def advance(self, state: TwoMassState, torque: Array, time: Array, dt: Array) -> TwoMassState:
        """Half a step of the positions, a whole step of the speeds, half a step of the positions (leapfrog)."""
        law, half = self.friction, 0.5 * dt
        if not isinstance(law, AbstractStaticFriction):
            return super().advance(state, torque, time, dt)
        state = once(state)
        motor_position = state.motor_position + half * state.motor_velocity
        load_position = state.load_position + half * state.load_velocity
        twist, relative = motor_position - load_position, state.motor_velocity - state.load_velocity
        of_motor, of_load = 1.0 / self.motor_inertia, 1.0 / self.load_inertia
        # What turns the masses against each other, but for the shaft: its damper answers to the speed that this makes.
        started, on_load = self.shaft(state), self.on_load
        on_motor = on_load.others()
        motor = Motion(state.motor_velocity, motor_position, time + half, torque)
        load = Motion(state.load_velocity, load_position, time + half, started)
        held = self.load.readout(load)
        ahead = law.net(motor, torque - started, on_motor) + started
        behind = started - law.net(load, started - held, on_load)
        push = once(ahead * of_motor + behind * of_load)
        shaft = once(self.mean_shaft(twist, relative, push, of_motor + of_load, dt))
        load = Motion(state.load_velocity, load_position, time + half, shaft)
        motor_velocity = law.turn(motor, torque - shaft, self.motor_inertia, on_motor, dt)
        load_velocity = law.turn(load, shaft - held, self.load_inertia, on_load, dt)
        return TwoMassState(
            motor_velocity,
            motor_position + half * motor_velocity,
            load_velocity,
            load_position + half * load_velocity,
            (),
        )

    def mean_shaft(self, twist: Array, relative: Array, push: Array, mobility: Array, dt: Array) -> Array:
        """Mean torque [N m] of the shaft over a step.

        Where contact begins or ends within the step, the contact torque counts for that share of the step only. So the
        motion depends continuously on the backlash width, and no step has to end at the moment of contact.

        Args:
            twist: in the middle of the step [rad].
            relative: speed, motor less load, at the start of the step [rad/s].
            push: acceleration of the twist but for the shaft's torque [rad/s^2].
            mobility: deceleration of the twist for each N m of the shaft's torque [rad/s^2 / (N m)].
            dt: length of the step [s].
        """
        half = 0.5 * dt

        def pressed(depth: Array, speed: Array, push: Array, share: Array) -> Array:
            # The damper takes the relative speed in the middle of the step, speed + half (push - mobility x torque),
            # where torque is the result itself: solved for it, which keeps a stiff damper stable.
            damper = half * self.damping * share
            given = self.spring(depth) + self.damping * share * speed
            return (given + damper * push) / (1.0 + damper * mobility)

        def face(depth: Array, speed: Array, push: Array) -> Array:
            # The depth of penetration goes from depth - swing to depth + swing within the step, on a straight line. It
            # is positive for `share` of the step, with a mean over the whole step of share^2 |swing|.
            swing = half * speed
            size = jnp.maximum(jnp.abs(swing), _SMALLEST)
            share = jnp.clip(0.5 + 0.5 * depth / size, 0.0, 1.0)
            deep = jnp.where(share < 1.0, share * share * size, depth)
            return jnp.maximum(pressed(deep, speed, push, share), 0.0)  # a contact pushes; it never pulls

        side = 0.5 * self.gap
        faces = face(twist - side, relative, push) - face(-twist - side, -relative, -push)
        return jnp.where(self.gap > 0.0, faces, pressed(twist, relative, push, jnp.ones_like(twist)))
