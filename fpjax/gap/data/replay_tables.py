"""Replay tables: a record as the replay loop reads it, and where its machine surely moves."""

import jax.numpy as jnp
import numpy as np
from jaxtyping import Bool, Float

from ...logs.arrays import Values, runs_of
from .channel import Channel
from .record import TURNING, Record
from .tables import TAPS, Guide, Tables

DAMPED = 0.7  # damping ratio of the guide: no resonance of its own [1]
LATE = 30  # samples by which a rate reading may lag without anybody having told
SURE = 5.0  # standard deviations above which a smoothed speed has a direction [1]


def tables_of(record: Record, bandwidth: float = 0.0, *, free: bool = False) -> Tables:
    """The record as the replay loop reads it, padded to a common length so that all logs share one compiled loop.

    Args:
        record: a log.
        bandwidth: of the guide [Hz] (`fpjax.gap.fit.guide`); zero for none.
        free: whether the simulated machine may rest where the real one surely moves, and torques of the position act
            where it is. Else they act at the encoder's angle, if there is one.
    """
    count = len(record.time)
    padded = _padded(count + TAPS + 64)
    torque = np.full(padded, record.torque[0])
    torque[TAPS : TAPS + count] = record.torque
    velocity, velocity_weight = _column(record.velocity, count, padded)
    position, position_weight = _column(record.position, count, padded)
    speed, angle = np.zeros(padded), np.zeros(padded)
    speed[TAPS : TAPS + count] = record.followed
    angle[TAPS : TAPS + count] = record.angle
    moving = np.zeros(padded)
    if not free:
        moving[TAPS : TAPS + count] = np.where(surely_moving(record), speed[TAPS : TAPS + count], 0.0)
    return Tables(
        jnp.asarray(torque, float),
        jnp.asarray(velocity, float),
        jnp.asarray(velocity_weight, float),
        jnp.asarray(position, float),
        jnp.asarray(position_weight, float),
        jnp.asarray(record.dt, float),
        Guide(*(jnp.asarray(value, float) for value in (speed, angle, *guide_of(record, bandwidth)))),
        jnp.asarray(moving, float),
        jnp.asarray(0.0 if free or record.integrated else 1.0, float),
    )


def surely_moving(record: Record) -> Bool[Values, " samples"]:
    """Where the machine moves in one direction, no matter how the readings are smoothed or delayed.

    That is in a run of one direction which no sample of the speed leaves in doubt, away from its ends. A run counts as
    motion where it reaches a share of the top speed: bristles that bend under a machine at rest do not.
    """
    speed, noise = record.followed, record.followed_noise
    least = TURNING * float(np.quantile(np.abs(speed), 0.95))
    away = record.smoothing or LATE
    found = np.zeros(len(speed), bool)
    for way in (speed > SURE * noise, speed < -SURE * noise):
        for first, last in runs_of(way):
            if np.max(np.abs(speed[first:last])) > least:
                found[first + away : max(last - away, 0)] = True
    return found


def guide_of(record: Record, bandwidth: float) -> tuple[float, float]:
    """(stiffness w^2 [1/s^2], damping 2 zeta w [1/s]) of a guide; without an encoder it has no angle to follow."""
    turning = 2.0 * np.pi * bandwidth
    return (0.0 if record.integrated else turning**2), 2.0 * DAMPED * turning


def _column(
    channel: Channel | None, count: int, padded: int
) -> tuple[Float[Values, " padded"], Float[Values, " padded"]]:
    values, weight = np.zeros(padded), np.zeros(padded)
    if channel is not None:
        values[TAPS : TAPS + count] = channel.values
        values[TAPS + count :] = channel.values[-1]
        weight[TAPS : TAPS + count] = 1.0 / channel.noise
    return values, weight


def _padded(count: int) -> int:
    size = 2**16  # more than MOST with its leads and edges: usually the only size
    while size < count:
        size *= 2
    return size
