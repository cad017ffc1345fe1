"""When the readings were really taken: a scatter of the position's rate that grows with the speed."""

import numpy as np

LEAST = 256  # samples
CLASSES = 8  # of speed, of equal counts
HEAVY = 3.0  # times: how much more the fastest class scatters than the slowest
LOOKED_AT = 400_000  # samples


def stamp_jitter(velocity: np.ndarray, position: np.ndarray, dt: float) -> float | None:
    """How far off their stamps the positions were read [s, rms]; None where none of it is seen.

    A reading that is taken tau late is off by tau times the speed. Two of them make the position's rate scatter around
    the velocity column by v tau / (sqrt(2) dt). Sensor noise does not grow with the speed, a lag of the velocity column
    follows the acceleration, and an eccentric scale is smooth: what counts is the scatter from one sample to the next.

    Args:
        velocity: [rad/s], shape (samples,), on the uniform grid.
        position: [rad], shape (samples,).
        dt: [s].
    """
    velocity, position = velocity[:LOOKED_AT], position[:LOOKED_AT]
    if velocity.size < LEAST:
        return None
    # the second difference of the mismatch: a lag, a bias, a scale error are smooth and leave none of it
    mismatch = np.diff(position) / dt - 0.5 * (velocity[1:] + velocity[:-1])
    rough = np.diff(mismatch, n=2)
    speed = np.abs(velocity[1:-2])
    order = np.argsort(speed)
    classes = np.array_split(order, CLASSES)
    # medians: a jump of the position at a turn's end is one sample
    scatter = np.array([np.median(rough[each] ** 2) / 0.455 for each in classes])  # of chi2 with one degree: its median
    square = np.array([np.mean(speed[each] ** 2) for each in classes])
    centred = square - square.mean()
    spread = float(centred @ centred)
    if not spread > 0.0 or not np.all(np.isfinite(scatter)):
        return None
    slope = float(centred @ scatter) / spread
    floor = float(scatter.mean()) - slope * float(square.mean())
    if slope <= 0.0 or scatter[-1] < HEAVY**2 * max(scatter[0], 1e-300) or slope * square[-1] < HEAVY * abs(floor):
        return None
    # rates of independent readings: third differences of the position have a variance of 1 + 9 + 9 + 1
    return float(dt * np.sqrt(slope / 20.0))
