"""Whether an observer's estimates can converge: its error dynamics, their slow mode, and persistent excitation.

While the mass slides, the estimates of every observer here have the error dynamics e' = -(1/J) s(w) phi(w)^T e (4.12),
with the slopes s = g'(w) and the regressor phi = d(friction)/d(parameters). For one parameter this is the pole
-s phi / J, which is -alpha / J for g = alpha |w| (4.13), (4.39). For several parameters the matrix has rank one at any
instant, so only the motion over a window can drive all errors to zero. How fast is given by the slowest mode over the
window: approximately that of the averaged matrix, exactly that of the monodromy matrix over a period (Floquet theory).

This holds for the smooth forms (tanh, ln cosh). With sign and |w| it holds only while sliding. While the mass sticks,
d|w|/dt is not sign(w) w', and the estimate obeys k_hat' = (alpha/J) u^2 / (k - k_hat) instead, which converges without
any motion: a fixed-step solver chatters about zero speed, the mass is on each side for such a share of the time that
the mean friction balances k_hat sign(w) + u, and z moves with sign(w) u (docs/thesis.md).
"""

import dataclasses
import math
from collections.abc import Mapping, Sequence

import jax.numpy as jnp
import numpy as np
from jax.typing import ArrayLike
from jaxtyping import Array, Float

from ..blocks.observers import AbstractObserver
from ..errors import InputError

WORDS = {
    "coulomb": "the Coulomb estimate (k_hat)", "viscous": "the viscous estimate (b_hat)",
    "steepness": "the steepness estimate (lambda_hat)",
}  # fmt: skip
AT_THE_TRUTH = 0.03  # error, as a fraction of the true value, within which an estimate counts as right
CONVERGED = 0.05  # predicted error at the run's end, as a fraction of the true value, above which the user is warned


@dataclasses.dataclass(frozen=True)
class Excitation:
    """Whether, and how fast, an observer's estimates converge along a motion.

    Attributes:
        names: the estimated parameters, in the order of everything below.
        gram: mean of phi phi^T over the window, shape (n, n); the units of phi squared.
        smallest_eigenvalue: of the gram matrix with its diagonal scaled to one [1]: 0 where the motion is not
            persistently exciting, 1 is the best possible.
        averaged: mean of -(1/J) s phi^T over the window [1/s], shape (n, n) (4.13), (4.39).
        averaged_time_constants: -1 / Re(eigenvalue) of `averaged`, slowest first [s]; infinite where nothing decays.
        time_constants: of the Floquet multipliers of the window, slowest first [s]; negative where an error grows.
        remaining: predicted |error| of each estimate at the end of the run, relative to its true value, when the
            estimates start at zero [1].
        duration: length of the run [s].
    """

    names: tuple[str, ...]
    gram: Float[np.ndarray, "n n"]
    smallest_eigenvalue: float
    averaged: Float[np.ndarray, "n n"]
    averaged_time_constants: Float[np.ndarray, " n"]
    time_constants: Float[np.ndarray, " n"]
    remaining: Float[np.ndarray, " n"]
    duration: float

    @property
    def slow_mode(self) -> float:
        """Time constant of the slowest error [s]; infinite where a direction is not excited at all."""
        return float(self.time_constants[0])

    @property
    def converges(self) -> bool:
        """Whether every estimate is predicted within 5 % at the end of the run."""
        return bool(np.all(self.remaining <= CONVERGED))

    @property
    def sentences(self) -> tuple[str, ...]:
        """For the user: one sentence for each estimate that cannot converge; empty where all do."""
        return self.sentences_of({})

    def sentences_of(self, off: Mapping[str, float]) -> tuple[str, ...]:
        """`sentences` for a simulated run, whose errors are known: an estimate may be right without having settled.

        Args:
            off: (estimate at the end - truth) / truth by name [1]; a missing name means that it is not known.
        """
        said = []
        for name, left in zip(self.names, self.remaining, strict=True):
            word, error = WORDS.get(name, f"the estimate of {name}"), off.get(name, math.inf)
            if left <= CONVERGED:
                continue
            modes = f"slow mode {_seconds(self.slow_mode)} against a run of {_seconds(self.duration)}"
            if abs(error) <= AT_THE_TRUTH:
                said.append(
                    f"{word} ends {100.0 * error:+.2g} % from the truth, but has not settled there: {modes}; check "
                    f"with a longer run."
                )
            else:
                said.append(
                    f"{word} cannot converge here: {modes}; {100.0 * left:.0f} % of its initial error would be left."
                )
        return tuple(said)


