"""The initial state of a log's replay: the loop's state at the log's first row."""

import equinox as eqx
import jax.numpy as jnp
import numpy as np

from ..blocks.controllers import ProportionalIntegral
from ..logs import Log
from ..simulation.loop import LoopState
from .model import Model


def initial_state(model: Model, log: Log, *, from_rest: bool = False) -> LoopState:
    """The loop's state at the log's first row.

    Velocity and position are the log's, a PI controller's integral is the one that gives the logged torque, and all
    other states (observer, spring, sensor) are at rest.

    Args:
        model: gives the loop.
        log: the log.
        from_rest: start at velocity zero instead of the log's.
    """
    state = model.loop.init()
    position = 0.0 if log.position is None else float(log.position[0])
    velocity = 0.0 if from_rest else _first_velocity(log)
    names = [name for name in type(state.plant).__dataclass_fields__ if name != "friction"]
    for name in names:
        value = velocity if name.endswith("velocity") else position if name.endswith("position") else 0.0
        state = eqx.tree_at(lambda at, name=name: getattr(at.plant, name), state, jnp.asarray(value))
    controller = model.loop.controller
    if isinstance(controller, ProportionalIntegral) and log.reference is not None and log.velocity is not None:
        integral = float(log.torque[0]) - float(controller.kp) * float(log.reference[0] - log.velocity[0])
        state = eqx.tree_at(lambda at: at.controller, state, jnp.asarray(integral))
    return state


def _first_velocity(log: Log) -> float:
    if log.velocity is not None:
        return float(log.velocity[0])
    if log.position is None:
        return 0.0
    # The slope of a quadratic through the first 21 rows: a single difference would be one encoder step over dt, or
    # zero.
    rows = min(21, log.samples)
    return float(np.polyfit(log.time[:rows] - log.time[0], log.position[:rows], 2)[1])
