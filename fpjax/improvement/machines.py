"""Machines: samples of what the diagnosis knows, with the torque that it leaves, ready for a closed loop."""

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
from ..gap.answer.diagnosis import Learned
from ..gap.answer.learned import blocks
from ..gap.answer.posterior import Posterior
from ..gap.data.record import Record, in_one_piece, make_records
from ..gap.machine import FEATURES, Machine, has_bristles, nominal_machine, structure_of
from ..gap.precision import double_precision
from ..gap.simulate.replay import SUBSTEPS
from ..logs import Log
from ..model_file import Model
from ..output.json_object import JsonObject
from .known import Known

COURSES = 3  # the recorded course of the missing torque, and two with the same spectrum and other phases
TURNED = math.pi / 3.0  # the most that a sample's missing torque is turned away from the recorded course [rad]
HISTORY = 4  # periods kept beyond the longest dead time

Values = np.ndarray


class Missing(AbstractLoad):
    """The torque that no law says, over time, as a load: tables that many machines share, in shares of one's own.

    Attributes:
        tables: driving torque [N m], shape (courses, samples).
        shares: of this machine [1], shape (courses,).
        dt: of the tables [s].
    """

    tables: Array
    shares: Array
    dt: Array

    def readout(self, motion: Motion) -> Array:
        """Minus the driving torque [N m]; held over a period, zero behind the end."""
        index = jnp.floor(motion.time / self.dt + 1e-3).astype(jnp.int32)
        last = self.tables.shape[1] - 1
        row = jax.lax.dynamic_index_in_dim(self.tables, jnp.clip(index, 0, last), axis=1, keepdims=False)
        return jnp.zeros_like(motion.velocity) - jnp.sum(self.shares * row)


@dataclasses.dataclass(frozen=True)
class Machines:
    """Machines that one closed loop is judged on.

    Attributes:
        machine: every array has a leading axis; the first is the fit itself.
        shares: of the courses of the missing torque, shape (own, courses).
        others: those of explanations that the log leaves open, of another structure each.
    """

    machine: Machine
    shares: Values
    others: tuple["Machines", ...] = ()

    @property
    def count(self) -> int:
        """How many, the others included."""
        return sum(len(part.shares) for part in self.parts)

    @property
    def parts(self) -> tuple["Machines", ...]:
        """Of each explanation, this one first, without others."""
        return (Machines(self.machine, self.shares), *self.others)

    @property
    def substeps(self) -> int:
        """Solver steps in a period that their structure needs."""
        return max(SUBSTEPS[structure_of(part.machine)] for part in self.parts)

    def periods(self, dt: float) -> tuple[int, int]:
        """Periods that the longest dead time of (actuator, sensor) needs, and some more."""
        longest = [0.0, 0.0]
        for part in self.parts:
            for side, delay in enumerate((part.machine.actuator.delay, part.machine.sensor.delay)):
                longest[side] = max(longest[side], 0.0 if delay is None else float(np.max(np.asarray(delay))))
        return math.ceil(longest[0] / dt) + HISTORY, math.ceil(longest[1] / dt) + HISTORY

    def first(self, count: int) -> "Machines":
        """The first of the chosen explanation."""
        return Machines(jax.tree.map(lambda leaf: leaf[:count], self.machine), self.shares[:count])


@dataclasses.dataclass(frozen=True)
class Ground:
    """What all machines of one log share.

    Attributes:
        record: the log as the diagnosis read it, from sample to sample.
        whole: all stretches of it that were diagnosed.
        courses: driving torque that the laws do not say [N m], shape (explanations x courses, samples).
        noise: standard deviation of a reading of (rate [rad/s], position [rad]).
        substeps: of the plant in a control period.
        laws: learned, that are in the machines.
    """

    record: Record
    whole: Record
    courses: Values
    noise: tuple[float, float]
    substeps: int
    laws: tuple[Learned, ...]


def record_of(log: Log, model: Model) -> Record:
    """The log as the diagnosis reads it: of one that is too long, stretches."""
    return make_records([log], [], model.nominal["inertia"])[0]


def one_piece(record: Record, log: Log, table: Values) -> tuple[Record, Values]:
    """(the record from sample to sample, what is followed along it): of a long log its first stretch.

    Args:
        record: of the log.
        log: whole.
        table: reference along the whole log, or another one, shape (samples,).
    """
    piece = in_one_piece(record)
    own = log.reference is not None and np.array_equal(table, np.asarray(log.reference)[: len(table)])
    if piece is not record and own and piece.reference is not None:
        table = np.asarray(piece.reference, float)[: len(table)]
    return piece, table


def make_ground(known: Known, whole: Record, seed: int) -> Ground:
    """What the machines of a log share.

    Args:
        known: from the diagnosis of the log.
        whole: the log.
        seed: of the phases.
    """
    record = in_one_piece(whole)
    posterior, laws = known.posterior, known.learned
    rows = _courses(posterior.missing[0], known.gap_after, laws, record, seed)
    for place, (_, rival) in enumerate(posterior.rivals):
        rows += _courses(rival.missing[0], rival.gap, (), record, seed + COURSES * (place + 1))
    substeps = max(SUBSTEPS[one.key[0]] for one in (posterior, *(rival for _, rival in posterior.rivals)))
    return Ground(record, whole, np.array(rows), posterior.noise, substeps, laws)


def _courses(recorded: Values, gap: float, laws: Sequence[Learned], record: Record, seed: int) -> list[Values]:
    """The recorded course of one explanation's missing torque, and surrogates of it."""
    recorded = recorded[: len(record.time)]
    course = np.nan_to_num(recorded, nan=0.0)
    size = rms(course[np.isfinite(recorded)])
    if size > 0.0 and np.isfinite(gap):
        # What noise adds to the course is no torque: the gap is told without it.
        course = course * min(gap / size, 1.0)
    for law in laws:
        course = course + np.where(np.isfinite(recorded), opposing(law, record), 0.0)
    return [course, *(surrogate(course, seed + place) for place in range(1, COURSES))]


