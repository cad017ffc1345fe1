"""Pictures of the commands, in the common style."""

import functools
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, ParamSpec, TypeVar

import numpy as np
from matplotlib import rc_context

from ..model_file import Model
from ..output.plotting import BLUE, GREY, RED, SERIES, STYLE, new_figure, save
from ..output.run_picture import beside, line

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from tuning import TuningResult

    from .. import Run
    from .replay import Replay

P = ParamSpec("P")
R = TypeVar("R")


def _styled(draw: Callable[P, R]) -> Callable[P, R]:
    """`draw` with the common style active, because titles and legends are styled when they are made."""

    @functools.wraps(draw)
    def inside(*arguments: P.args, **options: P.kwargs) -> R:
        with rc_context(STYLE):
            return draw(*arguments, **options)

    return inside


@_styled
def draw_run(model: Model, signals: dict[str, np.ndarray], path: Path) -> Path:
    """Draw reference and motion, the error, the torques, and the estimates with their true values."""
    from ..model_file.picture_labels import about_model
    from ..output.run_picture import run_figure

    return save(run_figure(signals["time"], signals, about_model(model)), path)


@_styled
def draw_replay(model: Model, found: "Replay", path: Path) -> Path:
    """Draw log and simulation, and their difference, for every quantity that was compared."""
    names = list(found.errors)
    figure, axes = new_figure(
        2 * len(names), 1, share_x=True, size=(7.4, 3.2 * len(names)), height_ratios=[2, 1] * len(names)
    )
    panels = axes[:, 0]
    for place, name in enumerate(names):
        recorded = getattr(found.log, name)
        simulated = found.signals[name if name == "torque" else f"measured_{name}"]
        error, unit, relative = found.errors[name]
        word = "force" if name == "torque" and model.linear else name
        upper, lower = panels[2 * place], panels[2 * place + 1]
        line(upper, found.log.time, recorded, GREY, "recorded")
        line(upper, found.log.time, simulated, BLUE, "simulated", linewidth=0.9)
        upper.set_ylabel(f"{word} [{unit}]")
        beside(upper)
        line(lower, found.log.time, recorded - simulated, RED)
        lower.set_ylabel(f"difference [{unit}]")
        lower.set_title(f"{word}: rms {error:.3g} {unit}, {100 * relative:.2g} % of the log's rms")
    panels[-1].set_xlabel("time [s]")
    return save(figure, path)


@_styled
def draw_tuning(after: Model, runs: "dict[str, Run]", results: "list[TuningResult]", path: Path) -> Path:
    """Draw the cost over the number of simulations for every method, and the run before and after."""
    estimates = [f"estimates.{name}" for name in after.loop.observer.estimated]
    rows = 2 + len(estimates)
    figure, axes = new_figure(rows, 1, size=(8.0, 2.3 * rows))
    panels = axes[:, 0]
    for color, result in zip(SERIES, results, strict=False):
        history = [(used, cost) for used, cost in result.history if np.isfinite(cost) and cost > 0.0]
        if history:
            used, cost = zip(*history, strict=True)
            panels[0].step(
                used, np.minimum.accumulate(cost), where="post", color=color, label=result.method, marker="."
            )
    panels[0].set(xlabel="simulations (tangents counted)", ylabel="best cost so far", yscale="log")
    beside(panels[0])
    position = after.units.reference == "position"
    motion = "position" if position else "velocity"
    for (name, run), color in zip(runs.items(), (RED, BLUE), strict=True):
        time, signals = np.asarray(run.time), {key: np.asarray(value) for key, value in run.signals.items()}
        line(panels[1], time, signals["reference"] - signals[motion], color, name)
        for panel, key in zip(panels[2:], estimates, strict=True):
            line(panel, time, signals[key], color, name)
            _look_at_the_truth(panel, after.nominal.get(key.removeprefix("estimates.")))
    panels[1].set_ylabel(f"tracking error [{after.units.name('rad' if position else 'rad/s')}]")
    kinds = {"coulomb": "N m", "viscous": "N m s/rad", "steepness": "s/rad"}
    for panel, key in zip(panels[2:], estimates, strict=True):
        word = key.removeprefix("estimates.")
        if after.nominal.get(word):
            panel.axhline(after.nominal[word], color=GREY, linestyle="--", label="true")
        panel.set_ylabel(f"{word} [{after.units.name(kinds.get(word, '1'))}]")
    for panel in panels[1:]:
        _name_what_leaves(panel)
        beside(panel)
    panels[-1].set_xlabel("time [s]")
    return save(figure, path)


def _look_at_the_truth(panel: "Axes", truth: float | None) -> None:
    """Limit a panel to values around the true one: with large gains the transient is a hundred times as large."""
    low, high = panel.get_ylim()
    if truth and (high > 4.0 * abs(truth) or low < -3.0 * abs(truth)):
        panel.set_ylim(max(low, truth - 2.0 * abs(truth)), min(high, truth + 2.0 * abs(truth)))


def _name_what_leaves(panel: "Axes") -> None:
    """Write into the legend how far a curve goes beyond its panel."""
    low, high = panel.get_ylim()
    for curve in panel.lines:
        values, label = np.asarray(curve.get_ydata(), float), str(curve.get_label())
        outside = values[(values < low) | (values > high)]  # NaN of a diverged run is on neither side
        if outside.size and not label.startswith("_"):
            furthest = float(outside[np.argmax(np.abs(outside))])
            curve.set_label(f"{label} (to {furthest:.3g})")
