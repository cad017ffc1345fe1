# pyright: reportArgumentType=false, reportCallIssue=false
"""The 24 effects of the contract, as changes of the simulator's blocks."""

from collections.abc import Callable
from math import pi
from typing import Any

import jax.numpy as jnp
import numpy as np

from .effect import Effect, Parameter, Setting, Size, Values, place
from .machine import NO_LIMIT, Feature, Machine

HIGHEST_RATIO = 1.5  # of a contact's damping to its critical one


def _constant(value: float) -> Size:
    return lambda setting: value


def _times(name: str, factor: float) -> Size:
    return lambda setting: factor * getattr(setting, name)


_ZERO = _constant(0.0)


def _amplitude(name: str, path: str) -> Parameter:
    """A torque amplitude of either sign [N m]."""
    return Parameter(name, "N m", _ZERO, _times("friction", -5), _times("friction", 5), _times("friction", 0.2), path)


INERTIA = Parameter(
    "inertia",
    "kg m^2",
    lambda s: s.inertia,
    _times("inertia", 0.1),
    _times("inertia", 10),
    _times("inertia", 0.2),
    "plant.inertia",
)
COULOMB = Parameter(
    "coulomb", "N m", lambda s: s.coulomb, _ZERO, _times("friction", 10), _times("friction", 0.2), "law.coulomb"
)
VISCOUS = Parameter(
    "viscous",
    "N m s/rad",
    lambda s: s.viscous,
    _ZERO,
    lambda s: 20 * s.viscous + 3 * s.friction / s.speed,
    lambda s: 0.2 * s.viscous + 0.05 * s.friction / s.speed,
    "law.viscous",
)
ORIGIN = Parameter("origin", "rad", _ZERO, _constant(-20.0), _constant(20.0), _constant(0.1), "origin")
NOMINAL = (INERTIA, COULOMB, VISCOUS, ORIGIN)

COULOMB_DIFFERENCE = _amplitude("coulomb_difference", "law.coulomb_difference")
VISCOUS_DIFFERENCE = Parameter(
    "viscous_difference",
    "N m s/rad",
    _ZERO,
    lambda s: -5 * s.viscous - s.friction / s.speed,
    lambda s: 5 * s.viscous + s.friction / s.speed,
    lambda s: 0.2 * s.viscous + 0.05 * s.friction / s.speed,
    "law.viscous_difference",
)
STRIBECK_TORQUE = Parameter(
    "stribeck_torque",
    "N m",
    _ZERO,
    _ZERO,
    _times("friction", 5),
    _times("friction", 0.2),
    "law.stribeck_torque",
)
STRIBECK_VELOCITY = Parameter(
    "stribeck_velocity",
    "rad/s",
    _times("speed", 0.05),
    _times("speed", 0.002),
    _times("speed", 0.5),
    _times("speed", 0.02),
    "law.stribeck_velocity",
)
STRIBECK_EXPONENT = Parameter(
    "stribeck_exponent",
    "1",
    _constant(1.5),
    _constant(0.4),
    _constant(4.0),
    _constant(0.5),
    "law.stribeck_exponent",
    lambda s: 1.0,
)
DEFLECTION = Parameter(
    "bristle_deflection",
    "rad",
    _times("speed", 2e-3),
    _times("speed", 1e-4),
    _times("speed", 5e-2),
    _times("speed", 1e-3),
    "plant.friction.deflection",
)
BRISTLE_DAMPING = Parameter(
    "bristle_damping",
    "N m s/rad",
    _ZERO,
    _ZERO,
    lambda s: 2 * (s.friction * s.inertia / (1e-3 * s.speed)) ** 0.5,
    lambda s: 0.3 * (s.friction * s.inertia / (1e-3 * s.speed)) ** 0.5,
    "plant.friction.damping",
)
BRISTLE_EXPONENT = Parameter(
    "bristle_exponent",
    "1",
    _constant(1.0),
    _constant(0.3),
    _constant(3.0),
    _constant(0.5),
    "plant.friction.exponent",
    lambda s: 1.0,
)
RIPPLE = tuple(
    _amplitude(f"ripple_{part}_{order + 1}", f"law.position_{part}.{order}")
    for order in range(3)
    for part in ("cosine", "sine")
)
RIPPLE_PERIODS = Parameter(
    "ripple_periods",
    "1/rev",
    _constant(3.0),
    _constant(0.5),
    _constant(64.0),
    _constant(0.05),
    "law.position_periods",
)
DRIFT = Parameter(
    "drift_amplitude",
    "N m",
    _ZERO,
    _ZERO,
    _times("friction", 5),
    _times("friction", 0.2),
    "law.drift_amplitude",
)
DRIFT_TIME = Parameter(
    "drift_time",
    "s",
    _times("duration", 0.25),
    _times("duration", 0.01),
    _times("duration", 2.0),
    _times("duration", 0.1),
    "law.drift_time",
)
DRAG = Parameter(
    "drag_coefficient",
    "N m s^2/rad^2",
    _ZERO,
    _ZERO,
    lambda s: 5 * s.friction / s.speed**2,
    lambda s: 0.2 * s.friction / s.speed**2,
    "law.drag_coefficient",
)
UNBALANCE = tuple(_amplitude(f"unbalance_{part}", f"plant.load.parts.1.{part}.0") for part in ("cosine", "sine"))
COGGING = tuple(
    _amplitude(f"cogging_{part}_{order + 1}", f"plant.load.parts.2.{part}.{order}")
    for order in range(2)
    for part in ("cosine", "sine")
)
COGGING_PERIODS = Parameter(
    "cogging_periods",
    "1/rev",
    _constant(6.0),
    _constant(1.5),
    _constant(200.0),
    _constant(0.05),
    "plant.load.parts.2.periods",
)
OFFSET = _amplitude("torque", "actuator.offset")
GAIN = Parameter("gain", "1", _constant(1.0), _constant(0.2), _constant(5.0), _constant(0.1), "actuator.gain")