def draw_machines(posterior: Posterior, model: Model, ground: Ground, count: int, seed: int) -> Machines:
    """Machines of the posterior and of the rivals that the log leaves open, as many of each as it is likely.

    Args:
        posterior: of the diagnosis.
        model: the nominal one.
        ground: of the log.
        count: how many; the first is the fit itself, with the missing torque as it was recorded.
        seed: of the draws.
    """
    many = divided(count, [share for share, _ in posterior.rivals])
    kinds = _widened((posterior, *(rival for _, rival in posterior.rivals)))
    drawn = []
    for place, (kind, some) in enumerate(zip(kinds, many, strict=True)):
        own = seed + 100 * place
        if some:
            machine = kind.machines(model, [ground.whole], some, own)
            drawn.append(Machines(machine, _padded(draw_shares(some, own), ground, place)))
    with double_precision():
        machine = with_laws(drawn[0].machine, ground.laws, many[0])
    return Machines(machine, drawn[0].shares, tuple(drawn[1:]))


def _widened(posteriors: Sequence[Posterior]) -> list[Posterior]:
    """The same with all features that one of its structure has: what is alike compiles once."""
    found = []
    for one in posteriors:
        wanted = {feature for other in posteriors if other.key[0] == one.key[0] for feature in other.key[1]}
        features = tuple(feature for feature in FEATURES if feature in wanted)
        found.append(dataclasses.replace(one, key=(one.key[0], features)))
    return found


def divided(count: int, shares: Sequence[float]) -> list[int]:
    """How many machines the chosen explanation and each of its rivals get; every open rival gets one at least.

    The chosen one has the probability that is left, also that of causes outside the vocabulary: their torque is what
    it does not explain.

    Args:
        count: of all machines.
        shares: probability of each rival [1].
    """
    rivals = [max(round(count * share), 1) for share in shares]
    while rivals and sum(rivals) > count // 2:  # the chosen one is what is told, and has half of them
        rivals[rivals.index(max(rivals))] -= 1
    return [count - sum(rivals), *rivals]


def _padded(shares: Values, ground: Ground, place: int) -> Values:
    """Shares of one explanation's courses among those of all, shape (count, explanations x COURSES)."""
    found = np.zeros((len(shares), len(ground.courses)))
    found[:, COURSES * place : COURSES * (place + 1)] = shares
    return found


def nominal_machines(model: Model, count: int = 1) -> Machines:
    """The nominal machine alone, `count` times, without any missing torque: what a tuning without a log would see."""
    with double_precision():
        machine = nominal_machine(model.loop.plant, model.loop.actuator, model.loop.sensor)
        machine = jax.tree.map(lambda leaf: jnp.broadcast_to(jnp.asarray(leaf, float), (count,)), machine)
    return Machines(machine, np.zeros((count, COURSES)))


def ready(machines: Machines, ground: Ground, longest: tuple[int, int]) -> Machines:
    """The machines with room for their dead times and with the log's noise on their sensors."""
    first, *others = (Machines(_readied(part, ground, longest), part.shares) for part in machines.parts)
    return dataclasses.replace(first, others=tuple(others))


def _readied(part: Machines, ground: Ground, longest: tuple[int, int]) -> Machine:
    machine, shape = part.machine, (len(part.shares),)
    with double_precision():
        sensor: JsonObject = {"longest_delay": longest[1]}
        for name, step, noise in zip(
            ("noise", "position_noise"), ("step_size", "position_step"), ground.noise, strict=True
        ):
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
    """The machines with what was learned in them; a jump at zero velocity is Coulomb friction."""
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
    time = record.time - record.time[0]
    x = {"velocity": record.speed, "position": record.angle, "torque": record.torque, "time": time}[law.of]
    if law.period is not None:
        at, torque = np.append(at, at[0] + law.period), np.append(torque, torque[0])
        x = at[0] + np.mod(x - at[0], law.period)
    twice = np.flatnonzero(np.diff(at) == 0.0)
    if not len(twice):
        return np.interp(x, at, torque)
    cut = int(twice[0]) + 1
    return np.where(x < 0.0, np.interp(x, at[:cut], torque[:cut]), np.interp(x, at[cut:], torque[cut:]))


def surrogate(course: Values, seed: int) -> Values:
    """A course with the same spectrum and random phases, shape (samples,)."""
    spectrum = np.fft.rfft(course)
    phases = np.exp(2j * np.pi * np.random.default_rng(seed).random(len(spectrum)))
    phases[0] = 1.0
    return np.fft.irfft(np.abs(spectrum) * phases, len(course))


def draw_shares(count: int, seed: int) -> Values:
    """Shares of the courses for each machine, shape (count, COURSES): the first has the recorded course alone.

    The missing torque was found along the log's own motion. Under other gains the machine moves a little differently,
    and what is missing then has the same size and colour, and not quite the same course.
    """
    random = np.random.default_rng([seed, 1])
    turn = TURNED * random.random(count)
    turn[0] = 0.0
    others = random.standard_normal((count, COURSES - 1))
    others /= np.linalg.norm(others, axis=1, keepdims=True)
    return np.concatenate([np.cos(turn)[:, None], np.sin(turn)[:, None] * others], axis=1)


def rms(values: Values) -> float:
    """Root mean square; 0 of nothing."""
    return float(np.sqrt(np.mean(np.square(values)))) if len(values) else 0.0
