"""Friction against velocity as a log shows it, in bins, with the laws that were found over it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from ...output.plotting import BLUE, GREY

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from .friction_curve import FrictionCurve


@dataclass(frozen=True)
class Law:
    """coulomb sign(v) + viscous v + offset, as a line.

    Attributes:
        label: its name in the legend.
        colour: of the line.
        coulomb: [N m].
        viscous: [N m s/rad].
        offset: [N m].
        dashed: drawn dashed, so that two laws that coincide can both be seen.
    """

    label: str
    colour: str
    coulomb: float
    viscous: float
    offset: float = 0.0
    dashed: bool = False


def draw_friction(panel: Axes, curve: FrictionCurve, laws: Sequence[Law], *, linear: bool = False) -> None:
    """Median and middle half of each bin, and the laws over them; the caller names the torque.

    Args:
        panel: to draw in.
        curve: of the log.
        laws: friction laws to draw over the bins.
        linear: whether the axis is in m/s instead of rad/s.
    """
    for side in (curve.velocity < 0.0, curve.velocity > 0.0):
        first = side[-1:].any()
        panel.fill_between(
            curve.velocity[side], curve.low[side], curve.high[side], color=BLUE, alpha=0.25, linewidth=0,
            label="middle half of each bin" if first else None,
        )  # fmt: skip
        panel.plot(
            curve.velocity[side], curve.middle[side], "o", color=BLUE, markersize=3.5,
            label="log, median of each bin" if first else None,
        )  # fmt: skip
    widest = float(np.max(np.abs(curve.velocity), initial=0.0))
    for law in laws:
        for side in (-1.0, 1.0):
            line = np.linspace(0.0, side * widest, 2)
            torque = side * law.coulomb + law.viscous * line + law.offset
            panel.plot(
                line, torque, color=law.colour, linewidth=1.6, linestyle="--" if law.dashed else "-",
                label=law.label if side > 0 else None,
            )  # fmt: skip
    panel.axhline(0.0, color=GREY, linewidth=0.6)
    panel.axvline(0.0, color=GREY, linewidth=0.6)
    panel.set_xlabel("velocity [m/s]" if linear else "velocity [rad/s]")
