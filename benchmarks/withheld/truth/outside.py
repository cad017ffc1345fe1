"""What no effect of the vocabulary explains: disturbances, wandering torque, hysteresis, losses."""

import numpy as np

from .effects import Plan, sign
from .machine import Machine
from .systems import spread


def disturbance_sine(plan: Plan, machine: Machine, rng: np.random.Generator) -> str:
    """A torque at a frequency of its own, locked to time and to nothing else."""
    amplitude = plan.draw.coulomb * spread(rng, 0.12, 0.5)
    frequency = spread(rng, 0.8, 15.0)
    time = np.arange(len(machine.reference) + 1) * machine.dt
    wave = np.sin(2 * np.pi * frequency * time + rng.uniform(0, 6.28))
    machine.disturbance = amplitude * wave
    return f"sine {amplitude:.3g} N m at {frequency:.2f} Hz"


def disturbance_walk(plan: Plan, machine: Machine, rng: np.random.Generator) -> str:
    """A random walk with a weak return to zero (its standard deviation is `size`)."""
    size, constant = plan.draw.coulomb * spread(rng, 0.12, 0.4), spread(rng, 0.3, 3.0)
    count = len(machine.reference) + 1
    keep = np.exp(-machine.dt / constant)
    steps = rng.normal(size=count) * size * np.sqrt(1 - keep**2)
    walk = np.zeros(count)
    walk[0] = size * rng.normal()
    for k in range(1, count):
        walk[k] = keep * walk[k - 1] + steps[k]
    machine.disturbance = walk
    return f"random walk {size:.3g} N m, returns within {constant:.2f} s"


def disturbance_pulses(plan: Plan, machine: Machine, rng: np.random.Generator) -> str:
    """Something hits or pulls the machine at a few times."""
    time = np.arange(len(machine.reference) + 1) * machine.dt
    machine.disturbance = np.zeros(len(time))
    count = int(rng.integers(4, 9))
    for _ in range(count):
        start, width = time[-1] * rng.uniform(0.05, 0.95), spread(rng, 0.03, 0.3)
        size = sign(rng) * plan.draw.coulomb * spread(rng, 0.3, 1.2)
        machine.disturbance += size * ((time >= start) & (time < start + width))
    return f"{count} pulses"


def hysteresis(plan: Plan, machine: Machine, rng: np.random.Generator) -> str:
    """A spring to a position that follows with play (a cable loom): a play operator's torque."""
    amplitude = plan.draw.coulomb * spread(rng, 0.25, 0.8)
    travel = 0.35 * plan.draw.kind.speed
    play, width = travel * spread(rng, 0.25, 0.8), travel * spread(rng, 0.5, 1.5)
    machine.physics |= {
        "hysteresis": amplitude,
        "hysteresis_play": play,
        "hysteresis_width": width,
        "start_position": 0.2 * machine.physics["start_position"] * travel,
    }
    return f"play {play:.3g} rad, spring saturating at {amplitude:.3g} N m over {width:.3g} rad"


def _losses(periods: int, rng: np.random.Generator, share: float, longest: int) -> np.ndarray:
    mask = np.zeros(periods, bool)
    while mask.mean() < share:
        start = int(rng.integers(1, periods))
        mask[start : start + int(rng.integers(2, longest + 1))] = True
    mask[0] = False
    return mask


def held_readings(plan: Plan, machine: Machine, rng: np.random.Generator) -> str:
    """The rate reading is stale for stretches: the controller and the log get the last value."""
    share, longest = spread(rng, 0.03, 0.15), int(rng.integers(6, 25))
    machine.held_reading = _losses(len(machine.reference), rng, share, longest)
    return f"{100 * share:.0f} % of the readings held, up to {longest} samples"


def dropped_commands(plan: Plan, machine: Machine, rng: np.random.Generator) -> str:
    """Commands are lost for stretches: the drive goes on with the last one, the log does not."""
    share, longest = spread(rng, 0.03, 0.12), int(rng.integers(8, 30))
    machine.held_command = _losses(len(machine.reference), rng, share, longest)
    return f"{100 * share:.0f} % of the commands dropped, up to {longest} samples"


OUTSIDE = {
    function.__name__: function
    for function in (
        disturbance_sine,
        disturbance_walk,
        disturbance_pulses,
        hysteresis,
        held_readings,
        dropped_commands,
    )
}
