"""Pictures of the commands, in the package's one style."""

import functools
from collections.abc import Callable
from pathlib import Path
from typing import Any, ParamSpec, TypeVar

import numpy as np
from matplotlib import rc_context

from ..model_file import Model
from ..output.plotting import BLUE, GREY, RED, SERIES, STYLE, new_figure, save, thin

P = ParamSpec("P")
R = TypeVar("R")


def _styled(draw: Callable[P, R]) -> Callable[P, R]:
    """Titles and legends are styled when they are made, not when the figure is."""

    @functools.wraps(draw)
    def inside(*arguments: P.args, **options: P.kwargs) -> R:
        with rc_context(STYLE):
            return draw(*arguments, **options)

    return inside


@_styled
def draw_run(model: Model, signals: dict[str, np.ndarray], path: Path) -> Path:
    """Reference and motion, the error, the torques, and the estimates with their truth."""
    position = model.units.reference == "position"
    units = model.units
    motion, unit = ("position", units.name("rad")) if position else ("velocity", units.name("rad/s"))
    estimates = [name for name in signals if name.startswith("estimates.")]
    figure, axes = new_figure(3 + len(estimates), 1, share_x=True, size=(7.0, 2.0 * (3 + len(estimates))))
    time = signals["time"]
    panels = axes[:, 0]
    _line(panels[0], time, signals["reference"], GREY, "reference", linestyle="--")
    _line(panels[0], time, signals[motion], BLUE, motion)
    panels[0].set_ylabel(f"{motion} [{unit}]")
    _legend_above(panels[0])
    _line(panels[1], time, signals["reference"] - signals[motion], RED, "")
    panels[1].set_ylabel(f"error [{unit}]")
    _line(panels[2], time, signals["torque"], BLUE, "commanded")
    _line(panels[2], time, signals["friction"], RED, "friction")
    if estimates:
        _line(panels[2], time, signals["compensation"], GREY, "compensation", linestyle="--")
    panels[2].set_ylabel(f"{'force' if model.linear else 'torque'} [{units.name('N m')}]")
    _legend_above(panels[2])
    kinds = {"coulomb": "N m", "viscous": "N m s/rad", "steepness": "s/rad"}
    for panel, name in zip(panels[3:], estimates, strict=True):
        word = name.removeprefix("estimates.")
        _line(panel, time, signals[name], BLUE, "estimate")
        true = model.nominal.get(word)
        if true:
            panel.axhline(true, color=GREY, linestyle="--", label=f"true {true:g}")
        panel.set_ylabel(f"{word} [{units.name(kinds.get(word, '1'))}]")
        panel.legend(loc="lower right")
    panels[-1].set_xlabel("time [s]")
    return save(figure, path)


@_styled
def draw_replay(model: Model, found: Any, path: Path) -> Path:
    """Record and simulation, and the difference, for every quantity that was compared."""
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
        _line(upper, found.log.time, recorded, GREY, "recorded")
        _line(upper, found.log.time, simulated, BLUE, "simulated", linewidth=0.9)
        upper.set_ylabel(f"{word} [{unit}]")
        upper.legend(loc="upper right", ncols=2)
        _line(lower, found.log.time, recorded - simulated, RED, "")
        lower.set_ylabel(f"difference [{unit}]")
        lower.set_title(f"{word}: rms {error:.3g} {unit}, {100 * relative:.2g} % of the record")
    panels[-1].set_xlabel("time [s]")
    return save(figure, path)


def _legend_above(panel: Any) -> None:
    """In a row, with room for it above the peaks."""
    low, high = panel.get_ylim()
    panel.set_ylim(low, high + 0.25 * (high - low))
    panel.legend(loc="upper right", ncols=3)


def _line(axes: Any, time: np.ndarray, values: np.ndarray, color: str, label: str, **style: Any) -> None:
    axes.plot(*thin(time, values), color=color, label=label or None, **style)


@_styled
def draw_tuning(before: Model, after: Model, results: list[Any], path: Path) -> Path:
    """Cost against simulations for every method, and the run before and after."""
    from .._simulate import simulate

    estimates = [f"estimates.{name}" for name in after.loop.observer.estimated]
    rows = 2 + len(estimates)
    figure, axes = new_figure(rows, 1, size=(7.0, 2.3 * rows))
    panels = axes[:, 0]
    for color, result in zip(SERIES, results, strict=False):
        history = [(used, cost) for used, cost in result.history if np.isfinite(cost) and cost > 0.0]
        if history:
            used, cost = zip(*history, strict=True)
            panels[0].step(
                used, np.minimum.accumulate(cost), where="post", color=color, label=result.method, marker="."
            )
    panels[0].set(xlabel="simulations (tangents counted)", ylabel="best cost so far", yscale="log")
    _legend_above(panels[0])
    if after.reference is None:
        return save(figure, path)
    position = after.units.reference == "position"
    motion = "position" if position else "velocity"
    runs = {}
    for name, model in (("before", before), ("after", after)):
        run = simulate(
            model.loop, after.reference, dt=model.dt, duration=model.needed_duration(), solver=model.solver,
            stepping=model.stepping, substeps=model.substeps, record=("reference", motion, *estimates),
        )  # fmt: skip
        runs[name] = (np.asarray(run.time), {key: np.asarray(value) for key, value in run.signals.items()})
    for (name, (time, signals)), color in zip(runs.items(), (RED, BLUE), strict=True):
        _line(panels[1], time, signals["reference"] - signals[motion], color, name)
        for panel, key in zip(panels[2:], estimates, strict=True):
            _line(panel, time, signals[key], color, name)
    panels[1].set_ylabel(f"tracking error [{after.units.name('rad' if position else 'rad/s')}]")
    kinds = {"coulomb": "N m", "viscous": "N m s/rad", "steepness": "s/rad"}
    for panel, key in zip(panels[2:], estimates, strict=True):
        word = key.removeprefix("estimates.")
        if after.nominal.get(word):
            panel.axhline(after.nominal[word], color=GREY, linestyle="--", label="true")
        panel.set_ylabel(f"{word} [{after.units.name(kinds.get(word, '1'))}]")
    for panel in panels[1:]:
        panel.legend(loc="best", ncols=3)
    panels[-1].set_xlabel("time [s]")
    return save(figure, path)
