"""What is tuned: parameters by dotted name (`fpjax.blocks.parameters`), their bounds, and unbounded coordinates.

Gradient methods move in coordinates q without bounds; `Space.values` maps q to parameter values within the bounds, and
`Space.coordinates` maps back. A smooth map in place of clipping keeps the gradient alive near a bound, so that a search
that has run into one can leave it again.
"""

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

from fpjax.blocks.parameters import get_parameter
from fpjax.errors import InputError
from fpjax.simulation.loop import ClosedLoop

Scale = Literal["log", "linear"]

TAIL = 0.3  # multiple of the knee below which a linear coordinate is logarithmic again
DECADES = 4.0  # half range of a log parameter without bounds
# Exponent p of the bend c = q / (1 + |q|^p)^(1/p) towards a bound: c differs from q by less than 0.01 % at 40 % of the
# way from the middle to the bound and by 2 % at 80 %, so that the coordinates are those of the gains nearly everywhere.
SHARPNESS = 8
INSIDE = 0.999  # share of the way to a bound that a start may have: on the bound itself q is infinite


@dataclasses.dataclass(frozen=True)
class Parameter:
    """One parameter to tune.

    Attributes:
        name: dotted path in the loop, as "observer.gain_1" or "controller.kp".
        start: start value, in the parameter's unit; None for its value in the loop.
        low: smallest value, in the parameter's unit; None for 1e-4 of the start (log scale only; "grid" and
            "grid_repaired" then have no bound).
        high: largest value, in the parameter's unit; None for 1e4 times the start (likewise), or for 8 control periods
            more than the start for a delay.
        scale: "log" or "linear": the space in which a gradient moves.
    """

    name: str
    start: float | None = None
    low: float | None = None
    high: float | None = None
    scale: Scale = "log"


class Space(eqx.Module):
    """The unbounded coordinates in which gradients move.

    The unit of a log parameter's coordinate is one e-fold, that of a linear one's is half its range. Close to a bound
    the map bends, c = middle + half q / (1 + |q|^p)^(1/p), so that no step leaves the bounds and the slope is
    continuous.

    Attributes:
        middle: of the bounds, in the parameter's unit, or of their logarithms where log, shape (n,).
        half: half the distance between the bounds, likewise, shape (n,).
        logarithmic: 1 where log, else 0, shape (n,).
        knee: value below which a log parameter's coordinate is linear, shape (n,); zero for none. Below 0.3 of it
            the coordinate is logarithmic again, so that one step cannot reach the low bound.
        low: lower bound given by the caller, shape (n,); minus infinity where none was given.
        high: upper bound given by the caller, shape (n,); infinity where none was given.
    """

    middle: Array
    half: Array
    logarithmic: Array
    knee: Array
    low: Array
    high: Array

    def values(self, at: Array) -> Array:
        """Parameter values, in their units, at unbounded coordinates of shape (n,)."""
        # The unused branch of each `where` gets an argument of 1 or 0: the derivative of log(0) or of exp(large) is not
        # finite, and 0 times it is NaN in the gradient (the double-where rule).
        log, turns = self.logarithmic > 0.0, self.knee > 0.0
        straight = self.middle + at * jnp.where(log, 1.0, self.half)
        turning = jnp.log(jnp.where(turns, self.knee, 1.0)) + _log_multiple(at)
        share = (jnp.where(turns, turning, straight) - self.middle) / self.half
        bent = self.middle + self.half * share / (1.0 + jnp.abs(share) ** SHARPNESS) ** (1.0 / SHARPNESS)
        return jnp.where(log, jnp.exp(jnp.where(log, bent, 0.0)), bent)

    def coordinates(self, values: np.ndarray | Sequence[float]) -> np.ndarray:
        """Unbounded coordinates of values, shape (..., n), on the host."""
        # The inverse of the bend in `values`: with s = q / (1 + |q|^p)^(1/p), q = s / (1 - |s|^p)^(1/p).
        share = np.clip(self.share(values), -INSIDE, INSIDE)
        straight = share / (1.0 - np.abs(share) ** SHARPNESS) ** (1.0 / SHARPNESS)
        half, knee = np.asarray(self.half, float), np.asarray(self.knee, float)
        # The inverse of `_log_multiple`: logarithmic below TAIL, linear up to the knee, logarithmic above.
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
        """Values of shape (..., n) clipped to the bounds that the caller gave, on the host."""
        return np.clip(values, np.asarray(self.low, float), np.asarray(self.high, float))

    def highest(self) -> np.ndarray:
        """The largest values within the bounds, the default ones too, in their units, shape (n,)."""
        top = np.asarray(self.middle, float) + np.asarray(self.half, float)
        log = np.asarray(self.logarithmic) > 0
        return np.where(log, np.exp(np.where(log, top, 0.0)), top)

    def linear_below(self, values: np.ndarray) -> "Space":
        """The same bounds; coordinates of log parameters are linear below these values and logarithmic above.

        As long as an estimate has not converged, it is about proportional to its gain: a Newton step towards a smaller
        gain is then nearly exact in the gain itself, but covers only one e-fold at a time in its logarithm. Towards
        larger gains a valley gain_1 ~ gain_2^p is a straight line in logarithms.

        Args:
            values: of the parameters, in their units, shape (n,).
        """
        knee = np.where(np.asarray(self.logarithmic) > 0.0, values, 0.0)  # on the host: nothing to compile
        return dataclasses.replace(self, knee=jax.device_put(knee.astype(self.middle.dtype)))


def _log_multiple(at: Array) -> Array:
    """ln(value / knee) at coordinate x: x above 0, ln(1 + x) below, with slope 1 / TAIL below the multiple TAIL.

    Value and slope are continuous at both joints.
    """
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
        raise InputError(f"parameters = {', '.join(names)} names a parameter twice: give each once.")
    rows = [_row(loop, one) for one in full]
    start, low, high, log = (np.array(column) for column in zip(*rows, strict=True))
    logarithmic = log > 0
    ends = [np.where(logarithmic, np.log(np.where(logarithmic, end, 1.0)), end) for end in (low, high)]
    # The default bounds of a log parameter bend the coordinates but do not bind `within`: Algorithm 1 has no bounds in
    # print, and moves as far as its steps take it unless the caller gave some.
    given = [
        np.array([default if end is None else end for end in ends], float)
        for default, ends in ((-np.inf, [one.low for one in full]), (np.inf, [one.high for one in full]))
    ]
    columns = ((ends[0] + ends[1]) / 2.0, (ends[1] - ends[0]) / 2.0, log, np.zeros_like(log), *given)
    return names, jnp.asarray(start, dtype), Space(*(jnp.asarray(column, dtype) for column in columns))


def _row(loop: ClosedLoop, one: Parameter) -> tuple[float, float, float, float]:
    """(start, low, high, 1 where log else 0) of one parameter, with the default bounds."""
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
