"""The modes of a window, made from its length, the machine's inertia and the sensors' noise."""

import functools
import math

import numpy as np

from ...blocks.friction.base import faded
from ...logs.arrays import Values
from .bursts import TILE
from .modes import PER_OCTAVE, Modes

PLAIN = 8  # modes of the lowest octaves, which are not rotated: each is as long as the window
FIRST_BAND = 4  # modes of the lowest octave: a window's start values take up two of them
FINEST, COARSEST = 0.03, 1e7  # range of q that is tried, over the q that equals the noise in the strongest mode


@functools.lru_cache(maxsize=16)
def make_modes(
    samples: int, dt: float, inertia: float, rate_noise: float, angle_noise: float, most: int = 0,
    damping: float = 0.0, guide: tuple[float, float] = (0.0, 0.0),
) -> Modes:  # fmt: skip
    """The modes of a window.

    Args:
        samples: of the window.
        dt: control period [s].
        inertia: nominal J [kg m^2].
        rate_noise: standard deviation of a rate reading [rad/s]; 0 for no rate sensor.
        angle_noise: of a position reading [rad]; 0 for none.
        most: modes with torque that are kept; 0 for all.
        damping: slope of the nominal friction over the inertia [1/s] (`Setting.damping`).
        guide: stiffness [1/s^2] and damping [1/s] by which the simulation is held near the motion.
    """
    basis, size, course = _singular(samples, dt, inertia, rate_noise, angle_noise, damping, guide)
    both = rate_noise > 0.0 and angle_noise > 0.0
    count = basis.shape[1]
    gain, torque = np.ones(count), np.zeros((samples, count))
    alive = np.zeros(count, bool)
    # Smaller singular values are rounding errors of the decomposition.
    alive[: len(size)] = size > 1e-13 * size[0]
    gain[alive] = size[alive[: len(size)]] ** 2
    torque[:, alive] = course.T[:, alive[: len(size)]]
    place = np.arange(count)
    band = np.floor(np.log2(np.maximum(place / FIRST_BAND, 0.5))).astype(int) + 1
    last = int(np.max(band[alive]))
    # Octave 0 has the first FIRST_BAND modes, octave 1 as many, then each twice as many as the one before.
    if np.sum(alive & (band == last)) < FIRST_BAND * 2 ** (last - 1) / 2:  # a rest joins the octave below
        band[band >= last] = last - 1
    last = int(np.max(band[alive]))
    keep = ~alive if both else np.zeros(count, bool)
    keep = keep | (alive & (place < (most or count)))  # place: singular values are in descending order
    # With one sensor, a mode that holds no torque is noise alone: in the last octave, with lambda zero.
    gain = np.where(alive, gain, 1.0 if both else 0.0)
    grid = np.concatenate(
        [[0.0], FINEST * 2.0 ** (np.arange(PER_OCTAVE * math.ceil(math.log2(COARSEST / FINEST))) / PER_OCTAVE)]
    )
    torques = int(np.max(band[keep & alive])) + 1
    band = np.where(alive, band, torques if both else last)
    levels = np.repeat(grid[:, None] / np.sqrt(gain[0]), torques, axis=1)
    if both:
        levels = np.concatenate([levels, np.minimum(grid, 1e5)[:, None]], axis=1)
    # The course of mode k has about k half periods within the window, as a sine of the integrator's modes has.
    frequency = (place + 0.5) / (2.0 * samples * dt)
    kept = np.flatnonzero(keep)
    turn, flat, tile = _turned(place[kept], alive[kept], gain[kept], torque[:, kept])
    return Modes(
        np.ascontiguousarray(basis[:, kept] @ turn), turn, flat, tile, gain[kept], torque[:, kept], band[kept],
        frequency[kept], levels, (~alive)[kept], inertia, np.zeros(levels.shape[1]),
    )  # fmt: skip


@functools.lru_cache(maxsize=4)
def _singular(
    samples: int, dt: float, inertia: float, rate_noise: float, angle_noise: float, damping: float,
    guide: tuple[float, float],
) -> tuple[Values, Values, Values]:  # fmt: skip
    """Singular value decomposition of the readings of a torque in each period; arguments as of `make_modes`."""
    index = np.arange(samples)
    lag = index[:, None] - index[None, :]  # samples from the period j in which a torque acts to the reading k
    held = lag > 0
    parts = []
    speed, travel = _pushed(samples, dt, damping, guide)
    if rate_noise > 0.0:
        parts.append(np.where(held, speed[np.maximum(lag, 0)] / inertia, 0.0) / rate_noise)
    if angle_noise > 0.0:
        parts.append(np.where(held, travel[np.maximum(lag, 0)] / inertia, 0.0) / angle_noise)
    return np.linalg.svd(np.concatenate(parts), full_matrices=len(parts) == 2)


def _pushed(samples: int, dt: float, damping: float, guide: tuple[float, float]) -> tuple[Values, Values]:
    """(speed [s], travel [s^2]) of a residual at each sample after one period of unit torque over inertia began.

    As `fpjax.gap.simulate.replay.advance` simulates it: the friction of a period acts at its mean speed, the guide
    pushes at its end, and what the guide has added is taken off the residual.
    """
    stiffness, firm = guide
    final, mean = (float(share) for share in faded(damping * dt))
    speed = angle = added = travelled = 0.0
    found = np.zeros((2, samples))
    for k in range(samples):
        found[:, k] = speed - added, angle - travelled
        push = dt * (-stiffness * angle - firm * speed)
        gained = dt * ((1.0 if k == 0 else 0.0) - damping * speed)
        angle, speed = angle + dt * (speed + mean * gained + 0.5 * push), speed + final * gained + push
        travelled, added = travelled + dt * (added + 0.5 * push), added + push
    return found[0], found[1]


def _turned(place: Values, alive: Values, gain: Values, torque: Values) -> tuple[Values, Values, Values]:
    """(rotation, lambda and tile of the rotated coefficients) of the kept modes; arguments of shape (modes,)."""
    time = np.linspace(-1.0, 1.0, len(torque))[:, None]
    turn, flat, tile = np.eye(len(place)), gain.copy(), np.zeros(len(place), int)
    half = np.floor(2.0 * np.log2(np.maximum(place, 1) / PLAIN)).astype(int)
    octave = np.floor(np.log2(np.maximum(place / FIRST_BAND, 0.5))).astype(int)
    group = np.where(~alive, 10**6, np.where(place < PLAIN, octave - 10**3, half))
    count = 0
    for one in np.unique(group):
        inside = np.flatnonzero(group == one)
        tiles = 1
        if place[inside[0]] >= PLAIN and alive[inside[0]] and len(inside) > TILE:
            # The eigenvectors of the time axis, restricted to the group's modes, are its most local vectors; their
            # eigenvalues are their times, in ascending order, so that neighbours make up a tile.
            course = torque[:, inside]
            turn[np.ix_(inside, inside)] = np.linalg.eigh(course.T @ (time * course))[1]
            flat[inside] = np.mean(gain[inside])
            tiles = round(len(inside) / TILE)
        for some in np.array_split(inside, tiles):
            tile[some] = count
            count += 1
    return turn, flat, tile
