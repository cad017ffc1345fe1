"""Exact sticking as functions; the steps themselves are methods of the plants (`advance`) and the friction laws."""

from jaxtyping import Array, PyTree

from ..friction import AbstractStaticFriction
from ..friction.base import Shares
from ..signals import Motion
from .masses import AbstractPlant
from .transmission import Transmission


def advance_exact(
    plant: AbstractPlant, state: PyTree, torque: Array, time: Array, dt: Array, substeps: int = 1
) -> PyTree:
    """The plant's state dt [s] later under a held torque [N m], with sticking resolved exactly.

    Args:
        plant: `OneMass` under a static law or `Bristles`, or `Transmission` under a static law.
        state: the plant's state at `time`.
        torque: applied over the step [N m].
        time: start of the step [s].
        dt: length of the step [s].
        substeps: number of steps taken within dt (a plant with a spring needs several).

    Raises:
        InputError: for a plant or a law that has no exact step.
    """
    step = dt / substeps
    for index in range(substeps):
        state = plant.advance(state, torque, time + index * step, step)
    return state


def mean_shaft(plant: Transmission, twist: Array, relative: Array, push: Array, mobility: Array, dt: Array) -> Array:
    """`Transmission.mean_shaft` [N m]."""
    return plant.mean_shaft(twist, relative, push, mobility, dt)


def turn(law: AbstractStaticFriction, motion: Motion, free: Array, inertia: Array, shares: Shares, dt: Array) -> Array:
    """`AbstractStaticFriction.turn` [rad/s]."""
    return law.turn(motion, free, inertia, shares, dt)
