"""Closed loops of many gains around many machines, simulated side by side in one compiled program, and their scores."""

import dataclasses

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, PyTree

from ..blocks.parameters import set_parameters
from ..blocks.position_torque import Loads
from ..blocks.signals import Signals
from ..compiled.batch import map_chunks
from ..gap.machine import Machine
from ..logs.arrays import Values
from ..logs.dynamics.derivative import slope
from ..model_file import Model
from ..simulation.loop import ClosedLoop, LoopState
from ..simulation.metrics import AbstractMeasure
from ..simulation.precision import double_precision
from ..simulation.scan import Inputs, Stepper, astype, make_stepper, roll, sampled_tables
from .machines import Ground, Machines, Missing

LANES = 256  # closed loops in one call; every call has exactly this many, so that nothing compiles twice
# The start of a run does not count, because the transient says little about tracking: this share of it, at most so
# long.
SETTLING = 0.1
LONGEST_SETTLING = 1.0  # [s]
SLOW = 0.1  # share of the reference's speed (95 % quantile) below which the machine counts as reversing
AFTER = 0.05  # [s] after a reversal that still counts to it
DIVERGED = 1e3  # error over the reference's standard deviation at which it is cut off [1]


class Following(AbstractMeasure):
    """The measure of tracking: sums over the run, kept in the carry of the scan.

    Attributes:
        position: whether the reference is a position (static).
        side: 1 where the load is to follow, 0 where the motor is [1].
        start: time from which on samples count [s].
        slow: speed of the reference below which the machine counts as reversing.
        after: time after a reversal that still counts to it [s].
        dt: control period [s].
        largest: errors are cut off here, in the unit of the reference.
    """

    side: Array
    start: Array
    slow: Array
    after: Array
    dt: Array
    largest: Array
    position: bool = eqx.field(static=True)

    def init(self, zero: Array) -> tuple[Array, ...]:
        """Zero sums, in the order of `update`'s first line."""
        return (zero,) * 11

    def update(self, total: tuple[Array, ...], signals: Signals) -> tuple[Array, ...]:
        """Add one sample."""
        square, near, turning, count, effort, peak, rough, last, second, before, left = total
        one, two = ("motor_position", "position") if self.position else ("motor_velocity", "velocity")
        motor, load = getattr(signals, one), getattr(signals, two)
        error = signals.reference - motor - self.side * (load - motor)
        # Cut off, so that a diverging run stays finite and does not spoil its chunk with NaN.
        error = jnp.clip(error, -self.largest, self.largest)
        moving = (signals.reference - before) / self.dt if self.position else signals.reference
        left = jnp.where(jnp.abs(moving) < self.slow, self.after, left - self.dt)
        counts = jnp.where(signals.time >= self.start, 1.0, 0.0)
        turns = counts * jnp.where(left > 0.0, 1.0, 0.0)
        torque = jnp.clip(signals.torque, -1e30, 1e30)
        # The fourth root of |second difference|: its mean to the fourth power is the power mean of exponent 1/4, in
        # which rare large steps hardly count.
        bend = jnp.sqrt(jnp.sqrt(jnp.abs(torque - 2.0 * last + second)))
        return (
            square + counts * error**2, near + turns * error**2, turning + turns, count + counts,
            effort + counts * torque**2, jnp.maximum(peak, counts * jnp.abs(torque)), rough + counts * bend,
            torque, last, signals.reference, left,
        )  # fmt: skip

    def final(self, total: tuple[Array, ...], samples: int) -> Array:
        """(rms error, rms error at reversals, rms torque, largest torque, roughness of the torque), shape (5,)."""
        del samples
        square, near, turning, count, effort, peak, rough, *_ = total
        many = jnp.maximum(count, 1.0)
        return jnp.stack([
            jnp.sqrt(square / many), jnp.sqrt(near / jnp.maximum(turning, 1.0)), jnp.sqrt(effort / many), peak,
            (rough / many) ** 4,
        ])  # fmt: skip


