"""What `fpjax simulate` measures on a run, and how it is said."""

from typing import TYPE_CHECKING, Any

import numpy as np

from ..errors import InputError
from ..model_file import Model

if TYPE_CHECKING:
    from .._simulate import Run

LOOKED_AT = 4000  # samples of a run that the excitation is judged by


def excitation_sentences(model: Model, velocity: np.ndarray, settled: dict[str, float]) -> tuple[str, ...]:
    """Which estimates cannot converge along a run; empty where all do, and for an observer whose law is not known.

    Args:
        model: its observer, and the true values of what that estimates.
        velocity: of the run [rad/s], shape (samples,).
        settled: what each estimate came to in it, in its unit.
    """
    from ..analysis.excitation import assess_excitation

    observer = model.loop.observer
    if not observer.estimated:
        return ()
    every = -(-len(velocity) // LOOKED_AT)
    duration = len(velocity) * model.dt
    try:
        found = assess_excitation(observer, velocity[::every], model.dt * every, model.nominal, duration=duration)
    except (InputError, AttributeError, KeyError):
        return ()  # an observer whose error dynamics are not known
    return found.told(
        {name: value / true - 1.0 for name, value in settled.items() if (true := model.nominal.get(name))}
    )


def recorded_names(model: Model) -> tuple[str, ...]:
    """Signals worth keeping of a single run."""
    names = (
        "torque", "measured_velocity", "measured_position", "reference", "velocity", "position", "control",
        "compensation", "applied", "friction",
    )  # fmt: skip
    return (*names, *(f"estimates.{name}" for name in model.loop.observer.estimated))


def measures_of(model: Model) -> dict[str, Any]:
    """Measures by the sentence they are shown with."""
    from .. import metrics

    error = metrics.position_error if model.units.reference == "position" else metrics.velocity_error
    found: dict[str, Any] = {
        "tracking error, mean absolute": metrics.MeanAbsolute(error),
        "tracking error, rms": metrics.RootMeanSquare(error),
        "tracking error, largest": metrics.Largest(error),
        "tracking error, rms of gradient": metrics.GradientRootMeanSquare(error),
        "control effort, rms": metrics.control_effort(),
    }
    nominal = model.nominal
    for name in model.loop.observer.estimated:
        found[f"{name}, final estimate"] = metrics.EstimateFinal(name)
        found[f"{name}, largest on the way"] = metrics.EstimatePeak(name)
        if nominal.get(name):
            found[f"{name}, settled to 5 %"] = metrics.SettlingTime(name, nominal[name])
    if "coulomb" in model.loop.observer.estimated:
        found["Coulomb torque error, mean"] = metrics.CoulombTorqueError(nominal["coulomb"])
    return found


def summary(model: Model, run: "Run") -> list[tuple[str, float, str]]:
    """(quantity, value, unit) rows."""
    units, nominal = model.units, model.nominal
    motion = units.name("rad" if units.reference == "position" else "rad/s")
    estimate = {"coulomb": "N m", "viscous": "N m s/rad", "steepness": "s/rad"}
    rows: list[tuple[str, float, str]] = []
    for quantity in measures_of(model):  # jit hands them back in the alphabet's order
        number = float(np.asarray(run.measures[quantity]))
        name = quantity.partition(",")[0]
        unit = motion
        if quantity.startswith(("control effort", "Coulomb torque")):
            unit = units.name("N m")
        elif quantity.endswith("settled to 5 %"):
            unit = "s" if np.isfinite(number) else "s (never)"
        elif name in estimate:
            unit = units.name(estimate[name])
            if quantity.endswith("final estimate") and nominal.get(name):
                unit += f"  (true {nominal[name]:g})"
        elif quantity.endswith("gradient"):
            unit = f"{motion} a sample"
        rows.append((quantity, number, unit))
    return rows
