"""Trial of a reference: machines are simulated in closed loop, and models compared with the logs that they give."""

from __future__ import annotations

import dataclasses
import functools
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from ..blocks.controllers import AbstractController, ProportionalIntegral
from ..blocks.feedforward import Feedforward
from ..blocks.observers import NoObserver
from ..gap.effects.effect import Effect
from ..gap.effects.vocabulary import on_rate_sensor
from ..gap.fit.candidate import NOMINAL
from ..gap.machine import Machine, Structure
from ..gap.simulate.family import Family
from ..gap.simulate.replay import SUBSTEPS, assembled
from ..gap.thresholds import THRESHOLDS
from ..model_file import Model
from ..simulation.loop import ClosedLoop
from ..simulation.scan import Inputs, make_stepper, roll, sampled_tables
from .expected_evidence import Evidence, Readings, apart, coefficients, evidence_against
from .lanes import RivalLanes, make_lanes
from .machines import NOMINAL_VARIANT, OFFSET, Shop, Variant
from .measurement_model import MeasurementModel
from .rivals import twins_of
from .trajectory import PlannedCourse, PlannedMotion, Shape

STAND_IN = 0.1  # bandwidth of the loop that stands in for an unknown controller, times dt [rad]
TURNING = 0.02  # share of the top speed over which the stand-in's feed-forward reverses the Coulomb friction
SHARP = 4.0  # sharpness of the soft minimum over the comparisons: large for the plain minimum
LEAST = 1e-3  # [nats] smaller evidence counts as this much, so that the logarithm has no pole
LEAST_SHARE = 1e-5  # [1] likewise, of the share of the commanded torque
# [1] share of the commanded torque that is designed for. A gap begins at a third of it; but the effect may be smaller
# than the detectable size, the windows' initial states take a part, and noise hides one.
SHARE = THRESHOLDS.slight
BEYOND_DOUBT = 1e9  # [nats] in place of the evidence between effects that are not to be told apart
STEEP = 2.0  # how fast the probability that a comparison is decided grows with the logarithm of its evidence
WORST = 0.05  # weight of the soft minimum beside that probability, so that a decided comparison still improves
OVERSHOOT = 1.1  # largest speed over the speed limit, because a loop overshoots its reference
TOLERANCE = 1.01  # on the limits of torque and speed as simulated
NUMBERS = ("inertia_error", "coulomb_error", "viscous_error", "torque_gain_error")
RECORD = ("torque", "measured_velocity", "measured_position")


class ExpectedRun(NamedTuple):
    """The expected result of recording a run.

    Attributes:
        nats: evidence of every comparison, shape (comparisons,).
        left: remaining misfit, in standard deviations, shape (comparisons, modes, windows).
        share: missing torque of the model over the rms of the commanded torque [1], shape (comparisons,).
        torque: largest |commanded torque| of the simulated machines [N m].
        speed: largest |velocity reading| of the simulated machines [rad/s].
        readings: logs of the simulated machines, each of shape (runs, samples).
        apart: evidence between the effects of two comparisons, if that of the first were true, infinite where it is not
            looked at [nats], shape (comparisons, comparisons); None where none is.
    """

    nats: Float[Array, " comparisons"]
    left: Float[Array, "comparisons modes windows"]
    share: Float[Array, " comparisons"]
    torque: Float[Array, ""]
    speed: Float[Array, ""]
    readings: Readings
    apart: Float[Array, "comparisons comparisons"] | None = None


class Wanted(NamedTuple):
    """What is to be decided.

    Attributes:
        each: weight of every comparison; 0 leaves it out, shape (comparisons,).
        pairs: whether the effects of two comparisons are to be told apart, shape (comparisons, comparisons).
    """

    each: Float[Array, " comparisons"]
    pairs: Bool[Array, "comparisons comparisons"]


@dataclass(frozen=True)
class RunComparison:
    """A comparison of one machine's log with another machine's model.

    Attributes:
        log: index of the variant that is simulated.
        model: index of the variant that is replayed on this log.
        moving: the model's parameters that are free in the fit.
        own: parameters of the model's effect that are free where it stands against another effect.
    """

    log: int
    model: int
    moving: tuple[str, ...]
    own: tuple[str, ...] = ()


