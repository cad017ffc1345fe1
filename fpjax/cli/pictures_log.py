"""The picture of `fpjax inspect`; a module of its own because it needs no model, and so no jax."""

from pathlib import Path
from typing import TYPE_CHECKING

from matplotlib import rc_context

from ..logs.dynamics.friction_picture import Law, draw_friction
from ..output.plotting import BLUE, GREY, RED, STYLE, new_figure, save, thin

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from ..logs import Log
    from ..logs.checks.inspection import Inspection
    from ..logs.dynamics.nominal import Nominal


def draw_inspection(found: "Inspection", path: Path) -> Path:
    """Draw the columns over time, and friction over speed in bins with the fitted law."""
    from ..logs.log import asks_for_a_position

    log = found.log
    names = [name for name in ("torque", "velocity", "position") if name in log.columns()]
    units = {column.name: column.unit for column in found.columns}
    with rc_context(STYLE):
        figure, axes = new_figure(len(names) + 1, 1, size=(7.0, 2.2 * len(names) + 3.2))
        panels = axes[:, 0]
        for panel, name in zip(panels, names, strict=False):
            panel.plot(*thin(log.time, log.columns()[name]), color=BLUE, label=name)
            tracked = "position" if asks_for_a_position(log) else "velocity"
            if log.reference is not None and name == tracked:
                panel.plot(*thin(log.time, log.reference), color=GREY, linestyle="--", linewidth=0.9, label="reference")
                panel.legend(loc="upper left", bbox_to_anchor=(1.0, 1.0), frameon=False)
            panel.set_ylabel(f"{name} [{units[name]}]")
            panel.set_xlabel("time [s]" if name == names[-1] else "")
        _draw_friction(panels[-1], log, found.nominal)
    return save(figure, path)


def _draw_friction(panel: "Axes", log: "Log", nominal: "Nominal | None") -> None:
    from ..logs.dynamics.friction_curve import friction_curve

    laws = [] if nominal is None else [Law("fitted", RED, nominal.coulomb, nominal.viscous, nominal.offset)]
    draw_friction(panel, friction_curve(log, nominal), laws, linear=log.linear)
    panel.legend(loc="upper left", bbox_to_anchor=(1.0, 1.0), frameon=False)
    taken = "inertia and load taken off" if nominal is not None and nominal.amplitude else "inertia taken off"
    panel.set_ylabel(f"torque [{log.torque_unit}]" + ("" if nominal is None else f",\n{taken}"))
