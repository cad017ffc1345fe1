"""Machines drawn at random with one effect of the vocabulary each, simulated by the package itself.

What is asked here is whether the search finds its own model again, so that the truth is in the model's own form; laws
of another form are `python -m benchmarks withheld`.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass, replace

import jax
import numpy as np

import fpjax as fp
from fpjax.gap.answer.corrected import corrected_loop
from fpjax.gap.answer.fitted_machine import machine_at
from fpjax.gap.data.record import make_records
from fpjax.gap.data.setting import Setting, make_setting
from fpjax.gap.effects.effect import Effect
from fpjax.gap.effects.vocabulary import EFFECTS, on_rate_sensor
from fpjax.gap.fit.candidate import NOMINAL
from fpjax.gap.simulate.family import Nominal, key_for, make_family
from fpjax.model_file import Model
from fpjax.simulation.loop import ClosedLoop

DURATION, DT = 10.0, 1e-3  # of a log and of its control period [s]
SUBSTEPS = 8  # steps of the plant in a period: a contact rings at up to 150 Hz
BY_NAME = {effect.name: effect for effect in EFFECTS if effect.name.removesuffix("_error") not in NOMINAL}
"""The effects that are searched for from starts; every fit asks for wrong numbers."""


@dataclass(frozen=True)
class Drawn:
    """One machine.

    Attributes:
        effect: of its truth.
        model: the nominal model, which has every number right and lacks the effect.
        log: of the loop with the effect.
        values: true values of the effect and the numbers, by parameter name.
    """

    effect: Effect
    model: Model
    log: fp.Log
    values: dict[str, float]


def draw(name: str, number: int, seed: int) -> Drawn:
    """Machine `number` with an effect.

    Args:
        name: of the effect.
        number: of the machine.
        seed: of all of them.
    """
    random = np.random.default_rng([seed, number, list(BY_NAME).index(name)])
    model = fp.load_model(_nominal(random))
    setting = make_setting(make_records([_log(model, model.loop, number)], [], model.nominal["inertia"]), model)
    effect, loop = BY_NAME[name], model.loop
    family = make_family(
        key_for((effect,), setting), Nominal(loop.plant, loop.actuator, loop.sensor), (effect,), setting
    )
    values = {number: setting.nominal[number] for number in NOMINAL} | _values(name, setting, _Random(random))
    vector = family.neutral(setting)
    for parameter, value in values.items():
        vector[family.index(parameter)] = value
    truth = corrected_loop(model, machine_at(family, vector))
    log = _log(model, truth, number + 1)
    if on_rate_sensor(effect):  # beside an encoder the rate is not fitted, its errors are read off
        log = replace(log, position=None)
    return Drawn(effect, model, log, values)


class _Random:
    """Draws that the ranges below are written with."""

    def __init__(self, random: np.random.Generator):
        self.uniform = random.uniform

    def ratio(self, low: float, high: float) -> float:
        """Uniform in its logarithm."""
        return math.exp(self.uniform(math.log(low), math.log(high)))

    def signed(self, low: float, high: float) -> float:
        """Uniform, of either sign."""
        return math.copysign(self.uniform(low, high), self.uniform(-1.0, 1.0))

    def waves(self, prefix: str, amplitude: float, harmonics: int) -> dict[str, float]:
        """Cosine and sine amplitudes, those of the overtones 30 % of the first at most."""
        found = {}
        for order in range(harmonics):
            size = amplitude * (self.uniform(0.0, 0.3) if order else 1.0)
            phase = self.uniform(0.0, 2.0 * math.pi)
            found[f"{prefix}_cosine_{order + 1}"] = size * math.cos(phase)
            found[f"{prefix}_sine_{order + 1}"] = size * math.sin(phase)
        return found

    def shaft(self, frequency: float, ratio: float) -> dict[str, float]:
        """A transmission of a resonance [Hz] and a damping ratio [1], the sensors on either side."""
        shares = {name: self.uniform(0.0, 1.0) for name in ("friction_share", "viscous_share")}
        side = 1.0 if self.uniform(-1.0, 1.0) > 0.0 else 0.0
        own = {"frequency": frequency, "damping_ratio": ratio, "load_share": self.uniform(0.2, 0.8), "load_side": side}
        return own | shares | {"shaft_inertia": 0.0}  # the model has no shaft whose inertia could be another


def _nominal(random: np.random.Generator) -> str:
    """A servo.toml: a velocity loop of 4 to 12 Hz, friction that stops the machine within 0.2 to 1 s."""
    draws = _Random(random)
    inertia, speed = draws.ratio(1e-3, 1.0), draws.ratio(3.0, 40.0)
    coulomb = inertia * speed * draws.uniform(1.0, 6.0)
    viscous = draws.uniform(0.1, 0.6) * coulomb / speed
    frequency = draws.uniform(0.25, 0.6)
    gain = inertia * 2.0 * math.pi * draws.uniform(4.0, 12.0)
    limit = 3.0 * (coulomb + viscous * speed + inertia * speed * 2.0 * math.pi * frequency * 2.5)
    return f"""[plant]
type = "one_mass"
inertia = {inertia:.6g}

[friction]
type = "coulomb_viscous"
coulomb = {coulomb:.6g}
viscous = {viscous:.6g}

