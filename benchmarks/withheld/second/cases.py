"""A case of the second generator: machine, reference, effect, clutter, sensors, all drawn from (seed, words) alone."""

import zlib
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from .clutter import add_clutter
from .effects import ACTUATOR, EFFECTS, Plan, Scales, sign
from .machines import KINDS, Drawn, between, draw
from .outside import OUTSIDE
from .physics import INITIAL
from .recording import PLAIN, RECORDINGS, USUAL, Recording, coarsen
from .references import reference
from .simulate import simulate
from .world import Trace, World

DT, PERIODS = USUAL, 10_001
# Of the laws, their draws and their labels. 1: the nominal models of "single_off" were exact; 2: the labels of
# `equivalent.EFFECTS` held their laws' own numbers.
VERSION = 3
SAME_LOGS = 2  # the first version that made the logs and models of this one
ATTEMPTS = 5  # draws of a case: an effect that is not visible is made larger, a loop that does not track is drawn again
SHORTEST = 3000  # fewest periods on which both can be judged


@dataclass
class Case:
    """A case before it is simulated."""

    plan: Plan
    world: World
    clutter: list[str]
    seed: int
    words: str
    recording: Recording = PLAIN


def generator(seed: int, words: str, purpose: str) -> np.random.Generator:
    """A random generator of its own for each purpose: more draws for one do not change another."""
    return np.random.default_rng([2, seed, zlib.crc32(words.encode()), zlib.crc32(purpose.encode())])


def build(
    seed: int, words: str, set_: str, sensors: str, system: str, effects: tuple[str, ...], periods: int, grow: float,
    recording: Recording = PLAIN,
) -> Case:  # fmt: skip
    """Draw one case.

    Args:
        seed, words: what all draws come from.
        set_: "single", "single_off", "wide", "starter", "recorded", "pairs", "none" or "outside".
        sensors: "rate", "both", "encoder" or "derived".
        system: a key of `KINDS`.
        effects: the effects, or the kind outside the vocabulary.
        periods: length of the log.
        grow: factor on the size of the effect.
        recording: how the record is made; its own length is already in `periods`.
    """
    drawn = draw(KINDS[system], generator(seed, words, "machine"))
    if recording.coarse:
        coarsen(drawn)
    rng, dt = generator(seed, words, "case"), recording.dt
    wanted = reference(drawn.kind, generator(seed, words, "reference"), periods, dt)
    values = machine_values(drawn, sensors, rng, dt)
    nominal = {"inertia": drawn.inertia, "coulomb": drawn.coulomb, "viscous": drawn.viscous}
    load_matters = "load_dependent_friction" in effects
    scales = scales_of(drawn, wanted, dt)
    if not drawn.kind.linear and "unbalance" not in effects and (load_matters or rng.random() < 0.15):
        # A load that is known: large where friction that depends on the load is asked for, else a side issue in 15 %.
        known = scales.torque * (rng.uniform(1.2, 2.0) if load_matters else rng.uniform(0.2, 0.6))
        nominal |= {"unbalance": known, "unbalance_phase": float(rng.uniform(0, 2 * np.pi))}
        values |= {"unbalance": known, "unbalance_phase": nominal["unbalance_phase"]}
    elif load_matters or rng.random() < 0.15:
        nominal["offset"] = sign(rng) * scales.torque * rng.uniform(0.2, 0.5)
        values["known_offset"] = nominal["offset"]
    plan = Plan(drawn, scales, values, nominal, sensors, grow)
    world = World(values, wanted, int(generator(seed, words, "noise").integers(2**31)), dt=dt)
    clutter: list[str] = []
    if set_ == "outside":
        OUTSIDE[effects[0]](plan, world, generator(seed, words, "outside"))
    else:
        for effect in effects:
            EFFECTS[effect](plan, generator(seed, words, effect))
    if set_ != "none":
        clutter = add_clutter(plan, effects, generator(seed, words, "clutter"))
    spread_nominal(plan, set_, generator(seed, words, "nominal"))
    world.curve = plan.curve
    # A measured current contains what the actuator did: effects of the actuator need the command in the log.
    commanded = set_ == "outside" or bool(ACTUATOR & set(effects))
    world.measured = not commanded and (rng.random() < 0.35 or recording.filtered)
    return Case(plan, world, clutter, seed, words, recording)


def spread_nominal(plan: Plan, set_: str, rng: np.random.Generator) -> None:
    """The nominal's own errors: up to 3 % in "single_off", 10 to 30 % in "wide"."""
    for name in ("inertia", "coulomb", "viscous"):
        small, large = rng.uniform(-0.03, 0.03), rng.uniform(0.1, 0.3)
        side = sign(rng)
        if f"{name}_error" in plan.parameters:
            continue
        if set_ == "single_off":
            plan.nominal[name] *= 1 + small
        elif set_ == "wide":
            plan.nominal[name] *= 1 + side * large


