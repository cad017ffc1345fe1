"""Hidden states at the start of each window, integrated along the measured motion before it.

The bristles' deflection, and the twist and relative speed of a transmission, are seen by no sensor. A window that
starts with a wrong deflection, or at the wrong face of a backlash, fits badly to its end. So the measured motion is
imposed on the mass that has the sensor, and only the hidden states are integrated through the past: nothing can
diverge, and after some periods they depend on their own start no more.
"""

import functools
from collections.abc import Callable

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int, PyTree

from ...blocks.friction import AbstractStaticFriction
from ...blocks.friction.bristles import Bristles
from ...blocks.plants.sticking import mean_shaft, turn
from ...blocks.plants.transmission import Transmission
from ...blocks.signals import Motion
from ...logs.arrays import Values
from ...simulation.precision import double_precision
from ..data.record import Record
from ..data.tables import TAPS, Tables
from ..effects.effect import Effect, EffectParameter
from ..machine import Machine, Structure
from .family import Family
from .lane_kernel import LANES, lane_kernel
from .replay import SUBSTEPS, assembled, command_at

PAST = 384  # periods of the past that a hidden state is integrated over; it forgets its start within them
BLOCK = 4096  # samples: a whole log is padded to a multiple, so that few lengths are compiled


class HiddenStates:
    """Integrates the hidden states of a family up to the start of each window.

    Args:
        family: with bristles or a transmission.
        records: the logs.
        tables: the records as the loops read them.
    """

    def __init__(self, family: Family, records: list[Record], tables: list[PyTree]):
        self.family, self.records, self.tables = family, records, tables
        with double_precision():
            nominal = jax.tree.map(lambda leaf: jnp.asarray(leaf, float), family.machine)
        self.fixed = [jax.tree.leaves((nominal, at)) for at in tables]
        structure = jax.tree.structure((nominal, tables[0]))
        self.run = _kernel(family.key[0], family.effects, family.parameters, structure)
        if family.key[0] == "transmission":
            self.whole = _whole_kernel(family.effects, family.parameters, structure)

    def centers(
        self, vectors: Float[Values, "parameters lanes"], which: int, windows: Int[Values, " lanes"]
    ) -> Float[Values, "2 lanes"]:
        """Hidden states at the start of windows, shape (2, lanes).

        Args:
            vectors: parameters of the lanes, (parameters, lanes).
            which: index of the record.
            windows: the window of each lane, an index into the record's `starts`, (lanes,).

        Returns:
            As `Windows.hidden`; zero where the integration was not finite.
        """
        record = self.records[which]
        starts = record.starts[windows]
        count = len(starts)
        # Shape (PAST + 1, lanes); before the log's start its first sample is repeated, as if the machine had rested.
        past = np.maximum(starts[None, :] - PAST + np.arange(PAST + 1)[:, None], 0)
        angle, speed = record.angle[past], record.speed[past]
        found = np.empty((2, count))
        with double_precision():
            for first in range(0, count, LANES):
                lanes = np.minimum(np.arange(first, first + LANES), count - 1)
                out = self.run(
                    self.fixed[which],
                    vectors[:, lanes],
                    angle[:, lanes],
                    speed[:, lanes],
                    past[:, lanes].astype(np.int32),
                )
                last = min(first + LANES, count)
                found[:, first:last] = np.stack([np.asarray(o) for o in out])[:, : last - first]
        return np.where(np.isfinite(found), found, 0.0)

    def shafts(
        self, vectors: Float[Values, "parameters lanes"], which: int, part: slice | None = None
    ) -> Float[Values, "_ lanes"]:
        """Torque of a shaft whose side with the sensor moves as measured [N m], shape (samples - 1, lanes).

        Args:
            vectors: parameters of at most `LANES` lanes, (parameters, lanes).
            which: index of the record.
            part: of its samples; None for all.
        """
        record, count = self.records[which], vectors.shape[1]
        first, last = (0, len(record.time)) if part is None else (part.start, part.stop)
        samples = last - first
        # Whole blocks: a log of another length then runs the loop that is compiled already.
        index = first + np.minimum(np.arange(-(-samples // BLOCK) * BLOCK), samples - 1)
        lanes = np.minimum(np.arange(LANES), count - 1)
        with double_precision():
            out = self.whole(
                self.fixed[which], vectors[:, lanes], record.angle[index], record.speed[index], index.astype(np.int32)
            )
        return np.asarray(out)[: samples - 1, :count]


@functools.lru_cache(maxsize=16)
def _kernel(
    structure: Structure, effects: tuple[Effect, ...], parameters: tuple[EffectParameter, ...], fixed: PyTree
) -> Callable[..., tuple[Array, Array]]:
    observe = _bristles if structure == "bristles" else _transmission

    def run(fixed: tuple[Machine, Tables], vector: Array, angle: Array, speed: Array, past: Array) -> PyTree:
        nominal, tables = fixed
        return observe(assembled(nominal, effects, parameters, vector), angle, speed, past, tables)

    return lane_kernel(run, fixed, effects, parameters, structure)


@functools.lru_cache(maxsize=16)
def _whole_kernel(
    effects: tuple[Effect, ...], parameters: tuple[EffectParameter, ...], fixed: PyTree
) -> Callable[..., Array]:
    def run(fixed: tuple[Machine, Tables], vector: Array, angle: Array, speed: Array, past: Array) -> Array:
        nominal, tables = fixed
        machine = assembled(nominal, effects, parameters, vector)
        lanes = vector.shape[1]

        def alike(values: Array) -> Array:
            return jnp.broadcast_to(values[:, None], (values.shape[0], lanes))

        return _driven(machine, alike(angle), alike(speed), alike(past), tables, lambda mean: mean)[2]

    return lane_kernel(run, fixed, effects, parameters)


def _bristles(machine: Machine, angle: Array, speed: Array, past: Array, tables: PyTree) -> tuple[Array, Array]:
    bristles = machine.plant.friction
    assert isinstance(bristles, Bristles)

    def step(share: Array, travel: Array) -> tuple[Array, None]:
        return bristles.advance(share, travel), None

    # Bristles know only how far the surfaces moved: the reading less the error of its scale, from relaxed bristles on.
    scaled = jnp.diff(angle, axis=0) / machine.sensor.scale[None]
    share, _ = jax.lax.scan(step, jnp.zeros_like(angle[0]), scaled)
    return share, jnp.zeros_like(share)


def _transmission(machine: Machine, angle: Array, speed: Array, past: Array, tables: PyTree) -> tuple[Array, Array]:
    """(twist [rad], relative speed [rad/s]) at the last sample, motor less load whichever of them is measured."""
    position, velocity, _ = _driven(machine, angle, speed, past, tables, lambda mean: None)
    sign = jnp.where(machine.sensor.load_side > 0.5, 1.0, -1.0)
    return sign * (position - angle[-1]), sign * (velocity - speed[-1])


def _driven(
    machine: Machine, angle: Array, speed: Array, past: Array, tables: PyTree, keep: Callable[[Array], PyTree]
) -> tuple[Array, Array, PyTree]:
    """Simulate the unmeasured mass of a transmission whose other mass moves as it was measured.

    Args:
        machine: of the lanes.
        angle: of the measured mass [rad], shape (samples, lanes).
        speed: likewise [rad/s].
        past: index of each sample in the log, (samples, lanes).
        tables: the log.
        keep: maps the shaft's mean torque over a period [N m] to what is returned of it; None to return nothing.

    Returns:
        (position [rad] and velocity [rad/s] of the unmeasured mass at the last sample, what `keep` gave by period).
    """
    plant = machine.plant
    assert isinstance(plant, Transmission)
    law, on_load = plant.friction, machine.sensor.load_side > 0.5
    substeps = SUBSTEPS["transmission"]
    h = tables.dt / substeps
    # With the sensor on the load, the motor is simulated, and the other way round.
    inertia = jnp.where(on_load, plant.motor_inertia, plant.load_inertia)
    shares = jax.tree.map(lambda share: jnp.where(on_load, 1.0 - share, share), plant.on_load)
    half = 0.5 * plant.gap
    actuator = machine.actuator
    assert actuator.gain is not None
    assert actuator.delay is not None
    assert actuator.offset is not None
    assert isinstance(law, AbstractStaticFriction)
    gain, delay, offset = actuator.gain, actuator.delay, actuator.offset

    def period(carry: tuple[Array, Array], row: tuple[Array, ...]) -> tuple[tuple[Array, Array], PyTree]:
        position, velocity = carry  # of the unmeasured mass
        seen, after, rate, rate_after, index = row
        command = command_at(tables, index, delay)
        # The command acts on the motor; a simulated load is driven by the shaft alone.
        plain = jnp.where(on_load, gain * command + offset, 0.0)
        mean = jnp.zeros_like(position)
        for k in range(substeps):
            middle = (k + 0.5) / substeps
            # The measured mass at the middle of the substep, on a line between its readings. The simulated one drifts
            # half a step, changes speed by the torques there, and drifts the other half (leapfrog).
            place, moving = seen + middle * (after - seen), rate + middle * (rate_after - rate)
            position = position + 0.5 * h * velocity
            sign = jnp.where(on_load, 1.0, -1.0)
            twist = sign * (position - place)
            relative = sign * (velocity - moving)
            # A known load acts on the load side: where that is measured, its motion holds it already.
            held = plant.load.readout(Motion(velocity, position + machine.origin, jnp.zeros_like(position), plain))
            held = jnp.where(on_load, 0.0, held)
            shaft = mean_shaft(plant, twist, relative, (plain + held) / inertia, 1.0 / inertia, h)
            mean = mean + shaft / substeps
            free = jnp.where(on_load, plain - shaft, shaft - held)
            velocity = turn(law, Motion(velocity, position, jnp.zeros_like(position), free), free, inertia, shares, h)
            position = position + 0.5 * h * velocity
        return (position, velocity), keep(mean)

    # Row k: both ends of period k, and the index of its command in the padded tables.
    rows = (angle[:-1], angle[1:], speed[:-1], speed[1:], past[:-1] + TAPS)
    # Start at the face that a steady motion presses on: the motor ahead of the load by half the clearance.
    side = jnp.sign(speed[0]) * jnp.where(on_load, 1.0, -1.0) * half
    (position, velocity), kept = jax.lax.scan(period, (angle[0] + side, speed[0]), rows)
    return position, velocity, kept
