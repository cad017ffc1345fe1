"""The stability of a solver's step with a smooth friction law: its number, a safe steepness, and a warning."""

import warnings
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax.core import Tracer
from jaxtyping import Array

from ..blocks.friction import AbstractStaticFriction
from ..blocks.signals import Motion
from ..errors import FpjaxWarning
from .loop import ClosedLoop
from .solvers import AbstractPlantSolver


def stiffness_number(loop: ClosedLoop, dt: float) -> float | None:
    """Steepest slope of a smooth friction law x dt / inertia [1], near rest steepness x coulomb x dt / inertia.

    Above the solver's limit (2 Euler, 2.51 ode3, 2.785 RK4) the velocity chatters around zero. None where the law is
    set-valued or has a state of its own, or where values are being traced.

    Args:
        loop: the closed loop.
        dt: solver step [s].
    """
    law, plant = loop.plant.friction, loop.plant
    steepness = getattr(law, "steepness", None)
    if steepness is None or not isinstance(law, AbstractStaticFriction):
        return None
    if any(isinstance(leaf, Tracer) or np.ndim(leaf) for leaf in jax.tree.leaves((plant, dt))):
        return None
    # The slope is taken numerically from the law itself, so it holds for any law: on a grid of +-3 widths of the tanh.
    velocity = np.linspace(-3.0, 3.0, 241, dtype=steepness.dtype) / np.asarray(steepness)
    slope = np.max(np.diff(np.asarray(_torque(law, velocity, _driving(loop)))) / np.diff(velocity))
    return float(slope * float(dt) / np.asarray(plant.rubbing_inertia()))


@eqx.filter_jit
def _torque(law: AbstractStaticFriction, velocity: Array, driving: Array) -> Array:
    """Friction torque [N m] at velocities [rad/s] of shape (points,); compiled, because every `simulate` calls it."""
    velocity = jnp.asarray(velocity)
    rest = jnp.zeros_like(velocity)
    return law.readout((), Motion(velocity, rest, rest, rest + driving), rest)


def _driving(loop: ClosedLoop) -> Array:
    """The torque [N m] for load-dependent friction: the actuator's limit, or else the torque at a constant speed."""
    law: Any = loop.plant.friction
    share = getattr(law, "load_coefficient", None)
    if share is None:
        return jnp.zeros_like(law.steepness)
    limit = getattr(loop.actuator, "limit", None)
    return law.coulomb / (1.0 - share) if limit is None else limit  # T = k + mu T at a constant speed


def safe_steepness(
    inertia: float, coulomb: float, dt: float, solver: AbstractPlantSolver, *, fraction: float = 0.5
) -> float:
    """The steepness [s/rad] at `fraction` of the solver's stability limit.

    Args:
        inertia: J [kg m^2].
        coulomb: k [N m].
        dt: solver step [s].
        solver: the solver.
        fraction: of the limit [1].
    """
    return fraction * solver.stability_limit * inertia / (max(coulomb, 1e-300) * dt)


def warn_if_stiff(loop: ClosedLoop, dt: float, solver: AbstractPlantSolver) -> None:
    """Warn, with the number, where the step is past the solver's stability limit."""
    number = stiffness_number(loop, dt)
    if number is not None and number > solver.stability_limit:
        warnings.warn(
            f"steepness x coulomb x dt / inertia = {number:.3g} is past {solver.name}'s stability limit "
            f"{solver.stability_limit:.3g}: the velocity will chatter around zero; use a step below "
            f"{dt * solver.stability_limit / number:.3g} s or a smaller steepness.",
            FpjaxWarning,
            stacklevel=3,
        )
