"""P and PI control of the velocity error, and a given torque without control."""

import dataclasses

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, PyTree

from ..block import as_optional, as_parameter, require_positive
from ..signals import Measurement
from .base import AbstractController


class Proportional(AbstractController):
    """u = kp (r - w).

    Attributes:
        kp: proportional gain [N m s/rad].
    """

    kp: Array = eqx.field(converter=as_parameter)

    def init(self) -> tuple[()]:
        """No state."""
        return ()

    def derivative(self, state: PyTree, reference: Array, measurement: Measurement) -> tuple[()]:
        """Nothing moves."""
        del state, reference, measurement
        return ()

    def readout(self, state: PyTree, reference: Array, measurement: Measurement) -> Array:
        """kp (r - w) [N m]."""
        del state
        return self.kp * (reference - measurement.velocity)


class TorqueInput(AbstractController):
    """No controller: the reference is the torque itself [N m], as in a run driven by a recorded torque."""

    def init(self) -> tuple[()]:
        """No state."""
        return ()

    def derivative(self, state: PyTree, reference: Array, measurement: Measurement) -> tuple[()]:
        """Nothing moves."""
        del state, reference, measurement
        return ()

    def readout(self, state: PyTree, reference: Array, measurement: Measurement) -> Array:
        """The reference [N m]."""
        del state, measurement
        return reference


class ProportionalIntegral(AbstractController):
    """u = kp e + integral of ki e, e = r - w; with an output limit and back-calculation anti-windup.

    Attributes:
        kp: proportional gain [N m s/rad].
        ki: integral gain [N m/rad].
        limit: largest |torque| of the output, an observer's compensation included [N m]; None for no limit.
        tracking_time: anti-windup time constant [s] with which the integral follows the limited output
            (Astrom, Hagglund, "Advanced PID control", 2006, section 3.5); used only with a limit.
    """

    kp: Array = eqx.field(converter=as_parameter)
    ki: Array = eqx.field(converter=as_parameter)
    limit: Array | None = eqx.field(converter=as_optional, default=None)
    tracking_time: Array = eqx.field(converter=as_parameter, default=0.01)

    def __check_init__(self) -> None:
        require_positive(self, "limit", "N m")
        require_positive(self, "tracking_time", "s")

    def init(self) -> Array:
        """Integral torque [N m]."""
        return jnp.zeros_like(self.kp)

    def derivative(self, state: Array, reference: Array, measurement: Measurement) -> Array:
        """ki e [N m/s], plus the anti-windup term while limited."""
        error = reference - measurement.velocity
        rate = self.ki * error
        if self.limit is None:
            return rate
        # Back-calculation: while the output is limited, the integral moves by what was cut off, at the rate 1 /
        # tracking_time.
        wanted = self.kp * error + state
        return rate + (jnp.clip(wanted, -self.limit, self.limit) - wanted) / self.tracking_time

    def readout(self, state: Array, reference: Array, measurement: Measurement) -> Array:
        """u [N m], limited where a limit is given."""
        return self.limited(self.kp * (reference - measurement.velocity) + state)

    @property
    def bounded(self) -> bool:
        """Whether there is a limit."""
        return self.limit is not None

    def unbounded(self) -> "ProportionalIntegral":
        """Without the limit."""
        return dataclasses.replace(self, limit=None)

    def limited(self, torque: Array) -> Array:
        """Clipped, where there is a limit [N m]."""
        return torque if self.limit is None else jnp.clip(torque, -self.limit, self.limit)

    def follow(self, excess: Array) -> Array | None:
        """Back-calculation [N m/s]."""
        return None if self.limit is None else excess / self.tracking_time
