"""The 25 effects of the contract as the second truth has them: each draws its law and its size.

`size` is the torque that an effect is to add, rms over the log, as a share of all torque. Where the law has another
form than the contract's, `Plan.other_form` holds the effect, and the label says what its parameters mean:
of a wave `amplitude` is that of the fundamental; of Maxwell elements `bristle_stiffness` is the initial one and
`bristle_deflection` the level over it; of a tabulated curve `stribeck_velocity` is where 1/e of the extra is left; of
two poles `time_constant` is their sum; of a knee `width` is what is lost far from it; of a transmission `stiffness` is
that of the linear spring and damper that transmit most nearly its torque over the log's own motion, and `frequency` the
free-free one with it; of friction that grows with the load `coefficient` is the slope of what it adds to the level on
the size of the torque delivered beyond friction, in motion, over the log, beside a constant level. These two are
computed after the simulation (`equivalent.py`); `Plan.parameters` and the label's `law` hold the law's own numbers.
"""

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from ..contract import EFFECTS as NAMES
from .machines import Drawn, between
from .physics import FADES, INITIAL, POINTS


@dataclass
class Scales:
    """What a reference asks of a machine, rms over the log but for `peak`."""

    torque: float
    speed: float
    acceleration: float
    peak: float  # torque that is passed 2 % of the time
    moving: float  # share of the time at more than 2 % of the speed


@dataclass
class Plan:
    """A case being put together."""

    drawn: Drawn
    scales: Scales
    values: dict[str, float]  # the true machine
    nominal: dict[str, float]
    sensors: str
    grow: float = 1.0  # raised where the first draw did not show
    curve: np.ndarray = field(default_factory=lambda: np.ones(POINTS))
    parameters: dict[str, dict[str, float]] = field(default_factory=dict)
    other_form: list[str] = field(default_factory=list)

    def size(self, rng: np.random.Generator, low: float = 0.13, high: float = 0.35) -> float:
        """Torque of an effect, rms [N m]: a share of all torque, raised by `grow`, never more than 70 % of it."""
        return self.scales.torque * min(between(rng, low, high) * self.grow, 0.7)


def sign(rng: np.random.Generator) -> float:
    """One or minus one."""
    return float(2 * rng.integers(2) - 1)


def coulomb_error(plan: Plan, rng: np.random.Generator) -> None:
    # A torque c sign(v) has an rms of c sqrt(share of the time in motion).
    change = sign(rng) * plan.size(rng) / np.sqrt(plan.scales.moving)
    true = plan.drawn.coulomb
    plan.nominal["coulomb"] = true + change if true + change > 0.25 * true else true + abs(change)
    plan.parameters["coulomb_error"] = {"coulomb": true}


def viscous_error(plan: Plan, rng: np.random.Generator) -> None:
    change = sign(rng) * plan.size(rng) / plan.scales.speed
    true = plan.drawn.viscous
    plan.nominal["viscous"] = true + change if true + change > 0.2 * true else true + abs(change)
    plan.parameters["viscous_error"] = {"viscous": true}


def inertia_error(plan: Plan, rng: np.random.Generator) -> None:
    # Between 10 % and 80 %: the wrong inertia adds a torque of the wanted size.
    change = min(plan.size(rng) / plan.scales.acceleration / plan.drawn.inertia, 0.8)
    change = max(change, 0.1)
    plan.nominal["inertia"] *= (1 + change) if rng.random() < 0.5 else 1 / (1 + change)
    plan.parameters["inertia_error"] = {"inertia": plan.drawn.inertia}


def stribeck(plan: Plan, rng: np.random.Generator) -> None:
    extra = min(between(rng, 0.35, 0.9) * plan.grow, 1.6)
    speed = plan.drawn.kind.speed * between(rng, 0.02, 0.08)
    size, shape = stribeck_table(rng)
    plan.curve = 1 + extra * shape
    plan.values["curve_speed"] = speed / size
    plan.parameters["stribeck"] = {"stribeck_torque": extra * plan.drawn.coulomb, "stribeck_velocity": speed}
    plan.other_form.append("stribeck")


