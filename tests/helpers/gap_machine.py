"""A machine in plain numpy, with an extra torque wherever a test wants it; no code of fpjax but `Log`."""

import dataclasses
import math

import numpy as np

from fpjax.logs import Log


@dataclasses.dataclass(frozen=True)
class Machine:
    """Inertia [kg m^2], Coulomb [N m] and viscous [N m s/rad] friction, a PI loop."""

    inertia: float = 0.05
    coulomb: float = 0.4
    viscous: float = 0.03
    kp: float = 3.0
    ki: float = 30.0


def record(
    machine=Machine(),
    *,
    seconds=8.0,
    dt=1e-3,
    extra=lambda time, velocity, position, command: 0.0,
    velocity_noise=2e-3,
    position_noise=1e-5,
    seed=3,
    reference=None,
    sensors=("velocity", "position"),
    linear=False,
    substeps=20,
):
    """A log of the closed loop; `extra` is a torque added to the plant that no model knows [N m]."""
    random = np.random.default_rng(seed)
    count = round(seconds / dt)
    time = dt * np.arange(count)
    if reference is None:
        reference = 5.0 * np.sin(2 * np.pi * 0.53 * time) * (1 + 0.5 * np.sin(2 * np.pi * 0.11 * time)) + np.sin(
            2 * np.pi * 2.3 * time
        )
    torque, velocity, position = np.empty(count), np.empty(count), np.empty(count)
    speed, angle, integral, h = 0.0, 0.0, 0.0, dt / substeps
    noise = velocity_noise * random.standard_normal(count)
    for k in range(count):
        velocity[k], position[k] = speed + noise[k], angle
        error = reference[k] - velocity[k]
        integral += machine.ki * error * dt
        torque[k] = machine.kp * error + integral
        for i in range(substeps):
            free = torque[k] + extra(time[k] + i * h, speed, angle, torque[k]) - machine.viscous * speed
            moved = speed + h * free / machine.inertia
            after = math.copysign(max(abs(moved) - h * machine.coulomb / machine.inertia, 0.0), moved)
            angle += 0.5 * h * (speed + after)
            speed = after
    position = position + position_noise * random.standard_normal(count)
    return Log(
        time,
        torque,
        velocity if "velocity" in sensors else None,
        position if "position" in sensors else None,
        reference,
        dt,
        "made.csv",
        linear,
    )
