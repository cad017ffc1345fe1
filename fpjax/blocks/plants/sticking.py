"""Exact sticking: one step that stops where the speed crosses zero, and holds there while friction can.

A set-valued law sign(w) needs no steepness and no small steps if the step knows it: where the speed would change
its sign,
the step is cut at the crossing and goes on with what is left of the torque, soft(T, k) / J, in the rest of the
time; a body
at rest stays there while |T| <= k. Forward mode differentiates this almost everywhere. One step a control period
is enough
for a held torque; the torque's smooth part is taken at the middle of the step (second order).

Reference: the event is that of Karnopp, "Computer simulation of stick-slip friction in mechanical dynamic
systems", 1985,
resolved in time instead of by a band of speeds.
"""

from typing import Any

import jax.numpy as jnp
from jaxtyping import Array

from ...compiled.elementary import log
from ...errors import InputError
from ..friction import AbstractStaticFriction
from ..friction.bristles import Bristles
from ..signals import Motion
from .masses import AbstractPlant, OneMass, OneMassState, TwoMassState
from .transmission import Transmission

_NEARLY_REST = 1e-30  # a speed that has a direction and no size


def advance_exact(plant: AbstractPlant, state: Any, torque: Array, time: Array, dt: Array, substeps: int = 1) -> Any:
    """The plant's state dt [s] later under a held torque [N m], with sticking resolved exactly.

    Args:
        plant: `OneMass` under a static law or `Bristles`, or `Transmission` under a static law.
        state: the plant's state at `time`.
        torque: applied over the step [N m].
        time: start of the step [s].
        dt: length of the step [s].
        substeps: steps taken within it (a spring needs several).

    Raises:
        InputError: for a plant or a law that has no exact step.
    """
    step = dt / substeps
    for index in range(substeps):
        start = time + index * step
        if isinstance(plant, Transmission) and isinstance(plant.friction, AbstractStaticFriction):
            state = _transmission(plant, state, torque, start, step)
        elif isinstance(plant, OneMass) and isinstance(plant.friction, AbstractStaticFriction):
            state = _one_mass(plant, state, torque, start, step)
        elif isinstance(plant, OneMass) and isinstance(plant.friction, Bristles):
            state = _bristles(plant, state, torque, start, step)
        else:
            raise InputError(
                f"{type(plant).__name__} with {type(plant.friction).__name__} has no exact sticking step: "
                f"use one mass or a "
                "Transmission with a static friction law, or a solver such as rk4 with a steepness."
            )
    return state


def _one_mass(plant: OneMass, state: OneMassState, torque: Array, time: Array, dt: Array) -> OneMassState:
    law = plant.friction
    assert isinstance(law, AbstractStaticFriction)
    velocity, half = state.velocity, 0.5 * dt
    side = jnp.sign(velocity)
    # Position and time of the middle for every evaluation: then their sines and exponentials are computed once.
    place, moment = state.position + half * velocity, time + half
    start = Motion(velocity, place, moment, torque)
    free = torque - plant.load.readout(start)
    first = free - law.drag(start) - side * law.level(start)
    halfway = velocity + half * first / plant.inertia
    halfway = jnp.where(halfway * side > 0.0, halfway, 0.5 * velocity)
    middle = Motion(halfway, place, moment, torque)
    sliding = (free - law.drag(middle) - side * law.level(middle)) / plant.inertia
    return OneMassState(*_slip(law, velocity, state.position, free, sliding, middle, plant.inertia, dt), ())


def _slip(
    law: AbstractStaticFriction,
    velocity: Array,
    position: Array,
    free: Array,
    sliding: Array,
    middle: Motion,
    inertia: Array,
    dt: Array,
    share: Any = 1.0,
) -> tuple[Array, Array]:
    """(velocity, position) after dt: slides with `sliding` [rad/s^2] up to zero speed, then sticks or breaks away."""
    after = velocity + dt * sliding
    crosses = velocity * after <= 0.0
    safe = jnp.where(crosses & (velocity != 0.0), sliding, 1.0)
    until = jnp.where(velocity != 0.0, -velocity / safe, 0.0)
    toward = jnp.where(free < 0.0, -_NEARLY_REST, _NEARLY_REST)
    rest = Motion(toward, middle.position, middle.time, middle.torque)
    level = share * law.breakaway(rest)
    left = (free - jnp.clip(free, -level, level)) / inertia  # soft(T, k) / J
    turned = left * (dt - until)
    slid = position + 0.5 * dt * (velocity + after)
    stopped = position + 0.5 * until * velocity + 0.5 * (dt - until) * turned
    return jnp.where(crosses, turned, after), jnp.where(crosses, stopped, slid)


