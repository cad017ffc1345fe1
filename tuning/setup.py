"""`Setup`: how a set of gains is judged, said once for `tune`, `tune_each` and `sweep`."""

import dataclasses
import difflib
from collections.abc import Sequence
from typing import TypedDict

from fpjax.errors import InputError
from fpjax.model_file import Model
from fpjax.output.json_object import JsonObject, TomlTable
from fpjax.simulation.scan import Stepper, Stepping, make_stepper
from fpjax.simulation.solvers import AbstractPlantSolver

from .objective import AbstractObjective
from .problem import Aggregate


class SetupWords(TypedDict, total=False):
    """The fields of `Setup` as keywords of `tune`, `tune_each` and `sweep`."""

    dt: float | None
    duration: float | None
    samples: int | None
    objective: str | AbstractObjective
    solver: str | AbstractPlantSolver | None
    stepping: Stepping | None
    substeps: int | None
    plants: TomlTable | None
    noise_seeds: Sequence[int]
    aggregate: Aggregate


@dataclasses.dataclass(frozen=True, kw_only=True)
class Setup:
    """The runs by which gains are judged, their cost, and what it must hold for.

    Attributes:
        dt: step, or control period when sampled [s].
        duration: of a run [s]; or `samples`.
        samples: of a run.
        objective: "estimation", "tracking", "thesis", or an objective.
        solver: "euler", "heun", "ode3", "rk4" or "exact"; None for the model's own, or "rk4".
        stepping: "continuous" or "sampled"; None for the model's own, or "continuous".
        substeps: solver steps per control period when sampled; None for the model's own, or 1.
        plants: true plants to judge on: values by name, one a plant, as {"plant.friction.viscous": [1, 2, 5]}; see
            `population`. The observer keeps its own idea of the inertia.
        noise_seeds: seeds of the sensor's noise, a run for each; none for no noise.
        aggregate: "mean" or "worst" over references x plants x seeds (in a sweep over plants x seeds).
    """

    dt: float | None = None
    duration: float | None = None
    samples: int | None = None
    objective: str | AbstractObjective = "estimation"
    solver: str | AbstractPlantSolver | None = None
    stepping: Stepping | None = None
    substeps: int | None = None
    plants: TomlTable | None = None
    noise_seeds: Sequence[int] = ()
    aggregate: Aggregate = "mean"

    def of_model(self, model: Model) -> "Setup":
        """What is not said, from the model: its step, its horizon, its solver."""
        return dataclasses.replace(
            self,
            dt=model.dt if self.dt is None else self.dt,
            duration=model.needed_duration() if self.duration is None and self.samples is None else self.duration,
            solver=self.solver or model.solver,
            stepping=self.stepping or model.stepping,
            substeps=self.substeps or model.substeps,
        )

    def stepper(self) -> Stepper:
        """How time passes in the runs."""
        named = ("dt", "duration", "samples", "solver", "stepping", "substeps")
        return make_stepper(**{name: value for name, value in self.words().items() if name in named})

    def words(self) -> JsonObject:
        """As keywords of `make_problem`, with the solver, stepping and substeps of a loop of which nothing is said."""
        said = {field.name: getattr(self, field.name) for field in dataclasses.fields(self)}
        usual = {"solver": "rk4", "stepping": "continuous", "substeps": 1}
        return said | {name: said[name] or value for name, value in usual.items()}


def settled(setup: Setup | None, words: TomlTable) -> Setup:
    """The setup with the keywords that were given in place of its own fields.

    Raises:
        InputError: for a keyword that is none of its fields.
    """
    known = [field.name for field in dataclasses.fields(Setup)]
    for word in words:
        if word not in known:
            near = difflib.get_close_matches(word, known, n=1)
            hint = f"did you mean {near[0]!r}? " if near else ""
            raise InputError(f"{word} is not a setting of tune, tune_each or sweep: {hint}Give {', '.join(known)}.")
    return dataclasses.replace(setup or Setup(), **words)
