"""Observers of two parameters: EFP (4.7)-(4.10) and its two extensions to tanh friction (chapter 4.2)."""

from typing import TYPE_CHECKING, ClassVar

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, PyTree

from ...compiled.hyperbolic import tanh
from ..block import as_optional, as_parameter, require_not_negative, require_positive
from ..friction import direction
from .base import AbstractObserver, Quadratic, absolute_or_smooth
from .single import steepness_sensitivity


class ExtendedState(eqx.Module):
    """z1 (driven through g2, gain_2) and z2 (driven through g1, gain_1): the thesis numbers them crosswise."""

    first: Array
    second: Array


class AbstractExtendedObserver(AbstractObserver):
    """Two parameters, two states: the first is driven through g2 (gain_2), the second through g1 (gain_1).

    Attributes:
        inertia: J [kg m^2].
        gain_1: alpha_1 in g1 = alpha_1 w^2 / 2.
        gain_2: alpha_2 in g2 = alpha_2 |w|.
        steepness: lambda [s/rad] of the smooth form of g2; None for |w|.
    """

    if TYPE_CHECKING:

        @property
        def gain_1(self) -> Array:
            """alpha_1."""
            ...

        @property
        def gain_2(self) -> Array:
            """alpha_2."""
            ...

        @property
        def steepness(self) -> Array | None:
            """lambda [s/rad]."""
            ...
    else:
        inertia: eqx.AbstractVar[Array]
        gain_1: eqx.AbstractVar[Array]
        gain_2: eqx.AbstractVar[Array]
        steepness: eqx.AbstractVar[Array | None]

    def check_gains(self) -> None:
        """Raise `InputError` for an inertia that is not positive, or a negative gain."""
        require_positive(self, "inertia", "kg m^2")
        require_not_negative(self, "gain_1", "1")
        require_not_negative(self, "gain_2", "1")
        require_positive(self, "steepness", "s/rad")

    def init(self) -> ExtendedState:
        """z1 = z2 = 0."""
        # zeros of the inertia's dtype and batch shape: a scan's carry must keep both
        zero = jnp.zeros_like(self.inertia)
        return ExtendedState(zero, zero)

    def derivative(self, state: PyTree, control: Array, velocity: Array) -> ExtendedState:
        """z1' = g2'(w) u / J (4.7), z2' = g1'(w) u / J (4.8)."""
        del state
        second, first = self.slopes(velocity)
        return ExtendedState(second * control / self.inertia, first * control / self.inertia)

    def estimates(self, state: ExtendedState, velocity: Array) -> tuple[Array, Array]:
        """(z1 - g2(w), z2 - g1(w)), with (4.9)-(4.10) read as estimates, not derivatives."""
        second = absolute_or_smooth(self.gain_2, self.steepness).value(velocity)
        return state.first - second, state.second - Quadratic(self.gain_1).value(velocity)

    def slopes(self, velocity: Array) -> tuple[Array, Array]:
        """(g2'(w), g1'(w)) (4.14)."""
        second = absolute_or_smooth(self.gain_2, self.steepness).slope(velocity)
        return second, Quadratic(self.gain_1).slope(velocity)


class ExtendedFriedlandPark(AbstractExtendedObserver):
    """EFP: estimates k through g2 and b through g1 (4.7)-(4.10).

    Attributes:
        inertia: J [kg m^2].
        gain_1: alpha_1 in g1 = alpha_1 w^2 / 2, drives b_hat.
        gain_2: alpha_2 in g2 = alpha_2 |w|, drives k_hat.
        steepness: lambda [s/rad] of the smooth forms (tanh, ln cosh); None for sign and |w|.
    """

    estimated: ClassVar[tuple[str, ...]] = ("coulomb", "viscous")

    inertia: Array = eqx.field(converter=as_parameter)
    gain_1: Array = eqx.field(converter=as_parameter)
    gain_2: Array = eqx.field(converter=as_parameter)
    steepness: Array | None = eqx.field(converter=as_optional, default=None)

    def __check_init__(self) -> None:
        self.check_gains()

    def readout(self, state: ExtendedState, velocity: Array) -> tuple[Array, dict[str, Array]]:
        """k_hat sign(w) + b_hat w (4.1), with (4.9)-(4.10) read as estimates, not derivatives."""
        coulomb, viscous = self.estimates(state, velocity)
        torque = coulomb * direction(velocity, self.steepness) + viscous * velocity
        return torque, {"coulomb": coulomb, "viscous": viscous}

    def regressor(self, velocity: Array, parameters: dict[str, Array]) -> tuple[Array, ...]:
        """(sign(w), w) (4.14)."""
        del parameters
        return direction(velocity, self.steepness), velocity


