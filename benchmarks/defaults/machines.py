"""Machines drawn at random, as servo.toml files without gains: what a user types who knows the machine only."""

import math
from dataclasses import dataclass

import numpy as np

LENGTHS = (1000, 4000)  # samples of a run; two, because every length compiles programs of its own


@dataclass(frozen=True)
class Drawn:
    """One machine.

    Attributes:
        name: unique.
        text: its servo.toml, without gains.
        inertia: [kg m^2].
        coulomb: [N m].
        viscous: [N m s/rad].
        limit: of the torque [N m].
        dt: control period [s].
        samples: of a run.
    """

    name: str
    text: str
    inertia: float
    coulomb: float
    viscous: float
    limit: float
    dt: float
    samples: int


def draw(number: int, seed: int) -> Drawn:
    """Machine `number`: inertia 1e-5 to 100 kg m^2, Coulomb friction 1 to 60 % of the limit, period 0.2 to 4 ms.

    The torque limit and the motion are drawn for the inertia: the reference needs a tenth to a half of the limit for
    its acceleration, or less where friction leaves less, so that every machine can follow it. A run is one of `LENGTHS`
    and 4 to 12 periods of the reference: 83 to 1000 samples a period, 0.02 to 15 Hz.

    Args:
        number: of the machine.
        seed: of all of them.
    """
    random = np.random.default_rng([seed, number])

    def between(low: float, high: float) -> float:
        """A number of a range, uniform in its logarithm."""
        return float(np.exp(random.uniform(math.log(low), math.log(high))))

    inertia, dt = between(1e-5, 100.0), between(2e-4, 4e-3)
    samples = int(random.choice(LENGTHS))
    duration = (samples - 1) * dt
    frequency = between(4.0, 12.0) / duration  # Hz
    amplitude = between(0.1, 10.0)  # rad/s
    share = random.uniform(0.01, 0.6)  # of the limit that Coulomb friction takes
    drive = random.uniform(0.1, 0.5) * (1.0 - share)  # of the limit that the acceleration takes
    viscous_share = random.uniform(0.02, 0.6) * (1.0 - share - drive)
    # 2 amplitude omega: a typical largest acceleration; the two sines in phase would have 1 + 0.6 x 2.7 = 2.6.
    limit = inertia * 2.0 * amplitude * 2.0 * math.pi * frequency / drive
    # 1.6 x amplitude is the largest speed of the two sines.
    coulomb, viscous = share * limit, viscous_share * limit / (1.6 * amplitude)
    noise = between(1e-5, 1e-3) * amplitude
    text = f"""[plant]
type = "one_mass"
inertia = {inertia:.6g}

[friction]
type = "coulomb_viscous"
coulomb = {coulomb:.6g}
viscous = {viscous:.6g}

[actuator]
limit = {limit:.6g}

[sensor]
noise = {noise:.6g}

[controller]
type = "pi"
limit = {limit:.6g}

[observer]
type = "efp"

[reference]
type = "multisine"
amplitudes = [{amplitude:.6g}, {0.6 * amplitude:.6g}]
frequencies = [{frequency:.6g}, {2.7 * frequency:.6g}]

[simulation]
dt = {dt:.9g}
duration = {duration:.9g}
stepping = "sampled"
solver = "exact"
"""
    return Drawn(f"machine_{number:02d}", text, inertia, coulomb, viscous, limit, dt, samples)
