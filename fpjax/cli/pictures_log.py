"""The picture of `fpjax inspect`; apart from the others because it needs no model, and so no jax."""

from pathlib import Path
from typing import Any

import numpy as np
from matplotlib import rc_context

from ..output.plotting import BLUE, GREY, RED, STYLE, new_figure, save, thin


def draw_inspection(found: Any, path: Path) -> Path:
    """The columns over time, and torque over speed with the fitted friction."""
    from ..logs.nominal import speed_of

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
                panel.legend(loc="upper right", ncols=2)
            panel.set_ylabel(f"{name} [{units[name]}]")
            panel.set_xlabel("time [s]" if name == names[-1] else "")
        speed, last = speed_of(log), panels[-1]
        # What accelerates is taken off, so that friction can be seen.
        nominal = found.nominal
        torque = log.torque if nominal is None else log.torque - nominal.inertia * np.gradient(speed, log.dt)
        step = max(1, log.samples // 20000)
        last.plot(speed[::step], torque[::step], ".", color=BLUE, markersize=1.5, alpha=0.4, rasterized=True)
        if nominal is not None:
            for side in (-1.0, 1.0):
                line = np.linspace(0.0, side * np.max(np.abs(speed)), 2)
                fitted = side * nominal.coulomb + nominal.viscous * line + nominal.offset
                last.plot(line, fitted, color=RED, label="least squares" if side > 0 else None)
            low, high = np.quantile(torque, [0.002, 0.998])
            last.set_ylim(low - 0.2 * (high - low), high + 0.2 * (high - low))
            last.legend(loc="lower right")
        last.set_xlabel(f"speed [{'m/s' if log.linear else 'rad/s'}]")
        last.set_ylabel(f"torque less inertia x acceleration\n[{log.torque_unit}]")
    return save(figure, path)