def _time(name: str, path: str) -> Parameter:
    return Parameter(name, "s", _ZERO, _ZERO, _times("dt", 30), _times("dt", 1), path)


ACTUATOR_LAG = _time("actuator_lag", "actuator.lag")
ACTUATOR_DELAY = _time("actuator_delay", "actuator.delay")
VELOCITY_LAG = _time("velocity_lag", "sensor.lag")
VELOCITY_DELAY = _time("velocity_delay", "sensor.delay")
LIMIT = Parameter(
    "limit",
    "N m",
    _constant(NO_LIMIT),
    _times("torque", 0.1),
    _times("torque", 0.999),
    _times("torque", 0.1),
    "actuator.limit",
)
DEAD_ZONE = Parameter(
    "dead_zone", "N m", _ZERO, _ZERO, _times("friction", 3), _times("friction", 0.1), "actuator.dead_zone"
)
BIAS = Parameter(
    "bias", "rad/s", _ZERO, _times("speed", -0.5), _times("speed", 0.5), _times("speed", 0.02), "sensor.bias"
)
SCALE = Parameter("scale", "1", _constant(1.0), _constant(0.2), _constant(5.0), _constant(0.1), "sensor.scale")
GAP = Parameter("gap", "rad", _ZERO, _ZERO, _times("speed", 0.05), _times("speed", 1e-3), "plant.gap")
STIFFNESS = Parameter(
    "stiffness",
    "N m/rad",
    lambda s: 0.25 * s.inertia * (2 * pi * 0.1 / s.dt) ** 2,
    lambda s: 0.25 * s.inertia * (2 * pi * 1e-3 / s.dt) ** 2,
    lambda s: 0.25 * s.inertia * (2 * pi * 0.3 / s.dt) ** 2,
    lambda s: 0.1 * s.inertia * (2 * pi * 0.05 / s.dt) ** 2,
    "plant.stiffness",
)
# A shaft or a tooth rings: were it overdamped, its free start would be a slow torque that explains anything.
DAMPING_RATIO = Parameter("damping_ratio", "1", _constant(0.1), _ZERO, _constant(HIGHEST_RATIO), _constant(0.1))
LOAD_SHARE = Parameter(
    "load_share", "1", _constant(0.5), _constant(0.05), _constant(0.95), _constant(0.1), "plant.load_share"
)
FRICTION_SHARE = Parameter(
    "friction_share", "1", _constant(0.5), _ZERO, _constant(1.0), _constant(0.2), "plant.friction_share"
)
LOAD_SIDE = Parameter("load_side", "1", _ZERO, _ZERO, _constant(1.0), _constant(1.0), "sensor.load_side")


def _asymmetric(values: dict[str, float], setting: Setting) -> dict[str, tuple[float, str]]:
    c, dc, b, db = (values[n] for n in ("coulomb", "coulomb_difference", "viscous", "viscous_difference"))
    return {
        "coulomb_positive": (c + dc, "N m"),
        "coulomb_negative": (c - dc, "N m"),
        "viscous_positive": (b + db, "N m s/rad"),
        "viscous_negative": (b - db, "N m s/rad"),
    }


