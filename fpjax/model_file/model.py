"""servo.toml <-> Model: the closed loop, its reference, and the settings of the simulation."""

import dataclasses
import os
import pathlib
from collections.abc import Mapping
from dataclasses import dataclass, field

import jax

from ..blocks.controllers import AbstractController, Proportional
from ..blocks.friction.bristles import Bristles
from ..blocks.references import AbstractReference
from ..errors import InputError
from ..output import toml_text
from ..output.json_object import JsonObject, TomlTable
from ..simulation.loop import ClosedLoop
from ..simulation.scan import Stepper, Stepping, make_stepper
from ..simulation.solvers import SOLVERS, get_solver
from . import body
from .admissible import check_all
from .bounds import Bounds, describe_bounds, read_bounds
from .controller import FEEDFORWARD, build_controller, describe_controller, describe_feedforward, with_feedforward
from .friction import OFFSET, SECTION, Steepness, build_friction, describe_friction
from .keys import Key, Units, check_keys, choose, missing, nearest, read_values
from .learned import build_learned, describe_learned, join_load, more_coulomb
from .limits import read_limits
from .observer import build_observer, choose_observer_steepness, describe_observer, known_to_observer, unwritten_gains
from .placed_gains import with_placed_gains
from .proportions import check_proportions
from .reference import build_reference, describe_reference

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


@dataclass(frozen=True)
class Model:
    """The nominal model that a servo.toml describes.

    Attributes:
        loop: plant, controller, observer, actuator, sensor; an unknown controller is a `Proportional(0.0)`.
        reference: the reference of the loop; None where it comes from a log.
        dt: step, or control period when sampled [s].
        duration: of a simulation [s]; None where it comes from a log.
        stepping: "continuous" or "sampled".
        solver: name of the solver.
        substeps: solver steps per control period when sampled.
        units: the units of motion and torque.
        controller_known: False for type = "unknown".
        sections: the sections as written.
        text: the file's text.
        path: the file; None where the model was given as text.
        notes: choices made for the user and warnings, a sentence each.
        bounds: (lowest, highest) of gains by their names in the file, as "controller.kp".
        limits: limits of planned runs by name: "speed", "acceleration", "torque", "travel".
    """

    loop: ClosedLoop
    reference: AbstractReference | None
    dt: float
    duration: float | None = None
    stepping: Stepping = "continuous"
    solver: str = "rk4"
    substeps: int = 1
    units: Units = field(default_factory=Units)
    controller_known: bool = True
    sections: TomlTable = field(default_factory=dict)
    text: str = ""
    path: pathlib.Path | None = None
    notes: tuple[str, ...] = ()
    bounds: Bounds = field(default_factory=dict)
    limits: Mapping[str, float] = field(default_factory=dict)

    @property
    def linear(self) -> bool:
        """Whether the axis is linear (m, N)."""
        return self.units.motion == "linear"

    @property
    def sensors(self) -> str:
        """What a log of this machine holds: "velocity", "position" or "both"."""
        return self.units.sensors

    @property
    def nominal(self) -> dict[str, float]:
        """The nominal parameters by name, in the machine's units: inertia, the friction law's numbers, offset."""
        friction = self.loop.plant.friction
        law = friction.law if isinstance(friction, Bristles) else friction
        values = {"inertia": body.total_inertia(self.loop.plant)}
        values |= {
            name: float(leaf)
            for name in type(law).__dataclass_fields__
            if isinstance(leaf := getattr(law, name), jax.Array) and leaf.ndim == 0
        }
        for name in ("coulomb", "viscous"):
            sides = [values.get(f"{name}_{side}") for side in ("positive", "negative")]
            if name not in values:
                values[name] = 0.5 * (sides[0] + sides[1]) if sides[0] is not None and sides[1] is not None else 0.0
        values["offset"] = body.describe_load(self.loop.plant.load)[1]
        return values

    def stepper(self, *, samples: int | None = None, duration: float | None = None) -> Stepper:
        """The time steps of a run, for `roll` and the tuning.

        Args:
            samples: number of samples, instead of a duration.
            duration: [s], instead of the model's.

        Raises:
            InputError: where no length is given and the model has none.
        """
        if samples is None and duration is None:
            duration = self.needed_duration()
        return make_stepper(
            dt=self.dt,
            duration=duration if samples is None else None,
            samples=samples,
            solver=self.solver,
            stepping=self.stepping,
            substeps=self.substeps,
        )

    def needed_duration(self) -> float:
        """The duration [s].

        Raises:
            InputError: where the file has none.
        """
        if self.duration is None:
            raise InputError(missing("simulation", Key("duration", "s"), {}, self.units))
        return self.duration

    def needed_reference(self) -> AbstractReference:
        """The reference.

        Raises:
            InputError: where the file has none.
        """
        if self.reference is None:
            raise InputError(
                '[reference] is missing: write for instance type = "sine", amplitude = 1.0, frequency = 1.0, or give a '
                "log with a reference by --log."
            )
        return self.reference

    def needed_controller(self) -> AbstractController:
        """The controller.

        Raises:
            InputError: where it is unknown.
        """
        if not self.controller_known:
            raise InputError(
                "[controller] is unknown, which is enough to estimate and diagnose but not to simulate: write "
                'type = "pi" with kp and ki, or one of p, lead, transfer_function, position_cascade.'
            )
        return self.loop.controller


