"""ClosedLoop: the blocks joined to one loop; its derivative and its step."""

from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, PyTree

from ..blocks.actuators import AbstractActuator, IdealActuator
from ..blocks.block import show_fields, with_arrays
from ..blocks.controllers import AbstractController
from ..blocks.observers import AbstractObserver, NoObserver
from ..blocks.plants import AbstractPlant
from ..blocks.sensors import AbstractSensor, IdealSensor
from ..blocks.signals import Measurement, Motion, PlantOutput, Signals
from ..compiled.native import alike_on_devices
from .solvers import AbstractPlantSolver, AbstractSolver

UNROLLED_SUBSTEPS = 4  # more substeps than this are an inner loop, to keep compilation short


class Period(eqx.Module):
    """Memory of a sampled observer about the period that ends now.

    Attributes:
        torque: torque commanded over the period [N m].
        velocity: velocity measured at its start [rad/s].
        begun: 0 at the first sample, which ends no period; 1 later.
    """

    torque: Array
    velocity: Array
    begun: Array


class LoopState(eqx.Module):
    """The evolving state of a closed loop.

    Attributes:
        plant: the plant's state, which contains that of the friction law.
        controller: the controller's state.
        observer: the observer's state.
        actuator: the actuator's state.
        sensor: the sensor's state.
        period: a `Period` for a sampled observer; the empty tuple in continuous time and without one.
    """

    plant: PyTree
    controller: PyTree
    observer: PyTree
    actuator: PyTree
    sensor: PyTree
    period: PyTree = ()


class Command(eqx.Module):
    """The result of the control law at one sample: all that a drive computes in a period.

    Attributes:
        memory: memory of the law for the next sample: (the controller's state, the observer's state, the `Period`).
        control: the controller's output u [N m].
        compensation: torque added by the observer [N m].
        torque: commanded torque u + compensation [N m].
        estimates: the observer's estimates by name.
    """

    memory: tuple[PyTree, PyTree, PyTree]
    control: Array
    compensation: Array
    torque: Array
    estimates: dict[str, Array]


