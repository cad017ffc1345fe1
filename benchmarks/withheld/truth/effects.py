"""The 24 effects as physics: each draws its law and its size and changes the true machine.

An effect changes `Plan.physics` (the truth) or `Plan.nominal` (what the model says) and writes the
contract's parameters, true values of the real machine, into `Plan.parameters`.

Where a law has no exact counterpart in the contract the label says what is meant: of a
non-sinusoidal position dependence `amplitude` is that of the fundamental; of Maxwell-slip bristles
`bristle_stiffness` is the initial one and `bristle_deflection` = Coulomb / initial stiffness; of a
Stribeck curve with another exponent `stribeck_velocity` is its own velocity scale.
"""

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from ..contract import EFFECTS as NAMES
from .systems import Draw, spread

Physics = dict[str, float]


@dataclass
class Plan:
    """A case being put together."""

    draw: Draw
    physics: Physics
    nominal: dict[str, float]
    peak: float  # largest torque the reference needs [N m]
    parameters: dict[str, dict[str, float]] = field(default_factory=dict)
    laws: dict[str, str] = field(default_factory=dict)
    together: tuple[str, ...] = ()


def off(rng: np.random.Generator, low: float, high: float) -> float:
    """A factor of 1 + d or 1 / (1 + d), d drawn from low to high, uniform in its logarithm."""
    size = 1 + spread(rng, low, high)
    return size if rng.random() < 0.5 else 1 / size


def sign(rng: np.random.Generator) -> float:
    return 1.0 if rng.random() < 0.5 else -1.0


def coulomb_error(plan: Plan, rng: np.random.Generator) -> None:
    plan.nominal["coulomb"] *= off(rng, 0.1, 0.5)
    plan.parameters["coulomb_error"] = {"coulomb": plan.draw.coulomb}


def viscous_error(plan: Plan, rng: np.random.Generator) -> None:
    plan.nominal["viscous"] *= off(rng, 0.25, 1.5)
    plan.parameters["viscous_error"] = {"viscous": plan.draw.viscous}


def inertia_error(plan: Plan, rng: np.random.Generator) -> None:
    plan.nominal["inertia"] *= off(rng, 0.08, 0.35)
    plan.parameters["inertia_error"] = {"inertia": plan.draw.inertia}


def stribeck(plan: Plan, rng: np.random.Generator) -> None:
    torque = plan.draw.coulomb * spread(rng, 0.15, 0.7)
    velocity = plan.draw.kind.speed * spread(rng, 0.015, 0.08)
    name, shape, exponent = STRIBECK[int(rng.integers(len(STRIBECK)))]
    plan.physics |= {
        "stribeck_torque": torque,
        "stribeck_velocity": velocity,
        "stribeck_exponent": exponent,
        "stribeck_shape": shape,
    }
    plan.parameters["stribeck"] = {"stribeck_torque": torque, "stribeck_velocity": velocity}
    plan.laws["stribeck"] = name


STRIBECK = [
    ("Tustin exp(-v/vs)", 0.0, 1.0),
    ("Gaussian exp(-(v/vs)^2)", 0.0, 2.0),
    ("Gaussian exp(-(v/vs)^2)", 0.0, 2.0),
    ("exp(-(v/vs)^0.5)", 0.0, 0.5),
    ("exp(-(v/vs)^1.5)", 0.0, 1.5),
    ("Lorentzian 1/(1+(v/vs)^2)", 1.0, 2.0),
]


def presliding(plan: Plan, rng: np.random.Generator) -> None:
    draw = plan.draw
    # 0.7 to 7 ms of motion at top speed.
    deflection = draw.kind.speed * spread(rng, 0.7e-3, 7e-3)
    name, kind, exponent = BRISTLES[int(rng.integers(len(BRISTLES)))]
    stiffness = draw.coulomb / deflection
    # Dahl friction has hysteresis of its own, and needs less damping than LuGre.
    ratio = spread(rng, 0.1, 0.8) if kind != 2 else spread(rng, 0.03, 0.3)
    plan.physics |= {
        "bristle_kind": kind,
        "bristle_stiffness": stiffness,
        "bristle_damping": 2 * ratio * np.sqrt(stiffness * draw.inertia),
        "bristle_exponent": exponent,
    }
    plan.parameters["presliding"] = {
        "bristle_deflection": deflection,
        "bristle_stiffness": stiffness,
    }
    plan.laws["presliding"] = name


