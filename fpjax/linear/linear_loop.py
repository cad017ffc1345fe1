"""A linearised loop, with its margins, bandwidth, step response and Bode diagram."""

import dataclasses
import math
from typing import TYPE_CHECKING, Any

import numpy as np

from ..output.drawable import Drawable
from .margins import Margins, frequency_grid, margins, root
from .state_space import StateSpace

if TYPE_CHECKING:
    from matplotlib.figure import Figure


@dataclasses.dataclass(frozen=True)
class LinearLoop(Drawable):
    """A loop linearised at an operating point.

    `plot` draws the Bode diagram of `ratio` with its margins, and the step response.

    Attributes:
        closed: the closed loop from "reference" and "disturbance" (a torque added to the command) to "velocity" and
            "position" as measured, and "torque" as commanded.
        ratio: the return ratio L at the commanded torque, closed with negative feedback: minus the torque that comes
            back around the loop for a torque put in; observer, actuator, sensor and hold are included.
        tracked: "velocity" or "position", the quantity that the reference is for.
        speed: velocity at the operating point [rad/s], of a linear axis [m/s].
    """

    closed: StateSpace
    ratio: StateSpace
    tracked: str
    speed: float

    @property
    def dt(self) -> float | None:
        """Control period [s]; None in continuous time."""
        return self.closed.dt

    def __str__(self) -> str:
        clock = "continuous" if self.dt is None else f"sampled at {self.dt:.4g} s"
        bandwidth = self.bandwidth() / (2.0 * math.pi)
        head = f"loop at a speed of {self.speed:.4g}, {clock}; bandwidth of the {self.tracked} {bandwidth:.4g} Hz"
        return f"{head}; {self.margins()}"

    __repr__ = __str__

    def margins(self) -> Margins:
        """Gain, phase, delay and modulus margin of `ratio`."""
        return margins(self.ratio)

    def tracking(self) -> StateSpace:
        """The closed loop from the reference to the tracked quantity."""
        return self.closed.channel(self.tracked, "reference")

    def bandwidth(self) -> float:
        """Frequency [rad/s] above which |tracking| stays below 1 / sqrt 2; NaN where it never reaches that."""
        system = self.tracking()
        grid = frequency_grid(self.ratio)

        def above(frequency: float) -> float:
            return float(np.abs(system.response(np.array([frequency]))[0, 0, 0]) - np.sqrt(0.5))

        follows = np.flatnonzero(np.abs(system.response(grid)[:, 0, 0]) >= np.sqrt(0.5))
        if not follows.size:
            return float("nan")
        if follows[-1] == len(grid) - 1:
            return float(grid[-1])
        return root(above, float(grid[follows[-1]]), float(grid[follows[-1] + 1]))

    def step_response(self, duration: float | None = None) -> tuple[np.ndarray, np.ndarray]:
        """(time [s], tracked quantity) after a unit step of the reference, as deviations from the operating point.

        Args:
            duration: [s]; None for about thirty times the inverse of the bandwidth.
        """
        if duration is None:
            bandwidth = self.bandwidth()
            duration = 30.0 / bandwidth if np.isfinite(bandwidth) and bandwidth > 0.0 else 1.0
        if self.dt is not None:
            duration = max(duration, 20.0 * self.dt)  # at least a readable number of samples
        return self.tracking().step(duration)

    def to_control(self) -> Any:
        """`closed` as `control.StateSpace` of python-control."""
        return self.closed.to_control()

    def _figure(self) -> "Figure":
        from .pictures import draw_linear

        return draw_linear(self.ratio, self.margins(), self.step_response(), self.tracked)
