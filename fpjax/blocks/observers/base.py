"""The contract of a Friedland-Park observer, and its nonlinearities g (2.28)-(2.30)."""

from abc import abstractmethod
from typing import TYPE_CHECKING, ClassVar

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, PyTree

from ...compiled.hyperbolic import tanh
from ..block import Block, as_parameter, require_not_negative, require_positive
from ..friction import log_cosh


class AbstractNonlinearity(Block):
    """An even function g(w) whose slope lies in the first and third quadrants."""

    @abstractmethod
    def value(self, velocity: Array) -> Array:
        """g(w)."""

    @abstractmethod
    def slope(self, velocity: Array) -> Array:
        """g'(w)."""


class Quadratic(AbstractNonlinearity):
    """g1(w) = gain w^2 / 2 (2.28).

    Attributes:
        gain: alpha.
    """

    gain: Array = eqx.field(converter=as_parameter)

    def __check_init__(self) -> None:
        require_not_negative(self, "gain", "1")

    def value(self, velocity: Array) -> Array:
        """gain w^2 / 2."""
        return 0.5 * self.gain * velocity * velocity

    def slope(self, velocity: Array) -> Array:
        """gain w."""
        return self.gain * velocity


class Absolute(AbstractNonlinearity):
    """g2(w) = gain |w| (2.29), the original of Friedland and Park (1992); use `LogCosh` where gradients matter.

    Attributes:
        gain: alpha.
    """

    gain: Array = eqx.field(converter=as_parameter)

    def __check_init__(self) -> None:
        require_not_negative(self, "gain", "1")

    def value(self, velocity: Array) -> Array:
        """gain |w|."""
        return self.gain * jnp.abs(velocity)

    def slope(self, velocity: Array) -> Array:
        """gain sign(w)."""
        return self.gain * jnp.sign(velocity)


class LogCosh(AbstractNonlinearity):
    """g3(w) = gain / lambda ln cosh(lambda w) (2.30): the smooth form of g2.

    Attributes:
        gain: alpha.
        steepness: lambda [s/rad].
    """

    gain: Array = eqx.field(converter=as_parameter)
    steepness: Array = eqx.field(converter=as_parameter)

    def __check_init__(self) -> None:
        require_not_negative(self, "gain", "1")
        require_positive(self, "steepness", "s/rad")

    def value(self, velocity: Array) -> Array:
        """gain / lambda ln cosh(lambda w)."""
        return self.gain / self.steepness * log_cosh(self.steepness * velocity)

    def slope(self, velocity: Array) -> Array:
        """gain tanh(lambda w)."""
        return self.gain * tanh(self.steepness * velocity)


def absolute_or_smooth(gain: Array, steepness: Array | None) -> AbstractNonlinearity:
    """g2 where `steepness` is None, else its smooth form g3."""
    return Absolute(gain) if steepness is None else LogCosh(gain, steepness)


