"""Start values of a Stribeck friction: the rise towards rest that the missing torque asks for at the measured speeds.

A machine that sticks and breaks away hides its friction from a fit that starts a factor of four away: the simulated one
sticks where the real one slides. (One whose static friction is twice the Coulomb level came so slowly near that it was
left behind, 1,800 nats from the truth, and an actuator's lag with wrong numbers was told.) At the measured speeds the
law is linear but for the width and the form of its rise, which are tried one after the other.
"""

import numpy as np

from ...logs.arrays import Values
from ..data.record import Record
from ..data.setting import Setting

WIDTHS = np.geomspace(0.004, 0.5, 24)  # of the top speed [1]
EXPONENTS = (1.0, 2.0)  # Tustin's curve and the Gaussian
SURE = 5.0  # standard deviations of a speed's noise from which on its direction counts as known [1]
SLOWEST = 0.002  # of the top speed, likewise [1]
SAMPLES = 4000  # of the log that are used, evenly spread; up to twice as many
FEWEST = 50  # samples below which nothing is fitted
CARRIED = 10.0  # samples that must carry a rise, as many as make the sum of its squares
DISTINCT = 1e-6  # of a column that must be no sum of the others [1]
CHANCE = 10.0  # times what a rise takes off noise by chance, below which there is none [1]


def stribeck_rise(course: Values, record: Record, numbers: dict[str, float], setting: Setting) -> dict[str, float]:
    """Values by name of the Stribeck friction, with its Coulomb and viscous levels, that fits a missing torque best.

    Args:
        course: the missing torque [N m], NaN where unknown, shape (samples,).
        record: the log.
        numbers: Coulomb and viscous friction of the model beside which it is missing, by name.
        setting: sizes.

    Returns:
        {} where no rise towards rest is found, or too little is known.
    """
    least = max(SURE * record.speed_noise, SLOWEST * setting.speed)
    keep = np.flatnonzero(np.isfinite(course) & (np.abs(record.speed) > least))
    keep = keep[:: max(1, len(keep) // SAMPLES)]
    if len(keep) < FEWEST:
        return {}
    speed, side = record.speed[keep], np.sign(record.speed[keep])
    # What is missing drives the machine; friction brakes it.
    braking = numbers["coulomb"] * side + numbers["viscous"] * speed - course[keep]
    columns = [side, speed, record.acceleration[keep]]
    if np.ptp(side) > 0.0:  # in one direction an offset is a Coulomb friction
        columns.append(np.ones_like(speed))
    common = np.stack([column for column in columns if np.any(column)], axis=1)
    sizes = np.linalg.norm(common, axis=0)
    basis, mixing = np.linalg.qr(common / sizes)
    if np.min(np.abs(np.diag(mixing))) < DISTINCT:
        return {}
    left = braking - basis @ (basis.T @ braking)
    best, found = CHANCE * float(left @ left) / len(left), {}
    for exponent in EXPONENTS:
        for width in WIDTHS[WIDTHS * setting.speed > least] * setting.speed:
            rise = side * np.exp(-((np.abs(speed) / width) ** exponent))
            if np.sum(rise**2) ** 2 < CARRIED * np.sum(rise**4):
                continue
            own = rise - basis @ (basis.T @ rise)
            along, energy = float(own @ left), max(float(own @ own), 1e-300)
            torque = along / energy
            if not (0.0 < torque <= setting.torque and along * torque > best):
                continue
            best = along * torque
            coulomb, viscous = (np.linalg.solve(mixing, basis.T @ (braking - torque * rise)) / sizes)[:2]
            found = {"stribeck_torque": torque, "stribeck_velocity": float(width), "stribeck_exponent": exponent}
            found |= {"coulomb": float(max(coulomb, 0.0)), "viscous": float(max(viscous, 0.0))}
    return found
