"""The picture of a plan: the run, its torque, and the expected evidence."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from ..gap.report.digits import show
from ..gap.report.names import effect_title
from ..gap.thresholds import THRESHOLDS
from ..output.plotting import BLACK, BLUE, GREEN, GREY, ORANGE, RED, new_figure, style, thin

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from .answer import Answer

TWINS = {"rivals": "exact twins: no run separates them", "effects": "a twin of the nominal numbers: no run shows it"}
LEAST = 1e-2  # [nats] the left end of the logarithmic axis


def draw(plan: Answer) -> Figure:
    """One page: speed, position and torque over time with their limits, and a bar for each effect or pair."""
    bars = _bars(plan)
    height = 5.0 + 0.19 * len(bars)
    # What the run is for: whether it is enough, each bar says.
    title = "Planned run, " + ("to show every effect" if plan.aim == "effects" else "to tell rivals apart")
    figure, axes = new_figure(
        4, 1, size=(7.6, height), title=title, height_ratios=[1.4, 1.0, 1.0, 0.5 + 0.19 * len(bars)]
    )
    angle = "m" if plan.linear else "rad"
    with style():
        rows = (
            (plan.motion["speed"], plan.limits.speed, f"speed [{angle}/s]", BLUE),
            (plan.motion["position"], float("inf"), f"position [{angle}]", GREEN),
            (plan.torque, plan.limits.torque, f"torque [{plan.torque_unit}]", ORANGE),
        )
        for axis, (values, limit, label, colour) in zip(axes[:3, 0], rows, strict=True):
            _course(axis, plan.time, values, limit, label, colour)
        axes[0, 0].sharex(axes[2, 0])
        axes[1, 0].sharex(axes[2, 0])
        axes[2, 0].set_xlabel("time [s]")
        _evidence(axes[3, 0], bars, TWINS[plan.aim])
    return figure


def _course(axis: Axes, time: np.ndarray, values: np.ndarray, limit: float, label: str, colour: str) -> None:
    axis.plot(*thin(time, values), color=colour)
    axis.set_ylabel(label)
    axis.margins(x=0.0)
    if np.isfinite(limit):
        for side in (limit, -limit):
            axis.axhline(side, color=GREY, linestyle="--", linewidth=0.9)
        axis.annotate("limit", (1.0, limit), xycoords=("axes fraction", "data"), ha="right", va="top", color=GREY)
        axis.set_ylim(-1.12 * limit, 1.12 * limit)


def _bars(plan: Answer) -> list[tuple[str, float, bool]]:
    """(name, nats, or NaN for twins, and whether the run decides it), from above to below."""
    motion = "linear" if plan.linear else "rotary"
    if plan.aim == "rivals":
        return [
            (
                " / ".join(effect_title(effect, motion) for effect in one.between),
                float("nan") if one.twins else one.nats,
                one.separated,
            )
            for one in plan.separations
        ]
    return [
        (effect_title(one.effect, motion), float("nan") if one.twin else one.nats, one.shown) for one in plan.visible
    ]


def _evidence(axis: Axes, bars: list[tuple[str, float, bool]], twins: str) -> None:
    place = np.arange(len(bars))[::-1]
    sizes = np.array([max(nats, LEAST) if np.isfinite(nats) else LEAST for _, nats, _ in bars])
    colours = [GREY if not np.isfinite(nats) else BLUE if decided else RED for _, nats, decided in bars]
    axis.barh(place, sizes - LEAST, left=LEAST, color=colours, height=0.72)
    for at, size, (_, nats, decided) in zip(place, sizes, bars, strict=True):
        told = twins if not np.isfinite(nats) else show(nats) if nats >= LEAST else f"below {LEAST:g}"
        told += "" if decided or not np.isfinite(nats) else ", not enough"
        # On paper: the dashed line would run through the words.
        paper = {"facecolor": "white", "linewidth": 0, "pad": 1.0}
        axis.text(size * 1.15, at, told, va="center", fontsize=7.5, color=BLACK, bbox=paper)
    axis.axvline(THRESHOLDS.sure, color=BLACK, linestyle="--", linewidth=0.9)
    axis.set_xscale("log")
    axis.set_xlim(LEAST, 60.0 * max(float(np.max(sizes)), THRESHOLDS.sure))
    axis.set_ylim(-0.7, len(bars) - 0.3)
    axis.set_yticks(place, [name for name, *_ in bars])
    axis.grid(axis="y", visible=False)
    axis.set_xlabel(f"expected log evidence [nats]; dashed: the {THRESHOLDS.sure:g} that the diagnosis needs")
