"""The one-step torque residual: what the nominal model cannot account for, period by period, with the timing of a
held torque.

The commanded torque F_k acts over [t_k, t_k + dt). Between two readings of the rate it is therefore exactly

    J (v_(k+1) - v_k) / dt = F_k - friction, at the middle of the period,

and between three readings of the position

    J (q_(k+1) - 2 q_k + q_(k-1)) / dt^2 = (F_k + F_(k-1)) / 2 - friction, at t_k.

Pairing F_k with a difference centred on t_k instead would show half a period of delay that does not exist.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np

from .record import noise_level, quantisation, smoothed
from .rigid import RigidBody

Values = np.ndarray


@dataclass(frozen=True)
class Residual:
    """One-step torque residual of a log and the motion that it goes with; every array of shape (samples,).

    Attributes:
        values: commanded torque less what the nominal model says the motion needed [N m].
        time: at which it lies [s].
        velocity: smoothed [rad/s].
        acceleration: smoothed [rad/s^2].
        position: measured or integrated [rad].
        position_known: whether the position was measured, so that its zero means something.
        torque: commanded [N m].
        noise: standard deviation of one sensor sample, in the sensor's unit.
        noise_gain: standard deviation of `values` per unit of `noise`, if the sensor's noise is white.
        differences: how often the sensor was differentiated: 1 (rate) or 2 (position).
        dt: [s].
    """

    values: Values
    time: Values
    velocity: Values
    acceleration: Values
    position: Values
    position_known: bool
    torque: Values
    noise: float
    noise_gain: float
    differences: int
    dt: float

    def noise_spectrum(self, frequency: Values) -> Values:
        """Power of white sensor noise in `values` at frequencies [Hz]; its mean over them is the variance."""
        step = (2.0 * np.sin(np.pi * frequency * self.dt)) ** (2 * self.differences)
        return (self.noise * self.noise_gain) ** 2 * step / (2.0, 6.0)[self.differences - 1]


def torque_residual(log: Any, model: RigidBody) -> Residual:
    """The one-step torque residual of a log.

    Args:
        log: a `fpjax.logs.Log` or a `Record`: `time`, `torque`, `velocity` and `position` (one of them may be None),
        `dt`.
        model: the nominal model.
    """
    time, torque, dt = np.asarray(log.time, float), np.asarray(log.torque, float), float(log.dt)
    velocity, position = _column(log.velocity), _column(log.position)
    differences = 1 if velocity is not None else 2
    if velocity is not None:
        noise = noise_level(velocity, quantisation(velocity))
        speed, slope = smoothed(velocity, 5)
        # both ends of the period, so that a reversal within it counts with the share of time on either side
        begin, end = speed, np.append(speed[1:], speed[-1] + slope[-1])
        gained = np.append(np.diff(velocity), slope[-1]) / dt
        at, command = time + 0.5 * dt, torque
    else:
        assert position is not None
        noise = noise_level(position, quantisation(position))
        _, first = smoothed(position, 6)
        speed, slope = smoothed(first / dt, 6)
        begin, end = speed - 0.5 * slope, speed + 0.5 * slope
        gained = np.gradient(speed, dt)
        gained[1:-1] = np.diff(position, 2) / dt**2
        at, command = time, 0.5 * (torque + np.concatenate([torque[:1], torque[:-1]]))
    if position is not None:
        angle = smoothed(position, 5)[0]
        if velocity is not None:
            angle = angle + 0.5 * dt * speed
    else:
        assert velocity is not None
        angle = np.concatenate([[0.0], np.cumsum(0.5 * dt * (velocity[1:] + velocity[:-1]))]) + 0.5 * dt * speed
    middle = 0.5 * (begin + end)
    if model.applied is not None:
        command = model.applied(torque, angle, dt)
        command = command if differences == 1 else 0.5 * (command + np.concatenate([command[:1], command[:-1]]))
    left = command - model.inertia * gained - model.viscous * middle
    since = at - time[0]  # a drift counts from the log's start
    if model.load is not None:
        left = left - model.load(middle, angle, since)
    # Where friction jumps, so does the acceleration, by up to 2 k / J, and a local quadratic rounds that corner off.
    corner = (1.0, 2.0)[differences - 1] * dt * model.coulomb / model.inertia
    doubt = 3.0 * _speed_noise(noise, dt, differences) + corner
    values = left - _set_valued(left, model, (begin, end), angle, since, doubt)
    gain = model.inertia * (np.sqrt(2.0) / dt if differences == 1 else np.sqrt(6.0) / dt**2)
    return Residual(
        values, at, middle, slope / dt, angle, position is not None, torque, noise, float(gain), differences, dt
    )


def _set_valued(
    left: Values, model: RigidBody, ends: tuple[Values, Values], angle: Values, time: Values, doubt: float
) -> Values:
    """The Coulomb torque nearest to `left` among those that the motion allows.

    At a known direction that is one number. Where the speed is zero within its noise, anything between both signs is
    possible,
    and only what lies beyond them is a residual.
    """
    low, high = (_mean_sign(ends[0] + shift, ends[1] + shift) for shift in (-doubt, doubt))
    middle = 0.5 * (ends[0] + ends[1])
    forward, backward = set_valued_levels(model, middle, angle, time)
    known = (low == high) & (np.abs(low) == 1.0)
    bottom = np.where(low < 0.0, low * backward, low * forward)
    top = np.where(high < 0.0, high * backward, high * forward)
    return np.where(known, np.where(middle < 0.0, -backward, forward), np.clip(left, bottom, top))


def set_valued_levels(model: RigidBody, speed: Values, angle: Values, time: Values) -> tuple[Values, Values]:
    """Magnitude of the set-valued friction [N m] forward and backward, at |speed| [rad/s], each of shape (samples,)."""
    fast = np.maximum(np.abs(speed), 1e-12)

    def level(side: float) -> Values:
        extra = 0.0 if model.level is None else model.level(side * fast, angle, time)
        return np.maximum(model.coulomb + extra, 0.0) * np.ones_like(fast)

    return level(1.0), level(-1.0)


def _mean_sign(begin: Values, end: Values) -> Values:
    """Mean of the sign along a straight line from begin to end."""
    travel = end - begin
    crossing = np.sign(begin) * np.sign(end) < 0.0
    safe = np.where(travel == 0.0, 1.0, travel)
    return np.where(crossing, (np.abs(end) - np.abs(begin)) / safe, np.sign(begin + end))


def _speed_noise(noise: float, dt: float, differences: int) -> float:
    """Standard deviation of the smoothed speed [rad/s]: local quadratics over 11 and 13 samples."""
    return 0.46 * noise if differences == 1 else 0.075 * noise / dt


def _column(column: Any) -> Values | None:
    return None if column is None else np.asarray(getattr(column, "values", column), float)
