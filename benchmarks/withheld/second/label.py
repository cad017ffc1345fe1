"""The label of a case of the second generator, and its log and nominal model on disk."""

from itertools import product
from pathlib import Path

import numpy as np

from ..contract import unit_of
from .cases import VERSION, Case, generator
from .effects import PERIODIC
from .equivalent import equivalents
from .recording import recorded
from .world import Trace


def stands_for(effect: str, case: Case, sensors: str) -> list[frozenset[str]]:
    """Sets of causes that make the very log that one effect makes, itself first."""
    plan, values = case.plan, case.world.values
    found = [frozenset({effect})]
    no_position = sensors == "rate"
    alone = set(plan.parameters)
    other = {"actuator_delay": "velocity_delay", "velocity_delay": "actuator_delay"}.get(effect)
    if other and no_position and "friction_drift" not in alone:
        found.append(frozenset({other}))
    if effect == "constant_torque":
        found.append(frozenset({"asymmetric_friction"}))
    if effect == "asymmetric_friction" and "viscous_positive" not in plan.parameters[effect]:
        found.append(frozenset({"constant_torque"}))
        if values["coulomb_positive"] + values["coulomb_negative"] != 2 * plan.drawn.coulomb:
            found[-1] |= {"coulomb_error"}
    known = plan.nominal.get("unbalance", 0.0) or plan.nominal.get("offset", 0.0)
    if effect == "torque_gain_error" and not known:
        found.append(frozenset({"inertia_error", "coulomb_error", "viscous_error"}))
    locked = (
        alone & PERIODIC
        or plan.nominal.get("unbalance", 0.0)
        or {"cogging", "position_dependent_friction"} & set(case.clutter)
    )
    if effect == "velocity_scale_error" and no_position and not locked:
        found.append(frozenset({"inertia_error", "viscous_error"}))
    return found


def accepted(case: Case, sensors: str) -> list[list[str]]:
    """Every set of causes that is right, the true one first."""
    sets: list[frozenset[str]] = []
    for choice in product(*(stands_for(effect, case, sensors) for effect in case.plan.parameters)):
        union = frozenset().union(*choice)
        if union not in sets:
            sets.append(union)
    return [sorted(one) for one in sets]


def label_of(case: Case, trace: Trace, size: dict[str, float], sensors: str, set_: str) -> dict[str, object]:
    """The label, but for the identity of the case; `law` holds a law's own numbers where `parameters` are others."""
    plan, linear = case.plan, case.plan.drawn.kind.linear
    true = {"inertia": plan.drawn.inertia, "coulomb": plan.drawn.coulomb, "viscous": plan.drawn.viscous}
    equivalent = equivalents(case, trace)
    return {
        "version": VERSION,
        "accepted": accepted(case, sensors),
        "also_true": also_true(case, sensors),
        "parameters": {
            effect: _with_units(effect, equivalent.get(effect, values), linear)
            for effect, values in plan.parameters.items()
        },
        "law": {effect: _with_units(effect, plan.parameters[effect], linear) for effect in equivalent},
        "other_form": plan.other_form,
        "nominal_true": true,
        "nominal_error_percent": {name: 100 * (plan.nominal[name] / value - 1) for name, value in true.items()},
        "measured_torque": case.world.measured,
        "linear": linear,
        "sizes": size,
    }


def _with_units(effect: str, values: dict[str, float], linear: bool) -> dict[str, dict[str, object]]:
    return {
        name: {"value": float(value), "unit": unit_of(effect, name)}
        for name, value in values.items()
        # The number of periods of a linear axis has no agreed unit.
        if not (linear and name == "periods")
    }


def also_true(case: Case, sensors: str) -> list[str]:
    """Effects of the vocabulary that are there beside the cause: the clutter, and what the drive did to a velocity."""
    drive = ["velocity_lag", "velocity_delay", "velocity_quantisation"] if sensors == "derived" else []
    return sorted({*case.clutter, *drive})


def columns_of(trace: Trace, sensors: str, rate_step: float) -> dict[str, np.ndarray]:
    """The columns that such sensors give."""
    found = {"time": trace.time, "torque": trace.torque}
    if sensors in ("rate", "both"):
        found["velocity"] = trace.rate
    if sensors == "derived":
        found["velocity"] = np.round(trace.derived / rate_step) * rate_step
    if sensors != "rate":
        found["position"] = trace.position
    found["reference"] = trace.position_reference if sensors == "encoder" else trace.reference
    return found


def model_text(case: Case, sensors: str) -> str:
    """The nominal servo.toml."""
    plan, values = case.plan, case.world.values
    nominal = plan.nominal
    words = {"rate": "velocity", "both": "both", "encoder": "position", "derived": "both"}
    lines = ["[units]", f'motion = "{"linear" if plan.drawn.kind.linear else "rotary"}"']
    lines += [f'reference = "{"position" if sensors == "encoder" else "velocity"}"', f'sensors = "{words[sensors]}"']
    lines += ["[plant]", 'type = "one_mass"', f"inertia = {nominal['inertia']:.9g}"]
    lines += ["[friction]", 'type = "coulomb_viscous"', f"coulomb = {nominal['coulomb']:.9g}"]
    lines += [f"viscous = {nominal['viscous']:.9g}"]
    if nominal.get("offset", 0.0):
        lines.append(f"offset = {nominal['offset']:.9g}")
    if nominal.get("unbalance", 0.0):
        lines += ["[load]", 'type = "unbalance"', f"amplitude = {nominal['unbalance']:.9g}"]
        lines += [f"phase = {nominal['unbalance_phase']:.9g}"]
    lines.append("[controller]")
    if sensors in ("rate", "both"):
        lines += ['type = "pi"', f"kp = {values['kp']:.9g}", f"ki = {values['ki']:.9g}"]
    else:
        lines.append('type = "unknown"')
    return "\n".join([*lines, "[simulation]", f"dt = {case.world.dt:.9g}"]) + "\n"


def write(place: Path, case: Case, trace: Trace, sensors: str) -> None:
    """log.csv and servo.toml."""
    found = columns_of(trace, sensors, case.plan.drawn.kind.rate_step)
    found = recorded(found, case.recording, generator(case.seed, case.words, "recording"))
    place.mkdir(parents=True, exist_ok=True)
    formats = ["%.6f" if name == "time" else "%.10g" for name in found]
    np.savetxt(
        place / "log.csv",
        np.stack(list(found.values()), axis=1),
        fmt=formats,
        delimiter=",",
        header=",".join(found),
        comments="",
    )
    (place / "servo.toml").write_text(model_text(case, sensors))
