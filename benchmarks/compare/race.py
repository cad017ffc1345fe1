"""Every method on every case, one row each, at the same objective, start and budget."""

import dataclasses
import time
from collections.abc import Callable

import tuning
from fpjax import AbstractReference
from fpjax.output.json_object import JsonObject
from tuning.methods import Method

from .cases import JOINT, Case

SWEEP, PRINTED = "dense_sweep", "algorithm_1"
GRADIENTS = ("levenberg_marquardt", "lbfgs", "adam")
DEFAULT = "levenberg_marquardt"  # of tuning.tune: its verdict is the headline


@dataclasses.dataclass(frozen=True)
class Settings:
    """The settings of a whole comparison.

    Attributes:
        dt: step [s].
        duration: of a run [s].
        budget: simulations of a reference that each method may use, tangents counted (five times that for all jointly).
        points: of the dense sweep, along each axis.
        objectives: names.
    """

    dt: float = 1e-4
    duration: float = 0.5
    budget: int = 160
    points: int = 48
    objectives: tuple[str, ...] = ("estimation", "thesis")


def methods(case: Case, budget: int) -> dict[str, Method]:
    """The methods, each with as many iterations as the budget allows; the budget, not the iterations, ends a search."""
    return {
        PRINTED: tuning.GridSearch(steps=case.steps, threshold=0.0, iterations=budget),
        "algorithm_1_repaired": tuning.RepairedGridSearch(steps=case.steps, threshold=0.0, iterations=budget),
        "levenberg_marquardt": tuning.LevenbergMarquardt(iterations=budget),
        "lbfgs": tuning.LBFGS(iterations=budget),
        # 3 simulations an iteration: Adam's step length decays over its iterations, which must fit the budget.
        "adam": tuning.Adam(iterations=max(1, budget // 3)),
        "nelder_mead": tuning.NelderMead(iterations=budget),
    }


def race(
    case: Case,
    objective: str,
    references: dict[str, AbstractReference],
    settings: Settings,
    share: Callable[[str], None],
) -> list[JsonObject]:
    """All rows of one case and objective; a row is what `compare.json` holds."""
    groups: dict[str, dict[str, AbstractReference]] = {name: {name: one} for name, one in references.items()}
    groups[JOINT] = references
    common: JsonObject = {
        "objective": case.objective(objective),
        "dt": settings.dt,
        "duration": settings.duration,
        "solver": "ode3",
    }
    rows = _sweep_rows(case, objective, references, settings, common)
    share(SWEEP)
    for label, group in groups.items():
        budget = settings.budget * len(group)
        for name, method in methods(case, settings.budget).items():
            parameters = case.printed_parameters if name == PRINTED else case.parameters
            result = tuning.tune(
                case.loop, group, parameters=parameters, method=method, max_simulations=budget, **common
            )
            history = _monotone(result.history)
            rows.append(
                {
                    "observer": case.name,
                    "objective": objective,
                    "reference": label,
                    "method": name,
                    "gains": _thesis_units(case, result.gains),
                    "cost": result.cost,
                    "standing": None if result.standing is None else _thesis_units(case, result.standing),
                    "standing_cost": result.standing_cost,
                    "start_cost": result.start_cost,
                    "simulations": result.simulations,
                    "simulated_steps": result.simulated_steps,
                    "simulations_to_best": _first_at(history, result.cost),
                    "run_seconds": result.run_seconds,
                    "compile_seconds": result.compile_seconds,
                    "message": result.message,
                    "identifiability": None if result.identifiability is None else result.identifiability.verdicts,
                    "history": history,
                    "versions": result.versions,
                }
            )
            share(name)
    return rows


def _sweep_rows(
    case: Case, objective: str, references: dict[str, AbstractReference], settings: Settings, common: JsonObject
) -> list[JsonObject]:
    axes = case.axes(settings.points)
    begin = time.perf_counter()
    # A sweep of one point first: its compiled program serves the whole sweep, which is then timed without compiling.
    tuning.sweep(
        case.loop, references, axes=[dataclasses.replace(axis, count=1, high=axis.low) for axis in axes], **common
    )
    swept = tuning.sweep(case.loop, references, axes=axes, **common)
    compile_seconds = time.perf_counter() - begin - swept.run_seconds
    rows = []
    for label in (*references, JOINT):
        gains, cost = swept.best(None if label == JOINT else label)
        number = settings.points**2 * (len(references) if label == JOINT else 1)
        rows.append(
            {
                "observer": case.name,
                "objective": objective,
                "reference": label,
                "method": SWEEP,
                "gains": _thesis_units(case, gains),
                "cost": cost,
                "standing": None,
                "standing_cost": None,
                "start_cost": None,
                "simulations": number,
                "simulated_steps": number * (swept.simulated_steps // swept.simulations),
                "simulations_to_best": number,
                "run_seconds": swept.run_seconds * (1.0 if label == JOINT else 1.0 / len(references)),
                "compile_seconds": compile_seconds,
                "message": f"{settings.points} x {settings.points} points; one sweep for all references",
                "identifiability": None,
                "history": [(number, cost)],
                "versions": swept.versions,
            }
        )
    return rows


def _thesis_units(case: Case, gains: dict[str, float]) -> dict[str, float]:
    """Gains in the thesis' units."""
    return {
        "gain_2": gains["observer.gain_2"] / case.units[0],
        "gain_1": gains["observer.gain_1"] / case.units[1],
    }


def _monotone(history: list[tuple[int, float]]) -> list[tuple[int, float]]:
    return [(int(used), float(cost)) for used, cost in history]


def _first_at(history: list[tuple[int, float]], cost: float) -> int:
    """Simulations used when a cost was first reached."""
    return next(used for used, reached in history if reached <= cost)
