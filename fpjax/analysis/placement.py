"""Gains by pole placement: where a search begins, and what a model file without gains gets."""

from collections.abc import Sequence

import jax.numpy as jnp
import numpy as np

from ..errors import InputError
from ..logs.dynamics.derivative import slope
from ..loop import ClosedLoop
from ..output.json_object import TomlTable
from ..parameters import get_parameter, set_parameters
from .excitation import error_matrix

DAMPING = 0.7  # of the velocity loop that kp and ki are placed for
FOLLOWED = 0.7  # error over the reference's peak at which kp alone overcomes Coulomb friction (held: 1)
PROBE = 2000  # samples of the reference that the observer's rates are averaged over
_GAINS = ("gain", "gain_1", "gain_2", "nonlinearity.gain")


def place_gain(loop: ClosedLoop, tables: Sequence[np.ndarray], dt: float, name: str, truths: TomlTable) -> float | None:
    """The gain that pole placement gives, in its unit; None where there is no rule for it.

    An observer's gain is placed where its estimate alone would settle in `placed_time`: gain = J / (tau mean s phi)
    (4.13), (4.39). kp = 2 zeta omega J and ki = omega^2 J are those of a velocity loop of damping 0.7 and the bandwidth
    that `placed_bandwidth` gives.

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
    """Time constant [s] of an estimate: half way, in logarithms, between 8 periods and the run."""
    return float(np.sqrt(8.0 * dt * horizon))


def placed_bandwidth(dt: float, horizon: float, least: float = 0.0) -> float:
    """Bandwidth of a velocity loop [rad/s]: half way between what a period allows, 0.2 / dt, and a tenth of the run.

    Args:
        dt: control period [s].
        horizon: of the run [s].
        least: below which friction would hold the machine [rad/s], as `friction_bandwidth` has it; what a period allows
            is the limit all the same.
    """
    allowed = 0.2 / dt
    return float(min(max(np.sqrt(allowed * (10.0 / horizon)), least), allowed))


def friction_bandwidth(loop: ClosedLoop, tables: Sequence[np.ndarray], truths: TomlTable) -> float:
    """Bandwidth [rad/s] from which kp times `FOLLOWED` of the reference's peak overcomes Coulomb friction; 0 if none.

    A weaker loop may not move at all: its error never asks for as much torque as friction holds.

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
    return coulomb / (FOLLOWED * peak * 2.0 * DAMPING * inertia)


def _unit_rate(loop: ClosedLoop, tables: Sequence[np.ndarray], dt: float, name: str, truths: TomlTable) -> float | None:
    """Rate [1/s] at which the estimate that this gain drives would settle with a gain of 1, all others at 0."""
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
    rate = -float(np.mean(np.trace(np.asarray(matrix), axis1=-2, axis2=-1)))
    return rate if np.isfinite(rate) and rate > 0.0 else None
