"""The first truth's cases: from an identity to a machine, its log and its label."""

import hashlib
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from fpjax.output.json_object import JsonObject

from .contract import unit_of
from .identity import Identity
from .truth.check import chi_square, noise_floor
from .truth.effects import EFFECTS, Plan
from .truth.integrate import simulate
from .truth.machine import Machine, Record
from .truth.outside import OUTSIDE
from .truth.reference import reference
from .truth.systems import KINDS, base_physics, draw_system, peak_torque, spread
from .truth.twins import accepted
from .truth.write import model_text

DT, PERIODS, PREROLL = 1e-3, 10_001, 400
OFF = 0.03  # largest relative error of the nominal values in the set single_off
VERSION = 1  # of the laws and of their draws: raise it when a seed would give another log


def generator(identity: Identity, purpose: int = 0) -> np.random.Generator:
    """Random numbers of this case alone; the same machine whatever its log shows of it."""
    words = f"{identity.seed}/{identity.set}/{identity.system}/{identity.number}/{identity.effects}/{purpose}"
    return np.random.default_rng(np.frombuffer(hashlib.sha256(words.encode()).digest(), dtype=np.uint32))


@dataclass
class Case:
    """A machine ready to be simulated, and its label."""

    identity: Identity
    machine: Machine
    plan: Plan
    with_position: bool
    outside_law: str | None


def build(identity: Identity, periods: int = PERIODS) -> Case:
    """Draw a case: machine, reference, effects, errors of the nominal model."""
    rng = generator(identity)
    kind = KINDS[identity.system]
    draw = draw_system(kind, rng)
    wanted = reference(kind, rng, periods, PREROLL, DT)
    if rng.random() < 0.5:
        # starts at rest: the reference sets in with the log
        rise = np.clip((np.arange(len(wanted)) - PREROLL) * DT / 0.15, 0, 1)
        wanted = wanted * rise * rise * (3 - 2 * rise)
    physics = base_physics(draw)
    nominal = {"inertia": draw.inertia, "coulomb": draw.coulomb, "viscous": draw.viscous}
    plain = identity.set == "starter"  # a known load would be a cause of its own where the log gives the model
    if rng.random() < 0.12 and not plain:
        nominal["offset"] = physics["known_offset"] = draw.coulomb * rng.uniform(-0.3, 0.3)
    if rng.random() < 0.12 and "unbalance" not in identity.effects and not plain:
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
    if identity.set == "wide":
        for name in ("inertia", "coulomb", "viscous"):
            nominal[name] *= 1 + rng.choice([-1.0, 1.0]) * rng.uniform(0.1, 0.3)
    machine.physics = plan.physics
    return Case(identity, machine, plan, identity.sensors != "rate", outside_law)


def label_of(case: Case, record: Record) -> JsonObject:
    """The label of a case without its identity: for the scorer, never for the diagnosis."""
    plan, identity, physics = case.plan, case.identity, case.machine.physics
    true = {
        "inertia": plan.draw.inertia,
        "coulomb": plan.draw.coulomb,
        "viscous": plan.draw.viscous,
    }
    return {
        "version": VERSION,
        "accepted": accepted(plan, case.with_position),
        "also_true": DRIVE if identity.sensors == "derived" else [],
        "parameters": {
            effect: {name: {"value": value, "unit": unit_of(effect, name)} for name, value in values.items()}
            for effect, values in plan.parameters.items()
        },
        "other_form": other_form(plan),
        "laws": plan.laws | ({"outside": case.outside_law} if case.outside_law else {}),
        "nominal_true": true,
        "nominal_error_percent": {name: 100 * (plan.nominal[name] / value - 1) for name, value in true.items()},
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
        "linear": False,
    }


DRIVE = ["velocity_delay", "velocity_lag", "velocity_quantisation"]  # what a drive does to a velocity that it derives


def other_form(plan: Plan) -> list[str]:
    """Effects whose law is not of the contract's form."""
    same = {
        "stribeck": "Gaussian",
        "presliding": "LuGre",
        "position_dependent_friction": "sine",
        "cogging": "second harmonic 0.00",
        "torque_saturation": "hard",
    }
    return [effect for effect, form in same.items() if effect in plan.laws and not plan.laws[effect].startswith(form)]


def derived_velocity(record: Record, identity: Identity, dt: float) -> np.ndarray:
    """The velocity that a drive makes of its encoder: differences, a filter, counts [rad/s]."""
    rng = generator(identity, purpose=1)
    span, pole = int(rng.integers(1, 9)), spread(rng, 5e-4, 4e-3)
    earlier = np.concatenate([np.full(span, record.position[0]), record.position[:-span]])
    raw, keep = (record.position - earlier) / (span * dt), np.exp(-dt / pole)
    found, last = np.zeros(len(raw)), 0.0
    for k, value in enumerate(raw.tolist()):
        last = value + (last - value) * keep
        found[k] = last
    step = float(np.ptp(found)) / 2 ** int(rng.integers(11, 15))
    return np.round(found / step) * step


def write(place: Path, case: Case, record: Record) -> None:
    """log.csv and servo.toml."""
    sensors, physics = case.identity.sensors, case.machine.physics
    columns = {"time": record.time, "torque": record.torque}
    if sensors in ("rate", "both"):
        columns["velocity"] = record.velocity
    if sensors == "derived":
        columns["velocity"] = derived_velocity(record, case.identity, case.machine.dt)
    if sensors != "rate":
        columns["position"] = record.position
    columns["reference"] = record.reference
    place.mkdir(parents=True, exist_ok=True)
    np.savetxt(
        place / "log.csv",
        np.stack(list(columns.values()), axis=1),
        fmt=["%.6f" if name == "time" else "%.9g" for name in columns],
        delimiter=",",
        header=",".join(columns),
        comments="",
    )
    text = model_text(case.plan.nominal, (physics["kp"], physics["ki"]), case.machine.dt, case.with_position)
    if sensors == "encoder":
        text = text.replace('sensors = "both"', 'sensors = "position"')
    (place / "servo.toml").write_text(text)


def run(wanted: list[Identity], periods: int, progress: Callable[[float], None] | None) -> list[tuple[Case, Record]]:
    """Simulate cases side by side."""
    cases = [build(identity, periods) for identity in wanted]
    records = simulate([case.machine for case in cases], progress=progress)
    for case, record in zip(cases, records, strict=True):
        if not np.all(np.isfinite(record.velocity)):
            raise ArithmeticError(f"{case.identity} diverged")
    return list(zip(cases, records, strict=True))
