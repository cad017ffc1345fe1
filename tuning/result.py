"""The result of a tuning: gains, costs, simulations and seconds used, identifiability, notes."""

import dataclasses
import math
from typing import TYPE_CHECKING, Any

import numpy as np

from fpjax.blocks.parameters import set_parameters
from fpjax.output.data_frames import to_frame
from fpjax.output.drawable import Drawable
from fpjax.output.json_object import JsonObject
from fpjax.output.plotting import new_figure, style
from fpjax.output.runfile import plain
from fpjax.output.runfile import versions as all_versions
from fpjax.simulation.loop import ClosedLoop

from .identifiability import Identifiability

if TYPE_CHECKING:
    from matplotlib.figure import Figure


@dataclasses.dataclass(frozen=True)
class TuningResult(Drawable):
    """The result of one tuning on one set of references.

    `plot` draws the best cost so far against simulations.

    Attributes:
        method: name of the method.
        objective: name of the objective.
        references: labels of the references it was tuned on.
        gains: tuned values by parameter name, in their units.
        start: values of the first start, likewise.
        cost: of the gains, the mean (or worst) over all cases [1].
        start_cost: of the first start [1]; infinite where it diverged.
        mean: mean cost over the cases [1].
        worst: worst cost over the cases [1].
        cases: cost of every case [1], nested lists of shape (references, plants, seeds).
        simulations: simulations of one case used by all starts; a forward-mode gradient of n gains counts 1 + n.
        simulated_steps: simulations x samples.
        iterations: of the best start.
        history: (simulations of all starts so far, best cost so far) after each iteration.
        starts: number of starts.
        diverged_starts: how many of them diverged and were dropped.
        message: why the search ended.
        run_seconds: seconds of the search without compiling.
        compile_seconds: seconds of compiling.
        identifiability: which gains the residuals determine; None where every start diverged.
        versions: of the packages that computed it.
        standing: last point of Algorithm 1, by parameter name, which its printed rule returns (`gains` are the best it
            saw); None for the other methods.
        standing_cost: the cost there [1].
        notes: sentences that one should read before the gains are used.
        path: of the best start, the value of every parameter after each iteration, by parameter name.
        settled: by estimate whose true value is known, its relative error at the end [1], (mean of the last quarter -
            truth) / |truth|, of the case where that is largest; under draws of the sensor's noise if the sensor has
            some, even where the gains were tuned without.
        noisy_cost: the cost under the worst of these draws [1]; None where there are none.
    """

    method: str
    objective: str
    references: tuple[str, ...]
    gains: dict[str, float]
    start: dict[str, float]
    cost: float
    start_cost: float
    mean: float
    worst: float
    cases: Any
    simulations: int
    simulated_steps: int
    iterations: int
    history: list[tuple[int, float]]
    starts: int
    diverged_starts: int
    message: str
    run_seconds: float
    compile_seconds: float
    identifiability: Identifiability | None
    versions: dict[str, str]
    standing: dict[str, float] | None = None
    standing_cost: float | None = None
    notes: tuple[str, ...] = ()
    path: dict[str, list[float]] = dataclasses.field(default_factory=dict)
    settled: dict[str, float] = dataclasses.field(default_factory=dict)
    noisy_cost: float | None = None

    @property
    def diverged(self) -> bool:
        """Whether every start diverged."""
        return not math.isfinite(self.cost)

    @property
    def at_bounds(self) -> dict[str, str]:
        """Gains that ended at a bound: "low" or "high" by name."""
        verdicts = self.identifiability.verdicts if self.identifiability else {}
        return {
            name: side
            for name, verdict in verdicts.items()
            for side in ("low", "high")
            if f"at its {side} bound" in verdict
        }

    def apply(self, loop: ClosedLoop) -> ClosedLoop:
        """A copy of the loop with the tuned gains."""
        return set_parameters(loop, self.gains)

    def _figure(self) -> "Figure":
        figure, axes = new_figure(size=(6.6, 3.4), title=f"{self.method} on {', '.join(self.references)}")
        with style():
            used, cost = (np.array(column) for column in zip(*self.history, strict=True)) if self.history else ([], [])
            shown = np.isfinite(cost)
            axes[0, 0].step(np.asarray(used)[shown], np.minimum.accumulate(np.asarray(cost)[shown]), where="post")
            axes[0, 0].set(xlabel="simulations (tangents counted)", ylabel="best cost so far", yscale="log")
        return figure

    def to_dataframe(self) -> Any:
        """The history as a `pandas.DataFrame`: best cost so far by the simulations used.

        Raises:
            InputError: where pandas is not installed.
        """
        return to_frame({"cost": [cost for _, cost in self.history]}, [used for used, _ in self.history], "simulations")

    def to_dict(self) -> JsonObject:
        """As JSON takes it, with `at_bounds` and `warning`; numbers that are not finite are None."""
        said = {"references": list(self.references), "at_bounds": self.at_bounds, "warning": self.warning}
        return plain({**dataclasses.asdict(self), **said})

    @property
    def warning(self) -> str:
        """A sentence where the gains are not an optimum, because they are at a bound or have no effect; else empty."""
        ends = [f"{name} at its {side} bound {self.gains[name]:.3g}" for name, side in self.at_bounds.items()]
        if ends:
            return (
                f"NOT AN OPTIMUM: {', '.join(ends)}. The cost still falls beyond it, or does not depend on it: do not "
                f"use these gains; give a wider range (Parameter(name, start, low, high), --parameter "
                f"NAME=LOW:START:HIGH), fewer parameters, or an objective with noise."
            )
        verdicts = self.identifiability.verdicts if self.identifiability else {}
        if verdicts and all(verdict == "dead" for verdict in verdicts.values()):
            return (
                f"NOT AN OPTIMUM: the cost does not depend on {' or '.join(self.gains)} where the search ended: do not "
                f"use these gains."
            )
        return ""

    def __str__(self) -> str:
        gains = "\n".join(
            f"  {name:<28} {self.start[name]:>12.6g} -> {value:<12.6g}" for name, value in self.gains.items()
        )
        dropped = f", {self.diverged_starts} of {self.starts} starts diverged" if self.diverged_starts else ""
        lines = [
            *([self.warning] if self.warning else []),
            f"{self.method} on {', '.join(self.references)} ({self.objective}): {self.message}{dropped}",
            gains,
            f"  cost {self.start_cost:.6g} -> {self.cost:.6g}  (mean {self.mean:.6g}, worst case {self.worst:.6g})",
            f"  {self.simulations} simulations, {self.simulated_steps:.3g} steps, {self.run_seconds:.2f} s"
            f" + {self.compile_seconds:.2f} s compiling",
        ]
        if self.standing is not None and self.standing != self.gains:
            where = ", ".join(f"{value:.6g}" for value in self.standing.values())
            lines.append(f"  its own rule ends at ({where}), cost {self.standing_cost:.6g}: not the best it saw")
        block = [str(self.identifiability)] if self.identifiability else []
        return "\n".join([*lines, *block, *(f"note: {note}" for note in self.notes)])

    __repr__ = __str__


def versions() -> dict[str, str]:
    """Versions of what a number depends on: fpjax, jax, numpy, python, and the backend."""
    found = all_versions()
    return {name: found[name] for name in ("fpjax", "jax", "numpy", "python", "backend")}
