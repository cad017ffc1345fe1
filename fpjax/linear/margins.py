"""Margins of a loop from its return ratio, continuous or sampled, without python-control."""

import dataclasses
import math
from collections.abc import Callable

import numpy as np
from scipy.optimize import brentq, minimize_scalar

from .state_space import StateSpace

POINTS = 3000  # frequencies that crossings are looked for at, before each is refined


@dataclasses.dataclass(frozen=True)
class Margins:
    """How far a loop is from instability, all of its return ratio L (negative feedback: 1 + L).

    Attributes:
        gain_margin: the smallest factor above 1 on L at which the loop turns unstable [1]; inf for none.
        gain_reduction: the largest factor below 1 at which it does [1]; 0 for none.
        phase_margin: the smallest |phase| that L may lose or win at a gain crossing [deg]; inf without a crossing.
        delay_margin: the shortest dead time that makes it unstable [s]; inf for none.
        modulus_margin: the smallest |1 + L| [1]: 1 / (largest sensitivity); 0.5 and above is usual.
        gain_crossing: frequency of the phase margin [rad/s]; NaN for none.
        phase_crossing: frequency of the gain margin [rad/s]; NaN for none.
        delay_crossing: frequency of the delay margin [rad/s]; NaN for none.
        modulus_frequency: where |1 + L| is smallest [rad/s].
        stable: whether the closed loop is.
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
        points: frequencies of the search.

    References:
        Astrom, Murray, "Feedback systems", 2021, section 10.3 (stability, modulus and delay margins).
    """
    grid = frequency_grid(ratio, points)
    values = ratio.response(grid)[:, 0, 0]
    imaginary = np.imag(values)

    def at(frequency: float) -> complex:
        return complex(ratio.response(np.array([frequency]))[0, 0, 0])

    gains, reductions, phases = [], [], []
    for index in _changes(imaginary):
        frequency = _root(lambda w: at(w).imag, float(grid[index]), float(grid[index + 1]))
        value = at(frequency)
        if value.real < 0.0 and abs(value.imag) < 1e-6 * abs(value):
            (gains if abs(value) < 1.0 else reductions).append((1.0 / abs(value), frequency))
    if ratio.dt is not None:  # the edge of the axis is a crossing of its own
        edge = at(math.pi / ratio.dt)
        if edge.real < 0.0:
            (gains if abs(edge) < 1.0 else reductions).append((1.0 / abs(edge), math.pi / ratio.dt))
    for index in _changes(np.abs(values) - 1.0):
        frequency = _root(lambda w: abs(at(w)) - 1.0, float(grid[index]), float(grid[index + 1]))
        phases.append((math.degrees(np.angle(-at(frequency))), frequency))
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
    """L / (1 + L)."""
    factor = 1.0 / (1.0 + ratio.d[0, 0])
    return StateSpace(
        ratio.a - factor * ratio.b @ ratio.c, factor * ratio.b, factor * ratio.c, factor * ratio.d, ratio.dt,
        ratio.inputs, ratio.outputs,
    )  # fmt: skip


def frequency_grid(system: StateSpace, points: int = POINTS) -> np.ndarray:
    """Frequencies [rad/s] that show a system: two decades around its poles, denser at resonances, up to Nyquist.

    Args:
        system: whose poles count, those of its closed loop too.
        points: how many.
    """
    rates = np.concatenate([system.rates(), closed(system).rates()])
    size = np.abs(rates)
    fastest = float(size.max()) if size.size else 1.0
    size = size[size > 1e-9 * max(fastest, 1e-300)]
    low = 1e-2 * float(size.min()) if size.size else 1e-2
    high = 1e2 * fastest if size.size else 1e2
    if system.dt is not None:
        high = math.pi / system.dt
        low = min(low, 1e-3 * high)
    low = max(low, 1e-9 * high)
    ringing = np.abs(rates[(np.abs(np.real(rates)) < 0.3 * np.abs(rates)) & (np.abs(np.imag(rates)) > 0.0)])
    dense = [resonance * (1.0 + np.linspace(-0.1, 0.1, 81)) for resonance in ringing]
    grid = np.unique(np.concatenate([np.geomspace(low, high, points), *dense]))
    return grid[(grid >= low) & (grid <= high)]


def _changes(values: np.ndarray) -> np.ndarray:
    finite = np.isfinite(values[:-1]) & np.isfinite(values[1:])
    return np.flatnonzero(finite & (np.sign(values[:-1]) * np.sign(values[1:]) < 0.0))


def _root(function: Callable[[float], float], low: float, high: float) -> float:
    found = brentq(lambda exponent: function(math.exp(exponent)), math.log(low), math.log(high), xtol=1e-13)
    return math.exp(float(found))  # type: ignore[arg-type]


def _smallest(grid: np.ndarray, values: np.ndarray, function: Callable[[float], float]) -> tuple[float, float]:
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
