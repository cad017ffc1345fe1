"""What a controller is: from a reference and a measurement to a control."""

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
        """Whether it asks for the reference of the next sample too (sampled stepping)."""
        return False

    def knowing(self, following: Array) -> "AbstractController":
        """The same controller, told the reference of the next sample [rad/s]."""
        del following
        return self

    def fed(self, rate: Array) -> "AbstractController":
        """The same controller, its velocity loop told the rate of the reference [rad/s] beside what it makes itself."""
        del rate
        return self

    # A limit holds for what leaves the controller: its control and the observer's compensation together. The loop
    # therefore asks for the control without the limit, adds the compensation, limits the sum, and lets the state
    # follow what was cut off.

    @property
    def bounded(self) -> bool:
        """Whether the output has a limit."""
        return False

    def unbounded(self) -> "AbstractController":
        """The same controller without its limit and its anti-windup."""
        return self

    def limited(self, torque: Array) -> Array:
        """What leaves of a torque [N m], the compensation included."""
        return torque

    def follow(self, excess: Array) -> PyTree:
        """Anti-windup: what the state's rate gains where the output was moved by `excess` [N m]; None for nothing."""
        del excess
        return None
