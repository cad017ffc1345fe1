"""Feed-forward: what the reference alone asks for, added to a velocity controller or a position cascade."""

import dataclasses

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, PyTree

from ..compiled.hyperbolic import tanh
from ..errors import InputError
from .block import as_parameter, require_not_negative, require_positive
from .controllers import AbstractController, Limited, PositionLoop
from .signals import Measurement


class AbstractFeedforward(AbstractController):
    """What the feed-forwards of a velocity and of a position share: the controller that they stand around.

    Attributes:
        controller: what the torque is added to.
    """

    controller: eqx.AbstractVar[AbstractController]

    def __check_init__(self) -> None:
        for name, unit in (("inertia", "kg m^2"), ("coulomb", "N m"), ("viscous", "N m s/rad")):
            require_not_negative(self, name, unit)
        require_positive(self, "speed", "rad/s")
        require_positive(self, "lag", "s")

    def _law(self) -> AbstractController:
        """The wrapped controller; where there is a limit, it holds for the sum."""
        return self.controller.unbounded() if self.controller.bounded else self.controller

    def knowing(self, following: Array) -> "AbstractFeedforward":
        """Told the reference of the next sample."""
        return dataclasses.replace(self, following=following)

    @property
    def follows_position(self) -> bool:
        """Whether the wrapped controller does."""
        return self.controller.follows_position

    @property
    def bounded(self) -> bool:
        """Whether the wrapped controller has a limit."""
        return self.controller.bounded

    def unbounded(self) -> "AbstractFeedforward":
        """Around the wrapped controller without its limit."""
        return dataclasses.replace(self, controller=self.controller.unbounded())

    def limited(self, torque: Array) -> Array:
        """By the wrapped controller [N m]."""
        return self.controller.limited(torque)


class Feedforward(AbstractFeedforward):
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

    def init(self) -> tuple[PyTree, Array, Array]:
        """(the wrapped controller's state, the reference that lags [rad/s], 0 before the first sample)."""
        zero = jnp.zeros_like(self.lag)
        return self.controller.init(), zero, zero

    def derivative(self, state: PyTree, reference: Array, measurement: Measurement) -> tuple[PyTree, Array, Array]:
        """The wrapped controller's, and that of the lag."""
        inner, late, _ = state
        return self.controller.derivative(inner, reference, measurement), (reference - late) / self.lag, 1.0 / self.lag

    def step(self, state: PyTree, reference: Array, measurement: Measurement, dt: Array) -> tuple[PyTree, Array, Array]:
        """The wrapped controller's step; a lag shorter than a period follows at once."""
        inner, late, begun = state
        after = self.controller.step(inner, reference, measurement, dt)
        before, wanted = jnp.where(begun > 0.0, late, reference), self._wanted(reference)
        return after, before + jnp.minimum(dt / self.lag, 1.0) * (wanted - before), jnp.ones_like(begun)

    def readout(self, state: PyTree, reference: Array, measurement: Measurement) -> Array:
        """u [N m]; where there is a limit, it holds for the sum."""
        inner, late, begun = state
        wanted = self._wanted(reference)
        # Nothing is known of the reference before the first sample: no acceleration until then, rather than from zero.
        slope = (wanted - jnp.where(begun > 0.0, late, reference)) / self.lag
        held = reference if self.following is None else 0.5 * (reference + wanted)
        torque = self._law().readout(inner, reference, measurement) + self.inertia * slope + self.viscous * held
        return self.limited(torque + self.coulomb * tanh(held / self.speed))

    def _wanted(self, reference: Array) -> Array:
        return reference if self.following is None else self.following

    @property
    def looks_ahead(self) -> bool:
        """Where the drive knows its reference a sample ahead."""
        return self.ahead

    def follow(self, excess: Array) -> PyTree:
        """The wrapped controller's; the lag follows no limit."""
        inner = self.controller.follow(excess)
        return None if inner is None else (inner, jnp.zeros_like(excess), jnp.zeros_like(excess))


