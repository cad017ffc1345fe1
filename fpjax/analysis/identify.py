"""Grey-box identification: any named parameters of a closed loop, fitted to a run through the differentiable simulator.

The loop is simulated with the input of the run (its reference, or its recorded torque through `TorqueInput`), and
Levenberg-Marquardt (optimistix) changes the named parameters until the simulated signals fit the measured ones. Each
parameter is searched on its own scale between its bounds; the Jacobian is taken in forward mode through the scan.
"""

import dataclasses
import functools
from collections.abc import Mapping, Sequence
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, PyTree

from ..blocks.parameters import get_parameters, set_parameters
from ..blocks.references import AbstractReference, Recorded
from ..compiled.programs import jit_by
from ..errors import InputError
from ..output.json_object import JsonObject, TomlTable
from ..simulation.histories import usual_largest, with_histories
from ..simulation.input_checks import check_one_run, checked_initial
from ..simulation.loop import ClosedLoop, LoopState
from ..simulation.scan import Inputs, Stepper, Stepping, loop_dtype, make_inputs, make_stepper, roll
from ..simulation.solvers import AbstractPlantSolver
from .verdicts import is_alive, verdicts

WIDTH = 100.0  # default bounds: the start value divided and multiplied by this
NOT_PINNED = 0.5  # relative standard error above which a parameter is not determined by the data
WORST = 1e6  # [standard deviations] residuals are cut off here, so that a diverged trial has a finite, large cost


@dataclasses.dataclass(frozen=True)
class Identified:
    """The result of an identification.

    Attributes:
        loop: the loop with the identified parameters.
        values: by name, each in its own unit.
        standard_errors: of the values, assuming independent residuals; they are too small where residuals are coloured.
        intervals: 95 % intervals, value -+ 1.96 standard errors on the parameter's own scale (logarithmic if positive).
        verdicts: by name: "pinned", or some of "dead" (moves nothing), "traded off with NAME", "not pinned" (standard
            error above half the value), "at its low bound", "at its high bound".
        correlation: of the estimates, shape (n, n).
        residual_rms: by signal, in the signal's unit.
        steps: number of Levenberg-Marquardt steps.
        converged: whether the search ended because no step lowers the cost any more.
    """

    loop: ClosedLoop
    values: dict[str, float]
    standard_errors: dict[str, float]
    intervals: dict[str, tuple[float, float]]
    verdicts: dict[str, str]
    correlation: Float[np.ndarray, "n n"]
    residual_rms: dict[str, float]
    steps: int
    converged: bool

    def __str__(self) -> str:
        rows = [
            f"  {name:<28} {value:12.6g} +- {self.standard_errors[name]:<10.2g} {self.verdicts[name]}"
            for name, value in self.values.items()
        ]
        state = "converged" if self.converged else "not converged"
        rms = ", ".join(f"{name} {value:.3g}" for name, value in self.residual_rms.items())
        return "\n".join([f"identified in {self.steps} steps ({state}); residual rms: {rms}", *rows])

    __repr__ = __str__


