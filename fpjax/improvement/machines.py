"""Machines drawn from the posterior of a diagnosis, with its unexplained torque, ready for closed loops."""

import dataclasses
import math
from collections.abc import Sequence

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from ..blocks.loads import AbstractLoad
from ..blocks.position_torque import Loads
from ..blocks.signals import Motion
from ..gap.answer.findings import Learned
from ..gap.answer.learned import blocks
from ..gap.answer.posterior import Posterior
from ..gap.answer.tracking import HISTORY
from ..gap.data.record import Record, in_one_piece, make_records
from ..gap.machine import FEATURES, Machine, has_bristles, nominal_machine, structure_of
from ..gap.simulate.replay import SUBSTEPS
from ..logs import Log
from ..logs.arrays import Values, rms
from ..model_file import Model
from ..output.json_object import JsonObject
from ..simulation.precision import double_precision
from .from_diagnosis import Known

COURSES = 3  # time courses of the missing torque: as found in the log, and two of the same spectrum with random phases
# [rad] The missing torque of a drawn machine is cos(angle) x the found course + sin(angle) x the others; the angle is
# at most this. So its rms stays, and its correlation with the found course is at least 1/2.
TURNED = math.pi / 3.0


class Missing(AbstractLoad):
    """The unexplained torque over time, as a load: tables that all machines share, weighted for each machine.

    Attributes:
        tables: driving torque [N m], shape (courses, samples).
        shares: weights of this machine [1], shape (courses,).
        dt: sample period of the tables [s].
    """

    tables: Array
    shares: Array
    dt: Array

    def readout(self, motion: Motion) -> Array:
        """Minus the driving torque [N m], held over a period; beyond the end its last value."""
        # The thousandth keeps a time computed as k * dt from falling below sample k by rounding.
        index = jnp.floor(motion.time / self.dt + 1e-3).astype(jnp.int32)
        last = self.tables.shape[1] - 1
        row = jax.lax.dynamic_index_in_dim(self.tables, jnp.clip(index, 0, last), axis=1, keepdims=False)
        # the zeros give the result the shape and dtype of a batched velocity
        return jnp.zeros_like(motion.velocity) - jnp.sum(self.shares * row)


@dataclasses.dataclass(frozen=True)
class Machines:
    """Machines on which gains are judged.

    Attributes:
        machine: the machines of one explanation, every array with a leading axis; the first one is the fit itself.
        shares: weights of the courses of the missing torque, shape (own machines, courses).
        others: machines of the other explanations that the log leaves open.
    """

    machine: Machine
    shares: Values
    others: tuple["Machines", ...] = ()

    @property
    def count(self) -> int:
        """The number of machines, the others included."""
        return sum(len(part.shares) for part in self.parts)

    @property
    def parts(self) -> tuple["Machines", ...]:
        """The machines of each explanation, this one first, each with empty `others`."""
        return (Machines(self.machine, self.shares), *self.others)

    @property
    def substeps(self) -> int:
        """Solver steps per control period that their structures need."""
        return max(SUBSTEPS[structure_of(part.machine)] for part in self.parts)

    def periods(self, dt: float) -> tuple[int, int]:
        """Periods of history for the longest dead times of (actuator, sensor), with a reserve."""
        longest = [0.0, 0.0]
        for part in self.parts:
            for side, delay in enumerate((part.machine.actuator.delay, part.machine.sensor.delay)):
                longest[side] = max(longest[side], 0.0 if delay is None else float(np.max(np.asarray(delay))))
        return math.ceil(longest[0] / dt) + HISTORY, math.ceil(longest[1] / dt) + HISTORY

    def only(self, kept: Values) -> "Machines":
        """Some of the machines, the first one among them.

        Args:
            kept: whether each machine is kept, in the order of `parts`, shape (machines,).
        """
        ends = np.cumsum([len(part.shares) for part in self.parts])
        own, *others = (
            Machines(jax.tree.map(lambda leaf, some=some: np.asarray(leaf)[some], part.machine), part.shares[some])
            for part, some in zip(self.parts, np.split(np.asarray(kept), ends[:-1]), strict=True)
        )
        return dataclasses.replace(own, others=tuple(part for part in others if len(part.shares)))

    def first(self, count: int) -> "Machines":
        """The first machines of the chosen explanation, without others."""
        return Machines(jax.tree.map(lambda leaf: leaf[:count], self.machine), self.shares[:count])


@dataclasses.dataclass(frozen=True)
class Ground:
    """The data of a log that all machines share.

    Attributes:
        record: the log as the diagnosis read it, in one uninterrupted piece.
        records: all parts of the log that were diagnosed.
        courses: driving torque that the machines' laws do not explain [N m], shape (explanations x courses, samples).
        noise: noise standard deviation of a reading of (rate [rad/s], position [rad]).
        substeps: solver steps of the plant per control period.
        laws: the learned laws that are in the machines.
    """

    record: Record
    records: Sequence[Record]
    courses: Values
    noise: tuple[float, float]
    substeps: int
    laws: tuple[Learned, ...]


