"""Panels that many figures share."""

import itertools
from collections.abc import Mapping, Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

import fpjax
from fpjax.output import plotting

from .. import presets
from ..presets import PRINTED, Setting

Line = tuple[np.ndarray, np.ndarray]  # (time [s], values)

SECONDS, VELOCITY, TORQUE = "time [s]", "velocity [deg/s]", "torque [N m]"
Window = tuple[float, float] | None


def record(
    observer: fpjax.AbstractObserver,
    reference: fpjax.AbstractReference,
    duration: float,
    *signals: str,
    law: fpjax.AbstractFriction | None = None,
    setting: Setting = PRINTED,
) -> dict[str, np.ndarray]:
    """Signals of the one-mass loop, by name, with "time"."""
    loop = presets.one_mass(observer, law)
    return presets.traces(presets.run(loop, reference, duration, setting, record=signals))


def within(signals: Mapping[str, np.ndarray], window: Window) -> dict[str, np.ndarray]:
    """The signals inside a window of time [s]."""
    if window is None:
        return dict(signals)
    inside = (signals["time"] >= window[0]) & (signals["time"] <= window[1])
    return {name: values[inside] for name, values in signals.items()}


def velocities(
    axis: Axes,
    runs: Mapping[str, Mapping[str, np.ndarray]],
    colors: Mapping[str, str],
    *,
    title: str = "",
    window: Window = None,
) -> None:
    """Reference and the velocities of several runs; the run drawn last lies on top."""
    first = within(next(iter(runs.values())), window)
    axis.plot(*plotting.thin(first["time"], first["reference"]), color=plotting.REFERENCE, ls="--", label="reference")
    for name, signals in runs.items():
        shown = within(signals, window)
        axis.plot(*plotting.thin(shown["time"], shown["velocity"]), color=colors[name], label=name, lw=1.1)
    finish(axis, title, VELOCITY)


def estimate_panel(axis: Axes, existing: Line, estimated: Line, *, title: str, label: str = TORQUE) -> None:
    """An existing torque and its estimate, each as (time, values)."""
    axis.plot(*plotting.thin(*existing), color=plotting.TRUTH, lw=1.0, label="existing")
    axis.plot(*plotting.thin(*estimated), color=plotting.COMPENSATED, lw=1.3, ls="--", label="estimated")
    finish(axis, title, label)


def chirp_figure(name: str, runs: Mapping[str, Mapping[str, np.ndarray]], duration: float) -> Figure:
    """A chirp from 1 to 100 Hz in `duration` [s]: its start, a stretch around 20 Hz, the amplitude over frequency."""
    figure, axes = plotting.new_figure(3, 1, title=name, size=(7.6, 7.2))
    rate = 99.0 / duration
    twenty = 19.0 / rate
    velocities(axes[0, 0], runs, COLORS, title="(a) 1 to 10 Hz", window=(0.0, 9.0 / rate))
    velocities(axes[1, 0], runs, COLORS, title="(b) around 20 Hz", window=(twenty - 0.12, twenty + 0.12))
    outer_labels(axes[:2])
    axes[0, 0].set_xlabel(SECONDS)
    for label, signals in runs.items():
        # The largest value of every two periods of the chirp, whose frequency rises linearly.
        edges = _period_edges(rate, duration)
        places = np.searchsorted(signals["time"], edges)
        peaks = [np.max(np.abs(signals["velocity"][start:stop])) for start, stop in itertools.pairwise(places)]
        axes[2, 0].plot(1.0 + rate * 0.5 * (edges[:-1] + edges[1:]), peaks, color=COLORS[label], label=label)
    axes[2, 0].axhline(1.0, color=plotting.REFERENCE, ls="--")
    axes[2, 0].set_xlabel("frequency of the reference [Hz]")
    axes[2, 0].set_ylim(bottom=0.0)
    finish(axes[2, 0], "(c) largest |velocity| of every two periods", VELOCITY)
    legend(figure, axes[0, 0])
    return figure


def _period_edges(rate: float, duration: float) -> np.ndarray:
    """Times [s] at which a chirp from 1 Hz up, gaining `rate` [Hz/s], has completed an even number of periods."""
    cycles = np.arange(0.0, duration + 0.5 * rate * duration**2, 2.0)
    return (np.sqrt(1.0 + 2.0 * rate * cycles) - 1.0) / rate


def finish(axis: Axes, title: str, label: str) -> None:
    """Title and vertical label."""
    axis.set_title(title)
    axis.set_ylabel(label)


def outer_labels(axes: np.ndarray, horizontal: str = SECONDS) -> None:
    """Horizontal labels below the last row only, vertical ones left of the first column only."""
    for axis in axes[-1]:
        axis.set_xlabel(horizontal)
    for axis in axes[:, 1:].flat:
        axis.set_ylabel("")


def legend(figure: Figure, axis: Axes, columns: int = 3) -> None:
    """One legend for the whole figure, below the panels."""
    handles, labels = axis.get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=columns, frameon=False)


COLORS = {"uncompensated": plotting.UNCOMPENSATED, "compensated": plotting.COMPENSATED}


def with_and_without(
    uncompensated: Mapping[str, np.ndarray], compensated: Mapping[str, np.ndarray]
) -> dict[str, Mapping[str, np.ndarray]]:
    """The two runs by the names that `COLORS` knows."""
    return {"uncompensated": uncompensated, "compensated": compensated}


def lettered(titles: Sequence[str]) -> list[str]:
    """(a) ..., (b) ..."""
    return [f"({chr(ord('a') + index)}) {title}" for index, title in enumerate(titles)]
