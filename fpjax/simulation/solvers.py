"""Fixed-step solvers: Euler, Heun, ode3 (Bogacki-Shampine), RK4, and exact sticking under a held torque."""

import math
from abc import abstractmethod
from collections.abc import Callable
from typing import ClassVar

import equinox as eqx
import jax
from jaxtyping import Array, PyTree

from ..blocks.plants import AbstractPlant
from ..errors import InputError


class AbstractPlantSolver(eqx.Module):
    """One step of a plant under a held torque (sampled stepping).

    Class attributes:
        name: its name in `servo.toml`.
        stability_limit: largest |rate| x dt on the negative real axis at which the step is stable [1].
    """

    name: ClassVar[str]
    stability_limit: ClassVar[float]

    @abstractmethod
    def advance_plant(self, plant: AbstractPlant, state: PyTree, torque: Array, time: Array, dt: Array) -> PyTree:
        """The plant's state one step of dt [s] after `time` [s], under a held torque [N m]."""


class AbstractSolver(AbstractPlantSolver):
    """One explicit step of any ODE: a plant under a held torque, or the whole loop (continuous stepping).

    Class attributes:
        nodes: fractions of the step [1] at which derivatives are evaluated, so that inputs must be known there; each
            only once.
    """

    nodes: ClassVar[tuple[float, ...]]

    def advance_plant(self, plant: AbstractPlant, state: PyTree, torque: Array, time: Array, dt: Array) -> PyTree:
        """A step of the plant's own derivative."""

        def derivative(node: int, at: PyTree) -> PyTree:
            return plant.derivative(at, torque, time + self.nodes[node] * dt)

        return self.advance(derivative, state, dt)

    @abstractmethod
    def advance(self, derivative: Callable[[int, PyTree], PyTree], state: PyTree, dt: Array) -> PyTree:
        """The state one step of dt [s] later; `derivative(node, state)` gets the index into `nodes`."""


class Euler(AbstractSolver):
    """Explicit Euler, first order."""

    name: ClassVar[str] = "euler"
    nodes: ClassVar[tuple[float, ...]] = (0.0,)
    # Here and below the limit is -z with |R(z)| = 1 on the negative real axis, where R, the stability function, is the
    # series of exp(z) up to the method's order (Hairer, Wanner, "Solving ordinary differential equations II").
    stability_limit: ClassVar[float] = 2.0

    def advance(self, derivative: Callable[[int, PyTree], PyTree], state: PyTree, dt: Array) -> PyTree:
        """y + dt f(y)."""
        return _combine(state, dt, (1.0, derivative(0, state)))


class Heun(AbstractSolver):
    """Heun's method (explicit trapezoid), second order."""

    name: ClassVar[str] = "heun"
    nodes: ClassVar[tuple[float, ...]] = (0.0, 1.0)
    stability_limit: ClassVar[float] = 2.0

    def advance(self, derivative: Callable[[int, PyTree], PyTree], state: PyTree, dt: Array) -> PyTree:
        """y + dt (k1 + k2) / 2."""
        first = derivative(0, state)
        second = derivative(1, _combine(state, dt, (1.0, first)))
        return _combine(state, dt, (0.5, first), (0.5, second))


class BogackiShampine(AbstractSolver):
    """ode3, third order, Simulink's solver in the thesis (Bogacki, Shampine, "A 3(2) pair of formulas", 1989)."""

    name: ClassVar[str] = "ode3"
    nodes: ClassVar[tuple[float, ...]] = (0.0, 0.5, 0.75)
    stability_limit: ClassVar[float] = 2.5127

    def advance(self, derivative: Callable[[int, PyTree], PyTree], state: PyTree, dt: Array) -> PyTree:
        """y + dt (2 k1 + 3 k2 + 4 k3) / 9."""
        first = derivative(0, state)
        second = derivative(1, _combine(state, dt, (0.5, first)))
        third = derivative(2, _combine(state, dt, (0.75, second)))
        return _combine(state, dt, (2.0 / 9.0, first), (1.0 / 3.0, second), (4.0 / 9.0, third))


class RungeKutta4(AbstractSolver):
    """The classical Runge-Kutta method, fourth order."""

    name: ClassVar[str] = "rk4"
    nodes: ClassVar[tuple[float, ...]] = (0.0, 0.5, 1.0)  # the middle one is evaluated twice
    stability_limit: ClassVar[float] = 2.7853

    def advance(self, derivative: Callable[[int, PyTree], PyTree], state: PyTree, dt: Array) -> PyTree:
        """y + dt (k1 + 2 k2 + 2 k3 + k4) / 6."""
        first = derivative(0, state)
        second = derivative(1, _combine(state, dt, (0.5, first)))
        third = derivative(1, _combine(state, dt, (0.5, second)))
        fourth = derivative(2, _combine(state, dt, (1.0, third)))
        return _combine(state, dt, (1.0 / 6.0, first), (1.0 / 3.0, second), (1.0 / 3.0, third), (1.0 / 6.0, fourth))


class ExactSticking(AbstractPlantSolver):
    """The plant's own step, `AbstractPlant.advance`: set-valued friction, with sticking resolved within the step.

    It is for sampled stepping only, because it needs a torque that is held over the step.
    """

    name: ClassVar[str] = "exact"
    stability_limit: ClassVar[float] = math.inf

    def advance_plant(self, plant: AbstractPlant, state: PyTree, torque: Array, time: Array, dt: Array) -> PyTree:
        """The plant's own step."""
        return plant.advance(state, torque, time, dt)


SOLVERS: dict[str, AbstractPlantSolver] = {
    solver.name: solver for solver in (Euler(), Heun(), BogackiShampine(), RungeKutta4(), ExactSticking())
}


def get_solver(solver: str | AbstractPlantSolver) -> AbstractPlantSolver:
    """A solver by its name (`euler`, `heun`, `ode3`, `rk4`, `exact`); a solver object is passed through."""
    if isinstance(solver, AbstractPlantSolver):
        return solver
    if solver not in SOLVERS:
        raise InputError(f"solver = {solver!r} is not known: choose one of {', '.join(SOLVERS)}.")
    return SOLVERS[solver]


def _combine(state: PyTree, dt: Array, *terms: tuple[float, PyTree]) -> PyTree:
    """state + dt * sum(weight * slope), leaf by leaf."""
    weights = [weight for weight, _ in terms]

    def leaf(value: Array, *slopes: Array) -> Array:
        total = weights[0] * slopes[0]
        for weight, slope in zip(weights[1:], slopes[1:], strict=True):
            total = total + weight * slope
        return value + dt * total

    return jax.tree.map(leaf, state, *[slope for _, slope in terms])
