"""Whether a solver's step can follow a smooth friction law: the number, and the warning that carries it."""

import warnings

import numpy as np
from jax.core import Tracer

from .errors import FpjaxWarning
from .loop import ClosedLoop
from .solvers import AbstractSolver


def stiffness_number(loop: ClosedLoop, dt: float) -> float | None:
    """steepness x coulomb x dt / inertia [1]; None where the law has no steepness or the values are being traced.

    Above the solver's limit (2 Euler, 2.51 ode3, 2.785 RK4) the velocity chatters around zero.

    Args:
        loop: the closed loop.
        dt: solver step [s].
    """
    friction, plant = loop.plant.friction, loop.plant
    steepness = getattr(friction, "steepness", None)
    coulomb = getattr(friction, "static", None)
    if coulomb is None:
        coulomb = getattr(friction, "coulomb", getattr(friction, "coulomb_positive", None))
    inertia = getattr(plant, "inertia", None)
    load_inertia = getattr(plant, "load_inertia", None)
    if load_inertia is not None and hasattr(plant, "stiffness") and type(plant).__name__ == "TwoMass":
        inertia = load_inertia
    values = (steepness, coulomb, inertia, dt)
    if any(value is None or isinstance(value, Tracer) for value in values):
        return None
    return float(np.max(np.asarray(steepness) * np.asarray(coulomb) * np.asarray(dt) / np.asarray(inertia)))


def safe_steepness(
    inertia: float, coulomb: float, dt: float, solver: AbstractSolver, *, fraction: float = 0.5
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


def warn_if_stiff(loop: ClosedLoop, dt: float, solver: AbstractSolver) -> None:
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