def assess_excitation(
    observer: AbstractObserver,
    velocity: ArrayLike | Sequence[float],
    dt: float,
    parameters: Mapping[str, ArrayLike],
    *,
    duration: float | None = None,
) -> Excitation:
    """Assess whether an observer's estimates converge along a window of motion.

    Args:
        observer: with its gains and its inertia.
        velocity: w over the window [rad/s], shape (samples,); whole periods where the motion is periodic. For a loop
            that tracks well its reference is good enough.
        dt: time between samples [s].
        parameters: true values by name, of all that the observer estimates (and `coulomb` for extension 1's
            sensitivity); nominal values are good enough.
        duration: length of the run to assess [s], taken as a repetition of the window; None for one window.

    Raises:
        InputError: for an observer that estimates nothing, a missing parameter or an invalid velocity.
    """
    names = tuple(observer.estimated)
    if not names:
        raise InputError(f"{type(observer).__name__} estimates nothing: give an observer with estimates.")
    missing = [name for name in names if name not in parameters]
    if missing:
        raise InputError(f"parameters lacks {', '.join(missing)}: give a (nominal) value of each estimated parameter.")
    speed = _checked_velocity(velocity, dt)
    window = dt * len(speed)
    duration = window if duration is None else float(duration)
    slopes, regressor = _vectors(observer, speed, parameters)
    inertia = float(np.asarray(observer.inertia))
    # slopes and regressor have the shape (samples, n).
    gram = regressor.T @ regressor / len(speed)
    averaged = -(slopes.T @ regressor) / (inertia * len(speed))
    multipliers, modes = np.linalg.eig(_monodromy(slopes, regressor, inertia, dt))
    # Liouville: the sum of the logarithms of the multipliers is the integral of the trace of the matrix.
    trace = -float(np.einsum("ti,ti->", slopes, regressor)) * dt / inertia
    truth = np.asarray([float(np.asarray(parameters[name])) for name in names])
    return Excitation(
        names=names,
        gram=gram,
        smallest_eigenvalue=_smallest(gram),
        averaged=averaged,
        averaged_time_constants=_slowest_first(_time_constants(np.linalg.eigvals(averaged).real)),
        time_constants=_slowest_first(_time_constants(_logarithm(multipliers, trace) / window)),
        remaining=_remaining(multipliers, modes, truth, duration / window),
        duration=duration,
    )


def error_matrix(
    observer: AbstractObserver, velocity: ArrayLike | Sequence[float], parameters: Mapping[str, ArrayLike]
) -> Array:
    """-(1/J) s(w) phi(w)^T, the matrix of e' (4.12) [1/s], shape (..., n, n) for velocities [rad/s] of shape (...).

    Args:
        observer: with its gains and its inertia.
        velocity: w [rad/s].
        parameters: values by name at which a nonlinear regressor is taken.
    """
    speed = jnp.asarray(velocity)
    values = {name: jnp.asarray(value, speed.dtype) for name, value in parameters.items()}
    slopes = jnp.stack([jnp.broadcast_to(each, speed.shape) for each in observer.slopes(speed)], axis=-1)
    regressor = jnp.stack([jnp.broadcast_to(each, speed.shape) for each in observer.regressor(speed, values)], axis=-1)
    return -slopes[..., :, None] * regressor[..., None, :] / observer.inertia


def pole(observer: AbstractObserver, velocity: float, parameters: Mapping[str, ArrayLike]) -> float:
    """The pole [1/s] of an observer of one parameter while it slides at a velocity [rad/s] (4.13), (4.39).

    For |w| it is -alpha / J at any speed; for g1 it is -alpha w^2 / J for b, and -alpha |w| / J for k.

    Raises:
        InputError: for an observer of several parameters, whose error has no single pole: use `assess_excitation`.
    """
    if len(observer.estimated) != 1:
        raise InputError(
            f"{type(observer).__name__} estimates {len(observer.estimated)} parameters, so its error has no single "
            "pole: use assess_excitation(...).time_constants."
        )
    return float(error_matrix(observer, float(velocity), parameters)[0, 0])


