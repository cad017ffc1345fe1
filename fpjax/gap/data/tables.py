"""Tables: a log as the replay loop reads it."""

import equinox as eqx
from jaxtyping import Array, Float

TAPS = 128  # periods of past commands from which an actuator's lag gets its start value


class Guide(eqx.Module):
    """Holds a simulation near the measured motion: one acceleration for all masses, taken out of the prediction again.

    Attributes:
        speed: measured and smoothed [rad/s], indexed as the torque, shape (padded,).
        angle: measured and smoothed [rad], likewise.
        stiffness: acceleration per angle error [1/s^2], scalar.
        damping: acceleration per speed error [1/s], scalar.
    """

    speed: Float[Array, " padded"]
    angle: Float[Array, " padded"]
    stiffness: Float[Array, ""]
    damping: Float[Array, ""]


class Tables(eqx.Module):
    """The log as the loop reads it, padded to a power of two: arrays of shape (padded,).

    Sample k of the record is entry k + TAPS.

    Attributes:
        torque: commanded [N m]; before the record its first value.
        velocity: reading [rad/s].
        velocity_weight: 1 / standard deviation [s/rad]; 0 where there is no reading or the sample is padding.
        position: reading [rad].
        position_weight: 1 / standard deviation [1/rad].
        dt: control period [s].
        guide: with stiffness and damping zero for a free simulation.
        moving: measured speed where the machine surely moves, else 0 [rad/s].
        imposed: 1 where torques of the position act at the guide's angle, 0 where they act at the simulated one.
    """

    torque: Float[Array, " padded"]
    velocity: Float[Array, " padded"]
    velocity_weight: Float[Array, " padded"]
    position: Float[Array, " padded"]
    position_weight: Float[Array, " padded"]
    dt: Float[Array, ""]
    guide: Guide
    moving: Float[Array, " padded"]
    imposed: Float[Array, ""]