def _bristles(plant: OneMass, state: OneMassState, torque: Array, time: Array, dt: Array) -> OneMassState:
    """Half a step of travel, the bristles by their exact law, the speed by the mean share, the other half."""
    bristles = plant.friction
    assert isinstance(bristles, Bristles)
    law, half = bristles.law, 0.5 * dt
    velocity, share = state.velocity, state.friction
    place, moment = state.position + half * velocity, time + half
    start = Motion(velocity, place, moment, torque)
    free = torque - plant.load.readout(start)
    # The share that acts over the step: after the travel of half a step at the speed that the step begins with.
    between = bristles.advance(share, half * velocity)
    first = free - law.drag(start) - law.level(start) * between
    halfway = velocity + half * first / plant.inertia
    middle = Motion(halfway, place, moment, torque)
    side = jnp.where(halfway < 0.0, -1.0, 1.0)
    slack = jnp.maximum(1.0 - between * side, _NEARLY_REST)
    # sigma_1 dz/dt, implicit in the speed: a stiff damper must not limit the step.
    damper = bristles.damping * jnp.exp(bristles.exponent * log(slack))
    pulled = (
        torque
        - plant.load.readout(middle)
        - law.drag(middle)
        - law.level(middle) * bristles.advance(share, half * halfway)
    )
    slope = (pulled - damper * velocity) / (plant.inertia + half * damper)
    after = velocity + dt * slope
    travel = half * (velocity + after)
    return OneMassState(after, state.position + travel, bristles.advance(share, travel))


def _transmission(plant: Transmission, state: TwoMassState, torque: Array, time: Array, dt: Array) -> TwoMassState:
    """Half a step of the positions, a whole step of the speeds, half a step of the positions."""
    law, half = plant.friction, 0.5 * dt
    assert isinstance(law, AbstractStaticFriction)
    motor_position = state.motor_position + half * state.motor_velocity
    load_position = state.load_position + half * state.load_velocity
    twist, relative = motor_position - load_position, state.motor_velocity - state.load_velocity
    mobility = 1.0 / plant.motor_inertia + 1.0 / plant.load_inertia
    shaft = mean_shaft(plant, twist, relative, torque / plant.motor_inertia, mobility, dt)
    motor = Motion(state.motor_velocity, motor_position, time + half, torque)
    load = Motion(state.load_velocity, load_position, time + half, shaft)
    on_load = shaft - plant.load.readout(load)
    motor_velocity = turn(law, motor, torque - shaft, plant.motor_inertia, 1.0 - plant.friction_share, dt)
    load_velocity = turn(law, load, on_load, plant.load_inertia, plant.friction_share, dt)
    return TwoMassState(
        motor_velocity,
        motor_position + half * motor_velocity,
        load_velocity,
        load_position + half * load_velocity,
        (),
    )


def mean_shaft(plant: Transmission, twist: Array, relative: Array, push: Array, mobility: Array, dt: Array) -> Array:
    """Mean torque [N m] of the shaft over a step.

    A face of the play that is met or left within the step presses for its share of the step only: then the motion
    depends smoothly on the gap, and no step has to end at a contact.

    Args:
        plant: of the shaft.
        twist: in the middle of the step [rad].
        relative: speed, motor less load, at the start of the step [rad/s].
        push: acceleration of the twist but for the shaft's [rad/s^2].
        mobility: acceleration of the twist that the shaft takes away [rad/s^2 / (N m)].
        dt: length of the step [s].
    """
    half = 0.5 * dt

    def pressed(depth: Array, speed: Array, push: Array, share: Array) -> Array:
        # The damper at the speed of the middle of the step, to second order: spring and torque change it on the way.
        damper = half * plant.damping * share
        return (plant.stiffness * depth + plant.damping * share * speed + damper * push) / (1.0 + damper * mobility)

    def face(depth: Array, speed: Array, push: Array) -> Array:
        swing = half * speed
        size = jnp.maximum(jnp.abs(swing), _NEARLY_REST)
        share = jnp.clip(0.5 + 0.5 * depth / size, 0.0, 1.0)
        deep = jnp.where(share < 1.0, share * share * size, depth)
        return jnp.maximum(pressed(deep, speed, push, share), 0.0)  # a face pushes; it never pulls

    play = 0.5 * plant.gap
    faces = face(twist - play, relative, push) - face(-twist - play, -relative, -push)
    return jnp.where(plant.gap > 0.0, faces, pressed(twist, relative, push, jnp.ones_like(twist)))


def turn(law: AbstractStaticFriction, motion: Motion, free: Array, inertia: Array, share: Array, dt: Array) -> Array:
    """Speed [rad/s] after dt of a body under a free torque [N m] and a share of a law; at rest it sticks exactly."""
    braking = share * (law.drag(motion) + jnp.sign(motion.velocity) * law.level(motion))
    velocity, _ = _slip(
        law, motion.velocity, motion.position, free, (free - braking) / inertia, motion, inertia, dt, share
    )
    return velocity
