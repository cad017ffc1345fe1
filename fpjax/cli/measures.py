"""The measures that `fpjax simulate` takes of a run, and their table."""

from typing import TYPE_CHECKING

import numpy as np

from ..errors import InputError
from ..model_file import Model
from ..output.json_object import JsonObject

if TYPE_CHECKING:
    from .. import Run

LOOKED_AT = 4000  # samples of a run from which the excitation is assessed
WITHIN = 0.05  # error, relative to the true value, within which an estimate counts as settled
RESERVE = 5.0  # standard deviations within which a noisy estimate counts as settled: beyond in none of 1e6 samples
SMOOTHED = 0.05  # most of the run over which an estimate is averaged to judge its settling, because it is noisy [1]


def excitation_sentences(model: Model, velocity: np.ndarray, settled: dict[str, float]) -> tuple[str, ...]:
    """Sentences on estimates that cannot converge along a run; empty where all do, or where it cannot be assessed.

    Args:
        model: gives the observer and the true values of its parameters.
        velocity: of the run [rad/s], shape (samples,).
        settled: final value of each estimate in the run, by name.
    """
    from .. import assess_excitation

    observer = model.loop.observer
    if not observer.estimated:
        return ()
    every = -(-len(velocity) // LOOKED_AT)
    duration = len(velocity) * model.dt
    try:
        found = assess_excitation(observer, velocity[::every], model.dt * every, model.nominal, duration=duration)
    except (InputError, AttributeError, KeyError):
        return ()  # an observer whose error dynamics are not known
    return found.sentences_of(
        {name: value / true - 1.0 for name, value in settled.items() if (true := model.nominal.get(name))}
    )


def recorded_names(model: Model) -> tuple[str, ...]:
    """Names of the signals that are kept of a single run."""
    names = (
        "torque", "measured_velocity", "measured_position", "reference", "velocity", "position", "control",
        "compensation", "applied", "friction",
    )  # fmt: skip
    return (*names, *(f"estimates.{name}" for name in model.loop.observer.estimated))


def measures_of(model: Model) -> JsonObject:
    """Measures by the words under which they are shown."""
    import fpjax as fp

    error = fp.position_error if model.units.reference == "position" else fp.velocity_error
    found: JsonObject = {
        "tracking error, mean absolute": fp.MeanAbsolute(error),
        "tracking error, rms": fp.RootMeanSquare(error),
        "tracking error, largest": fp.Largest(error),
        "tracking error, rms of gradient": fp.GradientRootMeanSquare(error),
        "control effort, rms": fp.control_effort(),
    }
    for name in model.loop.observer.estimated:
        found[f"{name}, final estimate"] = fp.EstimateFinal(name)
        found[f"{name}, largest on the way"] = fp.EstimatePeak(name)
    if "coulomb" in model.loop.observer.estimated:
        found["Coulomb torque error, mean"] = fp.CoulombTorqueError(model.nominal["coulomb"])
    return found


def settling_time(time: np.ndarray, estimate: np.ndarray, truth: float) -> float:
    """Time [s] after which an estimate stays within 5 % of the truth; infinite where it ends outside.

    A noisy estimate is averaged first, until `RESERVE` times its scatter about a line through its last quarter is a
    fifth of these 5 %, over a twentieth of the run at most; so much beyond them, 5 % at most, counts as inside. The
    time is known to half of what is averaged over.

    Args:
        time: [s], shape (samples,).
        estimate: in the truth's unit, shape (samples,).
        truth: not zero.
    """
    total, within = np.concatenate([[0.0], np.cumsum(np.asarray(estimate, float))]), WITHIN * abs(truth)
    longest = max(round(SMOOTHED * len(estimate)), 1)
    count = 1
    while True:
        mean = (total[count:] - total[:-count]) / count
        reserve = RESERVE * _scatter(mean[-(-3 * len(mean) // 4) :])
        if reserve <= 0.2 * within or count == longest:
            break
        count = min(2 * count, longest)
    outside = np.flatnonzero(~(np.abs(mean - truth) <= within + min(reserve, within)))
    last = int(outside[-1]) if outside.size else -1
    return float("inf") if last == len(mean) - 1 else float(time[last + 1 + count // 2])


def _scatter(values: np.ndarray) -> float:
    """Standard deviation about a straight line."""
    place = np.arange(len(values)) - 0.5 * (len(values) - 1)
    slope = float(place @ values) / max(float(place @ place), 1e-300)
    return float(np.std(values - slope * place))


def summary(model: Model, run: "Run") -> list[tuple[str, float, str]]:
    """(quantity, value, unit) rows."""
    units = model.units
    motion = units.name("rad" if units.reference == "position" else "rad/s")
    rows: list[tuple[str, float, str]] = []
    for quantity in measures_of(model):  # this order, because jit returns the measures in alphabetical order
        number = float(np.asarray(run.measures[quantity]))
        name, _, which = quantity.partition(", ")
        unit = motion
        if quantity.startswith(("control effort", "Coulomb torque")):
            unit = units.name("N m")
        elif name in run.settled:
            unit = units.name(ESTIMATES.get(name, ""))
        elif quantity.endswith("gradient"):
            unit = f"{motion} per sample"
        if which == "final estimate" and name in run.settled:
            rows += _settled_rows(model, run, name, unit)
        rows.append((quantity, number, unit))
    return rows


ESTIMATES = {"coulomb": "N m", "viscous": "N m s/rad", "steepness": "s/rad"}


def _settled_rows(model: Model, run: "Run", name: str, unit: str) -> list[tuple[str, float, str]]:
    """Rows on an estimate's final value: its mean over the last quarter, as in `tune`; the last sample is noisy."""
    true = model.nominal.get(name)
    rows = [
        (f"{name}, mean of the last quarter", run.settled[name], f"{unit}  (true {true:g})" if true else unit),
        (f"{name}, scatter about it", run.scatter[name], unit),
    ]
    if true:
        after = settling_time(np.asarray(run.time), np.asarray(run.signals[f"estimates.{name}"]), true)
        rows.append((f"{name}, settled to 5 %", after, "s" if np.isfinite(after) else "s (never)"))
    return rows
