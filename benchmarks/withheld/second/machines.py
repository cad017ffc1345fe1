"""Six types of machines from a hobby servo to a gantry, with the resolutions of their drives."""

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class Kind:
    """A type of machine; SI units of its motion (rotary: kg m^2, N m, rad; linear: kg, N, m)."""

    name: str
    linear: bool
    inertia: float
    coulomb: float
    viscous: float
    speed: float  # of its references, [rad/s] or [m/s]
    travel: float  # farthest from the start [rad] or [m]
    bandwidth: tuple[float, float]  # of the velocity loop [rad/s]
    rate_noise: float  # of a rate sensor, standard deviation
    rate_step: float  # its counts
    encoder_step: float
    torque_bits: int  # the torque's word over twice the rating
    highest: float  # frequency of its references [Hz]


def turn(bits: int) -> float:
    """Step of an encoder with so many bits a turn [rad]."""
    return 2 * np.pi / 2**bits


KINDS = {
    kind.name: kind
    for kind in (
        # name, linear, inertia, coulomb, viscous, speed, travel, bandwidth, rate noise, rate step, encoder, bits, Hz
        Kind("hobby", False, 2.2e-3, 0.06, 6e-3, 6.0, 2.8, (38, 65), 0.02, 0.0153, turn(12), 11, 2.5),
        Kind("joint", False, 0.16, 1.6, 0.45, 2.5, 2.8, (30, 65), 2e-3, 1.1e-3, turn(17), 14, 2.5),
        Kind("motor", False, 6.5e-4, 0.062, 1.1e-3, 42.0, 60.0, (90, 190), 0.012, 0.02, turn(16), 13, 7.0),
        Kind("table", False, 0.85, 6.0, 2.2, 3.6, 9.0, (55, 130), 3e-4, 1.5e-4, turn(20), 16, 3.0),
        Kind("stage", True, 4.2, 6.5, 13.0, 0.45, 0.25, (60, 130), 2.5e-4, 1e-4, 5e-7, 14, 5.0),
        Kind("gantry", True, 92.0, 38.0, 170.0, 0.16, 0.3, (40, 85), 6e-5, 4e-5, 1e-6, 15, 2.0),
    )
}
ROTARY = tuple(name for name, kind in KINDS.items() if not kind.linear)


def between(rng: np.random.Generator, low: float, high: float) -> float:
    """A number of a range, uniform in its logarithm."""
    return float(low * (high / low) ** rng.random())


@dataclass
class Drawn:
    """One machine of a kind, before any effect."""

    kind: Kind
    inertia: float
    coulomb: float
    viscous: float
    bandwidth: float
    rate_noise: float
    encoder_step: float
    compensation: str  # "none", "friction" or "friction and inertia"
    start: float  # position at which the log starts


def draw(kind: Kind, rng: np.random.Generator) -> Drawn:
    """A machine of a kind: a third around its inertia and friction, its encoder finer or coarser."""
    finer = int(rng.integers(-1, 2)) if kind.encoder_step < turn(12) else 0
    return Drawn(
        kind=kind,
        inertia=kind.inertia * between(rng, 0.7, 1.4),
        coulomb=kind.coulomb * between(rng, 0.7, 1.4),
        viscous=kind.viscous * between(rng, 0.6, 1.7),
        bandwidth=between(rng, *kind.bandwidth),
        rate_noise=kind.rate_noise * between(rng, 0.6, 1.6),
        encoder_step=kind.encoder_step * 2.0**finer,
        compensation=("none", "friction", "friction and inertia")[int(rng.integers(3))],
        start=float(rng.uniform(-0.3, 0.3)) * kind.travel,
    )
