"""servo.toml -> Model: sections are read in the order in which they depend on each other, then checked together."""

import dataclasses
import os
import pathlib

from ..blocks.controllers import Proportional
from ..errors import InputError
from ..logs.columns.units import find_unit
from ..output import toml_text
from ..output.json_object import JsonObject, TomlTable
from ..simulation.loop import ClosedLoop
from ..simulation.scan import Stepping
from ..simulation.solvers import SOLVERS, get_solver
from . import body
from .admissible import check_all
from .bounds import read_bounds
from .controller import FEEDFORWARD, build_controller, with_feedforward
from .friction import OFFSET, SECTION, Steepness, build_friction
from .keys import Key, Units, check_keys, choose, nearest, read_values
from .learned import build_learned, join_load, more_coulomb
from .limits import read_limits
from .model import Model
from .observer import build_observer, choose_observer_steepness, known_to_observer, unwritten_gains
from .placed_gains import with_placed_gains
from .proportions import check_proportions
from .reference import build_reference
from .writing import describe_model

SECTIONS = (
    "units", "plant", "transmission", "friction", "load", "learned", "actuator", "sensor",
    "controller", "feedforward", "observer", "reference", "simulation", "bounds", "limits",
)  # fmt: skip


_DT = Key("dt", "s", "positive")


_DURATION = Key("duration", "s", "positive", None)


_UNITS = {
    "motion": ("rotary", "linear"),
    "reference": ("velocity", "position", "none"),
    "sensors": ("velocity", "position", "both"),
}


LOG_SUFFIXES = (".csv", ".npz", ".mat", ".parquet", ".mcap")


LARGEST_RUN = 1e9  # [steps]; a longer run comes from a wrong unit of dt or duration


def load_model(source: str | os.PathLike[str]) -> Model:
    """Read a servo.toml.

    Args:
        source: its path, or its text (anything with a line break or a "=").

    Returns:
        A `Model`.

    Raises:
        InputError: one sentence on the first thing that is wrong, naming section and key.
    """
    # a user often gives the log where the model belongs: the suffix tells before the parser complains of its first
    # line
    text, path = toml_text.read_source(source)
    name = path.name if path else "the model"
    if path is not None and path.suffix.lower() in LOG_SUFFIXES:
        raise InputError(f"{name} is a log, not a model: give a servo.toml (fpjax inspect {name} writes a first one).")
    sections = toml_text.parse(text, name)
    for section in sections:
        if section not in SECTIONS:
            raise InputError(f"{name}: section [{section}] is not known: {nearest(section, SECTIONS)}.")
    for section, table in sections.items():
        # [[load]] and [[learned]] may be written several times; any other section is one table
        several = (
            section in ("load", "learned") and isinstance(table, list) and all(isinstance(each, dict) for each in table)
        )
        if not isinstance(table, dict) and not several:
            raise InputError(f"{name}: {section} is a section: write [{section}] on a line of its own, its keys below.")
    for section in ("plant", SECTION, "simulation"):
        if section not in sections:
            needs = {"plant": "type and inertia", SECTION: "type, coulomb and viscous", "simulation": "dt"}[section]
            raise InputError(f"{name}: section [{section}] is missing: it needs {needs}.")
    return _build(sections, text, path)


def _build(sections: TomlTable, text: str, path: pathlib.Path | None) -> Model:
    # units and time first: messages name the machine's units, and steepness and placed gains depend on the step
    units = _read_units(sections.get("units", {}))
    time = _read_simulation(sections["simulation"], units)
    solver, dt = get_solver(time["solver"]), time["dt"]
    notes: list[str] = []
    learned, jump = build_learned(sections.get("learned"), units)
    friction_table = more_coulomb(sections[SECTION], jump, notes, units)
    offset = read_values(SECTION, friction_table, (OFFSET,), units)["offset"]
    # The steepness depends on the inertia of the body on which friction acts, so a plant without friction is built
    # first.
    bare = body.build_plant(
        sections["plant"], sections.get("transmission"), build_friction({"type": "none"}, units, _never()),
        join_load(body.build_load(sections.get("load"), offset, units), learned), units,
    )  # fmt: skip
    sampled_only = bool(sections.get("actuator", {}).get("delay")) or (
        bool(sections.get("sensor")) and sections["sensor"].get("type") != "ideal"
    )
    which = "[sensor]" if sections.get("sensor") else "[actuator] delay"
    if time["solver"] == "exact":
        sampled_only, which = True, 'solver = "exact"'
    stepping = _stepping(time["stepping"], sampled_only, which, notes)
    step = dt / time["substeps"] if stepping == "sampled" else dt
    largest = (sections.get("actuator") or {}).get("limit")
    steepness = Steepness(float(bare.rubbing_inertia()), step, solver, units, largest)
    friction = build_friction(friction_table, units, steepness)
    if steepness.note:
        notes.append(steepness.note)
    plant = body.build_plant(sections["plant"], sections.get("transmission"), friction, bare.load, units)
    missing_gains = unwritten_gains(sections.get("controller"), sections.get("observer"))
    tables = _with_any_gain(sections, missing_gains)
    controller = build_controller(tables.get("controller", {"type": "unknown"}), units, dt)
    # The observer takes inertia and friction from the plant, so it is built after it; placed gains need the whole
    # loop, so a 1 stands for them until then.
    known = known_to_observer(plant)
    choose_observer_steepness(known, sections, time, dt, units, notes)
    loop = ClosedLoop(
        plant=plant,
        controller=Proportional(0.0) if controller is None else controller,
        observer=build_observer(tables.get("observer"), units, plant, known),
        actuator=body.build_actuator(sections.get("actuator"), units, dt),
        sensor=body.build_sensor(sections.get("sensor"), units, dt),
    )
    reference = build_reference(
        sections.get("reference"), units, path.parent if path else None, units.motion == "linear", time["duration"]
    )
    # checks of the numbers against each other come after every section was read: an error in one section is named
    # first
    notes += check_all(friction, controller, reference, dt, units, learned, loop.actuator)
    loop = with_placed_gains(loop, missing_gains, reference, time, {k: v for k, v in known.items() if v}, notes)
    around = with_feedforward(None if controller is None else loop.controller, sections.get(FEEDFORWARD), units, dt)
    loop = loop if around is None else dataclasses.replace(loop, controller=around)
    model = Model(
        loop=loop,
        reference=reference,
        dt=dt,
        duration=time["duration"],
        stepping=stepping,
        solver=time["solver"],
        substeps=time["substeps"],
        units=units,
        controller_known=controller is not None,
        sections=sections,
        text=text,
        path=path,
        notes=tuple(notes),
        bounds=read_bounds(sections.get("bounds"), loop, units),
        limits=read_limits(sections.get("limits"), units),
    )
    return dataclasses.replace(model, notes=(*model.notes, *about_proportions(model)))


