"""Whether a solver's step can follow a smooth friction law: the number, and the warning that carries it."""

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
    # The law itself tells its slope, whatever its levels: on a grid over the width of the tanh, finer than it bends.
    velocity = np.linspace(-3.0, 3.0, 241, dtype=steepness.dtype) / np.asarray(steepness)
    slope = np.max(np.diff(np.asarray(_torque(law, velocity, _driving(loop)))) / np.diff(velocity))
    return float(slope * float(dt) / np.asarray(plant.rubbing_inertia()))


@eqx.filter_jit
def _torque(law: AbstractStaticFriction, velocity: Array, driving: Array) -> Array:
    """Friction torque [N m] at these velocities [rad/s]; compiled, because every `simulate` asks."""
    velocity = jnp.asarray(velocity)
    rest = jnp.zeros_like(velocity)
    return law.readout((), Motion(velocity, rest, rest, rest + driving), rest)


def _driving(loop: ClosedLoop) -> Array:
    """The torque [N m] for a level that grows with it: the actuator's limit, else what holds a constant speed."""
    law: Any = loop.plant.friction
    share = getattr(law, "load_coefficient", None)
    if share is None:
        return jnp.zeros_like(law.steepness)
    limit = getattr(loop.actuator, "limit", None)
    return law.coulomb / (1.0 - share) if limit is None else limit


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