ModelSource = Model | str | os.PathLike[str]
"""A model as the functions of fpjax take it: a `Model`, the path of a servo.toml, or its text."""


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
    torque = {"Nm": "N m", "N*m": "N m"}.get(torque, torque)
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


def dump_model(model: Model, *, comments: Mapping[tuple[str, str], str] | None = None) -> str:
    """A model as servo.toml text; `load_model` of it gives the same numbers to the last bit.

    Args:
        model: the model, its loop perhaps replaced (`dataclasses.replace(model, loop=...)`).
        comments: by (section, key), a comment after the value.

    Raises:
        InputError: for a block that the file cannot hold.
    """
    return toml_text.write(describe_model(model), comments)


def describe_model(model: Model) -> JsonObject:
    """A model's sections with their numbers, in the order of the file.

    Raises:
        InputError: for a block that the file cannot hold.
    """
    loop, written = model.loop, model.sections
    loads, offset = body.describe_load(loop.plant.load)
    friction = describe_friction(loop.plant.friction)
    if offset:
        friction["offset"] = offset
    plants = body.describe_plant(loop.plant)
    actuator = body.describe_actuator(loop.actuator)
    controller = loop.controller if model.controller_known else None
    # keys at their default value are left out, so that a written file is as short as a hand-made one
    simulation: JsonObject = {"dt": model.dt}
    if model.duration is not None:
        simulation["duration"] = model.duration
    simulation |= {"stepping": model.stepping, "solver": model.solver}
    if model.substeps != 1:
        simulation["substeps"] = model.substeps
    sections: JsonObject = {
        "units": _write_units(model.units),
        "plant": plants["plant"],
        "transmission": plants.get("transmission"),
        "friction": friction,
        "load": loads[0] if len(loads) == 1 else loads,
        "learned": describe_learned(body.flat_loads(loop.plant.load)),
        "actuator": actuator,
        "sensor": body.describe_sensor(loop.sensor),
        "controller": describe_controller(controller, written.get("controller", {})),
        "feedforward": describe_feedforward(controller),
        "observer": describe_observer(loop.observer),
        "reference": describe_reference(model.reference, written.get("reference", {})),
        "simulation": simulation,
        "bounds": describe_bounds(model.bounds),
        "limits": dict(model.limits),
    }
    return {name: table for name, table in sections.items() if table}


def _write_units(units: Units) -> dict[str, str]:
    default = Units(torque="N" if units.motion == "linear" else "N m")
    return {key: value for key, value in dataclasses.asdict(units).items() if value != getattr(default, key)}
