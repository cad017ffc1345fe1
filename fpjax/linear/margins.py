"""Stability margins of a loop from its return ratio, continuous or sampled, without python-control."""

import dataclasses
import math
from collections.abc import Callable

import numpy as np
from scipy.optimize import brentq, minimize_scalar

from .state_space import StateSpace

POINTS = 3000  # frequencies at which crossings are bracketed before a root search refines them


@dataclasses.dataclass(frozen=True)
class Margins:
    """How far a loop is from instability, from its return ratio L (negative feedback: 1 + L).

    Attributes:
        gain_margin: the smallest factor above 1 on L at which the loop becomes unstable [1]; inf for none.
        gain_reduction: the largest factor below 1 on L at which it becomes unstable [1]; 0 for none.
        phase_margin: the smallest phase shift of L, of either sign, to the stability limit at a gain crossing [deg];
            inf without a crossing.
        delay_margin: the shortest additional dead time that makes the loop unstable [s]; inf for none.
        modulus_margin: the smallest |1 + L|, the inverse of the largest sensitivity [1]; 0.5 and above is usual.
        gain_crossing: frequency of the phase margin [rad/s]; NaN for none.
        phase_crossing: frequency of the gain margin [rad/s]; NaN for none.
        delay_crossing: frequency of the delay margin [rad/s]; NaN for none.
        modulus_frequency: where |1 + L| is smallest [rad/s].
        stable: whether the closed loop is stable.
    """

    gain_margin: float
    gain_reduction: float
    phase_margin: float
    delay_margin: float
    modulus_margin: float
    gain_crossing: float
    phase_crossing: float
    delay_crossing: float
    modulus_frequency: float
    stable: bool

    def rows(self) -> list[tuple[str, float, str]]:
        """(quantity, value, unit) for a table."""

        def at(frequency: float, unit: str) -> str:
            return f"{unit} at {frequency / (2.0 * math.pi):.4g} Hz" if math.isfinite(frequency) else unit

        return [
            ("gain margin", self.gain_margin, at(self.phase_crossing, "x")),
            ("gain reduction margin", self.gain_reduction, "x"),
            ("phase margin", self.phase_margin, at(self.gain_crossing, "deg")),
            ("delay margin", 1e3 * self.delay_margin, at(self.delay_crossing, "ms")),
            ("modulus margin", self.modulus_margin, at(self.modulus_frequency, "1")),
        ]

    def __str__(self) -> str:
        rows = [f"  {name:<22} {value:10.4g} {unit}" for name, value, unit in self.rows()]
        return "\n".join(["stable" if self.stable else "UNSTABLE", *rows])

    __repr__ = __str__


def margins(ratio: StateSpace, *, points: int = POINTS) -> Margins:
    """The margins of a return ratio.

    Args:
        ratio: L, one input and one output, closed with negative feedback; sampled with its `dt`.
        points: number of frequencies of the search.

    References:
        Astrom, Murray, "Feedback systems", 2021, section 10.3 (stability, modulus and delay margins).
    """
    grid = frequency_grid(ratio, points)
    values = ratio.response(grid)[:, 0, 0]
    imaginary = np.imag(values)

    def at(frequency: float) -> complex:
        return complex(ratio.response(np.array([frequency]))[0, 0, 0])

    # Gain margins, as (factor, frequency): where L crosses the negative real axis.
    gains, reductions, phases = [], [], []
    for index in _changes(imaginary):
        frequency = root(lambda w: at(w).imag, float(grid[index]), float(grid[index + 1]))
        value = at(frequency)
        # A pole on the axis turns the sign of the imaginary part through infinity, not zero: that is no crossing.
        if value.real < 0.0 and abs(value.imag) < 1e-6 * abs(value):
            (gains if abs(value) < 1.0 else reductions).append((1.0 / abs(value), frequency))
    if ratio.dt is not None:  # at Nyquist's frequency a sampled L is real: a crossing without a change of sign
        edge = at(math.pi / ratio.dt)
        if edge.real < 0.0:
            (gains if abs(edge) < 1.0 else reductions).append((1.0 / abs(edge), math.pi / ratio.dt))
    for index in _changes(np.abs(values) - 1.0):
        frequency = root(lambda w: abs(at(w)) - 1.0, float(grid[index]), float(grid[index + 1]))
        phases.append((math.degrees(np.angle(-at(frequency))), frequency))
    # A delay only takes phase away: a phase margin of -10 degrees is used up by a delay of 350.
    delays = [(math.radians(phase % 360.0) / frequency, frequency) for phase, frequency in phases]
    gain, phase_crossing = min(gains, default=(math.inf, math.nan))
    reduction, _ = max(reductions, default=(0.0, math.nan))
    phase, gain_crossing = min(phases, key=lambda pair: abs(pair[0]), default=(math.inf, math.nan))
    delay, delay_crossing = min(delays, default=(math.inf, math.nan))
    modulus, frequency = _smallest(grid, np.abs(1.0 + values), lambda w: abs(1.0 + at(w)))
    return Margins(
        gain, reduction, phase, delay, modulus, gain_crossing, phase_crossing, delay_crossing, frequency,
        closed(ratio).stable,
    )  # fmt: skip