@dataclass(frozen=True)
class Trial:
    """The function from a reference to its expected evidence.

    Attributes:
        shop: makes the machines.
        measurement: of the diagnosis.
        course: the map from shapes to motions.
        simulated: variants that run in closed loop.
        models: variants that are replayed on the logs.
        comparisons: pairs of log and model.
        lanes: by structure, the lanes of its models, and the index among them of each model.
        steered: structures of models through which gradients are taken. The evidence of the others counts, but does not
            steer the search: their gradients would be most of what there is to compile.
        material: whether a comparison's misfit is the torque of a whole gap, so that its share of the commanded torque
            counts too. Two rivals differ by less than their gap, and an error of a reading makes no torque.
        between: whether the effects of two comparisons are to be told apart, shape (comparisons, comparisons); None
            where each comparison is one between rivals already.
    """

    shop: Shop
    measurement: MeasurementModel
    course: PlannedCourse
    simulated: tuple[Variant, ...]
    models: tuple[Variant, ...]
    comparisons: tuple[RunComparison, ...]
    lanes: Mapping[Structure, tuple[RivalLanes, Mapping[int, int]]]
    steered: frozenset[Structure]
    material: tuple[bool, ...]
    between: np.ndarray | None = None

    def followed(self, motion: PlannedMotion) -> Float[Array, " samples"]:
        """The reference of the simulated loop for a motion [rad/s], or [rad] where the loop follows a position."""
        # The loop that stands in for an unknown controller is a velocity loop, whatever the drive's reference is.
        position = self.shop.model.controller_known and self.shop.model.units.reference == "position"
        return motion.position if position else motion.speed

    def reference(self, shape: Shape) -> Float[Array, " samples"]:
        """The reference of the simulated loop for a shape; differentiable."""
        return self.followed(self.course.motion(shape))

    def seen(self, reference: Float[Array, " samples"]) -> ExpectedRun:
        """The expected run of a reference; differentiable."""
        readings = self.simulate(reference)
        told: dict[int, Evidence] = {}
        for structure in _structures(self.models):
            still = readings if structure in self.steered else jax.lax.stop_gradient(readings)
            told |= self._structure(structure, still)
        nats, left, missing = (
            jnp.stack([getattr(told[i], name) for i in range(len(self.comparisons))])
            for name in ("nats", "left", "missing")
        )
        effort = jnp.sqrt(jnp.mean(readings.torque**2, axis=1) + 1e-30)
        share = missing / effort[jnp.asarray([one.log for one in self.comparisons])]
        largest, fastest = jnp.max(jnp.abs(readings.torque)), jnp.max(jnp.abs(readings.rate))
        between = None if self.between is None else self._apart([told[i] for i in range(len(told))])
        return ExpectedRun(nats, left, share, largest, fastest, readings, between)

    def _apart(self, told: Sequence[Evidence]) -> Float[Array, "comparisons comparisons"]:
        """The evidence between every two effects, infinite where it is not looked at."""

        def stacked(each: Sequence[Array]) -> Array:  # structures may have different numbers of directions
            longest = max(len(one) for one in each)
            return jnp.stack([jnp.concatenate([one, jnp.zeros((longest - len(one), *one.shape[1:]))]) for one in each])

        effects, frees = stacked([one.effect for one in told]), stacked([one.free for one in told])

        def row(pair: tuple[Array, Array]) -> Array:
            return jax.vmap(lambda other: apart(self.measurement, *pair, other))(effects)

        # Row by row and checkpointed: all pairs side by side would take gigabytes for a long run.
        found = jax.lax.map(jax.checkpoint(row), (effects[:, 0], frees))
        return jnp.where(jnp.asarray(self.between), found, jnp.inf)

    def cost(self, reference: Float[Array, " samples"], wanted: Wanted) -> tuple[Array, ExpectedRun]:
        """The cost of a reference: minus the log of the probability that the diagnosis decides every comparison, plus a
        penalty beyond the limits.

        An effect is decided by its evidence, over the nominal model and over the other effects, and by a missing torque
        that is a sufficient share of the commanded one. Beyond several times what is needed they hardly count any more,
        so that a comparison that no motion improves does not outweigh the others. The motion keeps its limits by
        construction; the penalty is for the simulated machine, whose loop may need more.

        Args:
            reference: from `reference` or `followed`, shape (samples,).
            wanted: what is to be decided.
        """
        weight, pairs = wanted
        seen = self.seen(reference)
        worth = jnp.log(jnp.maximum(seen.nats, LEAST) / THRESHOLDS.sure)
        # Twice, because evidence grows with the square of a torque. The smooth minimum of the two is what decides.
        size = 2.0 * jnp.log(jnp.maximum(seen.share, LEAST_SHARE) / SHARE)
        worth = jnp.where(jnp.asarray(self.material), -jnp.logaddexp(-worth, -size), worth)
        if seen.apart is not None:
            # An excluded pair counts as one that is decided beyond doubt.
            between = jnp.where(pairs & jnp.isfinite(seen.apart), jnp.maximum(seen.apart, LEAST), BEYOND_DOUBT)
            between = jnp.log(between / THRESHOLDS.sure)
            worth = -jnp.logaddexp(-worth, jax.nn.logsumexp(-SHARP * between, axis=1) / SHARP)
        total = jnp.sum(weight)
        decided = jnp.sum(weight * jax.nn.log_sigmoid(STEEP * worth)) / total
        soft = -jax.nn.logsumexp(-SHARP * worth, b=weight) / SHARP + jnp.log(total) / SHARP
        mean = jnp.sum(weight * worth) / total
        limits = self.course.limits
        over = jnp.maximum(seen.speed / limits.speed - OVERSHOOT, 0.0)
        if np.isfinite(limits.torque):
            over = over + jnp.maximum(seen.torque / limits.torque - 1.0, 0.0)
        return -(decided + WORST * (soft + mean)) + 20.0 * jnp.log1p(over), seen

    def beyond(self, seen: ExpectedRun) -> bool:
        """Whether a simulated machine left its limits: the torque, or the speed by more than an overshoot."""
        limits = self.course.limits
        fine = seen.torque <= TOLERANCE * limits.torque and seen.speed <= TOLERANCE * OVERSHOOT * limits.speed
        return not bool(fine)

    def _periods(self, family: Family, vectors: np.ndarray, side: str) -> int:
        """The longest dead time of the actuator or the rate sensor among some machines, in whole periods."""
        return int(np.ceil(np.max(vectors[family.index(f"{side}_delay")]) / self.measurement.dt))

    def simulate(self, reference: Float[Array, " samples"]) -> Readings:
        """The logs of the simulated variants."""
        found: dict[int, tuple[Array, Array, Array]] = {}
        for structure in _structures(self.simulated):
            which = [i for i, v in enumerate(self.simulated) if v.structure == structure]
            family = self.shop.family(structure)
            vectors = np.stack([self.shop.vector(self.simulated[i]) for i in which], axis=1)
            machines = quiet(assembled(family.machine, family.effects, family.parameters, jnp.asarray(vectors)))
            machines = short(machines, *(self._periods(family, vectors, side) for side in ("actuator", "velocity")))
            stepper = make_stepper(
                dt=self.measurement.dt, samples=len(self.course.time), solver="exact", stepping="sampled",
                substeps=SUBSTEPS[family.key[0]],
            )  # fmt: skip
            silence = tuple(jnp.zeros(len(self.course.time)) for _ in range(machines.sensor.noise_channels))

            def one(machine: Machine, silence: Any = silence, stepper: Any = stepper) -> tuple[Array, Array, Array]:
                loop = loop_of(self.shop.model, machine, self.course.limits.speed)
                inputs = Inputs(jnp.asarray(self.course.time), sampled_tables(loop.controller, reference), silence)
                _, recorded, _ = roll(loop, inputs, stepper, {}, RECORD)
                return recorded["torque"], recorded["measured_velocity"], recorded["measured_position"]

            out = eqx.filter_vmap(one)(machines)
            for row, index in enumerate(which):
                found[index] = (out[0][row], out[1][row], out[2][row])
        rows = [jnp.stack([found[i][part] for i in range(len(self.simulated))]) for part in range(3)]
        return Readings(*rows)

    def _structure(self, structure: Structure, readings: Readings) -> dict[int, Evidence]:
        """The evidence of the comparisons whose model has this structure, by index of the comparison."""
        lanes, places = self.lanes[structure]
        out = coefficients(self.shop, self.measurement, lanes, readings)
        which = [i for i, c in enumerate(self.comparisons) if self.models[c.model].structure == structure]
        bases, tangents, shifts, owns = [], [], [], []
        most = max(len(self.comparisons[i].moving) for i in which)
        widest = max(len(self.comparisons[i].own) for i in which)
        for index in which:
            comparison = self.comparisons[index]
            place = places[comparison.model]
            base = out[:, lanes.base[place], comparison.log]

            def slope(pair: tuple[int, float], log: int = comparison.log, base: Array = base) -> Array:
                return (out[:, pair[0], log] - base) / pair[1]

            def slopes(
                names: Sequence[str], count: int, place: int = place, base: Array = base, slope: Any = slope
            ) -> Array:
                # Padded with zero tangents to a common number, so that one vmap serves all comparisons.
                found = [slope(lanes.tangents[place][name]) for name in names]
                found += [jnp.zeros_like(base)] * (count - len(found))
                return jnp.stack(found) if found else jnp.zeros((0, *base.shape))

            bases.append(base)
            tangents.append(slopes(comparison.moving, most))
            shifts.append(jnp.stack([slope(pair) for pair in lanes.shifts[place]]))
            owns.append(slopes(comparison.own, widest))
        told = jax.vmap(functools.partial(evidence_against, self.measurement))(
            jnp.stack(bases), jnp.stack(tangents), jnp.stack(shifts), jnp.stack(owns)
        )  # fmt: skip
        return {index: Evidence(*(part[row] for part in told)) for row, index in enumerate(which)}