@dataclasses.dataclass(frozen=True)
class Score:
    """Scores of closed loops, each of shape (candidates, machines).

    Attributes:
        error: rms of the tracking error, in the reference's unit; infinite where the loop is unstable.
        reversal: rms of the tracking error around reversals, likewise.
        torque: rms of the commanded torque [N m].
        peak: largest commanded torque [N m].
        rough: size of the torque's second difference [N m], its power mean of exponent 1/4: a measure of noise in the
            torque, to which rare sharp steps (of a friction compensation, of a reference with corners) hardly add.
    """

    error: Values
    reversal: Values
    torque: Values
    peak: Values
    rough: Values

    def only(self, kept: Values) -> "Score":
        """The scores in some machines.

        Args:
            kept: whether each machine is kept, shape (machines,).
        """
        return Score(*(getattr(self, field.name)[:, kept] for field in dataclasses.fields(self)))

    def of(self, candidate: int) -> "Score":
        """The scores of one candidate, each of shape (machines,)."""
        return Score(*(getattr(self, field.name)[candidate] for field in dataclasses.fields(self)))


class Judge:
    """Runs closed loops and scores them; compiled once.

    Every loop gets the same sensor noise, so that differences between gains are not those of random draws.

    Args:
        model: gives controller, observer and the kind of reference.
        names: of the gains in the loop.
        ground: data of the log that all machines share.
        reference: of the loops, shape (samples,).
        seed: of the sensors' noise.
        lanes: closed loops in one call; None for `LANES`.
    """

    def __init__(
        self, model: Model, names: tuple[str, ...], ground: Ground, reference: Values, seed: int,
        lanes: int | None = None,
    ):  # fmt: skip
        self.ground, self.names, self.lanes = ground, names, lanes or LANES
        self.position = model.units.reference == "position"
        self.dt = float(ground.record.dt)
        count = len(reference)
        self.reference = np.asarray(reference, float)
        moving = slope(self.reference, self.dt) if self.position else self.reference
        self.start = min(SETTLING * count * self.dt, LONGEST_SETTLING)
        self.slow = SLOW * float(np.quantile(np.abs(moving), 0.95))
        self.size = max(float(np.std(self.reference)), 1e-12)
        self.turns = self._turns(moving)
        with double_precision():
            self.stepper = make_stepper(
                dt=self.dt, samples=count, solver="exact", stepping="sampled", substeps=ground.substeps
            )
            self.law = astype((model.loop.controller, model.loop.observer), float)
            random = np.random.default_rng(seed)
            self.noise = jnp.asarray(random.standard_normal((2, count)))
            self.time = jnp.asarray(np.arange(count) * self.dt)
            self.measure = Following(
                jnp.zeros(()), jnp.asarray(self.start), jnp.asarray(self.slow), jnp.asarray(AFTER),
                jnp.asarray(self.dt), jnp.asarray(DIVERGED * self.size), self.position,
            )  # fmt: skip

    def __call__(self, values: Values, machines: Machines) -> Score:
        """The scores of every candidate in every machine.

        Args:
            values: gains, shape (candidates, gains).
            machines: `ready`.
        """
        scores = [self.run(values, part, self.reference, noisy=True)[0] for part in machines.parts]
        names = [field.name for field in dataclasses.fields(Score)]
        return Score(*(np.concatenate([getattr(one, name) for one in scores], axis=1) for name in names))

    def settle(self, values: Values, machines: Machines, speed: float) -> tuple[LoopState, Values]:
        """(states of a steady motion at a speed, reference there) of every candidate around every machine.

        The states' arrays have a leading axis of candidates x machines.
        """
        table = np.full(len(self.reference), speed)
        if self.position:
            table = speed * self.dt * np.arange(len(self.reference))
        after = table[-1:] + (speed * self.dt if self.position else 0.0)  # the reference of the sample after the run
        return self.run(values, machines, table, noisy=False)[1], after

    def run(self, values: Values, machines: Machines, reference: Values, *, noisy: bool) -> tuple[Score, LoopState]:
        """(scores, states after the last sample) for the machines of one explanation.

        Args:
            values: gains, shape (candidates, gains).
            machines: of one explanation; `others` are not run.
            reference: shape (samples,).
            noisy: with sensor noise, missing torque and the log's initial motion; else without, from rest.
        """
        candidates, count = len(values), len(machines.shares)
        # Lanes in the order candidate by candidate, within it machine by machine: shape (candidates x machines, ...).
        rows = np.repeat(np.asarray(values, float), count, axis=0)
        index = np.tile(np.arange(count), candidates)
        shares = machines.shares[index] if noisy else np.zeros((len(index), machines.shares.shape[1]))
        leaves, structure = jax.tree.flatten(machines.machine)
        leaves = [np.asarray(leaf)[index] for leaf in leaves]
        record = self.ground.record
        found, ends = [], []
        with double_precision():
            shared = (
                self.law, self.stepper, self.time, jnp.asarray(reference), self.noise * float(noisy),
                jnp.asarray(self.ground.courses), jnp.asarray(float(record.speed[0]) if noisy else 0.0),
                jnp.asarray(float(record.angle[0]) if noisy else 0.0), self.measure,
            )  # fmt: skip
            for first in range(0, len(index), self.lanes):
                # The last call is filled up by repeating the last lane, to keep its shape.
                some = np.minimum(np.arange(first, first + self.lanes), len(index) - 1)
                machine = jax.tree.unflatten(structure, [leaf[some] for leaf in leaves])
                lanes = (machine, shares[some], {name: rows[some, i] for i, name in enumerate(self.names)})
                numbers, state = map_chunks(_one, lanes, shared)
                kept = min(self.lanes, len(index) - first)
                found.append(np.asarray(numbers)[:kept])
                ends.append(jax.tree.map(lambda leaf, kept=kept: np.asarray(leaf)[:kept], state))
        numbers = np.concatenate(found).reshape(candidates, count, -1)
        # The error was cut off at DIVERGED, so a diverged run shows a large rms rather than infinity.
        bad = ~np.isfinite(numbers).all(axis=2) | (numbers[:, :, 0] > 0.1 * DIVERGED * self.size)
        numbers = np.where(bad[:, :, None], np.inf, numbers)
        state = jax.tree.map(lambda *parts: np.concatenate(parts), *ends)
        return Score(*np.moveaxis(numbers, 2, 0)), state

    def _turns(self, moving: Values) -> int:
        """The number of reversals of the reference after the settling time, without dips below the slow speed."""
        after = moving[int(self.start / self.dt) :]
        fast = after[np.abs(after) > self.slow]
        return int(np.sum(np.diff(np.sign(fast)) != 0))


