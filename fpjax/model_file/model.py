"""Model: what a servo.toml describes: the closed loop, its reference, and the settings of the simulation."""

import os
import pathlib
from collections.abc import Mapping
from dataclasses import dataclass, field

import jax

from ..blocks.controllers import AbstractController
from ..blocks.friction.bristles import Bristles
from ..blocks.references import AbstractReference
from ..errors import InputError
from ..output.json_object import TomlTable
from ..simulation.loop import ClosedLoop
from ..simulation.scan import Stepper, Stepping, make_stepper
from . import body
from .bounds import Bounds
from .keys import Key, Units, missing


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