def records_of(log: Log, model: Model) -> list[Record]:
    """The log as the diagnosis reads it, one record; of a log that is too long, parts of it."""
    return make_records([log], [], model.nominal["inertia"])


def one_piece(record: Record, log: Log, table: Values) -> tuple[Record, Values]:
    """(the record in one uninterrupted piece, the reference along it); of a long log its first stretch.

    Args:
        record: of the log.
        log: the whole log.
        table: the reference along the whole log, or another reference, shape (samples,).
    """
    piece = in_one_piece(record)
    own = log.reference is not None and np.array_equal(table, np.asarray(log.reference)[: len(table)])
    if piece is not record and own and piece.reference is not None:
        table = np.asarray(piece.reference, float)[: len(table)]
    return piece, table


def make_ground(known: Known, records: Sequence[Record], seed: int) -> Ground:
    """The data that the machines of a log share.

    Args:
        known: from the diagnosis of the log.
        records: the log.
        seed: of the surrogates' phases.
    """
    record = in_one_piece(records[0])
    posterior, laws = known.posterior, known.learned
    rows = _courses(posterior.missing[0], known.gap_after, laws, record, seed)
    for place, (_, rival) in enumerate(posterior.rivals):
        rows += _courses(rival.missing[0], rival.gap, (), record, seed + COURSES * (place + 1))
    substeps = max(SUBSTEPS[one.key[0]] for one in (posterior, *(rival for _, rival in posterior.rivals)))
    return Ground(record, records, np.array(rows), posterior.noise, substeps, laws)


def _courses(recorded: Values, gap: float, laws: Sequence[Learned], record: Record, seed: int) -> list[Values]:
    """The course of one explanation's missing torque along the log, and surrogates of it, each of shape (samples,)."""
    recorded = recorded[: len(record.time)]
    course = np.nan_to_num(recorded, nan=0.0)
    size = rms(course[np.isfinite(recorded)])
    if size > 0.0 and np.isfinite(gap):
        # Sensor noise adds to the course; the gap of the diagnosis is corrected for it, so the course is scaled to it.
        course = course * min(gap / size, 1.0)
    # The learned laws act in the machines. They oppose the motion, so their torque is added back to what drives.
    for law in laws:
        course = course + np.where(np.isfinite(recorded), opposing(law, record), 0.0)
    return [course, *(surrogate(course, seed + place) for place in range(1, COURSES))]


def draw_machines(posterior: Posterior, model: Model, ground: Ground, count: int, seed: int) -> Machines:
    """Draw machines from the posterior and its rivals, in proportion to their probabilities.

    Args:
        posterior: of the diagnosis.
        model: the nominal model.
        ground: of the log.
        count: number of machines; the first is the fit itself, with the missing torque as found in the log.
        seed: of the draws.
    """
    many = divided(count, [share for share, _ in posterior.rivals])
    kinds = _widened((posterior, *(rival for _, rival in posterior.rivals)))
    drawn = []
    for place, (kind, some) in enumerate(zip(kinds, many, strict=True)):
        own = seed + 100 * place
        if some:
            machine = kind.machines(model, ground.records, some, own)
            drawn.append(Machines(machine, _padded(draw_shares(some, own), ground, place)))
    with double_precision():
        machine = with_laws(drawn[0].machine, ground.laws, many[0])
    return Machines(machine, drawn[0].shares, tuple(drawn[1:]))


def _widened(posteriors: Sequence[Posterior]) -> list[Posterior]:
    """The posteriors, each with the features of all of its structure, so that they share compiled programs."""
    found = []
    for one in posteriors:
        # the features of a structure decide which arrays a machine has, and so which program runs it: the same ones
        # for all explanations of a structure save a compilation each
        wanted = {feature for other in posteriors if other.key[0] == one.key[0] for feature in other.key[1]}
        features = tuple(feature for feature in FEATURES if feature in wanted)
        found.append(dataclasses.replace(one, key=(one.key[0], features)))
    return found


def divided(count: int, shares: Sequence[float]) -> list[int]:
    """Number of machines of the chosen explanation and of each of its rivals, at least one of each rival.

    The chosen explanation gets the remaining probability, that of unknown causes included, because their torque is in
    its missing torque.

    Args:
        count: number of all machines.
        shares: probability of each rival [1].
    """
    rivals = [max(round(count * share), 1) for share in shares]
    while rivals and sum(rivals) > count // 2:  # at least half are of the chosen explanation, which is the answer given
        rivals[rivals.index(max(rivals))] -= 1
    return [count - sum(rivals), *rivals]


