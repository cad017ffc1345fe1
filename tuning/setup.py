"""`Setup`: the simulations, the cost and the cases by which gains are judged; of `tune`, `tune_each` and `sweep`."""

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
    """The fields of `Setup` as keyword arguments of `tune`, `tune_each` and `sweep`."""

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
    """The simulations by which gains are judged, their cost, and the cases over which it is taken.

    Attributes:
        dt: step, or control period when sampled [s].
        duration: of a run [s]; give this or `samples`.
        samples: of a run.
        objective: "estimation", "tracking", "thesis", or an objective.
        solver: "euler", "heun", "ode3", "rk4" or "exact"; None for the model's own, or "rk4".
        stepping: "continuous" or "sampled"; None for the model's own, or "continuous".
        substeps: solver steps per control period when sampled; None for the model's own, or 1.
        plants: true plants to judge on: values by parameter name, one value for each plant, as
            {"plant.friction.viscous": [1, 2, 5]}; see `population`. The observer keeps its own nominal inertia.
        noise_seeds: seeds of the sensor noise, one run for each; empty for runs without noise.
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
        """A copy whose unset fields are taken from the model: step, horizon, solver, stepping and substeps."""
        return dataclasses.replace(
            self,
            dt=model.dt if self.dt is None else self.dt,
            duration=model.needed_duration() if self.duration is None and self.samples is None else self.duration,
            solver=self.solver or model.solver,
            stepping=self.stepping or model.stepping,
            substeps=model.substeps if self.substeps is None else self.substeps,
        )

    def stepper(self) -> Stepper:
        """The time stepping of the runs: step, number of samples, solver, and substeps."""
        named = ("dt", "duration", "samples", "solver", "stepping", "substeps")
        return make_stepper(**{name: value for name, value in self.words().items() if name in named})

    def words(self) -> JsonObject:
        """As keyword arguments of `make_problem`; an unset solver, stepping or substeps gets its default."""
        said = {field.name: getattr(self, field.name) for field in dataclasses.fields(self)}
        usual = {"solver": "rk4", "stepping": "continuous", "substeps": 1}
        return said | {name: value for name, value in usual.items() if said[name] is None}


def with_keywords(setup: Setup | None, words: TomlTable) -> Setup:
    """The setup with the given keyword arguments in place of its own fields; a default `Setup` where there is none.

    Raises:
        InputError: for a keyword that is not a field of `Setup`.
    """
    known = [field.name for field in dataclasses.fields(Setup)]
    for word in words:
        if word not in known:
            near = difflib.get_close_matches(word, known, n=1)
            hint = f"did you mean {near[0]!r}? " if near else ""
            raise InputError(f"{word} is not a setting of tune, tune_each or sweep: {hint}Give {', '.join(known)}.")
    return dataclasses.replace(setup or Setup(), **words)