BRISTLES = [
    ("LuGre", 1.0, 1.0),
    ("LuGre", 1.0, 1.0),
    ("Dahl, exponent 1", 2.0, 1.0),
    ("Dahl, exponent 2", 2.0, 2.0),
    ("Dahl, exponent 1/2", 2.0, 0.5),
    ("Maxwell slip", 3.0, 1.0),
]


def asymmetric_friction(plan: Plan, rng: np.random.Generator) -> None:
    c, b = plan.draw.coulomb, plan.draw.viscous
    variant = ("opposite Coulomb", "one Coulomb", "viscous", "both")[int(rng.integers(4))]
    size = sign(rng) * spread(rng, 0.08, 0.3)
    positive, negative, v_positive, v_negative = c, c, b, b
    if variant in ("opposite Coulomb", "both"):
        positive, negative = c * (1 + size), c * (1 - size)
    if variant == "one Coulomb":
        positive, negative = (c * (1 + size), c) if rng.random() < 0.5 else (c, c * (1 + size))
    if variant in ("viscous", "both"):
        other = sign(rng) * spread(rng, 0.2, 0.6)
        v_positive, v_negative = b * (1 + other), b * (1 - other)
    plan.physics |= {
        "coulomb_positive": positive,
        "coulomb_negative": negative,
        "viscous_positive": v_positive,
        "viscous_negative": v_negative,
    }
    found = {}
    if variant != "viscous":
        found |= {"coulomb_positive": positive, "coulomb_negative": negative}
    if variant in ("viscous", "both"):
        found |= {"viscous_positive": v_positive, "viscous_negative": v_negative}
    plan.parameters["asymmetric_friction"] = found
    plan.laws["asymmetric_friction"] = variant


def position_dependent_friction(plan: Plan, rng: np.random.Generator) -> None:
    amplitude = plan.draw.coulomb * spread(rng, 0.1, 0.4)
    slow = plan.draw.kind.name == "gimbal"
    periods = float(rng.integers(2, 9)) if slow else float(rng.integers(1, 7))
    # Two of three are not sinusoidal: a machine's dependence on the angle rarely is.
    sharp = rng.random() < 0.7
    second, third = (rng.uniform(0.1, 0.4), rng.uniform(0.0, 0.3)) if sharp else (0.0, 0.0)
    plan.physics |= {
        "ripple": amplitude,
        "ripple_periods": periods,
        "ripple_phase": float(rng.uniform(0, 2 * np.pi)),
        "ripple_second": second,
        "ripple_third": third,
        "ripple_phase_second": float(rng.uniform(0, 2 * np.pi)),
        "ripple_phase_third": float(rng.uniform(0, 2 * np.pi)),
    }
    plan.parameters["position_dependent_friction"] = {"amplitude": amplitude, "periods": periods}
    plan.laws["position_dependent_friction"] = f"harmonics 1 : {second:.2f} : {third:.2f}" if sharp else "sine"


def friction_drift(plan: Plan, rng: np.random.Generator) -> None:
    amplitude = plan.draw.coulomb * spread(rng, 0.12, 0.6)
    constant = spread(rng, 0.8, 5.0)
    plan.physics |= {"drift": amplitude, "drift_time": constant}
    plan.parameters["friction_drift"] = {"amplitude": amplitude, "time_constant": constant}


def quadratic_drag(plan: Plan, rng: np.random.Generator) -> None:
    coefficient = plan.draw.coulomb * spread(rng, 0.12, 0.7) / plan.draw.kind.speed**2
    plan.physics["drag"] = coefficient
    plan.parameters["quadratic_drag"] = {"coefficient": coefficient}


def _two_mass(plan: Plan, rng: np.random.Generator, frequency: float, share: float) -> float:
    """Splits inertia and friction; returns the stiffness for a free-free frequency [Hz]."""
    reduced = plan.draw.inertia * share * (1 - share)
    where = ("motor", "load", "shared")[int(rng.integers(3))]
    load = {"motor": 0.0, "load": 1.0, "shared": rng.uniform(0.25, 0.75)}[where]
    plan.physics |= {"load_share": share, "friction_load_share": load}
    plan.laws["two_mass"] = f"load share {share:.2f}, friction on {where}"
    return reduced * (2 * np.pi * frequency) ** 2


