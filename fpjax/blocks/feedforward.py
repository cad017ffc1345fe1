"""Feed-forward: the torque that the reference itself asks for, added to a velocity controller or a position cascade."""

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
    """What the feed-forwards for a velocity and for a position reference share: the controller that they wrap.

    Attributes:
        controller: the wrapped controller, to whose output the torque is added.
        inertia: that multiplies the reference's acceleration [kg m^2].
        coulomb: Coulomb friction compensated in the direction of the reference's speed [N m].
        viscous: viscous friction compensated at that speed [N m s/rad].
        speed: at which tanh(1), three quarters, of `coulomb` is applied [rad/s].
        ahead: whether the reference of the next sample is known when sampled.
        following: the reference of the next sample; None where it is not known.
    """

    controller: eqx.AbstractVar[AbstractController]
    inertia: eqx.AbstractVar[Array]
    coulomb: eqx.AbstractVar[Array]
    viscous: eqx.AbstractVar[Array]
    speed: eqx.AbstractVar[Array]
    ahead: eqx.AbstractVar[bool]
    following: eqx.AbstractVar[Array | None]

    def __check_init__(self) -> None:
        for name, unit in (("inertia", "kg m^2"), ("coulomb", "N m"), ("viscous", "N m s/rad")):
            require_not_negative(self, name, unit)
        require_positive(self, "speed", "rad/s")
        require_positive(self, "lag", "s")

    def _law(self) -> AbstractController:
        """The wrapped controller without its limit, which is applied to the sum instead."""
        return self.controller.unbounded() if self.controller.bounded else self.controller

    def _with_torque(self, feedback: Array, acceleration: Array, speed: Array) -> Array:
        """The sum of feedback [N m] and feed-forward at the reference's acceleration [rad/s^2] and speed [rad/s].

        Where there is a limit, it holds for the sum.
        """
        torque = feedback + self.inertia * acceleration + self.viscous * speed
        return self.limited(torque + self.coulomb * tanh(speed / self.speed))

    @property
    def looks_ahead(self) -> bool:
        """Whether the drive knows its reference one sample ahead."""
        return self.ahead

    def _wanted(self, reference: Array) -> Array:
        """The reference to be reached by the end of the period: the next sample's where it is known."""
        return reference if self.following is None else self.following

    def knowing(self, following: Array) -> "AbstractFeedforward":
        """The same feed-forward with the reference of the next sample set."""
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

    dr/dt is computed as (r - x) / lag with x' = (r - x) / lag. It depends on no measurement, so it moves no pole of the
    loop and costs no stability margin.

    In sampled stepping the torque is held from one sample to the next. Moving the machine from r_k to r_k+1 takes the
    difference of the two over the period, and the friction at their mean. A reference from a table or a formula is
    known one sample ahead, and with `ahead` exactly this torque is applied (lag = one period; a longer lag smooths it
    and delays it). Without the next sample (`ahead` = False, or none is passed) the difference to the sample before is
    used, which is half a period late, and the friction at r_k likewise; the feedback has to correct what is missing.

    Attributes:
        controller: the wrapped controller, to whose output the torque is added.
        inertia: inertia that multiplies dr/dt [kg m^2].
        coulomb: Coulomb friction compensated in the direction of the reference [N m].
        viscous: viscous friction compensated at the speed of the reference [N m s/rad].
        speed: reference velocity at which tanh(1), three quarters, of `coulomb` is applied [rad/s].
        lag: time constant of the reference's derivative [s]; at least one control period when sampled.
        ahead: whether the reference of the next sample is known when sampled (static).
        following: the reference of the next sample [rad/s]; the loop sets it for one sample. Not a parameter.
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
        """(the wrapped controller's state, the lagged reference [rad/s], 0 before the first sample and 1 after it)."""
        zero = jnp.zeros_like(self.lag)
        return self.controller.init(), zero, zero

    def derivative(self, state: PyTree, reference: Array, measurement: Measurement) -> tuple[PyTree, Array, Array]:
        """The wrapped controller's, and that of the lag."""
        inner, late, _ = state
        # The last state is a flag that must leave 0; as an ODE it is a ramp, of which only the sign is used.
        return self.controller.derivative(inner, reference, measurement), (reference - late) / self.lag, 1.0 / self.lag

    def step(self, state: PyTree, reference: Array, measurement: Measurement, dt: Array) -> tuple[PyTree, Array, Array]:
        """The wrapped controller's step; a lag shorter than a period is no lag at all."""
        inner, late, begun = state
        after = self.controller.step(inner, reference, measurement, dt)
        before, wanted = jnp.where(begun > 0.0, late, reference), self._wanted(reference)
        return after, before + jnp.minimum(dt / self.lag, 1.0) * (wanted - before), jnp.ones_like(begun)

    def readout(self, state: PyTree, reference: Array, measurement: Measurement) -> Array:
        """u [N m]; where there is a limit, it holds for the sum."""
        inner, late, begun = state
        wanted = self._wanted(reference)
        # At the first sample there is no earlier reference: the acceleration is then taken as zero. Taken as a step
        # from zero it would kick the machine.
        slope = (wanted - jnp.where(begun > 0.0, late, reference)) / self.lag
        held = reference if self.following is None else 0.5 * (reference + wanted)
        return self._with_torque(self._law().readout(inner, reference, measurement), slope, held)

    def follow(self, excess: Array) -> PyTree:
        """The wrapped controller's anti-windup; the lag of the reference needs none."""
        inner = self.controller.follow(excess)
        return None if inner is None else (inner, jnp.zeros_like(excess), jnp.zeros_like(excess))


