"""Effects outside the vocabulary, of the second generator."""

import numpy as np

from .effects import Plan, sign
from .machines import between
from .world import World


def fading_gain(plan: Plan, world: World, rng: np.random.Generator) -> None:
    """The torque constant changes while the motor warms."""
    plan.values["gain_fade"] = sign(rng) * min(between(rng, 0.12, 0.3) * plan.grow, 0.6)
    plan.values["gain_fade_time"] = between(rng, 4.0, 9.0)


def magnetic_hysteresis(plan: Plan, world: World, rng: np.random.Generator) -> None:
    """Part of the torque follows the command through a memory."""
    plan.values["magnet"] = float(rng.uniform(0.5, 0.9))
    plan.values["magnet_width"] = plan.scales.torque * min(between(rng, 0.35, 0.8) * plan.grow, 2.0)


def rate_limit(plan: Plan, world: World, rng: np.random.Generator) -> None:
    """The drive changes its torque no faster than so."""
    swing = plan.scales.peak * plan.drawn.bandwidth
    plan.values["slew"] = swing * between(rng, 0.35, 0.8) / np.sqrt(plan.grow)


def lost_commands(plan: Plan, world: World, rng: np.random.Generator) -> None:
    """Commands do not come for stretches, and the log does not know."""
    lost = np.zeros(len(world.reference), bool)
    share = min(between(rng, 0.08, 0.2) * plan.grow, 0.5)
    while lost.mean() < share:
        begin = int(rng.integers(1, len(lost)))
        lost[begin : begin + int(rng.integers(8, 40))] = True
    world.lost_commands = lost


def changing_inertia(plan: Plan, world: World, rng: np.random.Generator) -> None:
    """A crank's inertia swings with its angle; a linear axis takes a payload half-way."""
    if plan.drawn.kind.linear:
        change = min(between(rng, 0.25, 0.6) * plan.grow, 1.5)
        plan.values |= {"payload": change, "payload_time": float(rng.uniform(4, 6))}
        plan.nominal["inertia"] *= 1 + change / 2
    else:
        plan.values |= {
            "swing": min(between(rng, 0.25, 0.55) * plan.grow, 0.8),
            "swing_phase": float(rng.uniform(0, 2 * np.pi)),
        }


def wandering_torque(plan: Plan, world: World, rng: np.random.Generator) -> None:
    """A torque that wanders with nothing that is recorded."""
    count, constant = len(world.reference), between(rng, 0.2, 1.5)
    width = max(int(constant / world.dt), 3)
    noise = np.convolve(rng.normal(size=count + 4 * width), np.hanning(width), mode="same")[2 * width : -2 * width]
    world.push = plan.size(rng) * noise / noise.std()


def pushes(plan: Plan, world: World, rng: np.random.Generator) -> None:
    """Somebody leans on the machine a few times."""
    time = np.arange(len(world.reference)) * world.dt
    world.push = np.zeros(len(time))
    for _ in range(int(rng.integers(4, 8))):
        middle, width = time[-1] * rng.uniform(0.05, 0.95), between(rng, 0.05, 0.3)
        hump = np.maximum(1 - np.abs(time - middle) / width, 0)
        world.push += sign(rng) * 3 * plan.size(rng) * hump


def two_tone_torque(plan: Plan, world: World, rng: np.random.Generator) -> None:
    """A neighbour's vibration: two tones of time."""
    time = np.arange(len(world.reference)) * world.dt
    slow, fast = between(rng, 1.5, 4.0), between(rng, 5.0, 14.0)
    size = plan.size(rng)
    world.push = size * (np.sin(2 * np.pi * slow * time) + np.sin(2 * np.pi * fast * time + rng.uniform(0, 6)))


OUTSIDE = {
    function.__name__: function
    for function in (
        fading_gain,
        magnetic_hysteresis,
        rate_limit,
        lost_commands,
        changing_inertia,
        wandering_torque,
        pushes,
        two_tone_torque,
    )
}