def _checked_velocity(velocity: ArrayLike | Sequence[float], dt: float) -> np.ndarray:
    speed = np.asarray(velocity, dtype=float)
    if speed.ndim != 1 or len(speed) < 2 or not np.all(np.isfinite(speed)) or not float(dt) > 0.0:
        raise InputError(
            f"velocity must be one row of at least two finite samples and dt must be positive, got a velocity of shape "
            f"{speed.shape} and dt = {float(dt):g} s."
        )
    return speed


def _vectors(
    observer: AbstractObserver, speed: np.ndarray, parameters: Mapping[str, ArrayLike]
) -> tuple[np.ndarray, np.ndarray]:
    """(slopes s, regressor phi) along a motion, each of shape (samples, n)."""
    velocity = jnp.asarray(speed, jnp.asarray(observer.inertia).dtype)
    values = {name: jnp.asarray(float(np.asarray(value)), velocity.dtype) for name, value in parameters.items()}

    def rows(parts: tuple[Array, ...]) -> np.ndarray:
        return np.stack([np.broadcast_to(np.asarray(part, dtype=float), speed.shape) for part in parts], axis=-1)

    return rows(observer.slopes(velocity)), rows(observer.regressor(velocity, values))


def _factors(slopes: np.ndarray, regressor: np.ndarray, inertia: float, dt: float) -> np.ndarray:
    """c of exp(A dt) = I - c s phi^T, exact because A = -(1/J) s phi^T has rank one."""
    rate = np.einsum("ti,ti->t", slopes, regressor) / inertia
    exponent = rate * dt
    # c = (1 - exp(-x)) / x * dt / J with x = s phi dt / J; its limit at x = 0 is dt / J. Negative rates, which chatter
    # makes, need no special case.
    safe = np.where(exponent == 0.0, 1.0, exponent)
    return np.where(exponent == 0.0, 1.0, -np.expm1(-safe) / safe) * dt / inertia


def _monodromy(slopes: np.ndarray, regressor: np.ndarray, inertia: float, dt: float) -> np.ndarray:
    """The transition matrix of the error over the whole window, shape (n, n): the product over all samples."""
    transition = np.eye(slopes.shape[1])
    for slope, row, factor in zip(slopes, regressor, _factors(slopes, regressor, inertia, dt), strict=True):
        transition = transition - np.outer(factor * slope, row @ transition)
    return transition


def _smallest(gram: np.ndarray) -> float:
    """The smallest eigenvalue of the gram matrix scaled to a unit diagonal; rounding below zero is cut off."""
    size = np.sqrt(np.diag(gram))
    if np.any(size == 0.0):
        return 0.0
    return float(max(np.linalg.eigvalsh(gram / np.outer(size, size))[0], 0.0))


def _logarithm(multipliers: np.ndarray, trace: float) -> np.ndarray:
    """ln |multiplier|; that of the fastest mode from Liouville's sum, as it is often below rounding (exp(-700))."""
    logs = np.log(np.maximum(np.abs(multipliers), 1e-300))
    fastest = int(np.argmin(logs))
    logs[fastest] = trace - (np.sum(logs) - logs[fastest])
    return logs


def _time_constants(rates: np.ndarray) -> np.ndarray:
    # A rate below the rounding error of the fastest one is counted as no decay.
    floor = 1e-13 * max(float(np.max(np.abs(rates))), 1e-300)
    return np.asarray([math.inf if abs(rate) <= floor else -1.0 / rate for rate in rates])


def _slowest_first(constants: np.ndarray) -> np.ndarray:
    # Growing errors (negative time constants) are worse than any slow one.
    return np.asarray(sorted(constants, key=lambda value: (value > 0.0, -abs(value))))


def _remaining(multipliers: np.ndarray, modes: np.ndarray, truth: np.ndarray, windows: float) -> np.ndarray:
    """|error| over |truth| after some windows, of estimates that start at zero (error = truth), shape (n,)."""
    # The initial error in the basis of the modes (the columns); least squares, because the modes may be parallel.
    shares, *_ = np.linalg.lstsq(modes, truth.astype(complex), rcond=None)
    # Magnitudes mode by mode: an error that happens to pass through zero at the end has not converged.
    left = np.abs(modes * shares) * np.abs(multipliers) ** windows
    return np.sum(left, axis=1) / np.maximum(np.abs(truth), 1e-300)


def _seconds(value: float) -> str:
    return "infinite" if math.isinf(value) else f"{value:.3g} s"