def _presliding(values: dict[str, float], setting: Setting) -> dict[str, tuple[float, str]]:
    deflection = values["bristle_deflection"]
    return {
        "bristle_deflection": (deflection, "rad"),
        "bristle_stiffness": (values["coulomb"] / deflection, "N m/rad"),
    }


def _compliance(values: dict[str, float], setting: Setting) -> dict[str, tuple[float, str]]:
    share = values["load_share"]
    reduced = values["inertia"] * share * (1 - share)
    return {
        "frequency": (float(np.sqrt(values["stiffness"] / reduced)) / (2 * pi), "Hz"),
        "stiffness": (values["stiffness"], "N m/rad"),
    }


def _two_mass_start(
    setting: Setting, frequency: float, share: float, ratio: float, side: float, friction: float, **more: float
) -> dict[str, float]:
    reduced = setting.inertia * share * (1 - share)
    stiffness = reduced * (2 * pi * frequency) ** 2
    start = {
        "stiffness": stiffness,
        "damping_ratio": ratio,
        "load_share": share,
        "friction_share": friction,
        "load_side": side,
    }
    return start | more


def _compliance_starts(setting: Setting) -> list[dict[str, float]]:
    top = 0.12 / setting.dt
    frequencies = [f for f in (8.0, 14.0, 21.0, 32.0, 48.0, 72.0) if f < top] or [0.3 * top, 0.6 * top]
    return [_two_mass_start(setting, f, 0.4, 0.05, side, 0.5) for f in frequencies for side in (0.0, 1.0)]


def _backlash_starts(setting: Setting) -> list[dict[str, float]]:
    return [
        _two_mass_start(setting, min(f, 0.15 / setting.dt), share, 0.2, 0.0, 0.5, gap=gap * setting.speed)
        for gap in (1e-3, 2.5e-3, 6e-3)
        for share in (0.35, 0.65)
        for f in (70.0, 140.0)
    ]


def _joined(*more: Parameter) -> Callable[[Machine, Values], Machine]:
    """A machine's transmission set by stiffness, damping ratio and shares, and what else has a path."""

    def apply(machine: Machine, values: Values) -> Machine:
        parameters = (STIFFNESS, LOAD_SHARE, FRICTION_SHARE, LOAD_SIDE, *more)
        machine = place(machine, {p.path: values[p.name] for p in parameters})
        share = values["load_share"]
        reduced = machine.plant.inertia * share * (1.0 - share)
        damping = 2.0 * values["damping_ratio"] * jnp.sqrt(values["stiffness"] * reduced)
        return place(machine, {"plant.damping": damping})

    return apply


_JOINED, _JOINED_WITH_PLAY = _joined(), _joined(GAP)


def _sines(names: list[str], values: dict[str, float], periods: str | None) -> dict[str, tuple[float, str]]:
    result = {"amplitude": (float(np.hypot(*(values[n] for n in names))), "N m")}
    return result | ({"periods": (values[periods], "1/rev")} if periods else {})


def _effect(name: str, parameters: tuple[Parameter, ...], **words: Any) -> Effect:
    features: dict[str, tuple[Feature, ...]] = {
        "stribeck": ("shape",),
        "friction_drift": ("shape",),
        "position_dependent_friction": ("ripple",),
        "unbalance": ("torque",),
        "cogging": ("torque",),
    }
    return Effect(name, parameters, features=features.get(name, ()), **words)