def backlash(plan: Plan, rng: np.random.Generator) -> None:
    draw = plan.draw
    # 0.8 to 8 ms of motion at top speed.
    gap = draw.kind.speed * spread(rng, 0.8e-3, 8e-3)
    share = rng.uniform(0.3, 0.7)
    frequency = spread(rng, 50, 200)
    stiffness = _two_mass(plan, rng, frequency, share)
    # A load without friction of its own would rattle for ever: some of the friction is put behind the backlash.
    plan.physics["friction_load_share"] = float(np.clip(plan.physics["friction_load_share"], 0.15, 0.85))
    ratio = spread(rng, 0.05, 0.6)
    reduced = draw.inertia * share * (1 - share)
    plan.physics |= {
        "transmission": 2.0,
        "gap": gap,
        "stiffness": stiffness,
        "damping": 2 * ratio * np.sqrt(stiffness * reduced),
    }
    plan.parameters["backlash"] = {"gap": gap}
    plan.laws["backlash"] = (
        f"contact {frequency:.0f} Hz, damping ratio {ratio:.2f}, sensors on motor, " + plan.laws.pop("two_mass")
    )


def compliance(plan: Plan, rng: np.random.Generator) -> None:
    draw = plan.draw
    share = rng.uniform(0.2, 0.6)
    on_load = rng.random() < 0.4
    frequency = spread(rng, 14, 70)
    ratio = spread(rng, 0.015, 0.12) if not on_load else spread(rng, 0.05, 0.15)
    stiffness = _two_mass(plan, rng, frequency, share)
    reduced = draw.inertia * share * (1 - share)
    if on_load:
        # With the sensor behind the spring the loop is stable up to a bandwidth of about 2 zeta omega.
        _slow_down(plan, 1.0 * ratio * 2 * np.pi * frequency)
    plan.physics |= {
        "transmission": 1.0,
        "stiffness": stiffness,
        "damping": 2 * ratio * np.sqrt(stiffness * reduced),
        "sensor_on_load": float(on_load),
    }
    plan.parameters["compliance"] = {"frequency": frequency, "stiffness": stiffness}
    plan.laws["compliance"] = (
        f"damping ratio {ratio:.3f}, sensors on {'load' if on_load else 'motor'}, " + plan.laws.pop("two_mass")
    )


def _slow_down(plan: Plan, bandwidth: float) -> None:
    """Lower the controller's gains to a bandwidth [rad/s] that the effect leaves stable."""
    factor = min(1.0, bandwidth / plan.draw.bandwidth)
    plan.draw.bandwidth *= factor
    plan.physics["kp"] *= factor
    plan.physics["ki"] *= factor**2


def unbalance(plan: Plan, rng: np.random.Generator) -> None:
    amplitude = plan.draw.coulomb * spread(rng, 0.08, 0.6)
    plan.physics |= {"unbalance": amplitude, "unbalance_phase": float(rng.uniform(0, 2 * np.pi))}
    plan.parameters["unbalance"] = {"amplitude": amplitude}


def cogging(plan: Plan, rng: np.random.Generator) -> None:
    amplitude = plan.draw.coulomb * spread(rng, 0.06, 0.35)
    low, high = {"gimbal": (6, 25), "servo": (4, 13), "drive": (6, 31)}[plan.draw.kind.name]
    periods = float(rng.integers(low, high))
    # Half of them with a second harmonic.
    second = float(rng.uniform(0.05, 0.3)) if rng.random() < 0.5 else 0.0
    plan.physics |= {
        "cogging": amplitude,
        "cogging_periods": periods,
        "cogging_phase": float(rng.uniform(0, 2 * np.pi)),
        "cogging_second": second,
        "cogging_phase_second": float(rng.uniform(0, 2 * np.pi)),
    }
    plan.parameters["cogging"] = {"amplitude": amplitude, "periods": periods}
    plan.laws["cogging"] = f"second harmonic {second:.2f}"


def constant_torque(plan: Plan, rng: np.random.Generator) -> None:
    torque = sign(rng) * plan.draw.coulomb * spread(rng, 0.05, 0.4)
    plan.physics["constant_torque"] = torque
    plan.parameters["constant_torque"] = {"torque": torque}


