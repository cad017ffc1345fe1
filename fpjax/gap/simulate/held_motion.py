"""A period of a simulated plant that is held in motion: its friction acts as where the machine surely moves."""

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, PyTree

from ...blocks.friction.base import AbstractStaticFriction, faded
from ...blocks.friction.general import GeneralFriction
from ...blocks.plants import OneMassState, TwoMassState
from ...blocks.plants.sticking import advance_exact
from ...blocks.servo_sensor import ServoSensor
from ...blocks.signals import Motion, PlantOutput
from ..machine import Machine, structure_of

LEAST_SPEED = 0.5  # of the measured speed: friction of a simulated machine that is slower acts as at this one


def held_in_motion(speed: Array, measured: Array) -> Array:
    """What a simulated machine's speed lacks of `LEAST_SPEED` of that at which it surely moves [rad/s], arrays alike.

    Args:
        speed: simulated.
        measured: as of `sure_speed`; 0 for unknown.
    """
    least = LEAST_SPEED * measured
    return jnp.where(jnp.sign(least) * (speed - least) < 0.0, least - speed, 0.0)


def sure_speed(sensor: ServoSensor, reading: Array, alone: Array) -> Array:
    """Speed at which the machine surely moves [rad/s], 0 for unknown.

    Without an encoder it is what the reading says under the sensor's bias and scale; a reading of which the bias is
    more than half may be a machine at rest; one of the other sign moves all the faster.

    Args:
        sensor: of the lanes.
        reading: where it is far from zero, else 0 [rad/s].
        alone: 1 where there is no encoder beside it.
    """
    bias, scale = sensor_error(sensor, alone)
    told = bias * jnp.sign(reading) < 0.5 * jnp.abs(reading)
    return jnp.where(told, (reading - bias) / scale, 0.0)


def sensor_error(sensor: ServoSensor, alone: Array) -> tuple[Array, Array]:
    """(bias [rad/s], scale [1]) of a rate sensor without an encoder beside it, as in `sure_speed`; else none."""
    return alone * sensor.bias, 1.0 + alone * (sensor.scale - 1.0)


def moved(
    machine: Machine, state: PyTree, applied: Array, shift: tuple[Array, Array], measured: Array, time: Array,
    dt: Array, substeps: int,
) -> PyTree:  # fmt: skip
    """The plant's state a period later.

    Args:
        machine: of the lanes.
        state: at the start of the period.
        applied: torque [N m].
        shift: (speed [rad/s], angle [rad]) from the simulated motion to the one in which friction and torques of the
            position act; of one rigid mass the friction's level alone, its drag, which has no direction that could be
            wrong, being that of its own speed. (With shafts and bristles that was tried: a Stribeck friction beside a
            known shaft came out up to 9 % off.)
        measured: speed [rad/s] at which the machine surely moves: there nothing stops within the period; 0 for unknown.
        time: start of the period [s].
        dt: control period [s].
        substeps: in a period.
    """
    behind, aside = shift
    side = jnp.sign(measured)
    rigid = isinstance(state, OneMassState) and structure_of(machine) == "rigid"
    motion = _at(turned(state, behind, aside), applied, time, 0.5 * dt)
    if not rigid:
        # As much faster as it takes not to stop, but no faster than it was: friction at another speed is another one.
        free = applied - machine.plant.load.readout(motion)
        most = 2.0 * dt * (jnp.abs(free) + machine.law.breakaway(motion)) / machine.plant.inertia
        most = jnp.minimum(most, jnp.abs(measured))
        rate = machine.sensor.seen(output_of(state))[0] + behind  # of the mass that was measured: the other one swings
        behind = behind + side * jnp.maximum(most - side * rate, 0.0) * jnp.abs(side)
        following = advance_exact(machine.plant, turned(state, behind, aside), applied, time, dt, substeps)
        return turned(following, -behind, -aside - dt * behind)
    law = _HeldInMotion(machine.law, behind)
    held = eqx.tree_at(lambda plant: plant.friction, machine.plant, law)
    following = advance_exact(held, turned(state, behind, aside), applied, time, dt, substeps)
    stops = side * following.velocity < 0.0
    stops = stops | ((side != 0.0) & (following.velocity == 0.0))
    # Where it would stop, the acceleration that it starts with goes on, as far as its own drag lets it.
    free = applied - machine.plant.load.readout(motion)
    sliding = (free - law.drag(motion) - side * law.level(motion)) / machine.plant.inertia
    final, mean = faded(dt * law.drag_slope(motion) / machine.plant.inertia)
    gained = jnp.where(stops, final * dt * sliding, following.velocity - motion.velocity)
    further = following.position - aside - state.position - dt * motion.velocity
    travel = jnp.where(stops, mean * dt * dt * sliding, further)
    carried = stops | (behind != 0.0)
    speed = jnp.where(carried, state.velocity + gained, following.velocity)  # at rest zero to the last bit
    return OneMassState(speed, state.position + dt * state.velocity + travel, following.friction)


class _HeldInMotion(AbstractStaticFriction):
    """A law in the motion in which a simulation is held: its level is that motion's, its drag the own speed's.

    Attributes:
        law: of the machine.
        behind: what the own speed lacks of that motion's [rad/s].
    """

    law: GeneralFriction
    behind: Array
    steepness: Array | None = None

    def level(self, motion: Motion) -> Array:
        """The law's [N m]."""
        return self.law.level(motion)

    def breakaway(self, motion: Motion) -> Array:
        """The law's [N m]."""
        return self.law.breakaway(motion)

    def drag(self, motion: Motion) -> Array:
        """The law's at the own speed [N m]."""
        return self.law.drag(Motion(motion.velocity - self.behind, motion.position, motion.time, motion.torque))


def _at(state: PyTree, applied: Array, time: Array, half: Array) -> Motion:
    """The motion at which a step's torques are taken: the speed of its start, the place and time of its middle."""
    output = output_of(state)
    place = output.motor_position + half * output.motor_velocity
    return Motion(output.motor_velocity, place, time + half, applied)


def rests(state: PyTree) -> Array:
    """Whether static friction holds every mass: the exact solution has a speed of zero there, to the last bit."""
    if isinstance(state, TwoMassState):
        return (state.motor_velocity == 0.0) & (state.load_velocity == 0.0)
    return state.velocity == 0.0


def turned(state: PyTree, faster: Array, further: Array) -> PyTree:
    """A plant's state with the same speed [rad/s] and angle [rad] added to each mass: twist and relative speed stay."""
    if isinstance(state, TwoMassState):
        return TwoMassState(
            state.motor_velocity + faster, state.motor_position + further,
            state.load_velocity + faster, state.load_position + further, state.friction,
        )  # fmt: skip
    return OneMassState(state.velocity + faster, state.position + further, state.friction)


def output_of(state: PyTree) -> PlantOutput:
    """Velocities and positions of load and motor; equal for one mass."""
    if isinstance(state, TwoMassState):
        return PlantOutput(
            state.load_velocity, state.load_position, state.motor_velocity, state.motor_position, state.load_velocity
        )
    return PlantOutput(state.velocity, state.position, state.velocity, state.position, state.velocity)
