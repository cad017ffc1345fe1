"""Gains: which are tuned by default, and their start values by pole placement, for a search or a model file."""

from collections.abc import Sequence

import jax.numpy as jnp
import numpy as np

from ..blocks.parameters import get_parameter, parameter_names, set_parameters
from ..errors import InputError
from ..logs.dynamics.derivative import slope
from ..output.json_object import TomlTable
from ..simulation.loop import ClosedLoop
from .excitation import error_matrix

DAMPING = 0.7  # damping ratio of the velocity loop for which kp and ki are placed [1]
# Tracking error, as a share of the reference's peak, at which kp alone overcomes Coulomb friction (1 is a machine that
# does not move at all).
FOLLOWED = 0.7
PROBE = 2000  # about how many samples of the reference the observer's rates are averaged over
_GAINS = ("gain", "gain_1", "gain_2", "nonlinearity.gain")


def place_gain(loop: ClosedLoop, tables: Sequence[np.ndarray], dt: float, name: str, truths: TomlTable) -> float | None:
    """The gain that pole placement gives, in its unit; None where there is no rule for it.

    An observer's gain is chosen so that its estimate alone settles with the time constant tau of `placed_time`: gain =
    J / (tau mean(s phi)), with s and phi of a gain of 1 (4.13), (4.39). kp = 2 zeta omega J and ki = omega^2 J place
    the poles of a velocity loop with the damping ratio zeta = 0.7 and the omega of `placed_bandwidth`.

    Args:
        loop: the closed loop.
        tables: references [rad/s] (or [rad] for a position loop), each of shape (samples,).
        dt: of the tables [s].
        name: dotted, as in "observer.gain_1" or "controller.kp".
        truths: true values by name, for an observer whose regressor depends on them.
    """
    horizon = dt * max(len(table) for table in tables)
    if name.startswith("observer."):
        rate = _unit_rate(loop, tables, dt, name, truths)
        return None if rate is None else 1.0 / (placed_time(dt, horizon) * rate)
    word = name.rpartition(".")[2]
    if name in ("controller.kp", "controller.ki") and not loop.controller.follows_position:
        inertia = float(np.asarray(loop.plant.inertia))  # type: ignore[attr-defined]
        omega = placed_bandwidth(dt, horizon, friction_bandwidth(loop, tables, truths))
        return 2.0 * DAMPING * omega * inertia if word == "kp" else omega * omega * inertia
    return None


def placed_time(dt: float, horizon: float) -> float:
    """Time constant [s] of an estimate: the geometric mean of 8 periods and the length of the run."""
    return float(np.sqrt(8.0 * dt * horizon))


def placed_bandwidth(dt: float, horizon: float, least: float = 0.0) -> float:
    """Bandwidth of a velocity loop [rad/s]: the geometric mean of 0.2 / dt and of 10 over the length of the run.

    Args:
        dt: control period [s].
        horizon: length of the run [s].
        least: bandwidth below which friction would hold the machine [rad/s], from `friction_bandwidth`. The limit of
            the control period, 0.2 / dt, comes first.
    """
    # The hold and the difference delay a sampled loop by about one period: at 0.2 / dt that costs 0.2 rad of phase.
    allowed = 0.2 / dt
    return float(min(max(np.sqrt(allowed * (10.0 / horizon)), least), allowed))


def friction_bandwidth(loop: ClosedLoop, tables: Sequence[np.ndarray], truths: TomlTable) -> float:
    """Bandwidth [rad/s] above which kp times `FOLLOWED` of the reference's peak overcomes Coulomb friction; 0 if none.

    A weaker loop may not move at all: its proportional torque always stays below the friction.

    Args:
        loop: the closed loop, with a velocity controller.
        tables: references [rad/s], each of shape (samples,).
        truths: true values by name; "coulomb" counts.
    """
    peak = max(float(np.max(np.abs(table))) for table in tables)
    coulomb = float(np.max(np.abs(np.asarray(truths.get("coulomb", 0.0)))))
    if not peak > 0.0:
        return 0.0
    inertia = float(np.asarray(loop.plant.inertia))  # type: ignore[attr-defined]
    # kp FOLLOWED peak = coulomb with kp = 2 zeta omega J, solved for omega.
    return coulomb / (FOLLOWED * peak * 2.0 * DAMPING * inertia)


def _unit_rate(loop: ClosedLoop, tables: Sequence[np.ndarray], dt: float, name: str, truths: TomlTable) -> float | None:
    """Rate [1/s] at which this gain's estimate would settle with a gain of 1 and all others 0; None without a rule."""
    known = [f"{prefix}.{word}" for prefix in ("observer", "observer.observer") for word in _GAINS]
    if name not in known or not loop.observer.estimated:
        return None
    present = []
    for each in known:
        try:
            get_parameter(loop, each)
        except InputError:
            continue
        present.append(each)
    alone = set_parameters(loop, {each: 1.0 if each == name else 0.0 for each in present})
    speeds = []
    for table in tables:
        velocity = np.asarray(table, dtype=float)
        velocity = slope(velocity, dt) if loop.controller.follows_position else velocity
        speeds.append(velocity[:: -(-len(velocity) // PROBE)])
    try:
        matrix = error_matrix(alone.observer, jnp.asarray(np.concatenate(speeds)), truths)
    except (AttributeError, KeyError):
        return None  # an observer whose error dynamics are not known
    # With one gain other than zero the matrix has rank one: its trace is its only eigenvalue.
    rate = -float(np.mean(np.trace(np.asarray(matrix), axis1=-2, axis2=-1)))
    return rate if np.isfinite(rate) and rate > 0.0 else None


def default_parameters(loop: ClosedLoop) -> list[str]:
    """What is tuned by default: the observer's gains, or the controller's where there is no observer gain.

    Raises:
        InputError: where the loop has neither.
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
