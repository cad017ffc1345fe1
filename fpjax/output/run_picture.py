"""The picture of a run: reference and motion, error, torques, estimates and true values."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from .plotting import BLUE, GREY, RED, new_figure, style, thin

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

KINDS = {"coulomb": "N m", "viscous": "N m s/rad", "steepness": "s/rad"}
# A panel shows at least this share of the settled estimate to either side; the transient at the start may be cut off.
WITHIN = 1.0


class About(NamedTuple):
    """Facts for the picture of a run that the run itself does not hold. Hashable, so that it can be a static field.

    Attributes:
        truths: (name, value) of the plant's friction parameters.
        units: pairs of a rotary SI unit and the machine's unit; empty for SI.
        position: whether the reference is a position.
        linear: whether the axis is linear.
        title: of the picture.
    """

    truths: tuple[tuple[str, float], ...] = ()
    units: tuple[tuple[str, str], ...] = ()
    position: bool = False
    linear: bool = False
    title: str = ""

    def unit(self, unit: str) -> str:
        """A rotary SI unit in the machine's units."""
        return dict(self.units).get(unit, unit)


def run_figure(time: np.ndarray, signals: Mapping[str, np.ndarray], about: About) -> Figure:
    """A figure with a panel for reference and motion, for the error, for the torques, and for every recorded estimate.

    Args:
        time: [s], shape (samples,).
        signals: by name, each of shape (samples,); panels of missing signals are left out.
        about: true values and units.
    """
    motion, unit = ("position", about.unit("rad")) if about.position else ("velocity", about.unit("rad/s"))
    torque = about.unit("N m")
    panels: list[Callable[[Any], None]] = []
    if motion in signals or "reference" in signals:
        panels.append(lambda axes: _motion(axes, time, signals, motion, unit))
    if motion in signals and "reference" in signals:
        panels.append(lambda axes: _error(axes, time, signals, motion, unit))
    if {"torque", "friction", "compensation", "control"} & set(signals):
        torques = f"{'force' if about.linear else 'torque'} [{torque}]"
        panels.append(lambda axes: _torques(axes, time, signals, torques))
    truths = dict(about.truths)
    for name in (each for each in signals if each.startswith("estimates.")):
        word = name.removeprefix("estimates.")
        label = f"{word} [{about.unit(KINDS.get(word, '1'))}]"
        panels.append(
            lambda axes, name=name, word=word, label=label: _estimate(
                axes, time, signals[name], truths.get(word), label
            )
        )
    known = {motion, "reference", "torque", "friction", "compensation", "control", "time"}
    if not panels:
        for name in (each for each in signals if each not in known):
            panels.append(lambda axes, name=name: _plain(axes, time, signals[name], name))
    figure, axes = new_figure(
        max(len(panels), 1), 1, share_x=True, size=(7.4, 1.9 * max(len(panels), 1) + 0.5), title=about.title
    )
    with style():
        for draw, panel in zip(panels, axes[:, 0], strict=False):
            draw(panel)
        axes[-1, 0].set_xlabel("time [s]")
    return figure


def columns_figure(
    time: np.ndarray, columns: Mapping[str, np.ndarray], units: Mapping[str, str], title: str = ""
) -> Figure:
    """A panel for each column.

    Args:
        time: [s], shape (samples,).
        columns: by name, each of shape (samples,).
        units: by name.
        title: of the picture.
    """
    figure, axes = new_figure(len(columns), 1, share_x=True, size=(7.4, 1.9 * len(columns) + 0.5), title=title)
    with style():
        for (name, values), panel in zip(columns.items(), axes[:, 0], strict=True):
            line(panel, time, values, GREY if name == "reference" else BLUE)
            panel.set_ylabel(f"{name} [{units[name]}]" if name in units else name)
        axes[-1, 0].set_xlabel("time [s]")
    return figure


def beside(panel: Axes) -> None:
    """Draw the legend outside the axes, to the right, so that it never covers data."""
    panel.legend(loc="upper left", bbox_to_anchor=(1.01, 1.02), borderaxespad=0.0, frameon=False)