def stribeck_table(rng: np.random.Generator) -> tuple[float, np.ndarray]:
    """(v / vs at which 1/e is left, table of a fall from 1 to 0 over v / (v + vs)): a shoulder and a slow tail.

    As measured Stribeck curves look, and of none of the forms of the vocabulary.
    """
    ratio = FADES[:-1] / (1 - FADES[:-1])
    shoulder, tail = rng.uniform(0.8, 1.6), rng.uniform(0.05, 0.2)
    fall = (1 - tail) / (1 + ratio ** (2 * shoulder)) + tail / (1 + 0.3 * ratio)
    shape = np.append(fall, 0.0)
    return float(np.interp(-np.exp(-1), -shape[:-1], ratio)), shape


def presliding(plan: Plan, rng: np.random.Generator) -> None:
    drawn = plan.drawn
    # A stiffness that resonates with the inertia at 9 to 26 Hz: within what a log at 1 kHz and its loop show.
    frequency = between(rng, 9.0, 26.0) / np.sqrt(plan.grow)
    stiffness = drawn.inertia * (2 * np.pi * frequency) ** 2
    set_elements(plan.values, drawn.coulomb, stiffness, between(rng, 0.1, 0.4), drawn.inertia)
    plan.parameters["presliding"] = {
        "bristle_stiffness": stiffness,
        "bristle_deflection": drawn.coulomb / stiffness,
    }
    plan.other_form.append("presliding")


def set_elements(values: dict[str, float], level: float, stiffness: float, ratio: float, inertia: float) -> None:
    """Stiffness and damping of sticking friction from its initial stiffness and damping ratio."""
    values["element_stiffness"] = stiffness / INITIAL
    values["element_damping"] = 2 * ratio * np.sqrt(stiffness * inertia)


def asymmetric_friction(plan: Plan, rng: np.random.Generator) -> None:
    drawn, side = plan.drawn, sign(rng)
    # Each direction keeps at least 30 % of its level and 40 % of its slope.
    level = min(plan.size(rng) / np.sqrt(plan.scales.moving), 0.7 * drawn.coulomb)
    slope = min(plan.size(rng) / plan.scales.speed, 0.6 * drawn.viscous)
    what = ("levels", "levels and slopes", "one level")[int(rng.integers(3))]
    up, down = drawn.coulomb + side * level, drawn.coulomb - side * level
    if what == "one level":
        up, down = (drawn.coulomb + 1.4 * level, drawn.coulomb) if side > 0 else (drawn.coulomb, drawn.coulomb + level)
    found = {"coulomb_positive": up, "coulomb_negative": down}
    if what == "levels and slopes":
        side = sign(rng)
        found |= {"viscous_positive": drawn.viscous + side * slope, "viscous_negative": drawn.viscous - side * slope}
    plan.values |= found
    plan.parameters["asymmetric_friction"] = found


def position_dependent_friction(plan: Plan, rng: np.random.Generator) -> None:
    # Amplitude = sqrt(2) x rms for a sine; the level stays positive.
    share = min(np.sqrt(2) * plan.size(rng) / plan.drawn.coulomb, 0.6)
    periods = periods_of(plan, rng, 1.5, 6.0)
    plan.values |= {
        "wave": share,
        "wave_periods": periods,
        "wave_phase": float(rng.uniform(0, 2 * np.pi)),
        "wave_steepness": float(rng.uniform(1.1, 2.5)),
    }
    plan.parameters["position_dependent_friction"] = {"amplitude": share * plan.drawn.coulomb, "periods": periods}
    plan.other_form.append("position_dependent_friction")