def identify(
    loop: ClosedLoop,
    reference: AbstractReference,
    measured: TomlTable,
    parameters: Sequence[str],
    *,
    dt: float,
    bounds: Mapping[str, tuple[float, float]] | None = None,
    noise: Mapping[str, float] | None = None,
    solver: str | AbstractPlantSolver = "rk4",
    stepping: Stepping = "continuous",
    substeps: int = 1,
    initial: LoopState | None = None,
    max_steps: int = 60,
) -> Identified:
    """Fit named parameters of a loop to a measured run.

    Args:
        loop: the model, its parameters the start of the search; for a run driven by a recorded torque its controller
            is `TorqueInput`.
        reference: what the run followed; the recorded torque [N m] as `Recorded(torque, dt)` for `TorqueInput`.
        measured: recorded signals by the names of `Signals` (`motor_velocity`, `position`, `torque`, ...), each of
            shape (samples,), from t = 0 on.
        parameters: dotted names, as in `parameter_names(loop)`, or starting with "reference.".
        dt: time between samples, and the solver's step [s].
        bounds: by name, (lowest, highest); by default a factor of 100 to either side of a positive start. Required for
            a start at or below zero.
        noise: standard deviation of each measured signal in its own unit, for weighing several signals; by default each
            signal counts by its own root mean square.
        solver: as in `simulate`.
        stepping: as in `simulate`.
        substeps: as in `simulate`.
        initial: state at t = 0; None for rest.
        max_steps: largest number of Levenberg-Marquardt steps.

    Raises:
        InputError: for invalid names, bounds or measurements.
    """
    import optimistix

    tree = {"loop": loop, "reference": reference}
    # one name is a name, and a path as the messages write it is the same parameter
    names = tuple(name.removeprefix("loop.") for name in ([parameters] if isinstance(parameters, str) else parameters))
    bounds = {name.removeprefix("loop."): limits for name, limits in (bounds or {}).items()}
    paths = tuple(name if name.startswith("reference.") else f"loop.{name}" for name in names)
    if not names or len(set(names)) != len(names):
        raise InputError(f"parameters must name at least one, each once, got {list(names)}.")
    start = _scalars(tree, paths)
    low, high = _limits(names, np.asarray(list(start.values())), bounds)
    if stepping == "sampled":
        most = [
            np.inf if name in bounds else usual_largest(name, value, float(dt))
            for name, value in zip(names, start.values(), strict=True)
        ]
        high = np.minimum(high, most)
        tree["loop"] = with_histories(loop, float(dt), dict(zip(names, high.tolist(), strict=True)))
    table = _measured(measured)
    samples = len(next(iter(table.values())))
    sigma = _sigma(table, noise)
    stepper = make_stepper(
        dt=dt, samples=samples, solver=solver, stepping=stepping, substeps=substeps, checkpoint="none"
    )
    check_one_run(loop, reference, stepper)
    _refuse_beyond(reference, samples, float(dt))
    initial = None if initial is None else checked_initial(initial, tree["loop"], stepping)
    dtype = loop_dtype(loop)
    problem = _Problem(
        tree=tree,
        stepper=stepper,
        initial=initial,
        measured={name: jnp.asarray(values, dtype) for name, values in table.items()},
        sigma={name: jnp.asarray(value, dtype) for name, value in sigma.items()},
        low=jnp.asarray(low, dtype),
        high=jnp.asarray(high, dtype),
        paths=paths,
    )
    at = jnp.asarray(_coordinates(np.asarray(list(start.values())), low, high), dtype)
    if not np.all(np.isfinite(_residuals_jit(at, problem))):
        raise InputError("The run cannot be simulated from the start values: give better ones, or a smaller step.")
    # Relative and absolute tolerance of the coordinates and of the cost; about the square root of the rounding in
    # single precision.
    precision = 1e-9 if dtype == jnp.float64 else 1e-5
    # forward-mode Jacobian: the parameters are few, the residuals many
    solution = optimistix.least_squares(
        _residuals,
        _marquardt(precision),
        at,
        args=problem,
        options={"jac": "fwd"},
        max_steps=max_steps,
        throw=False,
    )
    converged = bool(solution.result == optimistix.RESULTS.successful)
    return _report(problem, names, np.asarray(solution.value, float), int(solution.stats["num_steps"]), converged)


class _Problem(eqx.Module):
    """All that the residuals depend on besides the coordinates; numbers are array leaves, so nothing recompiles."""

    tree: JsonObject
    stepper: Stepper
    initial: LoopState | None
    measured: dict[str, Float[Array, " samples"]]
    sigma: dict[str, Float[Array, ""]]
    low: Float[Array, " n"]
    high: Float[Array, " n"]
    paths: tuple[str, ...] = eqx.field(static=True)


# Cached, because jax compiles anew for every new solver object.
@functools.cache
def _marquardt(precision: float) -> Any:
    import optimistix

    return optimistix.LevenbergMarquardt(rtol=precision, atol=precision)


def _residuals(at: Array, problem: _Problem) -> Array:
    """Residuals of all signals in standard deviations, shape (signals x samples,)."""
    values = _values(at, problem.low, problem.high)
    tree = set_parameters(problem.tree, {path: values[i] for i, path in enumerate(problem.paths)})
    loop, reference = tree["loop"], tree["reference"]
    inputs: Inputs = make_inputs(loop, reference, problem.stepper)
    _, recorded, _ = roll(loop, inputs, problem.stepper, {}, tuple(problem.measured), problem.initial)
    parts = [(recorded[name] - problem.measured[name]) / problem.sigma[name] for name in problem.measured]
    joined = jnp.concatenate(parts)
    # The inner `where` keeps NaN out of the branch that is differentiated (0 * NaN is NaN).
    sound = jnp.isfinite(joined)
    return jnp.where(sound, jnp.clip(jnp.where(sound, joined, 0.0), -WORST, WORST), WORST)