def assemble_loop(
    law: tuple[PyTree, PyTree], machine: Machine, shares: Array, courses: Array, dt: Array, values: dict[str, Array]
) -> ClosedLoop:
    """The closed loop of one lane: a machine, its missing torque as a load, and the control law with its gains."""
    missing = Missing(courses, shares, dt)
    plant = eqx.tree_at(lambda at: at.load, machine.plant, Loads((machine.plant.load, missing)))
    loop = ClosedLoop(plant, law[0], law[1], machine.actuator, machine.sensor)
    return set_parameters(loop, values)


def start_state(loop: ClosedLoop, machine: Machine, speed: Array, angle: Array) -> LoopState:
    """The loop's initial state, with the log's first velocity and position on both sides of the plant."""
    state = loop.init()
    for name in type(state.plant).__dataclass_fields__:
        if name.endswith(("velocity", "position")):
            value = speed if name.endswith("velocity") else angle + machine.origin
            old = getattr(state.plant, name)
            new = jnp.broadcast_to(value, old.shape).astype(old.dtype)
            state = eqx.tree_at(lambda at, name=name: getattr(at.plant, name), state, new)
    return state


def _one(
    lane: tuple[Machine, Array, dict[str, Array]], law: PyTree, stepper: Stepper, time: Array, reference: Array,
    noise: Array, courses: Array, speed: Array, angle: Array, measure: Following,
) -> tuple[Array, LoopState]:  # fmt: skip
    machine, shares, values = lane
    loop = assemble_loop(law, machine, shares, courses, stepper.dt, values)
    state = start_state(loop, machine, speed, angle)
    side = dataclasses.replace(measure, side=machine.sensor.load_side)
    finals, _, last = roll(
        loop, Inputs(time, sampled_tables(loop.controller, reference), (noise[0], noise[1])), stepper,
        {"following": side}, initial=state,
    )  # fmt: skip
    return finals["following"], last