def periods_of(plan: Plan, rng: np.random.Generator, low: float, high: float) -> float:
    """Periods a turn, whole for rotary machines; so many periods in the travel for linear ones."""
    kind = plan.drawn.kind
    if kind.linear:
        return float(2 * np.pi * between(rng, low, high) / kind.travel)
    # Periods of a turn such that enough of them lie within the travel.
    turns = kind.travel / np.pi if kind.travel < 4 else 1.0
    return float(max(round(between(rng, low, high) / turns), 2))


def friction_drift(plan: Plan, rng: np.random.Generator) -> None:
    constant = between(rng, 1.2, 4.5)
    # rms of exp(-t / T) over 10 s: sqrt(T / (2 x 10 s)).
    fading = np.sqrt(constant / 20)
    plan.values |= {
        "drift": plan.size(rng) / fading,
        "drift_time": constant,
        "drift_slow": float(rng.choice([0.0, 0.15])),
    }
    plan.parameters["friction_drift"] = {"amplitude": plan.values["drift"], "time_constant": constant}
    if plan.values["drift_slow"]:
        plan.other_form.append("friction_drift")


def load_dependent_friction(plan: Plan, rng: np.random.Generator) -> None:
    plan.values["load_friction"] = coefficient = min(between(rng, 0.12, 0.3) * plan.grow, 0.5)
    plan.parameters["load_dependent_friction"] = {"coefficient": coefficient}
    plan.other_form.append("load_dependent_friction")


def quadratic_drag(plan: Plan, rng: np.random.Generator) -> None:
    # rms of v |v| is about 1.5 times the square of the rms speed, for a sine sqrt(3/2) = 1.22, more for peaks.
    coefficient = plan.size(rng) / (1.5 * plan.scales.speed**2)
    plan.values["drag"] = coefficient
    plan.parameters["quadratic_drag"] = {"coefficient": coefficient}


def _split(plan: Plan, rng: np.random.Generator, frequency: float, load_share: float) -> float:
    """Two masses, their friction shared; the stiffness for a free frequency."""
    plan.values |= {"split": 1.0, "load_share": load_share, "friction_on_load": float(rng.uniform(0.15, 0.6))}
    return plan.drawn.inertia * load_share * (1 - load_share) * (2 * np.pi * frequency) ** 2


def backlash(plan: Plan, rng: np.random.Generator) -> None:
    drawn = plan.drawn
    # 1 to 5 ms of motion at top speed, and at least four counts of the encoder.
    gap = max(drawn.kind.speed * between(rng, 0.9e-3, 5e-3), 4 * drawn.encoder_step) * plan.grow
    wanted = _split(plan, rng, between(rng, 60, 150), float(rng.uniform(0.3, 0.7)))
    # Contact torque k d^1.5 has the slope 1.5 k d^0.5: k such that the slope is `wanted` at the depth to which the
    # torque of the log presses the faces.
    press = max(0.5 * plan.scales.torque, drawn.coulomb)
    stiffness = (wanted / 1.5) ** 1.5 / np.sqrt(press)
    plan.values |= {
        "clearance": gap,
        "contact_stiffness": stiffness,
        # Impacts at a few hundredths of the machine's speed lose about half of their speed.
        "contact_loss": between(rng, 0.15, 0.5) / drawn.kind.speed * 80,
    }
    plan.parameters["backlash"] = {"gap": gap}
    plan.other_form.append("backlash")


def compliance(plan: Plan, rng: np.random.Generator) -> None:
    drawn = plan.drawn
    on_load = rng.random() < 0.35
    # With the sensor on the load the resonance limits the loop: higher ones only.
    frequency = between(rng, 24 if on_load else 13, 55) / np.sqrt(plan.grow)
    share = float(rng.uniform(0.25, 0.6))
    stiffness = _split(plan, rng, frequency, share)
    ratio = between(rng, 0.12, 0.2) if on_load else between(rng, 0.03, 0.12)
    reduced = drawn.inertia * share * (1 - share)
    if on_load:
        # With the sensor behind the spring the loop is stable up to a bandwidth of about 2 zeta omega.
        plan.values["sensor_on_load"] = 1.0
        slow_down(plan, ratio * 2 * np.pi * frequency)
    twist = 0.5 * plan.scales.torque / stiffness
    plan.values |= {
        "stiffness": stiffness,
        "hardening": float(rng.uniform(0, 0.15)) / twist**2,
        "damping": 2 * ratio * np.sqrt(stiffness * reduced),
    }
    plan.parameters["compliance"] = {"frequency": frequency, "stiffness": stiffness}
    plan.other_form.append("compliance")