def _padded(shares: Values, ground: Ground, place: int) -> Values:
    """Weights of one explanation's courses, with zeros for all others, shape (count, explanations x COURSES)."""
    found = np.zeros((len(shares), len(ground.courses)))
    found[:, COURSES * place : COURSES * (place + 1)] = shares
    return found


def nominal_machines(model: Model, count: int = 1) -> Machines:
    """The nominal machine, `count` times, without missing torque, as for a tuning without a log."""
    with double_precision():
        machine = nominal_machine(model.loop.plant, model.loop.actuator, model.loop.sensor)
        machine = jax.tree.map(lambda leaf: jnp.broadcast_to(jnp.asarray(leaf, float), (count,)), machine)
    return Machines(machine, np.zeros((count, COURSES)))


def ready(machines: Machines, ground: Ground, longest: tuple[int, int]) -> Machines:
    """The machines with histories long enough for their dead times, and with the log's noise on their sensors."""
    first, *others = (Machines(_readied(part, ground, longest), part.shares) for part in machines.parts)
    return dataclasses.replace(first, others=tuple(others))


def _readied(part: Machines, ground: Ground, longest: tuple[int, int]) -> Machine:
    machine, shape = part.machine, (len(part.shares),)
    with double_precision():
        sensor: JsonObject = {"longest_delay": longest[1]}
        for name, step, noise in zip(
            ("noise", "position_noise"), ("step_size", "position_step"), ground.noise, strict=True
        ):
            # The log's noise includes rounding, step^2 / 12, which the machine's sensor makes itself.
            rounded = np.asarray(getattr(machine.sensor, step))
            own = np.asarray(getattr(machine.sensor, name))
            found = np.sqrt(np.maximum(noise**2 - rounded**2 / 12.0, 0.0))
            sensor[name] = jnp.asarray(np.broadcast_to(np.where(own == 0.0, found, own), shape), float)
        return dataclasses.replace(
            machine,
            actuator=dataclasses.replace(machine.actuator, longest_delay=longest[0]),
            sensor=dataclasses.replace(machine.sensor, **sensor),
        )


def with_laws(machine: Machine, laws: Sequence[Learned], count: int) -> Machine:
    """The machines with the learned laws; a jump at zero velocity is added to their Coulomb friction."""
    if not laws:
        return machine
    tables, jump = blocks(laws, float(np.min(machine.law.coulomb)))
    wide = jax.tree.map(lambda leaf: jnp.broadcast_to(jnp.asarray(leaf, float), (count,)), tables)
    machine = eqx.tree_at(lambda at: at.plant.load, machine, Loads((machine.plant.load, *wide)))
    coulomb = machine.law.coulomb + jump
    under = has_bristles(machine)
    return eqx.tree_at(lambda at: (at.plant.friction.law if under else at.plant.friction).coulomb, machine, coulomb)


def opposing(law: Learned, record: Record) -> Values:
    """A learned law's torque along the log [N m], with the sign of friction, shape (samples,)."""
    at, torque = np.asarray(law.at, float), np.asarray(law.torque, float)
    x = {
        "velocity": record.speed, "position": record.angle, "torque": record.torque, "time": record.elapsed,
    }[law.of]  # fmt: skip
    if law.period is not None:
        at, torque = np.append(at, at[0] + law.period), np.append(torque, torque[0])
        x = at[0] + np.mod(x - at[0], law.period)
    # A table with two values at zero velocity is interpolated for each direction on its own.
    twice = np.flatnonzero(np.diff(at) == 0.0)
    if not len(twice):
        return np.interp(x, at, torque)
    cut = int(twice[0]) + 1
    return np.where(x < 0.0, np.interp(x, at[:cut], torque[:cut]), np.interp(x, at[cut:], torque[cut:]))


def surrogate(course: Values, seed: int) -> Values:
    """A course with the same amplitude spectrum and random phases, shape (samples,) (Theiler et al., 1992)."""
    spectrum = np.fft.rfft(course)
    phases = np.exp(2j * np.pi * np.random.default_rng(seed).random(len(spectrum)))
    # the mean keeps its sign
    phases[0] = 1.0
    return np.fft.irfft(np.abs(spectrum) * phases, len(course))


def draw_shares(count: int, seed: int) -> Values:
    """Weights of the courses for each machine, shape (count, COURSES); the first machine has the found course alone.

    The missing torque was found along the log's own motion. With other gains the machine moves a little differently, so
    its missing torque keeps size and spectrum, but not exactly its course. The weights of a machine have unit length.
    """
    random = np.random.default_rng([seed, 1])
    turn = TURNED * random.random(count)
    turn[0] = 0.0
    others = random.standard_normal((count, COURSES - 1))
    # the courses have the same rms and are nearly uncorrelated, so weights of unit length keep the rms
    others /= np.linalg.norm(others, axis=1, keepdims=True)
    return np.concatenate([np.cos(turn)[:, None], np.sin(turn)[:, None] * others], axis=1)
