"""ClosedLoop: the blocks joined; its derivative and its step."""

from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array

from .blocks.actuators import AbstractActuator, IdealActuator
from .blocks.controllers import AbstractController
from .blocks.observers import AbstractObserver, NoObserver
from .blocks.plants import AbstractPlant
from .blocks.plants.sticking import advance_exact
from .blocks.sensors import AbstractSensor, IdealSensor
from .blocks.signals import Measurement, Motion, Signals
from .solvers import AbstractSolver, ExactSticking

UNROLLED_SUBSTEPS = 4  # more of them go into an inner loop, so that compiling stays short


class LoopState(eqx.Module):
    """The evolving state of a closed loop.

    Attributes:
        plant: the plant's, the friction law's within it.
        controller: the controller's.
        observer: the observer's.
        actuator: the actuator's.
        sensor: the sensor's.
    """

    plant: Any
    controller: Any
    observer: Any
    actuator: Any
    sensor: Any


class ClosedLoop(eqx.Module):
    """Plant, controller, and what stands between them.

    Attributes:
        plant: the body and its friction.
        controller: from reference and measurement to control.
        observer: estimates friction and compensates it.
        actuator: from commanded to applied torque.
        sensor: from the plant's output to a measurement.
    """

    plant: AbstractPlant
    controller: AbstractController
    observer: AbstractObserver = NoObserver()
    actuator: AbstractActuator = IdealActuator()
    sensor: AbstractSensor = IdealSensor()

    def init(self) -> LoopState:
        """Every block at rest."""
        return LoopState(
            self.plant.init(), self.controller.init(), self.observer.init(), self.actuator.init(), self.sensor.init()
        )

    def advance_continuous(
        self, state: LoopState, references: tuple[Array, ...], time: Array, dt: Array, solver: AbstractSolver
    ) -> tuple[LoopState, Signals]:
        """One solver step of the whole loop as one ODE.

        Args:
            state: at `time`.
            references: r at `time` + node * dt for each of the solver's nodes [rad/s].
            time: [s].
            dt: step [s].
            solver: the explicit solver.

        Returns:
            (state at time + dt, signals at `time`).
        """

        def derivative(node: int, at: LoopState) -> LoopState:
            return self.derivative(at, references[node], time + solver.nodes[node] * dt)

        return solver.advance(derivative, state, dt), self.signals(state, references[0], time)

    def signals(self, state: LoopState, reference: Array, time: Array) -> Signals:
        """All signals of the continuous loop at one instant."""
        output = self.plant.readout(state.plant, jnp.zeros_like(time), time)
        measurement = self.sensor.readout(output)
        control = self.controller.readout(state.controller, reference, measurement)
        compensation, estimates = self.observer.readout(state.observer, measurement.velocity)
        torque = control + compensation
        motion = Motion(output.motor_velocity, output.motor_position, time)
        applied = self.actuator.readout(state.actuator, torque, motion)
        output = self.plant.readout(state.plant, applied, time)
        return _signals(time, reference, output, measurement, control, compensation, torque, applied, estimates)

    def derivative(self, state: LoopState, reference: Array, time: Array) -> LoopState:
        """Time derivative of the whole loop at `time` [s] under reference [rad/s]."""
        now = self.signals(state, reference, time)
        measurement = Measurement(now.measured_velocity, now.measured_position)
        return LoopState(
            self.plant.derivative(state.plant, now.applied, time),
            self.controller.derivative(state.controller, reference, measurement),
            self.observer.derivative(state.observer, now.control, measurement.velocity),
            self.actuator.derivative(state.actuator, now.torque),
            (),
        )

    def advance_sampled(
        self,
        state: LoopState,
        reference: Array,
        time: Array,
        dt: Array,
        noise: tuple[Array, ...],
        solver: AbstractSolver,
        substeps: int,
    ) -> tuple[LoopState, Signals]:
        """One control period: read, control, observe, hold the torque while the plant takes `substeps` solver steps.

        Args:
            state: at `time`.
            reference: r at `time` [rad/s].
            time: start of the period [s].
            dt: control period [s].
            noise: the sensor's standard normals of this sample.
            solver: for the plant.
            substeps: solver steps per period.

        Returns:
            (state at time + dt, signals at `time`).
        """
        output = self.plant.readout(state.plant, jnp.zeros_like(time), time)
        sensor, measurement = self.sensor.step(state.sensor, output, noise, dt)
        control = self.controller.readout(state.controller, reference, measurement)
        controller = self.controller.step(state.controller, reference, measurement, dt)
        compensation, estimates = self.observer.readout(state.observer, measurement.velocity)
        observer = self.observer.step(state.observer, control, measurement.velocity, dt)
        torque = control + compensation
        motion = Motion(output.motor_velocity, output.motor_position, time)
        actuator, applied = self.actuator.step(state.actuator, torque, motion, dt)
        output = self.plant.readout(state.plant, applied, time)
        plant, step = state.plant, dt / substeps

        def substep(plant: Any, start: Array) -> tuple[Any, None]:
            def derivative(node: int, at: Any) -> Any:
                return self.plant.derivative(at, applied, start + solver.nodes[node] * step)

            return solver.advance(derivative, plant, step), None

        if isinstance(solver, ExactSticking):
            plant = advance_exact(self.plant, plant, applied, time, dt, substeps)
        elif substeps <= UNROLLED_SUBSTEPS:
            for index in range(substeps):
                plant, _ = substep(plant, time + index * step)
        else:
            plant, _ = jax.lax.scan(substep, plant, time + step * jnp.arange(substeps).astype(time.dtype))
        now = _signals(time, reference, output, measurement, control, compensation, torque, applied, estimates)
        return LoopState(plant, controller, observer, actuator, sensor), now


def _signals(
    time: Array,
    reference: Array,
    output: Any,
    measurement: Measurement,
    control: Array,
    compensation: Array,
    torque: Array,
    applied: Array,
    estimates: dict[str, Array],
) -> Signals:
    return Signals(
        time=time,
        reference=reference,
        velocity=output.velocity,
        position=output.position,
        motor_velocity=output.motor_velocity,
        motor_position=output.motor_position,
        measured_velocity=measurement.velocity,
        measured_position=measurement.position,
        control=control,
        compensation=compensation,
        torque=torque,
        applied=applied,
        friction=output.friction,
        estimates=estimates,
    )
