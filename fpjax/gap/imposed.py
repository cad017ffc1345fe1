# pyright: reportArgumentType=false
"""Imposed motion: what a model would have to be given beside the command to move as was measured, in torque.

For a log without a rate sensor. Under tight feedback a position hardly moves whatever the model is, and one that is
simulated from a free start hides a constant torque. So the measured motion is imposed on the side that the encoder sits
on, hidden states (bristles, the other side of a shaft) are integrated through the recorded past and never fitted, and

    left = 1/2 (net_k + net_(k-1)) - J (q_(k+1) - 2 q_k + q_(k-1)) / dt^2    [N m]

where net_k is the momentum per time that the model's own step gains in a period from the state measured at its start,
and J the inertia of that side. It is smoothed by the weights with which the record's acceleration is differentiated, so
that both sides of the equation have one band, and told once per `stride` samples, which is what that band can hold.
"""

import functools
from collections.abc import Callable
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from ..blocks.plants import OneMassState, TwoMassState
from ..blocks.plants.transmission import Transmission
from .effect import Effect, Parameter
from .machine import Machine, structure_of
from .measure import NoiseFloor, lap_length, rms, rms_interval
from .record import PAST, Record, band_weights
from .replay import (
    STATES,
    TAPS,
    WORST,
    Carry,
    Tables,
    Windows,
    advance,
    assembled,
    begin,
    from_rows,
    lane_kernel,
    output_of,
)

Values = np.ndarray
SHORT_PAST = 32  # periods of the past where nothing is hidden


class Imposed(eqx.Module):
    """The measured motion as the loop reads it, padded as `Tables` are.

    Attributes:
        angle: smoothed position [rad].
        speed: smoothed [rad/s].
        weight: 1 / standard deviation that the encoder's noise gives to the torque [1/(N m)].
    """

    angle: Array
    speed: Array
    weight: Array


def imposed_motion(record: Record, inertia: float, size: int) -> Imposed:
    """The motion of a record for the loop.

    Args:
        record: without a rate sensor.
        inertia: of the nominal model [kg m^2].
        size: padded length.
    """
    return Imposed(
        _padded(record.angle, size), _padded(record.speed, size), jnp.asarray(1.0 / noise_torque(record, inertia))
    )


def noise_torque(record: Record, inertia: float) -> float:
    """Standard deviation of what the encoder's noise alone leaves of the torque [N m]."""
    assert record.position is not None
    gain = float(np.sqrt(np.sum(np.convolve(band_weights(record.half), (1.0, -2.0, 1.0)) ** 2)))
    return inertia * record.position.noise * gain / record.dt**2


def torque_floor(record: Record, left: Values, inertia: float) -> NoiseFloor:
    """What a perfect model would leave of the torque: by laps of the reference, or by the encoder's noise.

    Args:
        record: the log.
        left: what the best model leaves [N m], shape (samples,), NaN where unknown.
        inertia: of the nominal model [kg m^2].
    """
    level = noise_torque(record, inertia)
    lap = 0 if record.reference is None else lap_length(record.reference)
    if lap:
        difference = (left[lap:] - left[:-lap]) / np.sqrt(2.0)
        difference = difference[np.isfinite(difference)]
        if len(difference) >= lap // 4 and rms(difference) > 1.05 * level:
            return NoiseFloor(rms(difference), rms_interval(difference), "repeats")
    return NoiseFloor(level, (0.9 * level, 1.1 * level), "sensor")


@functools.lru_cache(maxsize=64)
def imposed_kernel(
    effects: tuple[Effect, ...],
    parameters: tuple[Parameter, ...],
    samples: int,
    half: int,
    stride: int,
    fixed: Any,
) -> Callable[[list[Array], Array, Array], Array]:
    """The compiled loop: (leaves, rows, start) -> what is left, in standard deviations of the
    encoder's noise, shape (1, samples / stride, lanes).

    Args:
        effects: all effects of the super-model.
        parameters: theirs, in the order of the vector.
        samples: length of a window.
        half: samples on either side of the local quadratics.
        stride: samples from one value to the next.
        fixed: structure of (nominal machine, tables, motion), whose leaves come first.
    """
    weights = band_weights(half)
    reach = len(weights) // 2
    told = np.arange(0, samples - stride + 1, stride)[:, None] + stride // 2 + np.arange(-reach, reach + 1)

    def run(fixed: tuple[Machine, Tables, Imposed], rows: Array, start: Array) -> Array:
        nominal, tables, motion = fixed
        vector, _, windows = from_rows(rows, start, len(parameters))
        machine = assembled(nominal, effects, parameters, vector)
        structure = structure_of(machine)
        past = max(SHORT_PAST, reach + 2) if structure == "rigid" else PAST
        inertia = _seen_inertia(machine)
        first = windows.start - past
        earlier = Windows(
            start=first,
            time=windows.time - past * tables.dt,
            velocity=motion.speed[first],
            slope=(motion.speed[first + 1] - motion.speed[first]) / tables.dt,
            position=motion.angle[first],
            hidden=(jnp.zeros_like(windows.time), jnp.zeros_like(windows.time)),
            integrated=jnp.zeros_like(windows.time),
        )

        def step(carry: Carry, index: Array) -> tuple[Carry, Array]:
            at = first + index
            measured = _with_motion(carry.plant, machine, motion.angle[at], motion.speed[at])
            carry = eqx.tree_at(lambda state: state.plant, carry, measured)
            following, _ = advance(machine, carry, earlier, tables, index)
            rate, _ = machine.sensor.seen(output_of(following.plant))
            return following, inertia * (rate - motion.speed[at]) / tables.dt

        states = jnp.zeros((STATES[structure], vector.shape[1]))
        length = past + samples + reach + 1
        carry = begin(machine, earlier, states, tables)
        _, net = jax.lax.scan(step, carry, jnp.arange(length, dtype=jnp.int32))
        at = first[None, :] + jnp.arange(1, length, dtype=jnp.int32)[:, None]
        second = tables.position[at + 1] - 2.0 * tables.position[at] + tables.position[at - 1]
        left = 0.5 * (net[1:] + net[:-1]) - inertia[None] * second / tables.dt**2
        smooth = jnp.einsum("j,ijl->il", jnp.asarray(weights), left[past - 1 + told])
        return jnp.clip(smooth * motion.weight, -WORST, WORST)[None]

    return lane_kernel(run, fixed)


def _with_motion(state: Any, machine: Machine, angle: Array, speed: Array) -> Any:
    """The state with the measured motion on the encoder's side."""
    if isinstance(state, OneMassState):
        return OneMassState(speed, angle, state.friction)
    on_load = machine.sensor.load_side > 0.5
    return TwoMassState(
        jnp.where(on_load, state.motor_velocity, speed),
        jnp.where(on_load, state.motor_position, angle),
        jnp.where(on_load, speed, state.load_velocity),
        jnp.where(on_load, angle, state.load_position),
        state.friction,
    )


def _seen_inertia(machine: Machine) -> Array:
    """Of the encoder's side [kg m^2]."""
    plant = machine.plant
    if not isinstance(plant, Transmission):
        return plant.inertia
    return jnp.where(machine.sensor.load_side > 0.5, plant.load_inertia, plant.motor_inertia)


def _padded(values: Values, size: int) -> Array:
    found = np.full(size, values[-1])
    found[:TAPS] = values[0]
    found[TAPS : TAPS + len(values)] = values
    return jnp.asarray(found)
