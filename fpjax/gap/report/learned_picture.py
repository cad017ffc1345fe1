"""The picture of the learned laws: each over its variable with its band, and the missing torque it was learned from."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from .digits import show_percent, show_unit
from .names import motion_units
from .sentences import variable_name
from .theme import AFTER, BEFORE, MUTED
from .where_picture import binned

if TYPE_CHECKING:
    from matplotlib.figure import FigureBase

    from ..answer.answer import Answer
    from ..answer.findings import Learned

MOST = 3  # panels beside each other that can be read


def laws_of(diagnosis: Answer) -> tuple[Learned, ...]:
    """The laws that are drawn."""
    return diagnosis.learned[:MOST]


def draw_learned(figure: FigureBase, diagnosis: Answer, *, narrow: bool) -> None:
    """Draw on a figure or subfigure.

    Args:
        figure: to draw on.
        diagnosis: has a learned law.
        narrow: panels below one another, for a phone.
    """
    laws = laws_of(diagnosis)
    linear = diagnosis.motion == "linear"
    units = motion_units(diagnosis.motion) | {"torque": diagnosis.gap.unit}
    shape = (len(laws), 1) if narrow else (1, len(laws))
    left = diagnosis.residual_where
    for axes, law in zip(figure.subplots(*shape, squeeze=False).ravel(), laws, strict=True):
        at, torque, low, high = (np.asarray(each) for each in (law.at, law.torque, law.low, law.high))
        axes.axhline(0.0, color=MUTED, linewidth=0.8)
        if left is not None and left.residual is not None and law.of in left.axes and law.period is None:
            # The course is a torque that acts on the machine, a law one that opposes, as friction: the other sign.
            centres, _, middle, _ = binned(np.asarray(left.axes[law.of], float), -np.asarray(left.residual, float))
            axes.plot(centres, middle, color=BEFORE, linestyle="", marker=".", markersize=3.5, label="what is left")
        axes.fill_between(at, low, high, color=AFTER, alpha=0.22, linewidth=0, label="90 % band")
        axes.plot(at, torque, color=AFTER, linewidth=1.6, label="learned law")
        repeats = f", every {law.period:.3g} {show_unit(units[law.of])}" if law.period is not None else ""
        name = variable_name(law.of, diagnosis)
        axes.set_title(f"{show_percent(law.share)} of what is left: a law of {name}{repeats}")
        axes.set_xlabel(f"{name} [{show_unit(units[law.of])}]")
        axes.margins(x=0.01)
        axes.set_ylabel(f"{'force' if linear else 'torque'} [{show_unit(diagnosis.gap.unit)}]")
        axes.legend(loc="best")
