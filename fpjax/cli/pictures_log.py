"""The picture of `fpjax inspect`; apart from the others because it needs no model, and so no jax."""

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from matplotlib import rc_context

from ..output.plotting import BLUE, GREY, RED, STYLE, new_figure, save, thin

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from ..logs import Log
    from ..logs.inspection import Inspection
    from ..logs.nominal import Nominal


def draw_inspection(found: "Inspection", path: Path) -> Path:
    """The columns over time, and friction over speed in bins with the fitted law over it."""
    log = found.log
    names = [name for name in ("torque", "velocity", "position") if name in log.columns()]
    units = {column.name: column.unit for column in found.columns}
    with rc_context(STYLE):
        figure, axes = new_figure(len(names) + 1, 1, size=(7.0, 2.2 * len(names) + 3.2))
        panels = axes[:, 0]
        for panel, name in zip(panels, names, strict=False):
            panel.plot(*thin(log.time, log.columns()[name]), color=BLUE, label=name)
            tracked = "position" if log.velocity is None else "velocity"
            if log.reference is not None and name == tracked:
                panel.plot(*thin(log.time, log.reference), color=GREY, linestyle="--", linewidth=0.9, label="reference")
                panel.legend(loc="upper left", bbox_to_anchor=(1.0, 1.0), frameon=False)
            panel.set_ylabel(f"{name} [{units[name]}]")
            panel.set_xlabel("time [s]" if name == names[-1] else "")
        draw_friction(panels[-1], log, found.nominal)
    return save(figure, path)


def draw_friction(panel: "Axes", log: "Log", nominal: "Nominal | None", label: str = "fitted") -> None:
    """Friction over velocity: median and middle half of each bin, and the model's law.

    Args:
        panel: to draw in.
        log: the log.
        nominal: a `fpjax.logs.nominal.Nominal`, or None.
        label: of the law.
    """
    from ..logs.friction_curve import friction_curve

    curve = friction_curve(log, nominal)
    rate = "m/s" if log.linear else "rad/s"
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
    if nominal is not None:
        widest = float(np.max(np.abs(curve.velocity), initial=0.0))
        for side in (-1.0, 1.0):
            line = np.linspace(0.0, side * widest, 2)
            law = side * nominal.coulomb + nominal.viscous * line + nominal.offset
            panel.plot(line, law, color=RED, linewidth=1.6, label=label if side > 0 else None)
    panel.axhline(0.0, color=GREY, linewidth=0.6)
    panel.axvline(0.0, color=GREY, linewidth=0.6)
    panel.legend(loc="upper left", bbox_to_anchor=(1.0, 1.0), frameon=False)
    panel.set_xlabel(f"velocity [{rate}]")
    taken = "inertia and load taken off" if nominal is not None and nominal.amplitude else "inertia taken off"
    panel.set_ylabel(f"torque [{log.torque_unit}]" + ("" if nominal is None else f",\n{taken}"))
