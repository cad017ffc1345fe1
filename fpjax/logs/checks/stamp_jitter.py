"""Jitter of the time stamps: a scatter of the position's rate that grows with the speed."""

import numpy as np

from ..noise import rounding_step

LEAST = 256  # [samples]
CLASSES = 8  # of speed, each of as many samples as the others
HEAVY = 3.0  # times the slowest class' standard deviation, by which the fastest must scatter more
JUMPS = 0.998  # of the samples [1]: more than that are single jumps
LOOKED_AT = 400_000  # [samples]


def stamp_jitter(velocity: np.ndarray, position: np.ndarray, dt: float) -> float | None:
    """Rms time between the stamps of the positions and their reading [s]; None where no such jitter is seen.

    A reading that is taken tau late is off by tau times the speed. With independent tau of rms size, the position's
    rate scatters around the velocity column by sqrt(2) v tau / dt. Three other errors look different: sensor noise does
    not grow with the speed, a lag of the velocity column follows the acceleration, and the error of an eccentric scale
    is smooth. So only the scatter from one sample to the next is used, and how it grows with the speed.

    An encoder's steps hide below a step a sample: at rest the reading repeats and does not scatter at all. The error of
    a step is uniform with variance step^2 / 12, so no class counts as quieter than this.

    Args:
        velocity: [rad/s], shape (samples,), on the uniform grid.
        position: [rad], shape (samples,).
        dt: control period [s].
    """
    velocity, position = velocity[:LOOKED_AT], position[:LOOKED_AT]
    if velocity.size < LEAST:
        return None
    # The second difference of the mismatch: a lag, a bias and a scale error are smooth and vanish in it.
    mismatch = np.diff(position) / dt - 0.5 * (velocity[1:] + velocity[:-1])
    rough = np.diff(mismatch, n=2)
    speed = np.abs(velocity[1:-2])
    # A position that wraps at a turn jumps by most of its range.
    wraps = np.abs(np.diff(position)) > 0.5 * np.ptp(position)
    whole = ~(wraps[:-2] | wraps[1:-1] | wraps[2:])
    rough, speed = rough[whole], speed[whole]
    if speed.size < LEAST // 2:
        return None
    order = np.argsort(speed)
    classes = np.array_split(order, CLASSES)
    # The variance in each class from the median of the squares, which ignores single jumps. The median of chi-squared
    # with one degree of freedom is 0.455.
    scatter = np.array([np.median(rough[each] ** 2) / 0.455 for each in classes])
    scatter = np.maximum(scatter, 20.0 * rounding_step(position) ** 2 / 12.0 / dt**2)
    square = np.array([np.mean(speed[each] ** 2) for each in classes])
    # straight line through (v^2, variance): its slope is the jitter's part, its value at v = 0 the sensor noise's
    centred = square - square.mean()
    spread = float(centred @ centred)
    if not spread > 0.0 or not np.all(np.isfinite(scatter)):
        return None
    slope = float(centred @ scatter) / spread
    floor = float(scatter.mean()) - slope * float(square.mean())
    if slope <= 0.0 or scatter[-1] < HEAVY**2 * max(scatter[0], 1e-300) or slope * square[-1] < HEAVY * abs(floor):
        return None
    # `rough` holds third differences of the position over dt: independent errors tau v of the readings have there a
    # variance of (1 + 9 + 9 + 1) tau^2 v^2 / dt^2. Where a few readings are far off their stamps (a bus that is busy
    # now and then), the median knows nothing of them: the mean square does, all but of single jumps.
    fastest = rough[classes[-1]] ** 2
    most = float(np.mean(np.minimum(fastest, np.quantile(fastest, JUMPS)))) - max(floor, 0.0)
    return float(dt * np.sqrt(max(slope, most / square[-1]) / 20.0))