def _length(at: Array, problem: _Problem) -> tuple[int, ...]:
    return problem.stepper.samples, *at.shape


_residuals_jit = jit_by(_length)(_residuals)
_jacobian_jit = jit_by(_length)(lambda at, problem: jax.jacfwd(_residuals)(at, problem))


def _logarithmic(low: Any) -> Any:
    return low > 0.0


def _values(at: Array, low: Array, high: Array) -> Array:
    """Parameters from their coordinates, shape (n,).

    A coordinate may be any real number; its sigmoid is the share of the way from the low to the high bound, so no step
    can leave the bounds. The way is logarithmic where the bounds are positive.
    """
    share = jax.nn.sigmoid(at)
    positive = _logarithmic(low)
    bottom, top = jnp.where(positive, low, 1.0), jnp.where(positive, high, 1.0)
    return jnp.where(positive, bottom * jnp.exp(share * jnp.log(top / bottom)), low + share * (high - low))


def _coordinates(values: np.ndarray, low: np.ndarray, high: np.ndarray) -> np.ndarray:
    """The inverse of `_values`."""
    positive = _logarithmic(low)
    with np.errstate(all="ignore"):
        share = np.where(positive, np.log(values / low) / np.log(high / low), (values - low) / (high - low))
    return np.log(share) - np.log1p(-share)


def _report(problem: _Problem, names: tuple[str, ...], at: np.ndarray, steps: int, converged: bool) -> Identified:
    here = jnp.asarray(at, problem.low.dtype)
    residuals = np.asarray(_residuals_jit(here, problem), float)
    by_signal = residuals.reshape(len(problem.measured), -1)
    # The noise standard deviation is estimated from the residuals, signal by signal (degrees of freedom shared out), so
    # that the standard errors do not depend on `noise` being right.
    spread = np.sqrt(np.sum(by_signal**2, axis=1) / max(by_signal.shape[1] - len(names) / len(by_signal), 1.0))
    weights = np.repeat(1.0 / np.maximum(spread, 1e-300), by_signal.shape[1])
    jacobian = np.asarray(_jacobian_jit(here, problem), float) * weights[:, None]
    values = np.asarray(_values(here, problem.low, problem.high), float)
    low, high = np.asarray(problem.low, float), np.asarray(problem.high, float)
    # Slopes by ln(value), or by half the range where the scale is linear, so that parameters can be compared. The chain
    # rule over `_values`: d share / d coordinate = share (1 - share), d ln(value) / d share = width.
    share = 1.0 / (1.0 + np.exp(-at))
    width = np.where(low > 0.0, np.log(np.maximum(high, 1e-300) / np.maximum(low, 1e-300)), 2.0)
    slopes = jacobian / (share * (1.0 - share) * width)
    lengths = np.linalg.norm(slopes, axis=0)
    # columns to length one: the eigenvalues of `normal` then show the directions, free of the parameters' units and
    # scales
    unit = slopes / np.maximum(lengths, 1e-300)
    normal = unit.T @ unit
    # Eigenvalues are floored instead of dropped as by a pseudo-inverse: a direction that the data do not determine must
    # show a large variance, not none.
    powers, directions = np.linalg.eigh(normal)
    covariance = directions / np.maximum(powers, 1e-14 * powers[-1]) @ directions.T
    deviation = np.sqrt(np.maximum(np.diag(covariance), 0.0))
    correlation = covariance / np.maximum(np.outer(deviation, deviation), 1e-300)
    error = np.where(is_alive(lengths), deviation / np.maximum(lengths, 1e-300), np.inf)
    logarithmic = low > 0.0
    # Back to the parameter's own unit: d value = value d ln(value), or half the range.
    absolute = np.where(logarithmic, np.abs(values), 0.5 * (high - low)) * error
    with np.errstate(over="ignore", invalid="ignore"):
        # 95 % intervals (1.96 standard deviations of a normal distribution), on the scale on which the fit is nearly
        # linear: they stay positive where the bounds are
        below = np.where(logarithmic, values * np.exp(-1.96 * error), values - 1.96 * absolute)
        above = np.where(logarithmic, values * np.exp(1.96 * error), values + 1.96 * absolute)
    tree = set_parameters(problem.tree, dict(zip(problem.paths, values, strict=True)))
    sizes = [float(problem.sigma[name]) for name in problem.measured]
    rms = np.sqrt(np.mean(by_signal**2, axis=1)) * sizes
    return Identified(
        loop=tree["loop"],
        values=dict(zip(names, map(float, values), strict=True)),
        standard_errors=dict(zip(names, map(float, absolute), strict=True)),
        intervals={name: (float(below[i]), float(above[i])) for i, name in enumerate(names)},
        verdicts=verdicts(names, lengths, correlation, error > NOT_PINNED, 2.0 * share - 1.0),
        correlation=correlation,
        residual_rms=dict(zip(problem.measured, map(float, rms), strict=True)),
        steps=steps,
        converged=converged,
    )