class AbstractObserver(Block):
    """Estimates friction parameters from the control and the velocity, and compensates with them.

    Every observer here has the form z' = s(w) (u - known) / J, estimate = z - g(w): the estimate's error e obeys
    e' = -(1/J) s(w) phi(w)^T e while the mass slides (4.12), with the slopes s and the regressor phi given by
    `slopes` and `regressor`.

    Class attributes:
        estimated: names of the estimated parameters, in the order of `slopes` and `regressor`.
    """

    estimated: ClassVar[tuple[str, ...]] = ()

    if TYPE_CHECKING:

        @property
        def inertia(self) -> Array:
            """J [kg m^2] of the error dynamics: every observer that estimates has it."""
            ...

    @abstractmethod
    def init(self) -> PyTree:
        """State whose estimates are zero at rest."""

    @abstractmethod
    def derivative(self, state: PyTree, control: Array, velocity: Array) -> PyTree:
        """z' from the control before compensation u [N m] and the velocity w [rad/s]."""

    @abstractmethod
    def readout(self, state: PyTree, velocity: Array) -> tuple[Array, dict[str, Array]]:
        """(compensation torque [N m], estimates by name)."""

    def step(self, state: PyTree, control: Array, velocity: Array, dt: Array) -> PyTree:
        """z one control period dt [s] later (sampled stepping): its derivative held over the period."""
        rates = self.derivative(state, control, velocity)
        # explicit Euler: exact where z' depends on held inputs only and not on z, as in all observers of one mass
        return jax.tree.map(lambda value, rate: value + dt * rate, state, rates)

    def advance(self, state: PyTree, torque: Array, before: Array, after: Array, dt: Array) -> PyTree:
        """z one control period later, from what was applied over it and the velocities at both of its ends.

        Holding the derivative from the period's start would be biased. g(w) changes by its slope in the middle of the
        period times the change of w, but the derivative has the slope at the start. The difference, half a period times
        w' u, is a false innovation: small, but always of one sign. As the Coulomb and viscous regressors are nearly
        alike, the error of the viscous friction grew to 60 % at dt = 1 ms. Here slope, compensation and regressor are
        all taken in the middle of the period, so that for a held torque the innovation vanishes at the true parameters
        to second order in dt.

        A period in which the speed changes its sign or is zero carries no information on the levels, and leaves the
        estimates as they are. With this rule 20 N m and 2 N m s/rad are found to 1e-4 at 1 ms and at 4 ms; without it,
        19.7 and 2.4 at 1 ms.

        This holds for every observer whose estimates are z - g(w); one of another form overrides `moved` and `carried`.

        Args:
            state: at the period's start.
            torque: commanded over the period, the compensation included [N m].
            before: velocity at the period's start [rad/s].
            after: velocity at its end [rad/s].
            dt: the period [s].
        """
        moved, same = self.moved(state, torque, before, after, dt), self.carried(state, before, after)
        # also where one of the two is exactly zero: at rest the applied torque need not reach the friction level
        slides = before * after > 0.0
        return jax.tree.map(lambda new, old: jnp.where(slides, new, old), moved, same)

    def moved(self, state: PyTree, torque: Array, before: Array, after: Array, dt: Array) -> PyTree:
        """`advance` without its rule for reversals, for a log whose filtered velocity blurs the moment of reversal."""
        middle = 0.5 * (before + after)
        # The compensation uses the estimates of the period's start. z of the start read at the middle's velocity would
        # be wrong: with large gains g(w) changes by more within half a period than the estimates do.
        compensation, _ = self.readout(self.carried(state, before, middle), middle)
        return self.step(state, torque - compensation, middle, dt)

    def carried(self, state: PyTree, before: Array, after: Array) -> PyTree:
        """The state of the same estimates at another velocity [rad/s]: z moves by g(after) - g(before)."""
        # estimate = z - g(w), so the readout of a zero state gives -g(w) for every estimate, whatever its
        # nonlinearity.
        rest = self.init()
        old, new = self.readout(rest, before)[1], self.readout(rest, after)[1]  # 0 - g(w)
        leaves, structure = jax.tree.flatten(state)
        moved = [leaf + old[name] - new[name] for leaf, name in zip(leaves, self.estimated, strict=True)]
        return jax.tree.unflatten(structure, moved)

    @abstractmethod
    def slopes(self, velocity: Array) -> tuple[Array, ...]:
        """g'(w) of each estimate."""

    @abstractmethod
    def regressor(self, velocity: Array, parameters: dict[str, Array]) -> tuple[Array, ...]:
        """d(friction)/d(parameter) of each estimated parameter, at the given parameter values."""


class NoObserver(AbstractObserver):
    """No estimate, no compensation."""

    def init(self) -> tuple[()]:
        """No state."""
        return ()

    def derivative(self, state: PyTree, control: Array, velocity: Array) -> tuple[()]:
        """Nothing moves."""
        del state, control, velocity
        return ()

    def advance(self, state: PyTree, torque: Array, before: Array, after: Array, dt: Array) -> tuple[()]:
        """Nothing moves."""
        del state, torque, before, after, dt
        return ()

    def readout(self, state: PyTree, velocity: Array) -> tuple[Array, dict[str, Array]]:
        """Zero compensation [N m]."""
        del state
        return jnp.zeros_like(velocity), {}

    def slopes(self, velocity: Array) -> tuple[Array, ...]:
        """None."""
        del velocity
        return ()

    def regressor(self, velocity: Array, parameters: dict[str, Array]) -> tuple[Array, ...]:
        """None."""
        del velocity, parameters
        return ()