def closed(ratio: StateSpace) -> StateSpace:
    """L / (1 + L), the loop closed with negative feedback."""
    factor = 1.0 / (1.0 + ratio.d[0, 0])
    return StateSpace(
        ratio.a - factor * ratio.b @ ratio.c, factor * ratio.b, factor * ratio.c, factor * ratio.d, ratio.dt,
        ratio.inputs, ratio.outputs,
    )  # fmt: skip


def frequency_grid(system: StateSpace, points: int = POINTS) -> np.ndarray:
    """Frequencies [rad/s] for a system: two decades around its poles, denser at resonances, up to Nyquist's.

    Args:
        system: the poles of this system and of its closed loop count.
        points: number of frequencies, those around resonances not counted.
    """
    rates = np.concatenate([system.rates(), closed(system).rates()])
    size = np.abs(rates)
    fastest = float(size.max()) if size.size else 1.0
    size = size[size > 1e-9 * max(fastest, 1e-300)]  # integrators have no rate to look around
    low = 1e-2 * float(size.min()) if size.size else 1e-2
    high = 1e2 * fastest if size.size else 1e2
    if system.dt is not None:
        high = math.pi / system.dt
        low = min(low, 1e-3 * high)
    low = max(low, 1e-9 * high)
    # Damping ratio below 0.3: the peak is narrow enough to fall between two points of the grid.
    ringing = np.abs(rates[(np.abs(np.real(rates)) < 0.3 * np.abs(rates)) & (np.abs(np.imag(rates)) > 0.0)])
    dense = [resonance * (1.0 + np.linspace(-0.1, 0.1, 81)) for resonance in ringing]
    grid = np.unique(np.concatenate([np.geomspace(low, high, points), *dense]))
    return grid[(grid >= low) & (grid <= high)]


def _changes(values: np.ndarray) -> np.ndarray:
    """Indices i where the sign changes between i and i + 1."""
    finite = np.isfinite(values[:-1]) & np.isfinite(values[1:])
    return np.flatnonzero(finite & (np.sign(values[:-1]) * np.sign(values[1:]) < 0.0))


def root(function: Callable[[float], float], low: float, high: float) -> float:
    """The root of a function of the frequency [rad/s] between two frequencies, searched over its logarithm."""
    found = brentq(lambda exponent: function(math.exp(exponent)), math.log(low), math.log(high), xtol=1e-13)
    return math.exp(float(found))  # type: ignore[arg-type]


def _smallest(grid: np.ndarray, values: np.ndarray, function: Callable[[float], float]) -> tuple[float, float]:
    """(the smallest value, its frequency [rad/s]): the best point of the grid, refined between its neighbours."""
    values = np.where(np.isfinite(values), values, np.inf)
    place = int(np.argmin(values))
    low, high = grid[max(place - 1, 0)], grid[min(place + 1, len(grid) - 1)]
    found = minimize_scalar(
        lambda exponent: function(math.exp(exponent)), bounds=(math.log(low), math.log(high)), method="bounded",
        options={"xatol": 1e-10},
    )  # fmt: skip
    value = float(found.fun)  # type: ignore[attr-defined]
    if value <= values[place]:
        return value, math.exp(float(found.x))  # type: ignore[attr-defined]
    return float(values[place]), float(grid[place])