def _structures(variants: Sequence[Variant]) -> tuple[Structure, ...]:
    """The structures of some variants, each once."""
    return tuple(dict.fromkeys(variant.structure for variant in variants))


def loop_of(model: Model, machine: Machine, speed: float) -> ClosedLoop:
    """The model's loop around a machine; where its controller is unknown, with a stiff velocity loop instead.

    This stand-in has the inverse dynamics of the planned motion as a feed-forward, with the nominal numbers, so that
    the torque is right even for motions that are faster than the feedback. The velocity feedback corrects for the
    machine's differences from the nominal model.

    Args:
        model: the nominal model.
        machine: a variant of it.
        speed: largest speed of the motion [rad/s].
    """
    controller: AbstractController = model.loop.controller
    observer: Any = model.loop.observer
    if not model.controller_known:
        nominal, bandwidth = model.nominal, STAND_IN / model.dt
        gain = nominal["inertia"] * bandwidth
        feedback = ProportionalIntegral(gain, 0.2 * gain * bandwidth)
        controller = Feedforward(
            controller=feedback,
            inertia=nominal["inertia"],
            coulomb=nominal["coulomb"],
            viscous=nominal["viscous"],
            speed=TURNING * speed,
            lag=model.dt,
        )
        observer = NoObserver()
    return ClosedLoop(machine.plant, controller, observer, machine.actuator, machine.sensor)