def slow_down(plan: Plan, bandwidth: float) -> None:
    """Lower the loop's bandwidth [rad/s] to what an effect leaves stable."""
    factor = min(1.0, bandwidth / plan.drawn.bandwidth)
    plan.drawn.bandwidth *= factor
    plan.values["kp"] *= factor
    plan.values["ki"] *= factor**2
    plan.values["position_gain"] *= factor


def unbalance(plan: Plan, rng: np.random.Generator) -> None:
    amplitude = np.sqrt(2) * plan.size(rng)
    plan.values |= {
        "unbalance": amplitude,
        "unbalance_phase": float(rng.uniform(0, 2 * np.pi)),
        "unbalance_second": float(rng.choice([0.0, 0.03])),
    }
    plan.parameters["unbalance"] = {"amplitude": amplitude}


def cogging(plan: Plan, rng: np.random.Generator) -> None:
    amplitude = np.sqrt(2) * plan.size(rng)
    periods = periods_of(plan, rng, 4.0, 24.0)
    plan.values |= {
        "cogging": amplitude,
        "cogging_periods": periods,
        "cogging_phase": float(rng.uniform(0, 2 * np.pi)),
        "cogging_steepness": float(rng.uniform(1.1, 2.5)),
    }
    plan.parameters["cogging"] = {"amplitude": amplitude, "periods": periods}
    plan.other_form.append("cogging")


def constant_torque(plan: Plan, rng: np.random.Generator) -> None:
    # The contract's offset is added to the command; the torque that the motor has to hold is its opposite.
    torque = sign(rng) * plan.size(rng)
    plan.values["offset"] = -torque
    plan.parameters["constant_torque"] = {"torque": torque}


def torque_gain_error(plan: Plan, rng: np.random.Generator) -> None:
    change = min(between(rng, 0.1, 0.3) * plan.grow, 0.6)
    gain = 1 + change if rng.random() < 0.5 else 1 / (1 + change)
    plan.values["gain"] = gain
    plan.parameters["torque_gain_error"] = {"gain": gain}


def _time(plan: Plan, rng: np.random.Generator) -> float:
    # A lag of 0.12 to 0.3 / bandwidth costs 7 to 17 deg of phase: visible, and the loop stays stable.
    return float(np.clip(between(rng, 0.12, 0.3) * np.sqrt(plan.grow) / plan.drawn.bandwidth, 1.2e-3, 11e-3))


def _poles(plan: Plan, rng: np.random.Generator, effect: str, first: str, second: str) -> None:
    total = _time(plan, rng)
    share = float(rng.choice([0.0, 0.12, 0.25]))
    plan.values |= {first: total * (1 - share), second: total * share}
    plan.parameters[effect] = {"time_constant": total}
    if share:
        plan.other_form.append(effect)


def actuator_lag(plan: Plan, rng: np.random.Generator) -> None:
    _poles(plan, rng, "actuator_lag", "pole_1", "pole_2")


def velocity_lag(plan: Plan, rng: np.random.Generator) -> None:
    _poles(plan, rng, "velocity_lag", "rate_pole_1", "rate_pole_2")


def actuator_delay(plan: Plan, rng: np.random.Generator) -> None:
    plan.values["delay"] = value = _time(plan, rng)
    plan.parameters["actuator_delay"] = {"delay": value}


