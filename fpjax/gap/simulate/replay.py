"""Replay: a recorded torque through the blocks, in windows, with the sensitivities that a fit needs.

A log is simulated in windows, each from start values of its own (multiple shooting), so that an error does not grow
over the whole log. All windows of all candidates, and every small change of a parameter that a Jacobian needs, are
lanes of one compiled loop: a lane has its own parameters and its own window, and `LANES` of them run at once in double
precision. (Forward-mode tangents were measured instead of differences: 1.6 times slower than a lane for each change,
and five times longer to compile.)
"""

import functools
from collections.abc import Callable

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, PyTree

from ...blocks.actuators import ActuatorState
from ...blocks.plants import OneMassState, TwoMassState
from ...blocks.signals import Motion
from ...compiled.native import once
from ..data.tables import TAPS, Tables
from ..effects.effect import Effect, EffectParameter
from ..machine import Machine, Structure, lanes, structure_of
from .held_motion import held_in_motion, moved, output_of, rests, sensor_error, sure_speed, turned
from .lane_kernel import lane_kernel
from .windows import Windows, from_rows

# Start values of a window: rate and position; the bristles' deflection; the twist and the relative speed.
STATES: dict[Structure, int] = {"rigid": 2, "bristles": 3, "transmission": 4}
# Integration steps in a control period: bristles and shafts are stiffer than a rigid mass. Two of them are off by 1 %
# in the frequency of the highest resonance that is looked for, a sixth of the sampling frequency (`highest_frequency`),
# and by 5 % in that of the hardest contact of a backlash, at a third of it.
SUBSTEPS: dict[Structure, int] = {"rigid": 1, "bristles": 2, "transmission": 2}
FINER = 3  # times as many substeps, to measure the integration error
WORST = 1e8  # a residual of more standard deviations counts as this many: a diverged lane must not overflow


def assembled(
    nominal: Machine, effects: tuple[Effect, ...], parameters: tuple[EffectParameter, ...], vector: Array
) -> Machine:
    """The nominal machine with every effect set from a vector of shape (parameters, lanes)."""
    values = {p.name: vector[index] for index, p in enumerate(parameters)}
    machine = lanes(nominal, vector.shape[1])
    for effect in effects:
        machine = effect.change(machine, values)
    return machine


def initial(machine: Machine, windows: Windows, states: Array, tables: Tables) -> tuple[PyTree, Array, Array]:
    """(plant's state, lagged torque [N m], lagged rate [rad/s]) at the start of the windows.

    Args:
        machine: of the lanes.
        windows: of the lanes.
        states: deviations of the start values from the estimates in `windows`, fitted by the caller: reading [rad/s],
            position [rad], hidden states; (states, lanes).
        tables: the log.
    """
    sensor, actuator = machine.sensor, machine.actuator
    # The sensor's model backwards: a reading lags by `late`, to first order in it, and has a scale and a bias.
    late = sensor.lag + sensor.delay
    rate = (windows.velocity + states[0] + late * windows.slope - sensor.bias) / sensor.scale
    # An integrated position has the integral of the bias in it, over the time since the log's start.
    drift = windows.integrated * ((windows.position - sensor.bias * windows.time) / sensor.scale - windows.position)
    position = windows.position + drift + windows.integrated * machine.origin + states[1]
    structure = structure_of(machine)
    if structure == "transmission":
        side = sensor.load_side
        twist, relative = windows.hidden[0] + states[2], windows.hidden[1] + states[3]
        # `rate` and `position` are those of the measured side; on the load, the motor is ahead of it by the twist.
        motor_rate, motor_position = rate + side * relative, position + side * twist
        plant: PyTree = TwoMassState(motor_rate, motor_position, motor_rate - relative, motor_position - twist, ())
    elif structure == "bristles":
        plant = OneMassState(rate, position, jnp.clip(windows.hidden[0] + states[2], -1.0, 1.0))
    else:
        plant = OneMassState(rate, position, ())
    assert actuator.lag is not None  # a machine of the diagnosis has every part
    assert actuator.delay is not None
    delay = actuator.delay
    # The first-order lag's state is the sum of the TAPS commands before, weighted by powers of `decay`; without a lag
    # the weight of the last one is 1.
    decay = jnp.exp(-tables.dt / jnp.maximum(actuator.lag, 1e-6 * tables.dt))

    def tap(carry: tuple[Array, Array], back: Array) -> tuple[tuple[Array, Array], None]:
        lagged, weight = carry
        command = command_at(tables, windows.start - 1 - back, delay)
        return (lagged + weight * actuator.shaped(command), weight * decay), None

    # A loop, not 128 copies: the copies were most of what there was to compile.
    taps = jnp.arange(TAPS, dtype=windows.start.dtype)
    (lagged, _), _ = jax.lax.scan(tap, (jnp.zeros_like(rate), 1.0 - decay), taps)
    # Limit, offset and cogging act behind the lag and are no part of its state.
    # The lagged rate: dead time taken out of the reading, lag left in.
    reading = (windows.velocity + states[0] - sensor.bias) / sensor.scale + sensor.delay * windows.slope
    return plant, lagged, reading


