"""Tables: a log as the replay loop reads it."""

import equinox as eqx
from jaxtyping import Array

TAPS = 128  # periods of the past that a lag is started from


class Guide(eqx.Module):
    """What holds a simulation near the measured motion: an acceleration of all masses alike, taken out again.

    Attributes:
        speed: measured and smoothed [rad/s], in step with the torque, shape (padded,).
        angle: likewise [rad].
        stiffness: acceleration by angle [1/s^2].
        damping: acceleration by speed [1/s].
    """

    speed: Array
    angle: Array
    stiffness: Array
    damping: Array


class Tables(eqx.Module):
    """The log as the loop reads it, padded to a length of few choices.

    Attributes:
        torque: commanded [N m], TAPS periods of the past first, shape (padded,).
        velocity: read [rad/s], in step with torque.
        velocity_weight: 1 / standard deviation [s/rad]; 0 where there is no reading or the sample is padding.
        position: read [rad].
        position_weight: 1 / standard deviation [1/rad].
        dt: control period [s].
        guide: of stiffness and damping zero for a simulation that is left to itself.
    """

    torque: Array
    velocity: Array
    velocity_weight: Array
    position: Array
    position_weight: Array
    dt: Array
    guide: Guide