class ClosedLoop(eqx.Module):
    """The closed loop of a plant, a controller, an observer, an actuator and a sensor.

    Plain numbers in a user's own block become array leaves here, so that gradients, sweeps and names reach them.

    Attributes:
        plant: the mechanics with its friction.
        controller: from reference and measurement to control.
        observer: estimates friction and compensates it.
        actuator: from commanded to applied torque.
        sensor: from the plant's output to a measurement.
    """

    plant: AbstractPlant = eqx.field(converter=with_arrays)
    controller: AbstractController = eqx.field(converter=with_arrays)
    observer: AbstractObserver = eqx.field(converter=with_arrays, default=NoObserver())
    actuator: AbstractActuator = eqx.field(converter=with_arrays, default=IdealActuator())
    sensor: AbstractSensor = eqx.field(converter=with_arrays, default=IdealSensor())

    def __repr__(self) -> str:
        """The blocks with their numbers."""
        return show_fields(self)

    def linearise(self, at: float | LoopState = 1.0, **settings: Any) -> Any:
        """The loop linearised about a steady motion: `fpjax.linearise`, which describes the arguments, as a method."""
        from .. import linearise  # by its public name, when called: linearisation is built on the loop

        return linearise(self, at, **settings)

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
        # The plant is read twice. Its motion does not depend on the torque, and is needed to compute the torque; its
        # friction may depend on the torque (stiction, load-dependent friction), and is read at the end.
        output = self.plant.readout(state.plant, jnp.zeros_like(time), time)
        measurement = self.sensor.readout(output)
        compensation, estimates = self.observer.readout(state.observer, measurement.velocity)
        control, torque, _ = self._command(state.controller, reference, measurement, compensation)
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
            self._controller_rates(state.controller, reference, measurement, now.compensation),
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
        solver: AbstractPlantSolver,
        substeps: int,
        following: Array | None = None,
    ) -> tuple[LoopState, Signals]:
        """One control period: read, observe, control, hold the torque while the plant takes `substeps` solver steps.

        Args:
            state: at `time`.
            reference: r at `time` [rad/s].
            time: start of the period [s].
            dt: control period [s].
            noise: standard normal random numbers of the sensor for this sample.
            solver: for the plant.
            substeps: solver steps per period.
            following: r at `time` + dt [rad/s] for a controller that looks ahead; None where it is not known.

        Returns:
            (state at time + dt, signals at `time`).
        """
        output = self.plant.readout(state.plant, jnp.zeros_like(time), time)
        sensor, measurement = self.sensor.step(state.sensor, output, noise, dt)
        memory = state.controller, state.observer, state.period
        command = self.control_law(memory, reference, measurement, dt, following)
        motion = Motion(output.motor_velocity, output.motor_position, time)
        actuator, applied = self.actuator.step(state.actuator, command.torque, motion, dt)
        output = self.plant.readout(state.plant, applied, time)
        plant, step = state.plant, dt / substeps

        def substep(plant: PyTree, start: Array) -> tuple[PyTree, None]:
            return solver.advance_plant(self.plant, plant, applied, start, step), None

        if substeps <= UNROLLED_SUBSTEPS:
            for index in range(substeps):
                plant, _ = substep(plant, time + index * step)
        else:
            starts = time + step * jnp.arange(substeps).astype(time.dtype)
            # an inner loop keeps the program's size independent of the number of substeps
            plant, _ = jax.lax.scan(*alike_on_devices(substep, plant, starts), starts)
        now = _signals(
            time, reference, output, measurement, command.control, command.compensation, command.torque, applied,
            command.estimates,
        )  # fmt: skip
        controller, observer, period = command.memory
        return LoopState(plant, controller, observer, actuator, sensor, period), now

    def control_law(
        self,
        memory: tuple[PyTree, PyTree, PyTree],
        reference: Array,
        measurement: Measurement,
        dt: Array,
        following: Array | None = None,
    ) -> Command:
        """One period of the sampled control law, without the plant; `fpjax.export` writes this as C.

        Args:
            memory: (the controller's state, the observer's state, the last `Period`), see `sampled`.
            reference: r [rad/s] (or [rad] for a position loop).
            measurement: reading of the sensor now.
            dt: control period [s].
            following: the next sample's reference for a controller that looks ahead; None where it is not known.
        """
        # The next reference is set in the controller only for this one call: as an argument of every block's readout
        # it would be in the interface of all controllers, though only a feed-forward uses it.
        if following is not None and self.controller.looks_ahead:
            told = eqx.tree_at(lambda at: at.controller, self, self.controller.knowing(following))
            return told.control_law(memory, reference, measurement, dt)
        before, observer, period = memory
        # The observer moves first: the velocity at the period's end is known only now, and the new estimates are used
        # in this very sample. Controller and limit come after it, because the limit holds for the sum.
        observer = self._observe(observer, period, measurement.velocity, dt)
        compensation, estimates = self.observer.readout(observer, measurement.velocity)
        control, torque, excess = self._command(before, reference, measurement, compensation)
        controller = self._unbounded().step(before, reference, measurement, dt)
        back = None if excess is None else self.controller.follow(excess)
        if back is not None:
            controller = jax.tree.map(lambda value, rate: value + dt * rate, controller, back)
        period = Period(torque, measurement.velocity, jnp.ones_like(dt)) if self.observer.estimated else ()
        return Command((controller, observer, period), control, compensation, torque, estimates)

    def _unbounded(self) -> AbstractController:
        return self.controller.unbounded() if self.controller.bounded else self.controller

    def _command(
        self, state: PyTree, reference: Array, measurement: Measurement, compensation: Array
    ) -> tuple[Array, Array, Array | None]:
        """(control, commanded torque, change of the torque by the limit) [N m]; the last is None without a limit.

        Control and compensation always sum to the commanded torque. The part that the limit cuts off is taken off the
        control, so that the observer never uses a torque that was not applied.
        """
        control = self._unbounded().readout(state, reference, measurement)
        wanted = control + compensation
        if not self.controller.bounded:
            return control, wanted, None
        torque = self.controller.limited(wanted)
        return jnp.where(torque == wanted, control, torque - compensation), torque, torque - wanted

    def _controller_rates(
        self, state: PyTree, reference: Array, measurement: Measurement, compensation: Array
    ) -> PyTree:
        rates = self._unbounded().derivative(state, reference, measurement)
        if not self.controller.bounded:
            return rates
        _, _, excess = self._command(state, reference, measurement, compensation)
        back = None if excess is None else self.controller.follow(excess)
        return rates if back is None else jax.tree.map(jnp.add, rates, back)

    def sampled(self, state: LoopState) -> LoopState:
        """The state in the form of `advance_sampled`: with a `Period`, where the loop has an observer."""
        if not self.observer.estimated or isinstance(state.period, Period):
            return state
        # of the state's own dtype and batch shape, so that the carry of the scan keeps both from the first step on
        zero = jnp.zeros_like(jnp.asarray(jax.tree.leaves(state.plant)[0]))
        return eqx.tree_at(
            lambda at: at.period, state, Period(zero, zero, zero), is_leaf=lambda leaf: isinstance(leaf, tuple)
        )

    def _observe(self, observer: PyTree, last: PyTree, velocity: Array, dt: Array) -> PyTree:
        """The observer's state after the last period, whose final velocity is known now."""
        if not isinstance(last, Period):
            return observer
        moved = self.observer.advance(observer, last.torque, last.velocity, velocity, dt)
        # the first sample ends no period: the observer stays at rest until there is a torque that has acted
        return jax.tree.map(lambda new, old: jnp.where(last.begun > 0.0, new, old), moved, observer)


def _signals(
    time: Array,
    reference: Array,
    output: PlantOutput,
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