def command_at(tables: Tables, index: Array, delay: Array) -> Array:
    """The mean torque [N m] that acts over the period `index` when held commands arrive after a dead time [s].

    A dead time of 2.3 periods makes it 0.7 of the command two periods before and 0.3 of that three before.
    """
    periods = delay / tables.dt
    whole = jax.lax.stop_gradient(jnp.floor(periods))  # the fraction alone carries a derivative
    first = jnp.maximum(index - whole.astype(index.dtype), 0)
    fraction = periods - whole
    return tables.torque[first] + fraction * (tables.torque[jnp.maximum(first - 1, 0)] - tables.torque[first])


class Carry(eqx.Module):
    """State of a lane.

    Attributes:
        plant: state of the plant, guided.
        torque: state of the actuator's lag [N m].
        lagged: state of the sensor's lag [rad/s].
        lagged_before: that one period ago, for a fractional dead time of the sensor [rad/s].
        guided: (speed [rad/s], angle [rad]) that the guide has added to the masses so far.
        push: speed of it that was added at the end of the last period [rad/s].
    """

    plant: PyTree
    torque: Array
    lagged: Array
    lagged_before: Array
    guided: tuple[Array, Array]
    push: Array


def begin(machine: Machine, windows: Windows, states: Array, tables: Tables) -> Carry:
    """The carry before the first sample."""
    plant, torque, reading = initial(machine, windows, states, tables)
    none = 0.0 * torque
    before = reading - tables.dt * windows.slope / machine.sensor.scale
    return Carry(plant, torque, reading, before, (none, none), none)


def advance(
    machine: Machine, carry: Carry, windows: Windows, tables: Tables, index: Array, fine: bool = False
) -> tuple[Carry, tuple[Array, Array]]:
    """One control period: (next carry, (predicted reading [rad/s], predicted position [rad])).

    The sensors are read first, then the plant moves under the command of this period, as in the closed loop. The
    predictions are those without the guide: what it has added to speed and angle is taken off (`fpjax.gap.fit.guide`).

    Args:
        machine: of the lanes.
        carry: state of the lanes.
        windows: of the lanes.
        tables: the log.
        index: of the period in the windows, a scalar.
        fine: with shorter integration steps.
    """
    structure = structure_of(machine)
    substeps = (FINER if fine else 1) * SUBSTEPS[structure]
    at = windows.start + index
    time = windows.time + index.astype(tables.dt.dtype) * tables.dt
    state = carry.plant
    sensor = machine.sensor
    output = output_of(state)
    guided_rate, guided_angle = sensor.seen(output)
    rate, angle = guided_rate - carry.guided[0], guided_angle - carry.guided[1]
    # The fraction of a period of the sensor's dead time is interpolated; `residuals` shifts by the whole periods.
    late = carry.lagged + _fraction(sensor.delay, tables.dt) * (carry.lagged_before - carry.lagged)
    predicted = (sensor.reading(late), angle)
    assert machine.actuator.delay is not None
    command = command_at(tables, at, machine.actuator.delay)
    half = 0.5 * tables.dt
    guide = tables.guide
    # Torques of the position act where the machine was measured, not where the simulated one is.
    aside = tables.imposed * (guide.angle[at] - guided_angle)
    # Cogging and other torques of the position act with the position and time at the middle of the period.
    place = output.motor_position + aside + half * output.motor_velocity
    motion = Motion(output.motor_velocity, place, time + half)
    # Its dead time is in `command` already.
    actuator = eqx.tree_at(lambda block: block.delay, machine.actuator, None, is_leaf=lambda leaf: leaf is None)
    after, applied = actuator.step(ActuatorState(carry.torque, ()), command, motion, tables.dt)
    # A machine that surely moves has friction in that direction, and as at half its speed at least. Else a model could
    # rest under any torque below its friction, and none would seem to be missing.
    measured = sure_speed(sensor, tables.moving[at], windows.integrated)
    behind = held_in_motion(guided_rate, measured)
    applied, shift, measured = once((applied, (behind, aside), measured))
    following = once(moved(machine, state, applied, shift, measured, time, tables.dt, substeps))
    # The guide's acceleration [rad/s^2], constant over the period.
    turning = guide.stiffness * (guide.angle[at] - guided_angle)
    # Beside an encoder the guide follows its rate, which is the true one; without, what the rate sensor's reading says
    # of it, so that the guide is as firm whatever the sensor's scale, and holds no model to a reading that is late.
    bias, scale = sensor_error(sensor, windows.integrated)
    behind_by = windows.integrated * sensor.delay / tables.dt
    whole = jax.lax.stop_gradient(jnp.floor(behind_by))
    first = at + whole.astype(at.dtype)
    slope = guide.speed[first + 1] - guide.speed[first]
    reading = guide.speed[first] + (behind_by - whole + windows.integrated * sensor.lag / tables.dt) * slope
    turning = turning + guide.damping * ((reading - bias) / scale - guided_rate)
    faster, further = tables.dt * turning, half * tables.dt * turning
    # A mass that static friction holds has lost the last push to it: there is nothing of it to take off.
    remaining = carry.guided[0] - jnp.where(rests(following), carry.push, 0.0)
    following = turned(following, faster, further)
    # The sum of its double integration, exact for a constant acceleration in each period.
    guided = (remaining + faster, carry.guided[1] + tables.dt * remaining + further)
    rate_after = sensor.seen(output_of(following))[0] - guided[0]
    lagged = sensor.follow(carry.lagged, rate, rate_after, tables.dt)
    torque = carry.torque if after.lagged is None else after.lagged
    return Carry(following, torque, lagged, carry.lagged, guided, faster), predicted


