"""The sets of cases: who is drawn, from which seed, and how they come to lie on disk."""

import hashlib
import json
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from .truth.check import chi_square, noise_floor
from .truth.effects import EFFECTS, UNITS, Plan, compatible
from .truth.integrate import simulate
from .truth.machine import Machine, Record
from .truth.outside import OUTSIDE
from .truth.reference import reference
from .truth.systems import KINDS, base_physics, draw_system, peak_torque
from .truth.twins import accepted
from .truth.write import model_text, write_label, write_log

SETS = ("single", "single_off", "pairs", "none", "outside")
DT, PERIODS, PREROLL = 1e-3, 10_001, 400
PAIRS_PER_SYSTEM, NONE_PER_SYSTEM = 6, 2
OFF = 0.03  # largest relative error of the nominal values in the set single_off
CHUNK = 400  # machines simulated together
VERSION = 1  # of the laws and of their draws: raise it when a seed would give another log


def split(seed: int) -> str:
    """Even seeds are for development, odd ones are reported."""
    return "development" if seed % 2 == 0 else "reported"


def seeds_of(half: str, count: int, skip: int = 0) -> list[int]:
    """The first seeds of a half, or those after the first `skip`."""
    first = 0 if half == "development" else 1
    return [first + 2 * (skip + k) for k in range(count)]


@dataclass(frozen=True)
class Identity:
    """What a case is, before anything is drawn."""

    seed: int
    set: str
    system: str
    effects: tuple[str, ...]
    number: int  # within its set and system

    @property
    def name(self) -> str:
        """An opaque name: nothing in a log's path tells its effect."""
        words = f"{VERSION}/{self.seed}/{self.set}/{self.system}/{self.number}/{self.effects}"
        return "case-" + hashlib.sha256(words.encode()).hexdigest()[:10]

    def generator(self, purpose: int = 0) -> np.random.Generator:
        """Random numbers of this case alone, whoever is simulated beside it."""
        words = f"{self.seed}/{self.set}/{self.system}/{self.number}/{self.effects}/{purpose}"
        digest = hashlib.sha256(words.encode()).digest()
        return np.random.default_rng(np.frombuffer(digest, dtype=np.uint32))


@dataclass
class Case:
    """A machine ready to be simulated, and its label."""

    identity: Identity
    machine: Machine
    plan: Plan
    with_position: bool
    outside_law: str | None


def identities(seed: int, sets: tuple[str, ...], systems: tuple[str, ...]) -> list[Identity]:
    """Every case of a seed."""
    result = []
    for system in systems:
        for name in sets:
            result += [
                Identity(seed, name, system, effects, number)
                for number, effects in enumerate(_members(seed, name, system))
            ]
    return result


def _members(seed: int, name: str, system: str) -> list[tuple[str, ...]]:
    if name in ("single", "single_off"):
        return [(effect,) for effect in EFFECTS]
    if name == "outside":
        return [(kind,) for kind in OUTSIDE]
    if name == "none":
        return [()] * NONE_PER_SYSTEM
    rng = np.random.default_rng([seed, list(KINDS).index(system), 77])
    names = list(EFFECTS)
    pairs: list[tuple[str, ...]] = []
    while len(pairs) < PAIRS_PER_SYSTEM:
        first, second = (names[i] for i in rng.choice(len(names), 2, replace=False))
        # the transmission is drawn first: lags are sized by the bandwidth that it leaves
        pair = tuple(sorted((first, second), key=lambda e: e not in ("compliance", "backlash")))
        used = {effect for chosen in pairs for effect in chosen}
        if compatible(first, second) and not {first, second} & used:
            pairs.append(pair)
    return pairs