def velocity_delay(plan: Plan, rng: np.random.Generator) -> None:
    plan.values["rate_delay"] = value = _time(plan, rng)
    plan.parameters["velocity_delay"] = {"delay": value}


def torque_saturation(plan: Plan, rng: np.random.Generator) -> None:
    # Below the torque that is exceeded in 2 % of the time, so that it acts.
    limit = plan.scales.peak * float(rng.uniform(0.62, 0.82)) / np.sqrt(plan.grow)
    plan.values |= {"limit": limit, "limit_power": between(rng, 7, 20)}
    plan.parameters["torque_saturation"] = {"limit": limit}
    plan.other_form.append("torque_saturation")


def torque_dead_zone(plan: Plan, rng: np.random.Generator) -> None:
    width = plan.size(rng)
    plan.values |= {"lost": width, "lost_rounding": width * between(rng, 0.1, 0.5)}
    # Far from the rounded knee slightly less is lost than with a sharp corner.
    knee = plan.values["lost_rounding"]
    plan.parameters["torque_dead_zone"] = {"width": width + 0.5 * (np.hypot(width, knee) - width)}
    plan.other_form.append("torque_dead_zone")


def velocity_bias(plan: Plan, rng: np.random.Generator) -> None:
    # At least eight standard deviations of the noise, and a hundredth of the top speed.
    low = max(0.01, 8 * plan.drawn.rate_noise / plan.drawn.kind.speed)
    bias = sign(rng) * plan.drawn.kind.speed * between(rng, low, max(0.05, 2 * low)) * plan.grow
    plan.values["rate_bias"] = bias
    plan.parameters["velocity_bias"] = {"bias": bias}


def velocity_scale_error(plan: Plan, rng: np.random.Generator) -> None:
    change = between(rng, 0.06, 0.22) * plan.grow
    plan.values["rate_scale"] = scale = 1 + change if rng.random() < 0.5 else 1 / (1 + change)
    plan.parameters["velocity_scale_error"] = {"scale": scale}


def velocity_quantisation(plan: Plan, rng: np.random.Generator) -> None:
    # Well above the noise, which would dither the steps away.
    step = plan.drawn.rate_noise * between(rng, 8, 35) * plan.grow
    plan.values["rate_step"] = max(step, 4 * plan.values["rate_step"])
    plan.parameters["velocity_quantisation"] = {"step": plan.values["rate_step"]}


EFFECTS: dict[str, Callable[[Plan, np.random.Generator], None]] = {name: globals()[name] for name in NAMES}
ACTUATOR = {"torque_gain_error", "actuator_lag", "actuator_delay", "torque_saturation", "torque_dead_zone"}
ON_RATE = {name for name in EFFECTS if name.startswith("velocity_")}
PERIODIC = {"unbalance", "cogging", "position_dependent_friction"}

# Effects that are not combined in a pair: twins, or two laws of the same place in the loop.
APART: tuple[frozenset[str], ...] = (
    frozenset({"actuator_lag", "velocity_lag", "actuator_delay", "velocity_delay", "compliance", "backlash"}),
    frozenset({"constant_torque", "asymmetric_friction", "velocity_bias", "unbalance"}),
    frozenset({"torque_gain_error", "velocity_scale_error", "inertia_error", "coulomb_error", "viscous_error"}),
    frozenset({"backlash", "compliance", "presliding", "velocity_quantisation", "stribeck"}),
    frozenset({"presliding", "stribeck", "torque_dead_zone"}),
    frozenset(
        {"coulomb_error", "asymmetric_friction", "torque_dead_zone", "friction_drift", "load_dependent_friction"}
    ),
    frozenset({"viscous_error", "asymmetric_friction", "quadratic_drag", "load_dependent_friction"}),
    frozenset({"inertia_error", "load_dependent_friction", "torque_gain_error"}),
)


def pair_fits(first: str, second: str) -> bool:
    """Whether two effects make a pair that can be distinguished in principle."""
    return first != second and not any({first, second} <= group for group in APART)