def quiet(machine: Machine) -> Machine:
    """The machine with sensors without rounding and noise, because the expected evidence already accounts for them."""
    nothing = jnp.zeros_like(machine.sensor.noise)
    names = ("noise", "step_size", "position_noise", "position_step")
    return eqx.tree_at(
        lambda at: tuple(getattr(at.sensor, name) for name in names), machine, (nothing,) * len(names)
    )  # fmt: skip


def short(machine: Machine, actuator: int, sensor: int) -> Machine:
    """The machine with histories just as long as its dead times [periods], as long histories take long to compile."""
    parts = dataclasses.replace(machine.actuator, longest_delay=actuator + 1)
    if actuator == 0:
        parts = eqx.tree_at(lambda at: at.delay, parts, None)
    reading = dataclasses.replace(machine.sensor, longest_delay=max(sensor, 1))
    return eqx.tree_at(lambda at: (at.actuator, at.sensor), machine, (parts, reading))


def effects_trial(
    shop: Shop, measurement: MeasurementModel, course: PlannedCourse, variants: Sequence[Variant]
) -> Trial:
    """A trial that compares the nominal machine's log with every effect at its detectable size.

    The nominal parameters and an offset are free in every model.
    """
    comparisons = tuple(RunComparison(0, i, shop.nuisances(v.effect), _own(v.effect)) for i, v in enumerate(variants))
    steered = frozenset[Structure](("rigid",))
    # A wrong number is in every other effect's model as a parameter that may move, a gain nearly.
    numbers = np.array([v.name in NUMBERS for v in variants])
    twins = twins_of(shop, variants)
    between = np.array([[frozenset((a.name, b.name)) not in twins for b in variants] for a in variants])
    between &= ~np.eye(len(variants), dtype=bool) & ~numbers[None, :]
    material = tuple(v.effect is not None and not on_rate_sensor(v.effect) for v in variants)
    trial = _trial(shop, measurement, course, (NOMINAL_VARIANT,), tuple(variants), comparisons, steered, material)
    return dataclasses.replace(trial, between=between)


