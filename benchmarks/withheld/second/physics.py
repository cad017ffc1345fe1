"""The laws of the second generator on many machines at once: friction, waves, contact, actuator.

Every function takes arrays with the machines last (elements or table points first) and has no state of its own.
"""

import numpy as np

# Friction is a Maxwell-slip model: parallel elements, each a spring in series with a slider, which slip one after the
# other. Presliding then has hysteresis, by another law than the bristles of the vocabulary.
ELEMENTS = 6
POINTS = 65  # of a tabulated Stribeck curve, uniform in v / (v + vs)
LIMITS = np.array([0.12, 0.14, 0.18, 0.2, 0.18, 0.18])  # share of each element in the level
YIELDS = np.array([0.25, 0.5, 0.8, 1.1, 1.6, 2.4])  # deflection at which each slips, in the mean one
INITIAL = float(np.sum(LIMITS / YIELDS))  # initial stiffness, in level / mean deflection
FADES = np.linspace(0, 1, POINTS)


def element_force(
    stretch: np.ndarray,
    speed: np.ndarray,
    up: np.ndarray,
    down: np.ndarray,
    deflection: np.ndarray,
    damping: np.ndarray,
) -> np.ndarray:
    """Force of each Maxwell element, (ELEMENTS, machines).

    Args:
        stretch: of each element's spring, (ELEMENTS, machines).
        speed: of the body.
        up, down: the friction level of either direction.
        deflection: mean yield deflection of a level of `scale` (see `stiffness`).
        damping: of all elements together, while they stick.
    """
    share = LIMITS[:, None]
    force = share * (stretch * deflection / YIELDS[:, None] + damping * speed)
    return np.minimum(np.maximum(force, -share * down), share * up)


def slide(stretch: np.ndarray, up: np.ndarray, down: np.ndarray, stiffness: np.ndarray) -> np.ndarray:
    """The stretch that each element keeps: no more than its level holds."""
    room = YIELDS[:, None] / stiffness
    return np.minimum(np.maximum(stretch, -room * down), room * up)


def table(values: np.ndarray, speed: np.ndarray, scale: np.ndarray) -> np.ndarray:
    """A tabulated law of the speed's size, (POINTS, machines), linear between its points."""
    size = np.abs(speed)
    place = size / (size + scale) * (POINTS - 1)
    low = np.minimum(place.astype(np.intp), POINTS - 2)
    lanes = np.arange(values.shape[1])
    first = values[low, lanes]
    return first + (place - low) * (values[low + 1, lanes] - first)


def trapezoid(angle: np.ndarray, steepness: np.ndarray) -> np.ndarray:
    """A trapezoidal wave whose fundamental is sin(angle); a steepness of 1 is a triangle."""
    height = np.minimum(np.maximum(2 / np.pi * np.arcsin(np.sin(angle)) * steepness, -1), 1)
    # Divided by the amplitude of its fundamental; a triangle of slope s clipped at 1: 8 s / pi^2 sin(pi / (2 s)).
    return height / (8 * steepness / np.pi**2 * np.sin(np.pi / (2 * steepness)))


def contact(
    twist: np.ndarray, rate: np.ndarray, gap: np.ndarray, stiffness: np.ndarray, loss: np.ndarray
) -> np.ndarray:
    """Hertzian contact behind a clearance: k depth^1.5 (1 + loss x rate), never pulling.

    The damping that grows with the depth is that of Hunt and Crossley ("Coefficient of restitution interpreted as
    damping in vibroimpact", 1975): no torque jumps where a contact begins.
    """
    depth = np.abs(twist) - gap / 2
    inside = np.maximum(depth, 0.0)
    side = np.sign(twist)
    return side * stiffness * inside * np.sqrt(inside) * np.maximum(1 + loss * side * rate, 0.0)


def spring(
    twist: np.ndarray, rate: np.ndarray, stiffness: np.ndarray, hardening: np.ndarray, damping: np.ndarray
) -> np.ndarray:
    """A spring that hardens with its twist, with damping."""
    return stiffness * twist * (1 + hardening * twist * twist) + damping * rate


def soft_limit(torque: np.ndarray, limit: np.ndarray, power: np.ndarray) -> np.ndarray:
    """u / (1 + |u / limit|^p)^(1/p)."""
    share = np.minimum(np.abs(torque) / limit, 1e3)
    return torque / (1 + share**power) ** (1 / power)


def dead_zone(torque: np.ndarray, width: np.ndarray, rounding: np.ndarray) -> np.ndarray:
    """The first `width` is lost, with a rounded knee."""
    over = np.abs(torque) - width
    passed = 0.5 * (over + np.sqrt(over * over + rounding * rounding))
    rest = 0.5 * (-width + np.sqrt(width * width + rounding * rounding))
    return np.sign(torque) * np.maximum(passed - rest, 0.0)