def machine_values(drawn: Drawn, sensors: str, rng: np.random.Generator, dt: float = DT) -> dict[str, float]:
    """The true machine without effects, with the loop that its sensors allow."""
    kind = drawn.kind
    reads_rate = sensors in ("rate", "both")
    # The drive derives its velocity by differences over some periods and a filter, both longer for coarse counts.
    coarse = drawn.encoder_step / (kind.speed * dt)
    average = int(np.clip(round(between(rng, 1, 4) * (1 + 2 * coarse)), 1, 16))
    pole = between(rng, 0.8e-3, 2.5e-3) * (1 + 2 * min(coarse, 2))
    # Lag in the loop: the period, or filter and mean delay of the differences. A bandwidth of 0.25 / lag keeps a phase
    # margin of about 90 - 14 deg.
    late = dt if reads_rate else pole + average * dt / 2 + dt
    bandwidth = min(drawn.bandwidth, 0.25 / late)
    drawn.bandwidth = bandwidth
    # Velocity loop J s w = kp e: bandwidth kp / J.
    kp = drawn.inertia * bandwidth
    # Sticking friction is a spring that resonates with the inertia at 220 to 300 Hz: far above the loop, nearly rigid.
    stiffness = drawn.inertia * (2 * np.pi * between(rng, 220, 300)) ** 2
    # The torque word spans twice the rating, which is six times what the reference asks for.
    rating = 6 * (drawn.coulomb + drawn.viscous * kind.speed + drawn.inertia * kind.speed * 2 * np.pi * kind.highest)
    values = {
        "inertia": drawn.inertia,
        "coulomb_positive": drawn.coulomb,
        "coulomb_negative": drawn.coulomb,
        "viscous_positive": drawn.viscous,
        "viscous_negative": drawn.viscous,
        "element_stiffness": stiffness / INITIAL,
        "element_damping": 2 * between(rng, 0.3, 0.8) * np.sqrt(stiffness * drawn.inertia),
        "kp": kp,
        "ki": kp * bandwidth * rng.uniform(0.1, 0.3),
        "position_gain": bandwidth * rng.uniform(0.12, 0.25) if sensors == "encoder" else 0.0,
        "reads_rate": float(reads_rate),
        "average": float(average),
        "filter": pole,
        "rate_noise": drawn.rate_noise,
        "rate_step": kind.rate_step,
        "encoder_step": drawn.encoder_step,
        "encoder_noise": drawn.encoder_step * rng.uniform(0.0, 0.3),
        "torque_step": 2 * rating / 2**kind.torque_bits,
        "torque_noise": 2 * rating / 2**kind.torque_bits * rng.uniform(0.5, 1.5),
        "rating": rating,
        "start": drawn.start,
    }
    if drawn.compensation != "none":
        values |= {
            "forward_coulomb": 0.85 * drawn.coulomb,
            "forward_viscous": drawn.viscous,
            "forward_speed": 0.03 * kind.speed,
        }
    if drawn.compensation == "friction and inertia":
        values["forward_inertia"] = 0.9 * drawn.inertia
    return values


def scales_of(drawn: Drawn, wanted: np.ndarray, dt: float = DT) -> Scales:
    """Sizes of the motion and torque of a machine that follows the reference exactly."""
    acceleration = np.gradient(wanted, dt)
    torque = drawn.inertia * acceleration + drawn.viscous * wanted
    torque = torque + drawn.coulomb * np.tanh(wanted / (0.01 * drawn.kind.speed))
    return Scales(
        # peak is exceeded in 2 % of the time; moving counts speeds above 2 % of the top speed.
        torque=float(np.sqrt(np.mean(torque**2))),
        speed=float(np.sqrt(np.mean(wanted**2))),
        acceleration=float(np.sqrt(np.mean(acceleration**2))),
        peak=float(np.quantile(np.abs(torque), 0.98)),
        moving=float(max(np.mean(np.abs(wanted) > 0.02 * drawn.kind.speed), 0.1)),
    )


def missing_torque(nominal: dict[str, float], trace: Trace, dt: float = DT) -> np.ndarray:
    """Torque that the nominal model lacks on the true motion, one value for each period, shape (periods - 1,)."""
    velocity, position = trace.true_velocity, trace.true_position
    middle = 0.5 * (velocity[1:] + velocity[:-1])
    angle = 0.5 * (position[1:] + position[:-1])
    # In a period in which the speed changes sign, Coulomb friction is the mean over both parts.
    spread = np.maximum(np.abs(velocity[1:] - velocity[:-1]) / 2, 1e-12)
    direction = np.clip(middle / spread, -1, 1)
    needed = nominal["inertia"] * np.diff(velocity) / dt + nominal["viscous"] * middle
    needed = needed + nominal["coulomb"] * direction + nominal.get("offset", 0.0)
    needed = needed + nominal.get("unbalance", 0.0) * np.sin(angle + nominal.get("unbalance_phase", 0.0))
    missing = trace.command[:-1] - needed
    # Near rest, friction holds the torque: nothing is missing unless it exceeds the Coulomb level.
    still = np.abs(middle) < 0.01 * np.std(velocity)
    held = trace.command[:-1] - needed + nominal["coulomb"] * direction
    beyond = np.sign(held) * np.maximum(np.abs(held) - nominal["coulomb"], 0)
    return np.where(still, beyond, missing)