def _scalars(tree: PyTree, paths: tuple[str, ...]) -> dict[str, float]:
    values = get_parameters(tree, paths)
    for path, value in values.items():
        if np.ndim(value) != 0:
            raise InputError(f"parameter {path!r} has shape {np.shape(value)}: only single numbers can be identified.")
    return {path: float(value) for path, value in values.items()}


def _limits(
    names: tuple[str, ...], start: np.ndarray, bounds: Mapping[str, tuple[float, float]]
) -> tuple[np.ndarray, np.ndarray]:
    unknown = [name for name in bounds if name not in names]
    if unknown:
        raise InputError(f"bounds name {unknown[0]!r}, which is not among the parameters {', '.join(names)}.")
    low, high = [], []
    for name, value in zip(names, start, strict=True):
        if name not in bounds:
            if value <= 0.0:
                raise InputError(
                    f"{name} starts at {value:g}, so its scale is unknown: give bounds={{{name!r}: (low, high)}}."
                )
            low.append(value / WIDTH)
            high.append(value * WIDTH)
            continue
        bottom, top = (float(each) for each in bounds[name])
        if not bottom < value < top or not np.isfinite(top - bottom):
            raise InputError(f"{name} starts at {value:g}, which is not inside its bounds ({bottom:g}, {top:g}).")
        low.append(bottom)
        high.append(top)
    return np.asarray(low), np.asarray(high)


def _measured(measured: TomlTable) -> dict[str, np.ndarray]:
    table = {name: np.asarray(values, dtype=float) for name, values in measured.items()}
    if not table:
        raise InputError("measured is empty: give at least one recorded signal, as in {'velocity': array}.")
    shapes = {name: values.shape for name, values in table.items()}
    if len(set(shapes.values())) != 1 or any(len(shape) != 1 or shape[0] < 2 for shape in shapes.values()):
        raise InputError(f"measured has shapes {shapes}: give rows of one common length.")
    for name, values in table.items():
        if not np.all(np.isfinite(values)):
            raise InputError(f"measured[{name!r}] holds {np.sum(~np.isfinite(values))} values that are not finite.")
    return table


def _refuse_beyond(reference: AbstractReference, samples: int, dt: float) -> None:
    """Refuse readings from after the end of a recorded reference, which would go on with its last value.

    Args:
        reference: of the run.
        samples: of each measured signal.
        dt: time between them [s].

    Raises:
        InputError: for such readings.
    """
    if not isinstance(reference, Recorded):
        return
    end, last = len(reference.values) * float(reference.interval), (samples - 1) * dt
    if last > end + 1e-3 * dt:  # a rounding error is no sample
        raise InputError(
            f"measured goes on to {last:.6g} s ({samples} samples), but the recorded reference ends at {end:.6g} s "
            f"({len(reference.values)}): give both of one run, or the part that both have."
        )


def _sigma(table: dict[str, np.ndarray], noise: Mapping[str, float] | None) -> dict[str, float]:
    if noise is None:
        return {name: max(float(np.sqrt(np.mean(values**2))), 1e-300) for name, values in table.items()}
    if set(noise) != set(table) or not all(value > 0.0 for value in noise.values()):
        raise InputError(f"noise names {sorted(noise)}: give one value above zero for each of {sorted(table)}.")
    return {name: float(noise[name]) for name in table}
