"""Observers of one parameter: CFP (2.11)-(2.12), MFP (2.33)-(2.34), NFP (2.41)-(2.42), steepness (4.28)-(4.29)."""

from typing import TYPE_CHECKING, ClassVar

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array

from ...compiled.hyperbolic import tanh
from ..block import as_optional, as_parameter, require_not_negative, require_positive
from ..friction import direction
from .base import AbstractNonlinearity, AbstractObserver


class AbstractSingleObserver(AbstractObserver):
    """One parameter, one state z: z' = g'(w) u / J, estimate = z - g(w) (2.11)-(2.12), (2.41)-(2.42), (4.28)-(4.29).

    Attributes:
        inertia: J [kg m^2].
        nonlinearity: g, one of `Quadratic`, `Absolute`, `LogCosh`.
    """

    if TYPE_CHECKING:

        @property
        def nonlinearity(self) -> AbstractNonlinearity:
            """g."""
            ...
    else:
        inertia: eqx.AbstractVar[Array]
        nonlinearity: eqx.AbstractVar[AbstractNonlinearity]

    def init(self) -> Array:
        """z = 0."""
        return jnp.zeros_like(self.inertia)

    def derivative(self, state: Array, control: Array, velocity: Array) -> Array:
        """z' = g'(w) u / J (2.11), (2.41), (4.28)."""
        del state
        return self.nonlinearity.slope(velocity) * control / self.inertia

    def estimate(self, state: Array, velocity: Array) -> Array:
        """z - g(w) (2.12), (2.34), (2.42), (4.29), in the parameter's unit."""
        return state - self.nonlinearity.value(velocity)

    def slopes(self, velocity: Array) -> tuple[Array, ...]:
        """(g'(w),)."""
        return (self.nonlinearity.slope(velocity),)


class ClassicalFriedlandPark(AbstractSingleObserver):
    """CFP: estimates k, cancels a known b exactly (2.9)-(2.12).

    Attributes:
        inertia: J [kg m^2].
        nonlinearity: g, one of `Quadratic`, `Absolute`, `LogCosh`.
        viscous: known b [N m s/rad], compensated.
        steepness: lambda of the compensating tanh [s/rad]; None for sign.
    """

    estimated: ClassVar[tuple[str, ...]] = ("coulomb",)

    inertia: Array = eqx.field(converter=as_parameter)
    nonlinearity: AbstractNonlinearity
    viscous: Array = eqx.field(converter=as_parameter, default=0.0)
    steepness: Array | None = eqx.field(converter=as_optional, default=None)

    def __check_init__(self) -> None:
        require_positive(self, "inertia", "kg m^2")
        require_not_negative(self, "viscous", "N m s/rad")
        require_positive(self, "steepness", "s/rad")

    def readout(self, state: Array, velocity: Array) -> tuple[Array, dict[str, Array]]:
        """b w + k_hat sign(w) (2.9), with k_hat = z - g(w) (2.12)."""
        coulomb = self.estimate(state, velocity)
        return self.viscous * velocity + coulomb * direction(velocity, self.steepness), {"coulomb": coulomb}

    def regressor(self, velocity: Array, parameters: dict[str, Array]) -> tuple[Array, ...]:
        """(sign(w),)."""
        del parameters
        return (direction(velocity, self.steepness),)


class ModifiedFriedlandPark(AbstractSingleObserver):
    """MFP: estimates k with a known b inside the observer instead of cancelled (2.31)-(2.34).

    Attributes:
        inertia: J [kg m^2].
        nonlinearity: g.
        viscous: known b [N m s/rad].
        steepness: lambda of the compensating tanh [s/rad]; None for sign.
    """

    estimated: ClassVar[tuple[str, ...]] = ("coulomb",)

    inertia: Array = eqx.field(converter=as_parameter)
    nonlinearity: AbstractNonlinearity
    viscous: Array = eqx.field(converter=as_parameter)
    steepness: Array | None = eqx.field(converter=as_optional, default=None)

    def __check_init__(self) -> None:
        require_positive(self, "inertia", "kg m^2")
        require_not_negative(self, "viscous", "N m s/rad")
        require_positive(self, "steepness", "s/rad")

    def derivative(self, state: Array, control: Array, velocity: Array) -> Array:
        """z' = g'(w) (u - b w) / J (2.33), (4.19)."""
        del state
        return self.nonlinearity.slope(velocity) * (control - self.viscous * velocity) / self.inertia

    def readout(self, state: Array, velocity: Array) -> tuple[Array, dict[str, Array]]:
        """k_hat sign(w) (2.31), with k_hat = z - g(w) (2.34)."""
        coulomb = self.estimate(state, velocity)
        return coulomb * direction(velocity, self.steepness), {"coulomb": coulomb}

    def regressor(self, velocity: Array, parameters: dict[str, Array]) -> tuple[Array, ...]:
        """(sign(w),)."""
        del parameters
        return (direction(velocity, self.steepness),)