def about_proportions(model: Model) -> list[str]:
    """Warnings for numbers that are out of proportion to the machine's others."""
    step = model.dt / (model.substeps if model.stepping == "sampled" else 1)
    return check_proportions(
        describe_model(model), model.reference, model.dt, model.duration, model.units,
        step / get_solver(model.solver).stability_limit,
    )  # fmt: skip


def _read_units(table: TomlTable) -> Units:
    check_keys("units", table, [field.name for field in dataclasses.fields(Units)])
    words = {key: choose("units", key, table[key], known) for key, known in _UNITS.items() if key in table}
    linear = words.get("motion") == "linear"
    torque = table.get("torque", "N" if linear else "N m")
    if not isinstance(torque, str) or not torque.strip():
        raise InputError(
            f'[units] torque = {torque!r} is not a unit: write "N m", "N", or a label such as "V" or "PWM".'
        )
    unit, si = find_unit(torque), {"torque": "N m", "force": "N"}
    if unit is not None and unit.quantity in si:
        right = si[unit.quantity]
        if unit.factor != 1.0 and right == ("N" if linear else "N m"):
            raise InputError(
                f'[units] torque = "{torque}" is not a label but another unit than the log is read in: write the '
                f'numbers of the file in {right}, and torque = "{right}".'
            )
        torque = right  # "Nm", "N*m"
    if torque == ("N m" if linear else "N"):
        kind, right = ("linear", "N") if linear else ("rotary", "N m")
        raise InputError(
            f'[units] torque = "{torque}" does not go with a {kind} axis: write "{right}", or change motion.'
        )
    return Units(torque=torque, **words)


def _read_simulation(table: TomlTable, units: Units) -> JsonObject:
    check_keys("simulation", table, ["dt", "duration", "stepping", "substeps", "solver"])
    values = read_values("simulation", table, (_DT, _DURATION), units)
    dt, duration = values["dt"], values["duration"]
    if duration is not None and not dt <= duration <= LARGEST_RUN * dt:
        why = "shorter than one step" if duration < dt else f"{duration / dt:.3g} steps"
        raise InputError(
            f"[simulation] duration = {duration:g} s is {why} of dt = {dt:g} s: check the unit (s) of both."
        )
    substeps = table.get("substeps", 1)
    if isinstance(substeps, bool) or not isinstance(substeps, int) or not 1 <= substeps <= 100_000:
        raise InputError(f"[simulation] substeps must be a whole number from 1 to 100000, got {substeps!r}.")
    solver = choose("simulation", "solver", table.get("solver", "rk4"), SOLVERS)
    stepping = (
        choose("simulation", "stepping", table["stepping"], ("continuous", "sampled")) if "stepping" in table else ""
    )
    return {**values, "substeps": substeps, "solver": solver, "stepping": stepping}


def _stepping(written: str, sampled_only: bool, which: str, notes: list[str]) -> Stepping:
    if sampled_only and written == "continuous":
        raise InputError(
            f'{which} only works at sample instants: write [simulation] stepping = "sampled", or drop {which}.'
        )
    if sampled_only and not written:
        notes.append(f'[simulation] stepping is not given: "sampled" was chosen, because {which} needs it.')
        return "sampled"
    return "sampled" if written == "sampled" else "continuous"


def _with_any_gain(sections: TomlTable, missing: tuple[str, ...]) -> JsonObject:
    """The sections with a 1 for every gain that pole placement will choose."""
    tables = {name: dict(table) if isinstance(table, dict) else table for name, table in sections.items()}
    for key in missing:
        section, _, word = key.partition(".")
        tables[section][word] = 1.0
    return tables


def _never() -> Steepness:
    """For a law that needs no steepness."""
    return Steepness(1.0, 1.0, get_solver("rk4"), Units())
