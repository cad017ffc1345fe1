"""Tables: a log as the replay loop reads it."""

import equinox as eqx
from jaxtyping import Array

TAPS = 128  # periods of the past that a lag is started from


class Tables(eqx.Module):
    """The log as the loop reads it, padded to a length of few choices.

    Attributes:
        torque: commanded [N m], TAPS periods of the past first, shape (padded,).
        velocity: read [rad/s], in step with torque.
        velocity_weight: 1 / standard deviation [s/rad]; 0 where there is no reading or the sample is padding.
        position: read [rad].
        position_weight: 1 / standard deviation [1/rad].
        dt: control period [s].
    """

    torque: Array
    velocity: Array
    velocity_weight: Array
    position: Array
    position_weight: Array
    dt: Array
