"""Feed-forward: the torque that the reference alone asks for, added to any velocity controller."""

import dataclasses
from typing import Any

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array

from ..compiled.hyperbolic import tanh
from .block import as_parameter, require_not_negative, require_positive
from .controllers import AbstractController
from .signals import Measurement


class Feedforward(AbstractController):
    """u = controller + inertia dr/dt + coulomb tanh(r / speed) + viscous r, for a velocity reference r.

    dr/dt is (r - x) / lag with x' = (r - x) / lag. Nothing of it depends on a measurement, so it moves no pole and
    costs no margin.

    Sampled, a torque is held from one sample to the next, and what moves the machine from r_k to r_k+1 is the
    difference of both over the period and the friction at their mean. A reference that comes from a table or a formula
    is known a sample ahead: with `ahead` that is what is given (lag = one period; a longer one lags behind it). The
    difference to the sample before is half a period late, and the friction at r_k likewise: so much is left to the
    feedback in a drive that is told its reference no sooner (`ahead` = False), or where no next sample is passed.

    Attributes:
        controller: what the torque is added to.
        inertia: of the acceleration that the reference asks for [kg m^2].
        coulomb: friction that is compensated in the reference's direction [N m].
        viscous: likewise, in proportion to its speed [N m s/rad].
        speed: reference at which three quarters of `coulomb` are given [rad/s].
        lag: of the derivative of the reference [s]; a control period at least when sampled.
        ahead: the reference of the next sample is known when sampled (static).
        following: that reference [rad/s], which the loop puts here for one sample; no parameter.
    """

    controller: AbstractController
    inertia: Array = eqx.field(converter=as_parameter)
    coulomb: Array = eqx.field(converter=as_parameter)
    viscous: Array = eqx.field(converter=as_parameter)
    speed: Array = eqx.field(converter=as_parameter)
    lag: Array = eqx.field(converter=as_parameter)
    ahead: bool = eqx.field(static=True, default=True)
    following: Array | None = eqx.field(default=None, repr=False)

    def __check_init__(self) -> None:
        for name, unit in (("inertia", "kg m^2"), ("coulomb", "N m"), ("viscous", "N m s/rad")):
            require_not_negative(self, name, unit)
        require_positive(self, "speed", "rad/s")
        require_positive(self, "lag", "s")

    def init(self) -> tuple[Any, Array, Array]:
        """(the wrapped controller's state, the reference that lags [rad/s], 0 before the first sample)."""
        zero = jnp.zeros_like(self.lag)
        return self.controller.init(), zero, zero

    def derivative(self, state: Any, reference: Array, measurement: Measurement) -> tuple[Any, Array, Array]:
        """The wrapped controller's, and that of the lag."""
        inner, late, _ = state
        return self.controller.derivative(inner, reference, measurement), (reference - late) / self.lag, 1.0 / self.lag

    def step(self, state: Any, reference: Array, measurement: Measurement, dt: Array) -> tuple[Any, Array, Array]:
        """The wrapped controller's step; a lag shorter than a period follows at once."""
        inner, late, begun = state
        after = self.controller.step(inner, reference, measurement, dt)
        before, wanted = jnp.where(begun > 0.0, late, reference), self._wanted(reference)
        return after, before + jnp.minimum(dt / self.lag, 1.0) * (wanted - before), jnp.ones_like(begun)

    def readout(self, state: Any, reference: Array, measurement: Measurement) -> Array:
        """u [N m]; where there is a limit, it holds for the sum."""
        inner, late, begun = state
        law = self.controller.unbounded() if self.controller.bounded else self.controller
        wanted = self._wanted(reference)
        # Nothing is known of the reference before the first sample: no acceleration until then, rather than from zero.
        slope = (wanted - jnp.where(begun > 0.0, late, reference)) / self.lag
        held = reference if self.following is None else 0.5 * (reference + wanted)
        torque = law.readout(inner, reference, measurement) + self.inertia * slope + self.viscous * held
        return self.limited(torque + self.coulomb * tanh(held / self.speed))

    def _wanted(self, reference: Array) -> Array:
        return reference if self.following is None else self.following

    @property
    def looks_ahead(self) -> bool:
        """Where the drive knows its reference a sample ahead."""
        return self.ahead

    def knowing(self, following: Array) -> "Feedforward":
        """Told the reference of the next sample [rad/s]."""
        return dataclasses.replace(self, following=following)

    @property
    def bounded(self) -> bool:
        """Whether the wrapped controller has a limit."""
        return self.controller.bounded

    def unbounded(self) -> "Feedforward":
        """Around the wrapped controller without its limit."""
        return dataclasses.replace(self, controller=self.controller.unbounded())

    def limited(self, torque: Array) -> Array:
        """By the wrapped controller [N m]."""
        return self.controller.limited(torque)

    def follow(self, excess: Array) -> Any:
        """The wrapped controller's; the lag follows no limit."""
        inner = self.controller.follow(excess)
        return None if inner is None else (inner, jnp.zeros_like(excess), jnp.zeros_like(excess))