class PositionFeedforward(AbstractFeedforward):
    """Velocity and torque feed-forward of a position cascade.

    The reference of the velocity loop becomes kp (r - position) + velocity dr/dt, and inertia d2r/dt2 + coulomb
    tanh(dr/dt / speed) + viscous dr/dt is added to the torque. With velocity = 1 and the machine's own numbers nothing
    is left to the position loop; without feed-forward a cascade follows a ramp of slope v with an error of v / kp.

    dr/dt is computed as (r - x) / lag with x' = (r - x) / lag, and d2r/dt2 from dr/dt in the same way. They depend on
    no measurement, so they move no pole of the loop and cost no stability margin.

    In sampled stepping, with the next reference known (`ahead`) and a lag of one period, dr/dt is the difference from
    this sample to the next: the rate of the very period in which the torque is held. The velocity loop gets the mean of
    this rate and the one before, which is the rate at this sample. The acceleration is the second difference about this
    sample, half a period before the middle of the held torque: without that delay it would take the reference two
    samples ahead, which a drive seldom has. Without the next sample (`ahead` = False) the velocity loop's rate is half
    a period late, the friction's rate a whole period, and the acceleration one and a half.

    A reference that is itself a reading (rounded to an encoder's counts) has rough differences: `lag` smooths them.

    Attributes:
        controller: a `PositionLoop`, or a limit around one.
        velocity: share of dr/dt that is added to the velocity loop's reference [1].
        inertia: inertia that multiplies d2r/dt2 [kg m^2].
        coulomb: Coulomb friction compensated in the direction of dr/dt [N m].
        viscous: viscous friction compensated at dr/dt [N m s/rad].
        speed: dr/dt at which tanh(1), three quarters, of `coulomb` is applied [rad/s].
        lag: time constant of both derivatives of the reference [s]; at least one control period when sampled.
        ahead: whether the reference of the next sample is known when sampled (static).
        following: the reference of the next sample [rad]; the loop sets it for one sample. Not a parameter.
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
                f"PositionFeedforward must wrap a PositionLoop, to whose velocity loop it adds the reference's rate; "
                f"got {type(inner).__name__}: use PositionLoop(kp, velocity_controller), or Feedforward for a velocity "
                "reference."
            )

    def init(self) -> tuple[PyTree, Array, Array, Array]:
        """(the cascade's state, lagged reference [rad], lagged rate [rad/s], 0 before the first sample and 1 after)."""
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
        """The cascade's step; a lag shorter than a period is no lag at all."""
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
        return self._with_torque(inner, (rate - before) / self.lag, rate)

    def _rates(self, state: PyTree, reference: Array) -> tuple[Array, Array, Array]:
        """dr/dt of this period and of the one before, and that at the sample [rad/s]."""
        _, late, slow, begun = state
        # At the first sample there is no earlier reference: rate and acceleration are then taken as they would be at
        # rest, instead of as a step from zero.
        late = jnp.where(begun > 0.0, late, reference)
        rate = (self._wanted(reference) - late) / self.lag
        before = jnp.where(begun > 0.0, slow, rate)
        return rate, before, rate if self.following is None else 0.5 * (rate + before)

    def follow(self, excess: Array) -> PyTree:
        """The cascade's anti-windup; the lags of the reference need none."""
        inner, zero = self.controller.follow(excess), jnp.zeros_like(excess)
        return None if inner is None else (inner, zero, zero, zero)
