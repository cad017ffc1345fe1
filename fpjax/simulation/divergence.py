"""The rule by which a run has diverged: numbers that are not finite, or signals out of all proportion."""

from collections.abc import Mapping
from typing import Any

import jax.numpy as jnp
from jaxtyping import Array, Bool

from ..blocks.controllers import AbstractController, TorqueInput

LARGEST = 1e15  # beyond this a number counts as not finite, in whatever unit
# A compensation over the largest torque that was commanded, and a motion over the largest reference [1]. An observer
# that is unstable behind a limit of the torque grows by decades while the loop looks healthy; machines that are far
# from what they are asked for (0.1 rad/s under a load where 1e-6 was asked) stay far below.
SCALE = 1e9
LEAST = 1.0  # in the signal's unit: below it nothing is out of proportion, though a reference is zero but for rounding


def in_proportion(controller: AbstractController, signals: Mapping[str, Any]) -> Bool[Array, "..."]:
    """Whether every sample is in proportion to the largest torque and reference of the run; not a number is not.

    What was not recorded is not judged, nor is motion without a reference or with one that is a torque.

    Args:
        controller: tells what the reference is.
        signals: of a run by name, each of shape (samples,).

    Returns:
        True or False by sample, shape (samples,); shape () where nothing can be judged.
    """
    healthy = jnp.array(True)
    motion = "position" if controller.follows_position else "velocity"
    motions = () if isinstance(controller, TorqueInput) else (motion, f"measured_{motion}")
    for scale, names in (("torque", ("control", "compensation")), ("reference", motions)):
        if scale not in signals:
            continue
        largest = jnp.max(jnp.abs(jnp.asarray(signals[scale])))
        limit = jnp.where(largest > 0.0, jnp.maximum(SCALE * largest, LEAST), jnp.inf)
        for name in names:
            if name in signals:
                healthy = healthy & (jnp.abs(jnp.asarray(signals[name])) <= limit)
    return healthy
