"""Replay tables: a record as the replay loop reads it, and where its machine surely moves."""

import jax.numpy as jnp
import numpy as np
from jaxtyping import Bool, Float

from ...logs.arrays import Values
from .channel import Channel
from .record import TURNING, Record
from .tables import TAPS, Guide, Tables

DAMPED = 0.7  # damping ratio of the guide: no resonance of its own [1]
AROUND = 10  # samples: the widest quadratic through a column
LATE = 30  # likewise, of a rate reading alone: by so much one may lag without anybody having told
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
    # With an encoder, the guide takes angle and speed from it: a rate reading may lag or have a bias.
    speed[TAPS : TAPS + count] = record.speed if record.integrated else np.gradient(record.angle, record.dt)
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

    That is, faster than any doubt about the direction for `AROUND` samples before and after, or `LATE`.
    """
    least = max(TURNING * float(np.quantile(np.abs(record.speed), 0.95)), SURE * record.speed_noise)
    width = 2 * (LATE if record.integrated else AROUND) + 1
    found = np.zeros(len(record.speed), bool)
    for way in (record.speed > least, record.speed < -least):
        # Centred; what lies beyond the log's ends counts as doubtful.
        found |= np.convolve(way, np.ones(width))[width // 2 :][: len(way)] > width - 0.5
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
