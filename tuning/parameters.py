"""What is tuned: parameters by dotted name (`fpjax.blocks.parameters`), their bounds, and a space without bounds."""

import dataclasses
import math
from collections.abc import Sequence
from typing import Literal

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax.typing import DTypeLike
from jaxtyping import Array

from fpjax.blocks.parameters import get_parameter, parameter_names
from fpjax.errors import InputError
from fpjax.simulation.loop import ClosedLoop

Scale = Literal["log", "linear"]

TAIL = 0.3  # of the knee: where a linear coordinate turns logarithmic again
DECADES = 4.0  # a log parameter without bounds may move this far either way
SHARPNESS = 8  # of the bend towards a bound: 0.1 % from straight at 40 % of the way, 4 % at 80 %
INSIDE = 0.999  # of the way to a bound: a start on it would have no slope


@dataclasses.dataclass(frozen=True)
class Parameter:
    """One parameter to tune.

    Attributes:
        name: dotted path in the loop, as "observer.gain_1" or "controller.kp".
        start: where to start, in the parameter's unit; None for its value in the loop.
        low: smallest value, in the parameter's unit; None for 1e-4 of the start (log scale only; "grid" and
            "grid_repaired" then have no bound).
        high: largest value, in the parameter's unit; None for 1e4 times the start (likewise).
        scale: "log" or "linear": the space in which a gradient moves.
    """

    name: str
    start: float | None = None
    low: float | None = None
    high: float | None = None
    scale: Scale = "log"


def default_parameters(loop: ClosedLoop) -> list[str]:
    """What is tuned where nobody says: the observer's gains, or the controller's.

    Raises:
        InputError: where there is neither.
    """
    names = parameter_names(loop)
    words = ("gain", "gain_1", "gain_2")
    chosen = [name for name in names if name.startswith("observer.") and name.rpartition(".")[2] in words]
    chosen = chosen or [
        name for name in names if name.startswith("controller.") and name.endswith((".kp", ".ki", ".gain"))
    ]
    if not chosen:
        raise InputError(f"There is nothing to tune: name it with parameters (--parameter), one of {', '.join(names)}.")
    return chosen


class Space(eqx.Module):
    """The unbounded coordinates in which gradients move.

    A log parameter's unit is one e-fold, a linear one's half its range. Close to a bound the map bends,
    c = middle + half q / (1 + |q|^p)^(1/p), so that no step leaves the bounds and no slope jumps.

    Attributes:
        middle: of the bounds, as a logarithm where log, shape (n,).
        half: half the distance of the bounds, likewise, shape (n,).
        logarithmic: 1 where log, else 0, shape (n,).
        knee: where log, and not zero: the value below which the coordinate is linear, shape (n,); from 0.3 of it
            downwards it is logarithmic again, so that one step cannot leap to the low bound.
        low: smallest value that was asked for, shape (n,); minus infinity where none was.
        high: largest value that was asked for, shape (n,); infinity where none was.
    """

    middle: Array
    half: Array
    logarithmic: Array
    knee: Array
    low: Array
    high: Array

    def values(self, at: Array) -> Array:
        """Parameter values, in their units, at unbounded coordinates of shape (n,)."""
        log, turns = self.logarithmic > 0.0, self.knee > 0.0
        straight = self.middle + at * jnp.where(log, 1.0, self.half)
        turning = jnp.log(jnp.where(turns, self.knee, 1.0)) + _turning(at)
        share = (jnp.where(turns, turning, straight) - self.middle) / self.half
        bent = self.middle + self.half * share / (1.0 + jnp.abs(share) ** SHARPNESS) ** (1.0 / SHARPNESS)
        return jnp.where(log, jnp.exp(jnp.where(log, bent, 0.0)), bent)

    def coordinates(self, values: np.ndarray | Sequence[float]) -> np.ndarray:
        """Unbounded coordinates of values, shape (..., n), on the host."""
        share = np.clip(self.share(values), -INSIDE, INSIDE)
        straight = share / (1.0 - np.abs(share) ** SHARPNESS) ** (1.0 / SHARPNESS)
        half, knee = np.asarray(self.half, float), np.asarray(self.knee, float)
        multiple = np.exp(straight * half + np.asarray(self.middle, float)) / np.where(knee > 0, knee, 1.0)
        low = TAIL * np.log(np.maximum(multiple, 1e-300) / TAIL) - 1.0 + TAIL
        turning = np.where(multiple >= 1.0, np.log(np.maximum(multiple, 1.0)), multiple - 1.0)
        turning = np.where(multiple < TAIL, low, turning)
        return np.where(knee > 0, turning, straight * np.where(np.asarray(self.logarithmic) > 0, half, 1.0))

    def share(self, values: np.ndarray | Sequence[float]) -> np.ndarray:
        """Where values lie between their bounds: -1 at the low one, 1 at the high one; shape (..., n)."""
        values = np.asarray(values, dtype=float)
        log = np.asarray(self.logarithmic) > 0
        bent = np.where(log, np.log(np.where(log, np.maximum(values, 1e-300), 1.0)), values)
        return (bent - np.asarray(self.middle, dtype=float)) / np.asarray(self.half, dtype=float)

    def within(self, values: np.ndarray) -> np.ndarray:
        """Values of shape (..., n) moved to the nearest one that was asked for, on the host."""
        return np.clip(values, np.asarray(self.low, float), np.asarray(self.high, float))

    def linear_below(self, values: np.ndarray) -> "Space":
        """The same bounds in coordinates that are linear below these values and logarithmic above, where log.

        An estimate that the observer has not yet brought home is about proportional to a gain: a Newton step down in
        the gain itself is then nearly exact, where one in its logarithm goes an e-fold at a time. Upwards a valley
        gain_1 ~ gain_2^p is straight in logarithms.
        """
        knee = np.where(np.asarray(self.logarithmic) > 0.0, values, 0.0)  # on the host: nothing to compile
        return dataclasses.replace(self, knee=jax.device_put(knee.astype(self.middle.dtype)))


