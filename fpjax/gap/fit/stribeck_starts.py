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
SAMPLES = 4000  # of the log that are used, evenly spread, at least
FEWEST = 50  # samples below which nothing is fitted


def stribeck_rise(course: Values, record: Record, numbers: dict[str, float], setting: Setting) -> dict[str, float]:
    """Values by name of the Stribeck friction, with its Coulomb and viscous levels, that fits a missing torque best.

    Args:
        course: the missing torque [N m], NaN where unknown, shape (samples,).
        record: the log.
        numbers: nominal numbers by name, beside which it is missing.
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
    common = np.stack([side, speed, record.acceleration[keep], np.ones_like(speed)], axis=1)
    common /= np.maximum(sizes := np.linalg.norm(common, axis=0), 1e-300)
    basis, mixing = np.linalg.qr(common)
    left = braking - basis @ (basis.T @ braking)
    best, found = 0.0, {}
    for exponent in EXPONENTS:
        for width in WIDTHS * setting.speed:
            rise = side * np.exp(-((np.abs(speed) / width) ** exponent))
            own = rise - basis @ (basis.T @ rise)
            energy, along = float(own @ own), float(own @ left)
            if along <= 0.0 or energy <= 1e-9 * float(rise @ rise) or along**2 / energy <= best:
                continue
            best, torque = along**2 / energy, along / energy
            coulomb, viscous = (np.linalg.solve(mixing, basis.T @ (braking - torque * rise)) / sizes)[:2]
            found = {"stribeck_torque": torque, "stribeck_velocity": float(width), "stribeck_exponent": exponent}
            found |= {"coulomb": float(max(coulomb, 0.0)), "viscous": float(max(viscous, 0.0))}
    return found
