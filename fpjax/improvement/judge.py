"""Judge: closed loops of many gains around many machines, all in one compiled kernel."""

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
from ..gap.precision import double_precision
from ..logs.dynamics.derivative import slope
from ..model_file import Model
from ..simulation.loop import ClosedLoop, LoopState
from ..simulation.metrics import AbstractMeasure
from ..simulation.scan import Inputs, Stepper, astype, make_stepper, roll, sampled_tables
from .machines import Ground, Machines, Missing

LANES = 256  # closed loops of one call: every call has as many, so that nothing compiles twice
SETTLING = 0.1  # of the run, and
LONGEST_SETTLING = 1.0  # s at most: how a loop starts says nothing of how it follows
SLOW = 0.1  # of the reference's 95 % quantile: below it the machine turns round
AFTER = 0.05  # s for which a reversal is felt
DIVERGED = 1e3  # error over the reference at which a loop is no loop any more [1]

Values = np.ndarray


class Following(AbstractMeasure):
    """Sums of what a loop is judged by; squares, until `Score` takes their roots.

    Attributes:
        position: the reference is a position (static).
        side: 1 where the load is followed, 0 where the motor is [1].
        start: time from which it counts [s].
        slow: speed of the reference below which the machine turns round [its unit/s].
        after: for so long a reversal is felt [s].
        dt: control period [s].
        largest: an error beyond it means that the loop has diverged.
    """

    side: Array
    start: Array
    slow: Array
    after: Array
    dt: Array
    largest: Array
    position: bool = eqx.field(static=True)

    def init(self, zero: Array) -> tuple[Array, ...]:
        """Nothing yet."""
        return (zero,) * 11

    def update(self, total: tuple[Array, ...], signals: Signals) -> tuple[Array, ...]:
        """Add one sample."""
        square, near, turning, count, effort, peak, rough, last, second, before, left = total
        one, two = ("motor_position", "position") if self.position else ("motor_velocity", "velocity")
        motor, load = getattr(signals, one), getattr(signals, two)
        error = signals.reference - motor - self.side * (load - motor)
        error = jnp.clip(error, -self.largest, self.largest)
        moving = (signals.reference - before) / self.dt if self.position else signals.reference
        left = jnp.where(jnp.abs(moving) < self.slow, self.after, left - self.dt)
        counts = jnp.where(signals.time >= self.start, 1.0, 0.0)
        turns = counts * jnp.where(left > 0.0, 1.0, 0.0)
        torque = jnp.clip(signals.torque, -1e30, 1e30)
        bend = jnp.sqrt(jnp.sqrt(jnp.abs(torque - 2.0 * last + second)))
        return (
            square + counts * error**2, near + turns * error**2, turning + turns, count + counts,
            effort + counts * torque**2, jnp.maximum(peak, counts * jnp.abs(torque)), rough + counts * bend,
            torque, last, signals.reference, left,
        )  # fmt: skip

    def final(self, total: tuple[Array, ...], samples: int) -> Array:
        """(rms of error, of error at reversals, of torque; largest torque; second difference), shape (5,)."""
        del samples
        square, near, turning, count, effort, peak, rough, *_ = total
        many = jnp.maximum(count, 1.0)
        return jnp.stack([
            jnp.sqrt(square / many), jnp.sqrt(near / jnp.maximum(turning, 1.0)), jnp.sqrt(effort / many), peak,
            (rough / many) ** 4,
        ])  # fmt: skip


@dataclasses.dataclass(frozen=True)
class Score:
    """What closed loops come to, each of shape (candidates, machines).

    Attributes:
        error: rms of the tracking error, in the reference's unit; infinite where the loop is unstable.
        reversal: likewise, while the machine turns round.
        torque: rms [N m].
        peak: largest torque [N m].
        rough: size of the torque's second difference [N m], the power mean of exponent 1/4: what noise does to it.
            Sharp and rare steps (of a friction compensation, of a reference with corners) hardly count.
    """

    error: Values
    reversal: Values
    torque: Values
    peak: Values
    rough: Values

    def of(self, candidate: int) -> "Score":
        """Of one candidate, each of shape (machines,)."""
        return Score(*(getattr(self, field.name)[candidate] for field in dataclasses.fields(self)))


class Judge:
    """Runs closed loops; compiled once.

    Args:
        model: gives controller, observer and what the reference is.
        names: of the gains in the loop.
        ground: of the log.
        reference: that is followed, shape (samples,).
        seed: of the sensors' noise.
    """

    def __init__(self, model: Model, names: tuple[str, ...], ground: Ground, reference: Values, seed: int):
        self.ground, self.names = ground, names
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
        """The closed loops of every candidate around every machine.

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
        after = table[-1:] + (speed * self.dt if self.position else 0.0)  # where the states' next sample is
        return self.run(values, machines, table, noisy=False)[1], after

    def run(self, values: Values, machines: Machines, reference: Values, *, noisy: bool) -> tuple[Score, LoopState]:
        """(scores, states after the last sample), without the machines of other explanations."""
        candidates, count = len(values), len(machines.shares)
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
            for first in range(0, len(index), LANES):
                some = np.minimum(np.arange(first, first + LANES), len(index) - 1)
                machine = jax.tree.unflatten(structure, [leaf[some] for leaf in leaves])
                lanes = (machine, shares[some], {name: rows[some, i] for i, name in enumerate(self.names)})
                numbers, state = map_chunks(_one, lanes, shared)
                kept = min(LANES, len(index) - first)
                found.append(np.asarray(numbers)[:kept])
                ends.append(jax.tree.map(lambda leaf, kept=kept: np.asarray(leaf)[:kept], state))
        numbers = np.concatenate(found).reshape(candidates, count, -1)
        bad = ~np.isfinite(numbers).all(axis=2) | (numbers[:, :, 0] > 0.1 * DIVERGED * self.size)
        numbers = np.where(bad[:, :, None], np.inf, numbers)
        state = jax.tree.map(lambda *parts: np.concatenate(parts), *ends)
        return Score(*np.moveaxis(numbers, 2, 0)), state

    def _turns(self, moving: Values) -> int:
        """Reversals of the reference that count."""
        after = moving[int(self.start / self.dt) :]
        fast = after[np.abs(after) > self.slow]
        return int(np.sum(np.diff(np.sign(fast)) != 0))


def assemble_loop(
    law: tuple[PyTree, PyTree], machine: Machine, shares: Array, courses: Array, dt: Array, values: dict[str, Array]
) -> ClosedLoop:
    """The loop of one lane."""
    missing = Missing(courses, shares, dt)
    plant = eqx.tree_at(lambda at: at.load, machine.plant, Loads((machine.plant.load, missing)))
    loop = ClosedLoop(plant, law[0], law[1], machine.actuator, machine.sensor)
    return set_parameters(loop, values)


def start_state(loop: ClosedLoop, machine: Machine, speed: Array, angle: Array) -> LoopState:
    """The loop in the log's first motion."""
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
