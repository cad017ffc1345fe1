"""Friction of the true machine: a set-valued Coulomb part, a smooth part, and bristles.

The set-valued part is `level(speed) * sign(velocity)`, anything within +-level(0) at rest.
"""

import numpy as np

Parameters = dict[str, np.ndarray]

MAXWELL_ELEMENTS = 8


class Friction:
    """Friction of one group of machines; laws that no machine of the group has are not computed."""

    def __init__(self, p: Parameters):
        self.p = p
        self.directional = bool(np.any(p["coulomb_positive"] != p["coulomb_negative"]))
        self.directional_viscous = bool(np.any(p["viscous_positive"] != p["viscous_negative"]))
        self.stribeck = bool(np.any(p["stribeck_torque"] != 0))
        self.lorentzian = bool(np.any(p["stribeck_shape"] == 1))
        self.ripple = bool(np.any(p["ripple"] != 0))
        self.drift = bool(np.any(p["drift"] != 0))
        self.drag = bool(np.any(p["drag"] != 0))
        # The level stays positive under ripple and drift: a negative one would drive.
        self.floor = 0.02 * np.minimum(p["coulomb_positive"], p["coulomb_negative"])

    def base(self, position: np.ndarray, time: float) -> np.ndarray | float:
        """Change of the Coulomb level with angle and time [N m]."""
        p = self.p
        change = 0.0
        if self.ripple:
            angle = p["ripple_periods"] * position + p["ripple_phase"]
            change = p["ripple"] * (
                np.cos(angle)
                + p["ripple_second"] * np.cos(2 * angle + p["ripple_phase_second"])
                + p["ripple_third"] * np.cos(3 * angle + p["ripple_phase_third"])
            )
        if self.drift:
            change = change + p["drift"] * np.exp(-max(time, 0.0) / p["drift_time"])
        return change

    def coulomb(self, positive: np.ndarray, change: np.ndarray | float) -> np.ndarray:
        """Coulomb level in the direction asked for, never below a floor [N m]."""
        p = self.p
        level = p["coulomb_positive"]
        if self.directional:
            level = np.where(positive, level, p["coulomb_negative"])
        if self.ripple or self.drift:
            level = np.maximum(level + change, self.floor)
        return level

    def near_rest(self, speed: np.ndarray) -> np.ndarray:
        """The extra torque near rest [N m]."""
        p = self.p
        ratio = (speed / p["stribeck_velocity"]) ** p["stribeck_exponent"]
        shape = np.exp(-ratio)
        if self.lorentzian:
            shape = np.where(p["stribeck_shape"] == 1, 1 / (1 + ratio), shape)
        return p["stribeck_torque"] * shape

    def smooth(self, velocity: np.ndarray) -> np.ndarray:
        """Viscous torque and drag [N m]."""
        p = self.p
        viscous = p["viscous_positive"]
        if self.directional_viscous:
            viscous = np.where(velocity >= 0, viscous, p["viscous_negative"])
        if self.drag:
            viscous = viscous + p["drag"] * np.abs(velocity)
        return viscous * velocity


def soft(torque: np.ndarray, level: np.ndarray) -> np.ndarray:
    """What is left of a torque once friction has taken up to `level`: 0 while it sticks."""
    return torque - np.clip(torque, -level, level)


def dahl_travel(relative: np.ndarray, travel: np.ndarray, exponent: np.ndarray) -> np.ndarray:
    """Exact solution of Dahl's dr/ds = sign (1 - r sign)^exponent over a signed travel (in units of C/k).

    `relative` is the bristle force over the Coulomb level, exponents 1/2, 1 and 2 are closed forms.
    """
    sign = np.where(travel >= 0, 1.0, -1.0)
    s = np.abs(travel)
    rest = np.maximum(1 - relative * sign, 0.0)
    left = rest * np.exp(-s)
    if np.any(exponent != 1):
        left = np.where(exponent == 2, rest / (1 + rest * s), left)
        left = np.where(exponent == 0.5, np.maximum(np.sqrt(rest) - s / 2, 0.0) ** 2, left)
    return sign * (1 - left)


def maxwell_shares() -> tuple[np.ndarray, np.ndarray]:
    """Stiffness and strength of the elements, as shares of the total, (elements, 1) each.

    All elements are equally stiff; their strengths grow linearly, so that they slip one after
    the other and the force bends over as a parabola does.
    """
    count = MAXWELL_ELEMENTS
    strength = np.arange(1, count + 1, dtype=float)
    return np.full((count, 1), 1 / count), (strength / strength.sum())[:, None]
