"""Wrappers around another controller: a position loop, an output limit."""

import dataclasses

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, PyTree

from ..block import as_parameter, require_positive
from ..signals import Measurement
from .base import AbstractController


class PositionLoop(AbstractController):
    """A proportional position loop around a velocity controller: the inner reference is kp (r - position).

    With `Proportional` inside it is the P/P cascade of a machine axis (EMPS).

    Attributes:
        kp: position gain [1/s].
        velocity_controller: the inner loop.
        rate: added to the inner reference [rad/s]; a feed-forward sets it for one sample. Not a parameter.
    """

    kp: Array = eqx.field(converter=as_parameter)
    velocity_controller: AbstractController
    rate: Array | None = eqx.field(default=None, repr=False)

    def init(self) -> PyTree:
        """The inner controller's state."""
        return self.velocity_controller.init()

    def derivative(self, state: PyTree, reference: Array, measurement: Measurement) -> PyTree:
        """The inner controller's."""
        return self.velocity_controller.derivative(state, self._inner(reference, measurement), measurement)

    def readout(self, state: PyTree, reference: Array, measurement: Measurement) -> Array:
        """u [N m] from a position reference [rad]."""
        return self.velocity_controller.readout(state, self._inner(reference, measurement), measurement)

    def step(self, state: PyTree, reference: Array, measurement: Measurement, dt: Array) -> PyTree:
        """The inner controller's."""
        return self.velocity_controller.step(state, self._inner(reference, measurement), measurement, dt)

    def _inner(self, reference: Array, measurement: Measurement) -> Array:
        inner = self.kp * (reference - measurement.position)
        return inner if self.rate is None else inner + self.rate

    @property
    def follows_position(self) -> bool:
        """Its reference is a position."""
        return True

    def fed(self, rate: Array) -> "PositionLoop":
        """With a rate added to the inner reference [rad/s]."""
        return dataclasses.replace(self, rate=rate)

    @property
    def bounded(self) -> bool:
        """Whether the inner controller's output has a limit."""
        return self.velocity_controller.bounded

    def unbounded(self) -> "PositionLoop":
        """Without the inner controller's limit."""
        return dataclasses.replace(self, velocity_controller=self.velocity_controller.unbounded())

    def limited(self, torque: Array) -> Array:
        """By the inner controller [N m]."""
        return self.velocity_controller.limited(torque)

    def follow(self, excess: Array) -> PyTree:
        """The inner controller's."""
        return self.velocity_controller.follow(excess)


class Limited(AbstractController):
    """Any controller with its output clipped. It adds no anti-windup: only the controller's own acts, where it has one.

    Attributes:
        controller: whose output is limited.
        limit: largest |torque| of the output, an observer's compensation included [N m].
    """

    controller: AbstractController
    limit: Array = eqx.field(converter=as_parameter)

    def __check_init__(self) -> None:
        require_positive(self, "limit", "N m")

    def init(self) -> PyTree:
        """The wrapped controller's."""
        return self.controller.init()

    def derivative(self, state: PyTree, reference: Array, measurement: Measurement) -> PyTree:
        """The wrapped controller's."""
        return self.controller.derivative(state, reference, measurement)

    def readout(self, state: PyTree, reference: Array, measurement: Measurement) -> Array:
        """u [N m], clipped."""
        return jnp.clip(self.controller.readout(state, reference, measurement), -self.limit, self.limit)

    def step(self, state: PyTree, reference: Array, measurement: Measurement, dt: Array) -> PyTree:
        """The wrapped controller's."""
        return self.controller.step(state, reference, measurement, dt)

    @property
    def follows_position(self) -> bool:
        """Whether the wrapped controller does."""
        return self.controller.follows_position

    @property
    def looks_ahead(self) -> bool:
        """Whether the wrapped controller does."""
        return self.controller.looks_ahead

    def knowing(self, following: Array) -> "Limited":
        """The wrapped controller with the reference of the next sample, under the same limit."""
        return Limited(self.controller.knowing(following), self.limit)

    def fed(self, rate: Array) -> "Limited":
        """The wrapped controller with the reference's rate [rad/s], under the same limit."""
        return Limited(self.controller.fed(rate), self.limit)

    @property
    def bounded(self) -> bool:
        """It has a limit."""
        return True

    def unbounded(self) -> AbstractController:
        """The wrapped controller, without this limit and without its own."""
        return self.controller.unbounded()

    def limited(self, torque: Array) -> Array:
        """Clipped [N m]."""
        # limits may be nested: the inner one first, so the smaller of the two holds
        return jnp.clip(self.controller.limited(torque), -self.limit, self.limit)

    def follow(self, excess: Array) -> PyTree:
        """The wrapped controller's."""
        return self.controller.follow(excess)
