"""Small effects that every real machine has and that are not the cause: 3 to 8 % of the torque together."""

import numpy as np

from .effects import Plan, sign, stribeck_table
from .machines import between

ITEMS = ("ripple", "offset", "stribeck", "wave", "asymmetry")
NAMES = {
    "ripple": "cogging",
    "offset": "constant_torque",
    "stribeck": "stribeck",
    "wave": "position_dependent_friction",
    "asymmetry": "asymmetric_friction",
}
# where the cause is of the same place, an item would change its parameters
CLASHES = {
    "ripple": {"cogging", "unbalance"},
    "offset": {"constant_torque", "asymmetric_friction", "velocity_bias"},
    "stribeck": {"stribeck", "presliding", "torque_dead_zone"},
    "wave": {"position_dependent_friction"},
    "asymmetry": {"asymmetric_friction", "constant_torque", "coulomb_error", "velocity_bias"},
}


def add_clutter(plan: Plan, effects: tuple[str, ...], rng: np.random.Generator) -> list[str]:
    """Add two or three small effects; returns the contract's names of what is there beside the cause."""
    total = plan.scales.torque * between(rng, 0.03, 0.08)
    free = [item for item in ITEMS if not CLASHES[item] & set(effects)]
    items = [str(item) for item in rng.choice(free, min(len(free), int(rng.integers(2, 4))), replace=False)]
    if {"offset", "asymmetry"} <= set(items):
        items.remove("asymmetry")
    # The squares of the sizes add up to the square of the total, as rms values of independent torques do.
    shares = rng.dirichlet(np.full(len(items), 2.0))
    kind, values, coulomb = plan.drawn.kind, plan.values, plan.drawn.coulomb
    for item, share in zip(items, np.sqrt(shares), strict=True):
        size = total * float(share)
        if item == "ripple":
            periods = 2 * np.pi * between(rng, 8, 30) / kind.travel if kind.linear else float(rng.integers(14, 45))
            values |= {
                "ripple": np.sqrt(2) * size,
                "ripple_periods": periods,
                "ripple_phase": float(rng.uniform(0, 2 * np.pi)),
            }
        elif item == "offset":
            values["offset"] = values.get("offset", 0.0) + sign(rng) * size
        elif item == "stribeck":
            extra = min(3 * size / coulomb, 0.2)
            speed = kind.speed * between(rng, 0.02, 0.05)
            scale, shape = stribeck_table(rng)
            plan.curve = 1 + extra * shape
            values["curve_speed"] = speed / scale
        elif item == "wave":
            values |= {
                "wave": min(np.sqrt(2) * size / coulomb, 0.3),
                "wave_periods": 2 * np.pi * between(rng, 2, 5) / kind.travel
                if kind.linear
                else float(rng.integers(2, 6)),
                "wave_phase": float(rng.uniform(0, 2 * np.pi)),
            }
        else:
            side = sign(rng) * min(size, 0.2 * coulomb)
            for name, way in (("coulomb_positive", 1), ("coulomb_negative", -1)):
                values[name] += way * side
    return sorted({NAMES[item] for item in items})