class NovelFriedlandPark(AbstractSingleObserver):
    """NFP: estimates b, k known and cancelled (2.39)-(2.42).

    Attributes:
        inertia: J [kg m^2].
        nonlinearity: g.
        coulomb: known k [N m], compensated (0 as in the thesis, which leaves k out of plant and observer alike).
        steepness: lambda of the compensating tanh [s/rad]; None for sign.
    """

    estimated: ClassVar[tuple[str, ...]] = ("viscous",)

    inertia: Array = eqx.field(converter=as_parameter)
    nonlinearity: AbstractNonlinearity
    coulomb: Array = eqx.field(converter=as_parameter, default=0.0)
    steepness: Array | None = eqx.field(converter=as_optional, default=None)

    def __check_init__(self) -> None:
        require_positive(self, "inertia", "kg m^2")
        require_not_negative(self, "coulomb", "N m")
        require_positive(self, "steepness", "s/rad")

    def readout(self, state: Array, velocity: Array) -> tuple[Array, dict[str, Array]]:
        """b_hat w (2.39) + known Coulomb, with b_hat = z - g(w) (2.42)."""
        viscous = self.estimate(state, velocity)
        return viscous * velocity + self.coulomb * direction(velocity, self.steepness), {"viscous": viscous}

    def regressor(self, velocity: Array, parameters: dict[str, Array]) -> tuple[Array, ...]:
        """(w,)."""
        del parameters
        return (velocity,)


class SteepnessObserver(AbstractSingleObserver):
    """Estimates the steepness lambda of k tanh(lambda w), k known (4.26)-(4.29).

    Attributes:
        inertia: J [kg m^2].
        nonlinearity: g.
        coulomb: known k [N m].
    """

    estimated: ClassVar[tuple[str, ...]] = ("steepness",)

    inertia: Array = eqx.field(converter=as_parameter)
    nonlinearity: AbstractNonlinearity
    coulomb: Array = eqx.field(converter=as_parameter)

    def __check_init__(self) -> None:
        require_positive(self, "inertia", "kg m^2")
        require_positive(self, "coulomb", "N m")

    def readout(self, state: Array, velocity: Array) -> tuple[Array, dict[str, Array]]:
        """k tanh(lambda_hat w) (4.26), with lambda_hat = z - g(w) (4.29)."""
        steepness = self.estimate(state, velocity)
        return self.coulomb * tanh(steepness * velocity), {"steepness": steepness}

    def regressor(self, velocity: Array, parameters: dict[str, Array]) -> tuple[Array, ...]:
        """(k w / cosh^2(lambda w),), the local form of (4.33)."""
        return (steepness_sensitivity(self.coulomb, parameters["steepness"], velocity),)


def steepness_sensitivity(coulomb: Array, steepness: Array, velocity: Array) -> Array:
    """d[k tanh(lambda w)]/d lambda = k w / cosh^2(lambda w) [N m rad/s]."""
    # 1 / cosh^2 x = 4 sigmoid(2 x) sigmoid(-2 x). The textbook form 1 - tanh^2 x has no digits left where tanh is close
    # to 1, and cosh itself overflows.
    twice = 2.0 * steepness * velocity
    return coulomb * velocity * (4.0 * jax.nn.sigmoid(twice) * jax.nn.sigmoid(-twice))
