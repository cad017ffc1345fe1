"""The nominal machine with the torque that it misses, which leads where a diagnosis asserts no cause."""

import dataclasses
import math

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from ..blocks.actuators import ActuatorState
from ..blocks.signals import Motion
from ..gap.answer.posterior import Posterior
from ..gap.data.record import Record, in_one_piece
from ..gap.machine import Machine, nominal_machine, structure_of
from ..logs.arrays import Values
from ..model_file import Model
from ..simulation.precision import double_precision
from .from_diagnosis import Known

STANDS = 3.0  # standard deviations of the measured speed below which a body counts as at rest


def lead_as_given(known: Known, model: Model, record: Record) -> Known:
    """What is known, led by the nominal machine where the diagnosis asserts no cause.

    The model that a diagnosis reports without asserting it (of an unexplained log, or a detail beside no gap) may have
    a structure that the machine does not have, a resonance or a backlash that nobody found. The nominal machine with
    the torque that it misses along the log makes that log too, whatever the torque is. So it leads with half of the
    machines or more, and the reported model is one of its rivals, as often as it is likely beside them.

    Args:
        known: of the diagnosis.
        model: the nominal model.
        record: of the log.
    """
    reported = known.posterior
    if known.causes or not reported.causes or not math.isfinite(known.gap_before):
        return known
    with double_precision():
        machine = nominal_machine(model.loop.plant, model.loop.actuator, model.loop.sensor)
        machine = jax.tree.map(lambda leaf: jnp.asarray(leaf, float), machine)  # made under the caller's precision
        if structure_of(machine) != "rigid":
            return known  # bristles and shafts have states that no sensor shows: their missing torque is not told here
        piece = in_one_piece(record)
        missing = slowest(missing_torque(machine, piece), known.gap_before)
    # Causes may hold together, so that their probabilities sum to more than one; machines have one explanation each.
    rivals = ((known.likely, dataclasses.replace(reported, gap=known.gap_after, rivals=())), *reported.rivals)
    total = max(sum(share for share, _ in rivals), 1.0)
    given = Posterior(
        key=("rigid", reported.key[1] if reported.key[0] == "rigid" else ()),
        names=(), values=np.zeros(0), free=(), covariance=np.zeros((0, 0)), low=np.zeros(0), high=np.zeros(0),
        sensor=reported.sensor, step=reported.step, noise=reported.noise, missing=(missing,), gap=known.gap_before,
        rivals=tuple((share / total, rival) for share, rival in rivals),
    )  # fmt: skip
    return dataclasses.replace(known, posterior=given, gap_after=known.gap_before, learned=(), given=True)


def missing_torque(machine: Machine, record: Record) -> Values:
    """The torque that a rigid machine lacks along a log [N m], shape (samples,): positive where it drives.

    At rest friction takes what it can of the other torques, and only what is beyond its level is missing.

    Args:
        machine: one, of scalar parameters.
        record: the log, in one piece.
    """
    time, speed, angle = (jnp.asarray(each, float) for each in (record.time, record.speed, record.angle))
    dt = jnp.asarray(record.dt, float)

    def act(state: ActuatorState, now: tuple[Array, Array, Array, Array]) -> tuple[ActuatorState, Array]:
        return machine.actuator.step(state, now[0], Motion(*now[1:]), dt)

    command = jnp.asarray(record.torque, float)
    _, torque = jax.lax.scan(act, machine.actuator.init(), (command, speed, angle, time))
    motion = Motion(speed, angle, time, torque)
    law = machine.law
    needed = machine.plant.inertia * jnp.asarray(record.acceleration, float) + machine.plant.load.readout(motion)
    needed = needed + law.drag(motion) - torque
    level = law.level(motion)
    stands = jnp.abs(speed) < STANDS * record.speed_noise
    friction = jnp.where(stands, jnp.clip(-needed, -level, level), level * jnp.sign(speed))
    return np.asarray(needed + friction)


def slowest(torque: Values, size: float) -> Values:
    """The slow part of a torque whose rms is `size`: what is faster is noise of the acceleration, which grows with it.

    Args:
        torque: shape (samples,).
        size: its rms without noise, as the diagnosis found it on its windows, in the unit of the torque.

    Returns:
        The frequencies up to that at which the rms is reached, scaled to it: one strong frequency may hold most.
    """
    spectrum = np.fft.rfft(torque)
    power = np.abs(spectrum) ** 2
    power[1:] *= 2.0
    slower = np.cumsum(power) - power
    kept = np.fft.irfft(np.where(slower < (size * len(torque)) ** 2, spectrum, 0.0), len(torque))
    return kept * min(size / max(float(np.sqrt(np.mean(kept**2))), 1e-300), 1.0)