[actuator]
limit = {limit:.6g}

[sensor]
noise = {draws.ratio(3e-4, 3e-3) * speed:.6g}
position_noise = {draws.ratio(3e-6, 3e-5) * speed:.6g}

[controller]
type = "pi"
kp = {gain:.6g}
ki = {gain * 2.0 * math.pi * draws.uniform(0.5, 2.0):.6g}

[reference]
type = "multisine"
amplitudes = [{0.6 * speed:.6g}, {0.3 * speed:.6g}, {0.12 * speed:.6g}]
frequencies = [{frequency:.6g}, {2.7 * frequency:.6g}, {7.3 * frequency:.6g}]

[simulation]
dt = {DT:.6g}
duration = {DURATION:.6g}
stepping = "sampled"
solver = "exact"
"""


def _values(name: str, s: Setting, draws: _Random) -> dict[str, float]:
    """True values of an effect: sizes that a log shows, shapes over the range that the vocabulary allows."""
    friction, speed, torque = s.coulomb, s.speed, s.torque

    def presliding() -> dict[str, float]:
        deflection = draws.ratio(7e-4, 8e-3) * speed
        critical = 2.0 * math.sqrt(friction * s.inertia / deflection)
        return {
            "bristle_deflection": deflection, "bristle_damping": draws.uniform(0.1, 0.5) * critical,
            "bristle_exponent": draws.uniform(0.7, 1.5),
        }  # fmt: skip

    def asymmetric() -> dict[str, float]:
        return {
            "coulomb_difference": draws.signed(0.15, 0.5) * friction,
            "viscous_difference": draws.signed(0.1, 0.5) * s.viscous,
        }

    def weight() -> dict[str, float]:
        size, phase = draws.uniform(0.2, 1.5) * friction, draws.uniform(0.0, 2.0 * math.pi)
        return {"unbalance_cosine": size * math.cos(phase), "unbalance_sine": size * math.sin(phase)}

    def late(parameter: str) -> dict[str, float]:
        return {parameter: draws.uniform(1.5, 10.0) * s.dt}

    ranges: dict[str, Callable[[], dict[str, float]]] = {
        "stribeck": lambda: {
            "stribeck_torque": draws.uniform(0.2, 2.0) * friction, "stribeck_velocity": draws.ratio(0.01, 0.15) * speed,
            "stribeck_exponent": draws.uniform(1.0, 2.0),
        },
        "presliding": presliding,
        "asymmetric_friction": asymmetric,
        "position_dependent_friction": lambda: draws.waves("ripple", draws.uniform(0.15, 0.6) * friction, 3)
        | {"ripple_periods": draws.ratio(1.0, 12.0)},
        "friction_drift": lambda: {
            "drift_amplitude": draws.uniform(0.2, 0.8) * friction, "drift_time": draws.uniform(0.05, 0.6) * DURATION,
        },
        "load_dependent_friction": lambda: {"load_coefficient": draws.uniform(0.03, 0.2)},
        "quadratic_drag": lambda: {"drag_coefficient": draws.uniform(0.2, 2.0) * friction / speed**2},
        "backlash": lambda: draws.shaft(draws.ratio(20.0, 150.0), draws.uniform(0.05, 0.8))
        | {"gap": draws.ratio(8e-4, 8e-3) * speed},
        "compliance": lambda: draws.shaft(draws.ratio(8.0, 80.0), draws.uniform(0.02, 0.2))
        | {"relative_hardening": draws.ratio(1.0, 100.0) / torque**2 if draws.uniform(0.0, 1.0) > 0.5 else 0.0},
        "unbalance": weight,
        "cogging": lambda: draws.waves("cogging", draws.uniform(0.15, 0.8) * friction, 2)
        | {"cogging_periods": draws.ratio(1.5, 24.0)},
        "constant_torque": lambda: {"torque": draws.signed(0.1, 0.6) * friction},
        "torque_gain_error": lambda: {"gain": draws.uniform(0.6, 1.5)},
        "actuator_lag": lambda: late("actuator_lag"),
        "velocity_lag": lambda: late("velocity_lag"),
        "actuator_delay": lambda: late("actuator_delay"),
        "velocity_delay": lambda: late("velocity_delay"),
        "torque_saturation": lambda: {"limit": draws.uniform(0.3, 0.9) * torque},
        "torque_dead_zone": lambda: {"dead_zone": draws.uniform(0.1, 0.6) * friction},
        "velocity_bias": lambda: {"bias": draws.signed(0.02, 0.1) * speed},
        "velocity_scale_error": lambda: {"scale": draws.uniform(0.7, 1.4)},
    }  # fmt: skip
    return ranges[name]()


def _log(model: Model, loop: ClosedLoop, seed: int) -> fp.Log:
    """What a drive with a tachometer and an encoder records of a loop."""
    names = ("torque", "measured_velocity", "measured_position", "reference")
    run = fp.simulate(
        loop, model.reference, dt=DT, duration=DURATION, stepping="sampled", solver="exact", substeps=SUBSTEPS,
        record=names, key=jax.random.key(seed),
    )  # fmt: skip
    torque, velocity, position, reference = (np.asarray(run.signals[name], float) for name in names)
    return fp.Log(np.asarray(run.time, float), torque, velocity, position, reference, DT, "drawn")
