"""The contract of a controller: it computes a control torque from a reference and a measurement."""

from abc import abstractmethod

import jax
from jaxtyping import Array, PyTree

from ..block import Block
from ..signals import Measurement


class AbstractController(Block):
    """From a reference and a measurement to a control u [N m]."""

    @abstractmethod
    def init(self) -> PyTree:
        """The state at rest."""

    @abstractmethod
    def derivative(self, state: PyTree, reference: Array, measurement: Measurement) -> PyTree:
        """Time derivative of the state (continuous stepping)."""

    @abstractmethod
    def readout(self, state: PyTree, reference: Array, measurement: Measurement) -> Array:
        """Control u [N m] from reference [rad/s] (or [rad] for a position loop)."""

    def step(self, state: PyTree, reference: Array, measurement: Measurement, dt: Array) -> PyTree:
        """The state one control period dt [s] later (sampled stepping): the derivative held over the period."""
        rates = self.derivative(state, reference, measurement)
        return jax.tree.map(lambda value, rate: value + dt * rate, state, rates)

    @property
    def follows_position(self) -> bool:
        """Whether its reference is a position [rad], not a velocity."""
        return False

    @property
    def looks_ahead(self) -> bool:
        """Whether it uses the reference of the next sample too (sampled stepping)."""
        return False

    def knowing(self, following: Array) -> "AbstractController":
        """The same controller with the reference of the next sample [rad/s] set, for use in this sample only."""
        del following
        return self

    def fed(self, rate: Array) -> "AbstractController":
        """The same controller with `rate` [rad/s] added to the reference of its velocity loop, for this sample only."""
        del rate
        return self

    # A limit holds for the torque that is commanded: the control and the observer's compensation together. The loop
    # therefore asks for the control without the limit (`unbounded`), adds the compensation, limits the sum (`limited`),
    # and feeds what was cut off back to the controller's state (`follow`).

    @property
    def bounded(self) -> bool:
        """Whether the output has a limit."""
        return False

    def unbounded(self) -> "AbstractController":
        """The same controller without its limit and its anti-windup."""
        return self

    def limited(self, torque: Array) -> Array:
        """The torque [N m] after the controller's limit; `torque` includes the compensation."""
        return torque

    def follow(self, excess: Array) -> PyTree:
        """Anti-windup: what is added to the state's rate because of the limit; None for nothing.

        Args:
            excess: the limited torque less the torque asked for [N m].
        """
        del excess
        return None
