"""One machine in plain numpy, and logs of it: the truth that the tests hold fpjax against. No code of fpjax but `Log`.

A step follows Euler's rule; then Coulomb friction takes its share of the speed and at most all of it, so that rest is
rest.
"""

import dataclasses
import functools
import math

import numpy as np

from fpjax import Log


@dataclasses.dataclass(frozen=True)
class Machine:
    """Inertia [kg m^2], Coulomb [N m] and viscous [N m s/rad] friction, a PI loop; its nominal numbers.

    `model_files.SMALL_BODY` is the model file of these numbers. Stribeck friction [N m] adds to the Coulomb friction at
    rest and fades with the speed [rad/s]. A constant torque [N m] pushes besides; a torque reaches the plant after a
    delay [control periods].
    """

    inertia: float = 0.05
    coulomb: float = 0.4
    viscous: float = 0.03
    kp: float = 3.0
    ki: float = 30.0
    stribeck: float = 0.0
    stribeck_velocity: float = 0.15
    constant: float = 0.0
    delay: int = 0

    def level(self, speed):
        """Coulomb friction at a speed [N m]."""
        if not self.stribeck:
            return self.coulomb
        return self.coulomb + self.stribeck * math.exp(-((speed / self.stribeck_velocity) ** 2))

    def advanced(self, speed, angle, torque, step):
        """(speed, angle) after a step [s] under a torque [N m]."""
        moved = speed + step * (torque + self.constant - self.viscous * speed) / self.inertia
        after = math.copysign(max(abs(moved) - step * self.level(speed) / self.inertia, 0.0), moved)
        return after, angle + 0.5 * step * (speed + after)


def nothing(time, velocity, position, command):
    return 0.0


def record(
    machine=Machine(),
    *,
    seconds=8.0,
    dt=1e-3,
    extra=nothing,
    velocity_noise=2e-3,
    position_noise=1e-5,
    position_step=0.0,
    seed=3,
    reference=None,
    feedforward=None,
    sensors=("velocity", "position"),
    linear=False,
    substeps=20,
):
    """A log of the closed loop; `extra` is a torque added to the plant that no model knows [N m].

    Args:
        machine: what moves, and its gains; gains of zero leave the feedforward alone: an open loop.
        seconds: length of the log.
        dt: control period [s].
        extra: of time [s], velocity [rad/s], position [rad] and commanded torque [N m].
        velocity_noise: standard deviation, in the loop as in the log [rad/s].
        position_noise: standard deviation [rad].
        position_step: step of the encoder, 0 for none [rad].
        seed: of the noise.
        reference: [rad/s] by sample; sines of several frequencies where it is None.
        feedforward: [N m] by sample, added to the controller's torque.
        sensors: columns of the log.
        linear: the units of the log.
        substeps: steps of the plant in a period.
    """
    count = round(seconds / dt)
    time = dt * np.arange(count)
    if reference is None:
        reference = 5.0 * np.sin(2 * np.pi * 0.53 * time) * (1 + 0.5 * np.sin(2 * np.pi * 0.11 * time)) + np.sin(
            2 * np.pi * 2.3 * time
        )
    random = np.random.default_rng(seed)
    noise = velocity_noise * random.standard_normal(count)
    given = [
        tuple(map(float, values))
        for values in (reference, np.zeros(count) if feedforward is None else feedforward, noise)
    ]
    torque, velocity, position = moved(machine, dt, substeps, extra, *given)
    position = position + position_noise * random.standard_normal(count)
    if position_step:
        position = np.round(position / position_step) * position_step
    return Log(
        time,
        torque.copy(),
        velocity.copy() if "velocity" in sensors else None,
        position if "position" in sensors else None,
        reference,
        dt,
        "made.csv",
        linear,
    )


@functools.lru_cache(maxsize=16)
def moved(machine, dt, substeps, extra, reference, feedforward, noise):
    """(torque, measured velocity, position) by sample; kept, for logs that differ in their columns only."""
    count, h = len(reference), dt / substeps
    torque, velocity, position = np.empty(count), np.empty(count), np.empty(count)
    speed, angle, integral = 0.0, 0.0, 0.0
    for k in range(count):
        read = speed + noise[k]
        error = reference[k] - read
        integral += machine.ki * error * dt
        torque[k], velocity[k], position[k] = machine.kp * error + integral + feedforward[k], read, angle
        applied = float(torque[k - machine.delay]) if k >= machine.delay else 0.0
        begun = dt * k
        for i in range(substeps):
            pushed = applied + extra(begun + i * h, speed, angle, applied)
            speed, angle = machine.advanced(speed, angle, pushed, h)
    return torque, velocity, position


def swing(rows, dt=1e-3, *, inertia, coulomb=0.0, amplitude, rate, noise=1e-3):
    """Columns of a mass that swings at one rate [rad/s] without a loop: the torque is what the motion takes.

    Args:
        rows: samples.
        dt: period [s].
        inertia: [kg m^2].
        coulomb: [N m].
        amplitude: of the speed [rad/s].
        rate: of the swing [rad/s].
        noise: of the velocity column [rad/s].
    """
    time = dt * np.arange(rows)
    speed = amplitude * np.sin(rate * time)
    return {
        "time": time,
        "torque": inertia * amplitude * rate * np.cos(rate * time) + coulomb * np.sign(speed),
        "velocity": speed + noise * np.random.default_rng(0).normal(size=rows),
        "position": -amplitude / rate * np.cos(rate * time),
    }