def _own(effect: Effect | None) -> tuple[str, ...]:
    """Parameters that an effect alone has; one beside the nominal numbers is no other cause than a wrong number."""
    return () if effect is None else tuple(p.name for p in effect.parameters if p.name not in (*NOMINAL, OFFSET))


def rivals_trial(shop: Shop, measurement: MeasurementModel, course: PlannedCourse, rivals: Sequence[Variant]) -> Trial:
    """A trial that compares every rival's log with every other rival's model.

    The model's own parameters and the nominal parameters are free.
    """
    comparisons = []
    for log in range(len(rivals)):
        for model, rival in enumerate(rivals):
            if model == log:
                continue
            assert rival.effect is not None
            # Where the log's machine has, say, a coulomb_error, the model's nominal coulomb must not be free: it would
            # explain the log by that very cause.
            wrong = rivals[log].name.removesuffix("_error")
            own = tuple(p.name for p in rival.effect.parameters)
            nominal = tuple(n for n in shop.nuisances(rival.effect) if n not in ("torque", wrong))
            comparisons.append(RunComparison(log, model, (*nominal, *own)))
    steered = frozenset(_structures(rivals))
    material = (False,) * len(comparisons)
    return _trial(shop, measurement, course, tuple(rivals), tuple(rivals), tuple(comparisons), steered, material)


def _trial(
    shop: Shop, measurement: MeasurementModel, course: PlannedCourse,
    simulated: tuple[Variant, ...], models: tuple[Variant, ...],
    comparisons: tuple[RunComparison, ...], steered: frozenset[Structure], material: tuple[bool, ...],
) -> Trial:  # fmt: skip
    moving: dict[int, tuple[str, ...]] = {}  # by model, the parameters that are free in any of its comparisons
    for one in comparisons:
        moving[one.model] = tuple(dict.fromkeys((*moving.get(one.model, ()), *one.moving, *one.own)))
    lanes: dict[Structure, tuple[RivalLanes, dict[int, int]]] = {}
    shop = shop.fitted_to((*simulated, *models))
    for structure in _structures(models):
        which = [i for i, v in enumerate(models) if v.structure == structure]
        made = make_lanes(shop, [models[i] for i in which], [moving[i] for i in which])
        lanes[structure] = made, {index: place for place, index in enumerate(which)}
    for variant in simulated:
        shop.family(variant.structure)  # made here, because a family cannot be made within a jax trace
    return Trial(shop, measurement, course, simulated, models, comparisons, lanes, steered, material)
