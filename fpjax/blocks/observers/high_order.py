"""An observer for a high-order plant: its input is the control after the plant's high-order part (3.27)-(3.28)."""

from collections.abc import Callable

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, PyTree

from ..block import as_parameter, require_not_negative, require_positive
from ..plants import held_high_order, high_order_derivative, high_order_output
from .base import AbstractObserver


class HighOrderState(eqx.Module):
    """P_HO's two states and the wrapped observer's state."""

    filtered: Array
    filter_rate: Array
    observer: PyTree


class HighOrderFeedforward(AbstractObserver):
    """Feeds an observer with P_HO u instead of u, so that a one-mass observer gets the torque at the load (Fig 3.5).

    The wrapped observer's `inertia` must be the total J_m + J_l, that of P_LO (3.27).

    Attributes:
        observer: the wrapped observer.
        motor_inertia: J_m [kg m^2].
        load_inertia: J_l [kg m^2].
        stiffness: k_s [N m/rad].
        damping: k_cv [N m s/rad].
    """

    observer: AbstractObserver
    motor_inertia: Array = eqx.field(converter=as_parameter)
    load_inertia: Array = eqx.field(converter=as_parameter)
    stiffness: Array = eqx.field(converter=as_parameter)
    damping: Array = eqx.field(converter=as_parameter)

    def __check_init__(self) -> None:
        require_positive(self, "motor_inertia", "kg m^2")
        require_positive(self, "load_inertia", "kg m^2")
        require_positive(self, "stiffness", "N m/rad")
        require_not_negative(self, "damping", "N m s/rad")

    @property
    def estimated(self) -> tuple[str, ...]:  # type: ignore[override]
        """The wrapped observer's parameters."""
        return self.observer.estimated

    @property
    def inertia(self) -> Array:
        """The wrapped observer's J [kg m^2]."""
        return self.observer.inertia

    def init(self) -> HighOrderState:
        """Filter and observer at rest."""
        zero = jnp.zeros_like(self.motor_inertia)
        return HighOrderState(zero, zero, self.observer.init())

    def derivative(self, state: HighOrderState, control: Array, velocity: Array) -> HighOrderState:
        """The filter driven by u, the observer by the filter's output."""
        rate, acceleration = high_order_derivative(state.filtered, state.filter_rate, control, self)
        transmitted = high_order_output(state.filtered, state.filter_rate, self)
        return HighOrderState(rate, acceleration, self.observer.derivative(state.observer, transmitted, velocity))

    def step(self, state: HighOrderState, control: Array, velocity: Array, dt: Array) -> HighOrderState:
        """Exact for a control held over dt [s], so that a resonance near the control rate does not limit the period."""
        filtered, rate, transmitted = self._transmit(state, control, dt)
        return HighOrderState(filtered, rate, self.observer.step(state.observer, transmitted, velocity, dt))

    def advance(self, state: HighOrderState, torque: Array, before: Array, after: Array, dt: Array) -> HighOrderState:
        """The filter moves by the control, the wrapped observer over the same period by the filter's output."""
        return self._over(state, torque, before, after, dt, self.observer.advance)

    def moved(self, state: HighOrderState, torque: Array, before: Array, after: Array, dt: Array) -> HighOrderState:
        """The filter moves by the control, the wrapped observer by its `moved`."""
        return self._over(state, torque, before, after, dt, self.observer.moved)

    def _over(
        self, state: HighOrderState, torque: Array, before: Array, after: Array, dt: Array, inner: Callable[..., PyTree]
    ) -> HighOrderState:
        # The compensation acts at the load, behind the spring: only the control passes the filter, and the
        # compensation is added again for the wrapped observer, which expects both.
        middle = 0.5 * (before + after)
        compensation, _ = self.observer.readout(self.observer.carried(state.observer, before, middle), middle)
        filtered, rate, transmitted = self._transmit(state, torque - compensation, dt)
        observed = inner(state.observer, transmitted + compensation, before, after, dt)
        return HighOrderState(filtered, rate, observed)

    def carried(self, state: HighOrderState, before: Array, after: Array) -> HighOrderState:
        """The wrapped observer's; the filter's states do not depend on the velocity."""
        return HighOrderState(state.filtered, state.filter_rate, self.observer.carried(state.observer, before, after))

    def _transmit(self, state: HighOrderState, control: Array, dt: Array) -> tuple[Array, Array, Array]:
        """(x, x', mean torque [N m] that passes) over a period of a held control, exact."""
        filtered, rate = held_high_order(state.filtered, state.filter_rate, control, self, dt)
        reduced = self.motor_inertia * self.load_inertia / (self.motor_inertia + self.load_inertia)
        # From mu x'' + (k_cv x' + k_s x) = u (3.28): averaged over the period, the mean of x'' is the change of x' over
        # dt, so the mean of the output needs no integral.
        return filtered, rate, control - reduced * (rate - state.filter_rate) / dt

    def readout(self, state: HighOrderState, velocity: Array) -> tuple[Array, dict[str, Array]]:
        """The wrapped observer's."""
        return self.observer.readout(state.observer, velocity)

    def slopes(self, velocity: Array) -> tuple[Array, ...]:
        """The wrapped observer's."""
        return self.observer.slopes(velocity)

    def regressor(self, velocity: Array, parameters: dict[str, Array]) -> tuple[Array, ...]:
        """The wrapped observer's."""
        return self.observer.regressor(velocity, parameters)
