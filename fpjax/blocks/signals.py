"""The signals that pass between blocks; in code the words, in docstrings the symbols with units."""

import equinox as eqx
from jaxtyping import Array

from ..errors import InputError


class Motion(eqx.Module):
    """What a friction law, a load or a cogging torque may depend on.

    Attributes:
        velocity: w [rad/s].
        position: theta [rad].
        time: t [s].
        torque: the torque that drives the body through the gear [N m]: the applied motor torque, or the shaft's torque
            for a body behind a spring. The inertia torque is not taken off, so a law that depends on it stays explicit
            in the acceleration. None where it is not known.
    """

    velocity: Array
    position: Array
    time: Array
    torque: Array | None = None


def driving_torque(motion: Motion, what: str) -> Array:
    """The torque that drives the body through the gear [N m].

    Raises:
        InputError: where the motion does not hold it.
    """
    if motion.torque is None:
        raise InputError(
            f"{what} depends on the torque through the gear, but this motion has no torque: give Motion(velocity, "
            f"position, time, torque)."
        )
    return motion.torque


class PlantOutput(eqx.Module):
    """The output of a plant.

    Attributes:
        velocity: load velocity w [rad/s].
        position: load position [rad].
        motor_velocity: velocity on the motor's side [rad/s] (the same for one mass).
        motor_position: position on the motor's side [rad].
        friction: friction torque that opposes the motion [N m].
    """

    velocity: Array
    position: Array
    motor_velocity: Array
    motor_position: Array
    friction: Array


class Measurement(eqx.Module):
    """What the controller and the observer receive.

    Attributes:
        velocity: measured velocity [rad/s].
        position: measured position [rad].
    """

    velocity: Array
    position: Array


class Signals(eqx.Module):
    """All signals of one sample of the closed loop; XLA leaves out the computation of those that are not used.

    Attributes:
        time: t [s].
        reference: r [rad/s] (or [rad] for a position loop).
        velocity: true load velocity w [rad/s].
        position: true load position [rad].
        motor_velocity: true motor velocity [rad/s].
        motor_position: true motor position [rad].
        measured_velocity: what the controller read [rad/s].
        measured_position: what the controller read [rad].
        control: the controller's output u [N m].
        compensation: what the observer adds [N m].
        torque: commanded torque u_n = u + compensation [N m].
        applied: torque that the actuator delivers [N m].
        friction: friction torque [N m].
        estimates: the observer's estimates by name (`coulomb` [N m], `viscous` [N m s/rad], `steepness` [s/rad]).
    """

    time: Array
    reference: Array
    velocity: Array
    position: Array
    motor_velocity: Array
    motor_position: Array
    measured_velocity: Array
    measured_position: Array
    control: Array
    compensation: Array
    torque: Array
    applied: Array
    friction: Array
    estimates: dict[str, Array]