def line(axes: Axes, time: np.ndarray, values: np.ndarray, color: str, label: str = "", **more: Any) -> None:
    """Draw a signal; one with more periods than a picture resolves is drawn as a band between its envelopes."""
    values = np.asarray(values)
    if turns(values) < 400:  # about one crossing for each pixel and a half of a panel's width
        axes.plot(*thin(time, values), color=color, label=label or None, **more)
        return
    middle, low, high = envelope(np.asarray(time), values)
    axes.fill_between(middle, low, high, color=color, alpha=0.35, lw=0.0, label=label or None)
    for edge in (low, high):
        axes.plot(middle, edge, color=color, lw=0.6)


def turns(values: np.ndarray) -> int:
    """How often a signal crosses its mid-range, with a hysteresis of 10 % of its range to either side."""
    low, high = np.nanmin(values), np.nanmax(values)
    band = 0.1 * (high - low)
    centre = 0.5 * (low + high)
    side = np.where(values > centre + band, 1, np.where(values < centre - band, -1, 0))
    side = side[side != 0]
    return int(np.count_nonzero(np.diff(side)))


def envelope(time: np.ndarray, values: np.ndarray, bins: int = 350) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """(time of each bin's middle [s], lowest, highest), each of shape (bins,)."""
    # `reduceat` takes the first sample of each bin, so the last edge is left out
    edges = np.linspace(0, len(values), bins + 1).astype(int)[:-1]
    low, high = np.minimum.reduceat(values, edges), np.maximum.reduceat(values, edges)
    return np.add.reduceat(time, edges) / np.diff([*edges, len(values)]), low, high


def _motion(axes: Axes, time: np.ndarray, signals: Mapping[str, np.ndarray], motion: str, unit: str) -> None:
    if "reference" in signals:
        line(axes, time, signals["reference"], GREY, "reference", linestyle="--")
    if motion in signals:
        line(axes, time, signals[motion], BLUE, motion)
    axes.set_ylabel(f"{motion} [{unit}]")
    beside(axes)


def _error(axes: Axes, time: np.ndarray, signals: Mapping[str, np.ndarray], motion: str, unit: str) -> None:
    line(axes, time, signals["reference"] - signals[motion], RED)
    axes.set_ylabel(f"error [{unit}]")


def _torques(axes: Axes, time: np.ndarray, signals: Mapping[str, np.ndarray], label: str) -> None:
    if "torque" in signals:
        line(axes, time, signals["torque"], BLUE, "commanded")
    if "friction" in signals:
        line(axes, time, signals["friction"], RED, "friction")
    if "compensation" in signals and np.any(signals["compensation"]):
        line(axes, time, signals["compensation"], GREY, "compensation", linestyle="--")
    axes.set_ylabel(label)
    beside(axes)


def _estimate(axes: Axes, time: np.ndarray, values: np.ndarray, truth: float | None, label: str) -> None:
    line(axes, time, values, BLUE, "estimate")
    if truth:
        axes.axhline(truth, color=GREY, linestyle="--", label=f"true {truth:g}")
    # the panel is scaled by the last quarter: an observer's start can be a hundred times the settled estimate, and
    # nothing of interest would be seen
    settled = values[-max(len(values) // 4, 1) :]
    about = truth or float(np.mean(settled))
    low, high = np.nanmin(values), np.nanmax(values)
    room = max(WITHIN * abs(about), 1.2 * float(np.max(np.abs(settled - about))))
    if high > about + 3.0 * room or low < about - 3.0 * room:
        axes.set_ylim(about - 1.5 * room, about + 1.5 * room)
        axes.set_title(f"transient from {low:.3g} to {high:.3g} not shown in full", fontsize=8)
    axes.set_ylabel(label)
    beside(axes)


def _plain(axes: Axes, time: np.ndarray, values: np.ndarray, label: str) -> None:
    line(axes, time, values, BLUE)
    axes.set_ylabel(label)
