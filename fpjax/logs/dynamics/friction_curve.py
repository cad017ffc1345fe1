"""Friction against velocity as a log shows it: the torque without inertial and known load torque, in bins."""

from dataclasses import dataclass, replace

import numpy as np

from ..log import Log
from .nominal import Nominal, angle_of, speed_of

BINS = 24  # on each side of zero velocity
FEWEST = 8  # [samples] in a bin
MOST_ROWS = 400_000  # [samples]: of a longer log, its middle is taken


@dataclass(frozen=True)
class FrictionCurve:
    """Friction torque in bins of velocity, each of as many samples as the others on its side.

    Attributes:
        velocity: median of each bin [rad/s], increasing.
        middle: median torque of each bin [N m].
        low: lower quartile of each bin [N m].
        high: upper quartile of each bin [N m].
    """

    velocity: np.ndarray
    middle: np.ndarray
    low: np.ndarray
    high: np.ndarray


def friction_curve(log: Log, nominal: Nominal | None) -> FrictionCurve:
    """The friction of a log in bins of velocity.

    Args:
        log: with a torque and a motion.
        nominal: whose inertia and unbalance are taken off; None to show the whole torque.
    """
    middle = slice(max(0, (log.samples - MOST_ROWS) // 2), (log.samples + MOST_ROWS) // 2)
    log = replace(
        log, time=log.time[middle], torque=log.torque[middle],
        velocity=None if log.velocity is None else log.velocity[middle],
        position=None if log.position is None else log.position[middle],
    )  # fmt: skip
    speed, torque = _averaged(log, nominal)
    # around zero velocity the direction is noise, and sticking friction takes any value: these samples belong to no
    # bin
    still = 1e-3 * float(np.quantile(np.abs(speed), 0.99)) if speed.size else 0.0
    rows = [(-1.0, speed < -still), (1.0, speed > still)]
    points: list[tuple[float, float, float, float]] = []
    for _, side in rows:
        order = np.argsort(speed[side])
        count = min(BINS, order.size // FEWEST)
        for part in np.array_split(order, count) if count else []:
            low, mid, high = np.quantile(torque[side][part], [0.25, 0.5, 0.75])
            points.append((float(np.median(speed[side][part])), float(mid), float(low), float(high)))
    columns = np.array(sorted(points)).reshape(len(points), 4).T
    return FrictionCurve(*columns)


def _averaged(log: Log, nominal: Nominal | None) -> tuple[np.ndarray, np.ndarray]:
    """(velocity, friction torque), each a weighted mean over a short window in which the motion keeps its direction.

    The weights are a smooth bump that is zero at both ends of the window. Integration by parts moves the derivatives
    from the noisy reading to the bump (a modulating function, Shinbrot, 1957), so the reading is not differentiated,
    and the mean acceleration belongs to the same window as the mean torque.
    """
    speed = speed_of(log)
    if nominal is None:
        return speed, log.torque
    size = int(np.clip(round(0.5 * nominal.window / log.dt), 4, max(4, log.samples // 8)))
    place = (np.arange(size) + 0.5) / size
    # zero with its first two derivatives at both ends, so integrating a position by parts twice leaves no end terms
    bump = (place * (1.0 - place)) ** 3
    bump /= bump.sum()
    order = 2 if log.position is not None else 1
    # The k-th weight belongs to the torque that is held from k to k + 1: the differences of the reading lie between the
    # same two samples.
    edges = np.diff(np.concatenate([np.zeros(order), bump, np.zeros(order)]), order) / log.dt**order
    reading = log.position if log.position is not None else log.velocity
    assert reading is not None
    # The second difference of a position belongs to the mean of the torques held before and after its middle sample.
    accelerated = np.convolve(reading, ((-1.0) ** order * edges)[::-1], "valid")
    given = log.torque if order == 1 else 0.5 * (log.torque + np.concatenate([log.torque[:1], log.torque[:-1]]))
    if nominal.amplitude > 0.0:
        given = given - nominal.amplitude * np.sin(angle_of(log) + nominal.phase)
    step = max(1, size // 8)
    count = min(accelerated.size, log.samples - size - order)
    first = order - 1
    torque = np.convolve(given, bump[::-1], "valid")[first : first + count] - nominal.inertia * accelerated[:count]
    mean = np.convolve(speed, bump[::-1], "valid")[first : first + count]
    # number of reversals up to each sample: equal at both ends of a window in which there is none
    turns = np.concatenate([[0], np.cumsum(speed[1:] * speed[:-1] < 0.0)])
    keeps = turns[first + size : first + size + count] == turns[first : first + count]
    rows = np.flatnonzero(keeps)[::step]
    return mean[rows], torque[rows]