def residuals(
    predicted: tuple[Array, Array], machine: Machine, windows: Windows, tables: Tables, index: Array
) -> tuple[Array, Array]:
    """Prediction less reading, in standard deviations of the sensors, each of shape (lanes,).

    A sensor with a dead time shows the rate in a later sample: the prediction is compared with that one.
    """
    at = windows.start + index
    whole = jax.lax.stop_gradient(jnp.floor(machine.sensor.delay / tables.dt)).astype(at.dtype)
    later = jnp.minimum(at + whole, tables.velocity.shape[0] - 1)
    velocity = (predicted[0] - tables.velocity[later]) * tables.velocity_weight[later]
    position = (predicted[1] - tables.position[at]) * tables.position_weight[at]
    return jnp.clip(velocity, -WORST, WORST), jnp.clip(position, -WORST, WORST)


@functools.lru_cache(maxsize=64)
def residual_kernel(
    effects: tuple[Effect, ...],
    parameters: tuple[EffectParameter, ...],
    longest: int,
    channels: tuple[bool, bool],
    fine: bool,
    fixed: PyTree,
) -> Callable[[list[Array], Array, Array, Array | np.integer], tuple[Array, Array]]:
    """The compiled loop: (leaves, rows, start, samples) -> residuals; logs and models of one structure share it.

    Args:
        effects: all effects of the family.
        parameters: their parameters, in the order of the vector.
        longest: length of the result's buffer [samples]. The window's own length is an argument of the function: were
            it compiled in, a log of a new length or rate would wait for all loops to be compiled again.
        channels: whether (velocity, position) is in the log.
        fine: with shorter steps.
        fixed: structure of (nominal machine, tables).

    Returns:
        A function of the leaves of (nominal machine, tables), the lanes as `as_rows` has them with their `start`, and
        the length of a window. It gives what was predicted less what was read, in standard deviations, shape
        (channels, longest, LANES): velocity, then position, zero behind the window; and the hidden states after its
        last sample, shape (2, LANES).
    """

    def run(fixed: tuple[Machine, Tables], rows: Array, start: Array, samples: Array) -> tuple[Array, Array]:
        nominal, tables = fixed
        vector, states, windows = from_rows(rows, start, len(parameters))
        machine = assembled(nominal, effects, parameters, vector)

        def step(index: Array, at: tuple[Carry, Array]) -> tuple[Carry, Array]:
            carry, found = at
            following, predicted = advance(machine, carry, windows, tables, index, fine)
            both = residuals(predicted, machine, windows, tables, index)
            kept = jnp.stack([r for r, there in zip(both, channels, strict=True) if there])
            return following, jax.lax.dynamic_update_index_in_dim(found, kept, index, 1)

        carry = begin(machine, windows, states, tables)
        room = jnp.zeros((sum(channels), longest, start.shape[0]), rows.dtype)
        last, found = jax.lax.fori_loop(jnp.int32(0), samples, step, (carry, room))
        return found, hidden_of(last.plant)

    return lane_kernel(run, fixed, effects, parameters, longest, channels, fine)


def hidden_of(state: PyTree) -> Array:
    """The hidden states of a plant, as in `Windows.hidden`, shape (2, lanes); zero for a rigid one."""
    if isinstance(state, TwoMassState):
        return jnp.stack([state.motor_position - state.load_position, state.motor_velocity - state.load_velocity])
    nothing = jnp.zeros_like(state.velocity)
    bristles = not isinstance(state.friction, tuple)
    return jnp.stack([state.friction if bristles else nothing, nothing])


def _fraction(delay: Array, dt: Array) -> Array:
    """Fraction of a period [1] in a delay [s]."""
    periods = delay / dt
    return periods - jax.lax.stop_gradient(jnp.floor(periods))