def torque_gain_error(plan: Plan, rng: np.random.Generator) -> None:
    gain = off(rng, 0.05, 0.25)
    plan.physics["gain"] = gain
    plan.parameters["torque_gain_error"] = {"gain": gain}


def _time(plan: Plan, rng: np.random.Generator) -> float:
    """A lag or a delay that the loop can stand: 4 to 25 % of a radian at its bandwidth [s]."""
    return float(np.clip(spread(rng, 0.05, 0.28) / plan.draw.bandwidth, 7e-4, 9e-3))


def actuator_lag(plan: Plan, rng: np.random.Generator) -> None:
    plan.physics["actuator_lag"] = value = _time(plan, rng)
    plan.parameters["actuator_lag"] = {"time_constant": value}


def velocity_lag(plan: Plan, rng: np.random.Generator) -> None:
    plan.physics["velocity_lag"] = value = _time(plan, rng)
    plan.parameters["velocity_lag"] = {"time_constant": value}


def actuator_delay(plan: Plan, rng: np.random.Generator) -> None:
    plan.physics["actuator_delay"] = value = _time(plan, rng)
    plan.parameters["actuator_delay"] = {"delay": value}


def velocity_delay(plan: Plan, rng: np.random.Generator) -> None:
    plan.physics["velocity_delay"] = value = _time(plan, rng)
    plan.parameters["velocity_delay"] = {"delay": value}


def torque_saturation(plan: Plan, rng: np.random.Generator) -> None:
    # Below the largest torque that the reference needs, so that it acts.
    limit = plan.peak * rng.uniform(0.6, 0.9)
    # Seven of ten are hard; the others bend with a power of 20 to 40.
    softness = 0.0 if rng.random() < 0.7 else 1 / rng.uniform(20, 40)
    plan.physics |= {"limit": limit, "softness": softness}
    plan.parameters["torque_saturation"] = {"limit": limit}
    plan.laws["torque_saturation"] = "hard" if softness == 0 else f"soft, power {1 / softness:.0f}"


def torque_dead_zone(plan: Plan, rng: np.random.Generator) -> None:
    width = plan.draw.coulomb * spread(rng, 0.05, 0.35)
    plan.physics["dead_zone"] = width
    plan.parameters["torque_dead_zone"] = {"width": width}


def velocity_bias(plan: Plan, rng: np.random.Generator) -> None:
    # 0.8 to 5 % of the top speed.
    bias = sign(rng) * plan.draw.kind.speed * spread(rng, 0.008, 0.05)
    plan.physics["bias"] = bias
    plan.parameters["velocity_bias"] = {"bias": bias}


def velocity_scale_error(plan: Plan, rng: np.random.Generator) -> None:
    scale = off(rng, 0.04, 0.2)
    plan.physics["scale"] = scale
    plan.parameters["velocity_scale_error"] = {"scale": scale}


def velocity_quantisation(plan: Plan, rng: np.random.Generator) -> None:
    # Well above the noise, which would dither the steps away.
    step = plan.draw.velocity_noise * spread(rng, 6, 40)
    plan.physics["velocity_step"] = step
    plan.parameters["velocity_quantisation"] = {"step": step}


EFFECTS: dict[str, Callable[[Plan, np.random.Generator], None]] = {
    name: globals()[name] for name in NAMES if name != "load_dependent_friction"
}

# Effects that are not combined in a pair: exact twins, or two of the same place in the loop.
EXCLUSIVE: tuple[frozenset[str], ...] = (
    frozenset({"actuator_lag", "velocity_lag", "actuator_delay", "velocity_delay", "compliance"}),
    frozenset({"constant_torque", "asymmetric_friction", "velocity_bias"}),
    frozenset({"torque_gain_error", "velocity_scale_error", "inertia_error", "coulomb_error", "viscous_error"}),
    frozenset({"backlash", "compliance", "presliding", "velocity_quantisation"}),
    frozenset({"presliding", "stribeck", "torque_dead_zone"}),
    frozenset({"coulomb_error", "asymmetric_friction", "torque_dead_zone", "friction_drift"}),
    frozenset({"viscous_error", "asymmetric_friction", "quadratic_drag"}),
)


def compatible(first: str, second: str) -> bool:
    """Whether two effects make a pair that can be distinguished in principle."""
    return first != second and not any({first, second} <= group for group in EXCLUSIVE)
