"""What the residual of a perfect model would look like: the same motion, made by the nominal model itself, with the
sensor's noise.

Differentiated noise, rounding, sticking and the corners of the motion at a reversal all leave a residual of their
own. Rather than
a formula for each, logs are made in which nothing is wrong and are sent through the same code.
"""

from dataclasses import dataclass

import numpy as np

from .record import quantisation
from .residual import Residual, set_valued_levels, torque_residual
from .rigid import RigidBody

Values = np.ndarray

DRAWS = 6
PULL = 0.05  # per period, by which the made motion is drawn to the measured one


@dataclass(frozen=True)
class MadeLog:
    """A log in which the model is right; the fields are those of `fpjax.logs.Log`."""

    time: Values
    torque: Values
    velocity: Values | None
    position: Values | None
    dt: float
    name: str = "made"
    reference: None = None


def null_residuals(log, model: RigidBody, residual: Residual, *, draws: int = DRAWS, seed: int = 0) -> list[Residual]:
    """Residuals of logs that the model itself made along the measured motion; the arguments are `made_logs`'."""
    applied = RigidBody(model.inertia, model.coulomb, model.viscous, model.level, model.load)
    return [torque_residual(made, applied) for made in made_logs(log, model, residual, draws=draws, seed=seed)]


def made_logs(log, model: RigidBody, residual: Residual, *, draws: int = DRAWS, seed: int = 0) -> list[MadeLog]:
    """Logs that the model itself made along the measured motion.

    Args:
        log: as for `torque_residual`.
        model: the nominal model.
        residual: of the log.
        draws: how many draws of the sensor's noise.
        seed: of the noise.
    """
    torque, velocity, position = _made_motion(residual, model)
    rate, angle = _values(log.velocity), _values(log.position)
    random = np.random.default_rng(seed)
    found = []
    for _ in range(draws):
        noise = residual.noise * random.standard_normal(len(torque))
        column = rate if rate is not None else angle
        step = 0.0 if column is None else quantisation(column)
        # a rounded sensor's noise is its rounding, plus what the level says is beyond it
        noise = noise * np.sqrt(max(1.0 - step**2 / 12.0 / max(residual.noise, 1e-300) ** 2, 0.0))
        if rate is not None:
            made = MadeLog(
                np.asarray(log.time),
                torque,
                _rounded(velocity + noise, step),
                None if angle is None else position,
                residual.dt,
            )
        else:
            made = MadeLog(np.asarray(log.time), torque, None, _rounded(position + noise, step), residual.dt)
        found.append(made)
    return found


def _made_motion(residual: Residual, model: RigidBody) -> tuple[Values, Values, Values]:
    """(torque [N m], velocity [rad/s], position [rad]) at the starts of the periods, exactly as the model moves."""
    dt, inertia = residual.dt, model.inertia
    since = residual.time - residual.time[0]
    forward, backward = set_valued_levels(model, residual.velocity, residual.position, since)
    load = np.zeros(len(forward))
    if model.load is not None:
        load = np.broadcast_to(model.load(residual.velocity, residual.position, since), load.shape)
    target = residual.velocity
    torque, velocity, position = (np.empty(len(forward)) for _ in range(3))
    speed, angle = float(target[0]), float(residual.position[0])
    needed = inertia * residual.acceleration + model.viscous * target + load
    side = np.sign(target)
    command = needed + np.where(side > 0, forward, -backward) * side**2 if np.any(side) else needed
    for k, (u, up, down, held, wanted) in enumerate(
        zip(command.tolist(), forward.tolist(), backward.tolist(), load.tolist(), target.tolist(), strict=True)
    ):
        velocity[k], position[k] = speed, angle
        u += PULL * inertia / dt * (wanted - speed)
        torque[k] = u
        free = u - held - model.viscous * speed
        # one period with friction that stops the motion exactly where it would cross zero
        level = up if speed > 0.0 or (speed == 0.0 and free > 0.0) else -down
        if speed == 0.0:
            after = dt / inertia * (free - level) if abs(free) > abs(level) else 0.0
        else:
            after = speed + dt / inertia * (free - level)
            if after * speed < 0.0:
                rest = dt * (1.0 - speed / (speed - after))
                other = up if free > 0.0 else -down
                after = rest / inertia * (free - other) if abs(free) > abs(other) else 0.0
        angle += 0.5 * dt * (speed + after)
        speed = after
    return torque, velocity, position


def _rounded(values: Values, step: float) -> Values:
    return values if step == 0.0 else step * np.round(values / step)


def _values(column) -> Values | None:
    return None if column is None else np.asarray(getattr(column, "values", column), float)