def _turning(at: Array) -> Array:
    """ln of a multiple: x above 0, ln(1 + x) below, x / TAIL from the multiple TAIL down; the slope never jumps."""
    middle = jnp.log1p(jnp.clip(at, TAIL - 1.0, 0.0))
    low = math.log(TAIL) + (jnp.minimum(at, TAIL - 1.0) - (TAIL - 1.0)) / TAIL
    return jnp.where(at > 0.0, at, jnp.where(at > TAIL - 1.0, middle, low))


def make_space(
    loop: ClosedLoop, parameters: Sequence[str | Parameter], dtype: DTypeLike
) -> tuple[tuple[str, ...], Array, Space]:
    """(names, start of shape (n,), `Space`) of what is to be tuned.

    Args:
        loop: where the parameters live.
        parameters: names, or `Parameter`s.
        dtype: of the arrays.

    Raises:
        InputError: for an invalid name, start or bounds.
    """
    full = [Parameter(one) if isinstance(one, str) else one for one in parameters]
    if not full:
        raise InputError("There is nothing to tune: name at least one parameter, as 'observer.gain_1'.")
    names = tuple(one.name for one in full)
    if len(set(names)) != len(names):
        raise InputError(f"parameters = {', '.join(names)} names one twice: give each once.")
    rows = [_row(loop, one) for one in full]
    start, low, high, log = (np.array(column) for column in zip(*rows, strict=True))
    logarithmic = log > 0
    ends = [np.where(logarithmic, np.log(np.where(logarithmic, end, 1.0)), end) for end in (low, high)]
    asked = [
        np.array([default if end is None else end for end in ends], float)
        for default, ends in ((-np.inf, [one.low for one in full]), (np.inf, [one.high for one in full]))
    ]
    columns = ((ends[0] + ends[1]) / 2.0, (ends[1] - ends[0]) / 2.0, log, np.zeros_like(log), *asked)
    return names, jnp.asarray(start, dtype), Space(*(jnp.asarray(column, dtype) for column in columns))


def _row(loop: ClosedLoop, one: Parameter) -> tuple[float, float, float, float]:
    current = get_parameter(loop, one.name)
    if current.ndim:
        raise InputError(f"{one.name} is an array of shape {current.shape}: only single numbers can be tuned.")
    start = float(current) if one.start is None else float(one.start)
    if one.scale not in ("log", "linear"):
        raise InputError(f"{one.name}: scale = {one.scale!r} is not known: choose 'log' or 'linear'.")
    low, high = one.low, one.high
    if one.scale == "log":
        if not start > 0.0:
            raise InputError(
                f"{one.name} = {start:g} cannot start on a log scale: give a start above zero, or scale='linear'."
            )
        low = start * 10.0**-DECADES if low is None else low
        high = start * 10.0**DECADES if high is None else high
        if not low > 0.0:
            raise InputError(f"{one.name}: low must be above zero on a log scale, got {low:g}.")
    if low is None or high is None:
        raise InputError(f"{one.name} on a linear scale needs both low and high.")
    if not (np.isfinite(low) and np.isfinite(high) and low < high):
        raise InputError(
            f"{one.name}: the range from {low:g} to {high:g} is empty or not finite: give a low below a high."
        )
    if not low <= start <= high:
        raise InputError(f"{one.name} = {start:g} starts outside its range from {low:g} to {high:g}.")
    return start, float(low), float(high), 1.0 if one.scale == "log" else 0.0
