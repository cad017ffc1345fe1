"""The picture of a linear loop: Bode diagram with margins, step response."""

import math

import numpy as np
from matplotlib.figure import Figure

from ..output.plotting import BLUE, GREY, RED, new_figure, style
from .margins import Margins, frequency_grid
from .state_space import StateSpace


def draw_linear(
    ratio: StateSpace,
    found: Margins,
    response: tuple[np.ndarray, np.ndarray],
    tracked: str,
) -> Figure:
    """Magnitude and phase of the return ratio, and the closed loop's step response.

    Args:
        ratio: the return ratio L.
        found: its margins.
        response: (time [s], tracked quantity), each of shape (samples,).
        tracked: name of the tracked quantity.
    """
    centre = found.gain_crossing if math.isfinite(found.gain_crossing) else found.modulus_frequency
    grid = frequency_grid(ratio)
    # The grid spans all poles; the picture shows three decades to either side of the crossover.
    grid = grid[(grid > 1e-3 * centre) & (grid < 1e3 * centre)]
    values = ratio.response(grid)[:, 0, 0]
    hertz = grid / (2.0 * math.pi)
    with style():
        figure, axes = new_figure(3, 1, size=(7.0, 7.4))
        magnitude, phase, step = axes[:, 0]
        magnitude.loglog(hertz, np.abs(values), color=BLUE)
        magnitude.axhline(1.0, color=GREY, linewidth=0.8)
        magnitude.set_ylabel("|L| [1]")
        magnitude.set_title(_title(found), loc="left")
        degrees = np.degrees(np.unwrap(np.angle(values)))
        # Unwrapping is free by multiples of 360: the phase at the crossover is put between -270 and 90.
        degrees -= 360.0 * round((np.interp(centre, grid, degrees) + 90.0) / 360.0)
        phase.semilogx(hertz, degrees, color=BLUE)
        phase.axhline(-180.0, color=GREY, linewidth=0.8)
        phase.set(ylabel="phase of L [deg]", xlabel="frequency [Hz]")
        if math.isfinite(found.gain_crossing):
            at = found.gain_crossing / (2.0 * math.pi)
            # The margin's bar stands on the branch of the curve that is drawn: its -180 may be 180 or -540 there.
            level = -180.0 + found.phase_margin
            level += 360.0 * round((np.interp(found.gain_crossing, grid, degrees) - level) / 360.0)
            base = -180.0 + 360.0 * round((level + 180.0 - found.phase_margin) / 360.0)
            phase.plot(
                [at, at], [base, level], color=RED, linewidth=2.0, label=f"phase margin {found.phase_margin:.1f} deg"
            )
            phase.legend(loc="best")
        if math.isfinite(found.phase_crossing):
            at, level = found.phase_crossing / (2.0 * math.pi), 1.0 / found.gain_margin
            magnitude.plot(
                [at, at], [level, 1.0], color=RED, linewidth=2.0, label=f"gain margin {found.gain_margin:.3g}"
            )
            magnitude.legend(loc="best")
        if ratio.dt is None:
            step.plot(*response, color=BLUE)
        else:
            step.step(*response, where="post", color=BLUE)
        step.axhline(1.0, color=GREY, linewidth=0.8, linestyle="--")
        step.set(xlabel="time [s]", ylabel=f"{tracked}, unit step")
    return figure


def _title(found: Margins) -> str:
    stable = "stable" if found.stable else "UNSTABLE"
    return f"return ratio at the commanded torque: {stable}, modulus margin {found.modulus_margin:.2f}"