def build(identity: Identity, periods: int = PERIODS) -> Case:
    """Draw a case: machine, reference, effects, errors of the nominal model."""
    rng = identity.generator()
    kind = KINDS[identity.system]
    draw = draw_system(kind, rng)
    wanted = reference(kind, rng, periods, PREROLL, DT)
    if rng.random() < 0.5:
        # starts at rest: the reference sets in with the log
        rise = np.clip((np.arange(len(wanted)) - PREROLL) * DT / 0.15, 0, 1)
        wanted = wanted * rise * rise * (3 - 2 * rise)
    physics = base_physics(draw)
    nominal = {"inertia": draw.inertia, "coulomb": draw.coulomb, "viscous": draw.viscous}
    if rng.random() < 0.12:
        nominal["offset"] = physics["known_offset"] = draw.coulomb * rng.uniform(-0.3, 0.3)
    if rng.random() < 0.12 and "unbalance" not in identity.effects:
        amplitude, phase = draw.coulomb * rng.uniform(0.1, 0.4), rng.uniform(0, 2 * np.pi)
        nominal |= {"unbalance": amplitude, "unbalance_phase": phase}
        physics |= {"known_unbalance": amplitude, "known_unbalance_phase": phase}
    plan = Plan(draw, physics, nominal, peak_torque(physics, wanted, DT), together=identity.effects)
    outside_law = None
    total = len(wanted)
    machine = Machine(physics, wanted, rng.normal(size=total), rng.normal(size=total), preroll=PREROLL, dt=DT)
    if identity.set == "outside":
        outside_law = OUTSIDE[identity.effects[0]](plan, machine, rng)
    else:
        for effect in identity.effects:
            EFFECTS[effect](plan, rng)
    if identity.set == "single_off":
        for name in ("inertia", "coulomb", "viscous"):
            nominal[name] *= 1 + rng.uniform(-OFF, OFF)
    order = identity.number + list(KINDS).index(identity.system) + identity.seed // 2
    machine.physics = plan.physics
    return Case(identity, machine, plan, order % 2 == 0, outside_law)


def label_of(case: Case, record: Record) -> dict[str, Any]:
    """What the scorer is told and the tool is not."""
    plan, identity, physics = case.plan, case.identity, case.machine.physics
    true = {
        "inertia": plan.draw.inertia,
        "coulomb": plan.draw.coulomb,
        "viscous": plan.draw.viscous,
    }
    effects = [] if identity.set == "outside" else list(identity.effects)
    return {
        "case": identity.name,
        "version": VERSION,
        "seed": identity.seed,
        "half": split(identity.seed),
        "set": identity.set,
        "system": identity.system,
        "effects": effects,
        "outside": identity.effects[0] if identity.set == "outside" else None,
        "accepted": accepted(plan, case.with_position),
        "parameters": {
            effect: {name: {"value": value, "unit": unit_of(effect, name)} for name, value in values.items()}
            for effect, values in plan.parameters.items()
        },
        "laws": plan.laws | ({"outside": case.outside_law} if case.outside_law else {}),
        "nominal_error_percent": {name: 100 * (plan.nominal[name] / value - 1) for name, value in true.items()},
        "with_position": case.with_position,
        "controller": plan.draw.controller,
        "known_offset": plan.nominal.get("offset", 0.0),
        "known_unbalance": plan.nominal.get("unbalance", 0.0),
        "noise": {
            "velocity": physics["velocity_noise"],
            "position": physics["position_noise"],
            "position_step": physics["position_step"],
        },
        "perfect_gap": noise_floor(physics),
        "nominal_chi_square": chi_square(plan.nominal, physics, record, case.machine.dt),
        "bandwidth": plan.draw.bandwidth,
    }


def unit_of(effect: str, name: str) -> str:
    """Unit of a contract parameter (two effects use one name with different units nowhere)."""
    return UNITS[name]


def write_case(folder: Path, case: Case, record: Record) -> None:
    """log.csv, servo.toml and, apart, the label."""
    place = folder / "logs" / case.identity.name
    write_log(place, record, case.with_position)
    physics = case.machine.physics
    text = model_text(case.plan.nominal, (physics["kp"], physics["ki"]), case.machine.dt, case.with_position)
    (place / "servo.toml").write_text(text)
    write_label(folder / "labels" / f"{case.identity.name}.json", label_of(case, record))


def generate(
    folder: Path,
    wanted: list[Identity],
    progress: Callable[[float], None] | None = None,
    periods: int = PERIODS,
) -> int:
    """Write the cases that are not on disk yet; returns how many were made."""
    missing = [one for one in wanted if not (folder / "labels" / f"{one.name}.json").exists()]
    for start in range(0, len(missing), CHUNK):
        part = missing[start : start + CHUNK]
        cases = [build(identity, periods) for identity in part]

        def report(share: float, start: int = start, size: int = len(part)) -> None:
            if progress is not None:
                progress((start + share * size) / len(missing))

        records = simulate([case.machine for case in cases], progress=report)
        for case, record in zip(cases, records, strict=True):
            if not np.all(np.isfinite(record.velocity)):
                raise ArithmeticError(f"{case.identity} diverged")
            write_case(folder, case, record)
    return len(missing)


def read_labels(folder: Path, wanted: list[Identity]) -> list[dict[str, Any]]:
    """The labels of the cases asked for, in their order."""
    return [json.loads((folder / "labels" / f"{one.name}.json").read_text()) for one in wanted]