EFFECTS: tuple[Effect, ...] = (
    _effect("coulomb_error", (COULOMB,), report=lambda v, s: {"coulomb": (v["coulomb"], "N m")}),
    _effect("viscous_error", (VISCOUS,)),
    _effect("inertia_error", (INERTIA,)),
    _effect(
        "stribeck",
        (STRIBECK_TORQUE, STRIBECK_VELOCITY, STRIBECK_EXPONENT),
        starts=lambda s: [
            {"stribeck_torque": 0.3 * s.friction, "stribeck_velocity": factor * s.speed, "stribeck_exponent": 1.5}
            for factor in (0.015, 0.06)
        ],
        report=lambda v, s: {
            "stribeck_torque": (v["stribeck_torque"], "N m"),
            "stribeck_velocity": (v["stribeck_velocity"], "rad/s"),
        },
    ),
    _effect(
        "presliding",
        (DEFLECTION, BRISTLE_DAMPING, BRISTLE_EXPONENT),
        starts=lambda s: [
            {
                "bristle_deflection": factor * s.speed,
                "bristle_damping": 0.6 * float(np.sqrt(s.friction * s.inertia / (factor * s.speed))),
            }
            for factor in (7e-4, 2e-3, 6e-3)
        ],
        report=_presliding,
        structure="bristles",
    ),
    _effect("asymmetric_friction", (COULOMB, COULOMB_DIFFERENCE, VISCOUS, VISCOUS_DIFFERENCE), report=_asymmetric),
    _effect(
        "position_dependent_friction",
        (*RIPPLE, RIPPLE_PERIODS),
        starts=lambda s: [{"ripple_periods": n} for n in s.hints.get("ripple_periods", (2.0, 4.0))],
        report=lambda v, s: _sines(["ripple_cosine_1", "ripple_sine_1"], v, "ripple_periods"),
    ),
    _effect(
        "friction_drift",
        (DRIFT, DRIFT_TIME),
        starts=lambda s: [{"drift_amplitude": 0.2 * s.friction, "drift_time": f * s.duration} for f in (0.08, 0.35)],
        report=lambda v, s: {"amplitude": (v["drift_amplitude"], "N m"), "time_constant": (v["drift_time"], "s")},
    ),
    _effect("quadratic_drag", (DRAG,), report=lambda v, s: {"coefficient": (v["drag_coefficient"], "N m s^2/rad^2")}),
    _effect(
        "backlash",
        (GAP, STIFFNESS, DAMPING_RATIO, LOAD_SHARE, FRICTION_SHARE),
        apply=_JOINED_WITH_PLAY,
        starts=_backlash_starts,
        report=lambda v, s: {"gap": (v["gap"], "rad")},
        structure="transmission",
        fixed=(LOAD_SIDE,),
    ),
    _effect(
        "compliance",
        (STIFFNESS, DAMPING_RATIO, LOAD_SHARE, FRICTION_SHARE),
        apply=_JOINED,
        starts=_compliance_starts,
        report=_compliance,
        structure="transmission",
        fixed=(LOAD_SIDE,),
    ),
    _effect("unbalance", UNBALANCE, report=lambda v, s: _sines(["unbalance_cosine", "unbalance_sine"], v, None)),
    _effect(
        "cogging",
        (*COGGING, COGGING_PERIODS),
        starts=lambda s: [{"cogging_periods": n} for n in s.hints.get("cogging_periods", (6.0, 12.0))],
        report=lambda v, s: _sines(["cogging_cosine_1", "cogging_sine_1"], v, "cogging_periods"),
    ),
    _effect("constant_torque", (OFFSET,)),
    _effect("torque_gain_error", (GAIN,)),
    _effect(
        "actuator_lag",
        (ACTUATOR_LAG,),
        starts=lambda s: [{"actuator_lag": f * s.dt} for f in (1.0, 4.0)],
        report=lambda v, s: {"time_constant": (v["actuator_lag"], "s")},
    ),
    _effect(
        "velocity_lag",
        (VELOCITY_LAG,),
        starts=lambda s: [{"velocity_lag": f * s.dt} for f in (1.0, 4.0)],
        report=lambda v, s: {"time_constant": (v["velocity_lag"], "s")},
    ),
    _effect(
        "actuator_delay",
        (ACTUATOR_DELAY,),
        starts=lambda s: [{"actuator_delay": f * s.dt} for f in (0.8, 3.5)],
        report=lambda v, s: {"delay": (v["actuator_delay"], "s")},
    ),
    _effect(
        "velocity_delay",
        (VELOCITY_DELAY,),
        starts=lambda s: [{"velocity_delay": f * s.dt} for f in (0.8, 3.5)],
        report=lambda v, s: {"delay": (v["velocity_delay"], "s")},
    ),
    _effect(
        "torque_saturation",
        (LIMIT,),
        starts=lambda s: [{"limit": f * s.torque} for f in (0.97, 0.9, 0.8, 0.65, 0.5, 0.35, 0.2)],
    ),
    _effect(
        "torque_dead_zone",
        (DEAD_ZONE,),
        starts=lambda s: [{"dead_zone": 0.1 * s.friction}],
        report=lambda v, s: {"width": (v["dead_zone"], "N m")},
    ),
    _effect("velocity_bias", (BIAS,)),
    _effect("velocity_scale_error", (SCALE,)),
)
"""Every effect that changes the simulation; `velocity_quantisation` is read from the data (see `noise`)."""


def on_rate_sensor(effect: Effect) -> bool:
    """Whether an effect is of the rate sensor alone, and so is nothing in a log without one."""
    sensor = (BIAS, SCALE, VELOCITY_LAG, VELOCITY_DELAY)
    return bool(effect.parameters) and all(parameter in sensor for parameter in effect.parameters)