def sizes(case: Case, trace: Trace) -> dict[str, float]:
    """Torque and missing torque of a log, rms, and the error of the rate reading against its noise."""
    missing = missing_torque(case.plan.nominal, trace, case.world.dt)
    reading = trace.rate - trace.true_velocity
    values = case.world.values
    noise = np.hypot(values["rate_noise"], case.plan.drawn.kind.rate_step / np.sqrt(12))
    return {
        "torque": float(np.sqrt(np.mean(trace.command**2))),
        "missing": float(np.sqrt(np.mean(missing**2))),
        "reading": float(np.sqrt(np.mean(reading**2)) / noise),
    }


def shows(case: Case, size: dict[str, float], set_: str) -> bool:
    """Whether the effect is clearly larger than the clutter, which is at most 8 % of the torque."""
    if set_ == "none":
        return True
    if any(effect.startswith("velocity_") for effect in case.plan.parameters):
        return size["reading"] > 2.5
    return size["missing"] > 0.1 * case.plan.scales.torque


def sane(case: Case, trace: Trace) -> bool:
    """Whether somebody would have kept this record: the machine follows its reference and is stable."""
    speed = case.plan.drawn.kind.speed
    error = np.std(trace.true_velocity - trace.reference)
    howls = np.max(np.abs(trace.true_velocity)) > 2.5 * speed
    # A machine at its torque limit for a quarter of the time shows little else.
    limited = np.mean(np.abs(trace.command) > case.world.values.get("limit", np.inf)) > 0.25
    return bool(np.isfinite(error) and error < 0.7 * np.std(trace.reference) and not howls and not limited)


class Asked(NamedTuple):
    """What a case is drawn from."""

    seed: int
    words: str
    set: str
    sensors: str
    system: str
    effects: tuple[str, ...]
    recording: str = ""  # of `RECORDINGS`; empty for ten seconds at 1 kHz


Done = tuple[Case, Trace, dict[str, float]]


def finished(
    wanted: Sequence[Asked], periods: int = PERIODS, progress: Callable[[float], None] | None = None
) -> Iterator[tuple[int, Done]]:
    """Simulate cases; an effect that is not visible is made larger, a record that nobody would keep is drawn again.

    Args:
        wanted: the cases.
        periods: length of the logs at 1 kHz; those of another rate or length in proportion.
        progress: called with the share done.

    Yields:
        The place in `wanted` and (case, trace, sizes), as they are done.
    """
    best: dict[int, Done] = {}
    anew, grow = [0] * len(wanted), [1.0] * len(wanted)
    left = list(range(len(wanted)))
    for attempt in range(ATTEMPTS):
        cases = []
        for i in left:
            seed, words, set_, sensors, system, effects, name = wanted[i]
            made = RECORDINGS[name] if name else PLAIN
            rows = made.periods(periods)
            cases.append(build(seed, f"{words}/{anew[i]}", set_, sensors, system, effects, rows, grow[i], made))

        def report(share: float, attempt: int = attempt) -> None:
            if progress is not None:
                # The first round simulates all cases, later rounds few.
                progress(0.6 * share if attempt == 0 else 0.6 + 0.4 * (attempt - 1 + share) / (ATTEMPTS - 1))

        again = []
        for i, case, trace in zip(left, cases, simulate([c.world for c in cases], progress=report), strict=True):
            size = sizes(case, trace)
            fine, seen = sane(case, trace), shows(case, size, wanted[i][2])
            size["kept"] = float(fine and seen)
            if i not in best or fine:
                best[i] = (case, trace, size)
            if (fine and seen) or periods < SHORTEST or attempt == ATTEMPTS - 1:
                if not np.all(np.isfinite(best[i][1].true_velocity)):
                    raise ArithmeticError(f"{wanted[i]} diverged")
                yield i, best[i]
                continue
            anew[i] += not fine
            grow[i] = grow[i] * 1.6 if fine else 1.0
            again.append(i)
        left = again
        if not left:
            break


def run(wanted: Sequence[Asked], periods: int = PERIODS, progress: Callable[[float], None] | None = None) -> list[Done]:
    """`finished`, in the order of `wanted`."""
    found = dict(finished(wanted, periods, progress))
    return [found[i] for i in range(len(wanted))]