class PositionFeedforward(AbstractFeedforward):
    """A position cascade whose velocity loop is told the reference's rate, and the torque that its motion asks for.

    The inner reference becomes kp (r - position) + velocity dr/dt, and inertia d2r/dt2 + coulomb tanh(dr/dt / speed) +
    viscous dr/dt is added to the torque. With velocity = 1 and the machine's own numbers nothing is left to the
    position loop; without it a cascade follows a ramp of slope v with an error of v / kp.

    dr/dt is (r - x) / lag with x' = (r - x) / lag, and d2r/dt2 the same of dr/dt. Nothing of it depends on a
    measurement, so it moves no pole and costs no margin.

    Sampled, with the next reference known (`ahead`) and a lag of one period, the rate is that from this sample to the
    next one: the friction of the period in which the torque is held. What the velocity loop is told is the mean of it
    and the one before, the rate at this very sample. The acceleration is the second difference about this sample, half
    a period before the middle of the held torque: to have it there takes the reference of two samples ahead, which a
    drive is seldom told. Without the next sample (`ahead` = False) the rate is half a period late, for the friction a
    whole one, and the acceleration one and a half.

    A reference that is itself a reading (rounded to an encoder's counts) has rough differences: `lag` smooths them.

    Attributes:
        controller: a `PositionLoop`, or a limit around one.
        velocity: share of the reference's rate that the velocity loop is told [1].
        inertia: of the acceleration that the reference asks for [kg m^2].
        coulomb: friction that is compensated in the direction of the reference's rate [N m].
        viscous: likewise, in proportion to it [N m s/rad].
        speed: rate at which three quarters of `coulomb` are given [rad/s].
        lag: of both derivatives of the reference [s]; a control period at least when sampled.
        ahead: the reference of the next sample is known when sampled (static).
        following: that reference [rad], which the loop puts here for one sample; no parameter.
    """

    controller: AbstractController
    velocity: Array = eqx.field(converter=as_parameter)
    inertia: Array = eqx.field(converter=as_parameter)
    coulomb: Array = eqx.field(converter=as_parameter)
    viscous: Array = eqx.field(converter=as_parameter)
    speed: Array = eqx.field(converter=as_parameter)
    lag: Array = eqx.field(converter=as_parameter)
    ahead: bool = eqx.field(static=True, default=True)
    following: Array | None = eqx.field(default=None, repr=False)

    def __check_init__(self) -> None:
        require_not_negative(self, "velocity", "1")
        inner = self.controller
        while isinstance(inner, Limited):
            inner = inner.controller
        if not isinstance(inner, PositionLoop):
            raise InputError(
                f"PositionFeedforward stands around a PositionLoop, whose velocity loop it tells the reference's rate, "
                f"got {type(inner).__name__}: use PositionLoop(kp, velocity_controller), or Feedforward for a velocity "
                "reference."
            )

    def init(self) -> tuple[PyTree, Array, Array, Array]:
        """(the cascade's state, the reference that lags [rad], its rate that lags [rad/s], 0 at first)."""
        zero = jnp.zeros_like(self.lag)
        return self.controller.init(), zero, zero, zero

    def derivative(
        self, state: PyTree, reference: Array, measurement: Measurement
    ) -> tuple[PyTree, Array, Array, Array]:
        """The cascade's, and those of the lags."""
        inner, late, slow, _ = state
        rate = (reference - late) / self.lag
        rates = self.controller.fed(self.velocity * rate).derivative(inner, reference, measurement)
        return rates, rate, (rate - slow) / self.lag, 1.0 / self.lag

    def step(
        self, state: PyTree, reference: Array, measurement: Measurement, dt: Array
    ) -> tuple[PyTree, Array, Array, Array]:
        """The cascade's step; lags shorter than a period follow at once."""
        inner, late, _, begun = state
        rate, before, now = self._rates(state, reference)
        after = self.controller.fed(self.velocity * now).step(inner, reference, measurement, dt)
        wanted, share = self._wanted(reference), jnp.minimum(dt / self.lag, 1.0)
        late = jnp.where(begun > 0.0, late, reference)
        return after, late + share * (wanted - late), before + share * (rate - before), jnp.ones_like(begun)

    def readout(self, state: PyTree, reference: Array, measurement: Measurement) -> Array:
        """u [N m]; where there is a limit, it holds for the sum."""
        rate, before, now = self._rates(state, reference)
        inner = self._law().fed(self.velocity * now).readout(state[0], reference, measurement)
        torque = inner + self.inertia * ((rate - before) / self.lag) + self.viscous * rate
        return self.limited(torque + self.coulomb * tanh(rate / self.speed))

    def _rates(self, state: PyTree, reference: Array) -> tuple[Array, Array, Array]:
        """dr/dt of this period and of the one before, and that at the sample [rad/s]."""
        _, late, slow, begun = state
        # Nothing is known of the reference before the first sample: no speed and no acceleration from zero.
        late = jnp.where(begun > 0.0, late, reference)
        rate = (self._wanted(reference) - late) / self.lag
        before = jnp.where(begun > 0.0, slow, rate)
        return rate, before, rate if self.following is None else 0.5 * (rate + before)

    def _wanted(self, reference: Array) -> Array:
        return reference if self.following is None else self.following

    @property
    def looks_ahead(self) -> bool:
        """Where the drive knows its reference a sample ahead."""
        return self.ahead

    def follow(self, excess: Array) -> PyTree:
        """The cascade's; the lags follow no limit."""
        inner, zero = self.controller.follow(excess), jnp.zeros_like(excess)
        return None if inner is None else (inner, zero, zero, zero)