class ExtendedSteepnessCoulomb(AbstractExtendedObserver):
    """Extension 1: estimates k through g1 and lambda through g2; b is known.

    Attributes:
        inertia: J [kg m^2].
        gain_1: alpha_1 in g1, drives k_hat.
        gain_2: alpha_2 in g2, drives lambda_hat.
        viscous: known b [N m s/rad], compensated.
        steepness: lambda [s/rad] of the smooth form of g2; None for |w|.
    """

    estimated: ClassVar[tuple[str, ...]] = ("steepness", "coulomb")

    inertia: Array = eqx.field(converter=as_parameter)
    gain_1: Array = eqx.field(converter=as_parameter)
    gain_2: Array = eqx.field(converter=as_parameter)
    viscous: Array = eqx.field(converter=as_parameter, default=0.0)
    steepness: Array | None = eqx.field(converter=as_optional, default=None)

    def __check_init__(self) -> None:
        self.check_gains()
        require_not_negative(self, "viscous", "N m s/rad")

    def readout(self, state: ExtendedState, velocity: Array) -> tuple[Array, dict[str, Array]]:
        """k_hat tanh(lambda_hat w) + b w."""
        steepness, coulomb = self.estimates(state, velocity)
        torque = coulomb * tanh(steepness * velocity) + self.viscous * velocity
        return torque, {"steepness": steepness, "coulomb": coulomb}

    def regressor(self, velocity: Array, parameters: dict[str, Array]) -> tuple[Array, ...]:
        """(k w / cosh^2(lambda w), tanh(lambda w)), local in the given parameters."""
        steepness = parameters["steepness"]
        return (
            steepness_sensitivity(parameters["coulomb"], steepness, velocity),
            tanh(steepness * velocity),
        )


class ExtendedSteepnessViscous(AbstractExtendedObserver):
    """Extension 2: estimates lambda through g2 and b through g1; k is known.

    Attributes:
        inertia: J [kg m^2].
        gain_1: alpha_1 in g1, drives b_hat.
        gain_2: alpha_2 in g2, drives lambda_hat.
        coulomb: known k [N m].
        steepness: lambda [s/rad] of the smooth form of g2; None for |w|.
    """

    estimated: ClassVar[tuple[str, ...]] = ("steepness", "viscous")

    inertia: Array = eqx.field(converter=as_parameter)
    gain_1: Array = eqx.field(converter=as_parameter)
    gain_2: Array = eqx.field(converter=as_parameter)
    coulomb: Array = eqx.field(converter=as_parameter)
    steepness: Array | None = eqx.field(converter=as_optional, default=None)

    def __check_init__(self) -> None:
        self.check_gains()
        require_positive(self, "coulomb", "N m")

    def readout(self, state: ExtendedState, velocity: Array) -> tuple[Array, dict[str, Array]]:
        """k tanh(lambda_hat w) + b_hat w."""
        steepness, viscous = self.estimates(state, velocity)
        torque = self.coulomb * tanh(steepness * velocity) + viscous * velocity
        return torque, {"steepness": steepness, "viscous": viscous}

    def regressor(self, velocity: Array, parameters: dict[str, Array]) -> tuple[Array, ...]:
        """(k w / cosh^2(lambda w), w), local in the given parameters."""
        return steepness_sensitivity(self.coulomb, parameters["steepness"], velocity), velocity
