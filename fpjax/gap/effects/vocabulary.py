"""The vocabulary: the effects of the contract, as changes of the simulator's blocks.

Start values matter: most effects are nonlinear in a parameter (a Stribeck velocity, a number of periods, a resonance),
and a fit that starts a factor of two to four away ends in another minimum.
"""

import cmath
from collections.abc import Callable
from typing import Any

import jax.numpy as jnp
import numpy as np

from ..data.setting import Setting
from ..machine import Feature, Machine
from .effect import Effect, EffectParameter, Values, place
from .parameters import (
    ACTUATOR_DELAY,
    ACTUATOR_LAG,
    BIAS,
    BRISTLE_DAMPING,
    BRISTLE_EXPONENT,
    COGGING,
    COGGING_PERIODS,
    COULOMB,
    COULOMB_DIFFERENCE,
    DAMPING_RATIO,
    DEAD_ZONE,
    DEFLECTION,
    DRAG,
    DRIFT,
    DRIFT_TIME,
    FACE_FREQUENCY,
    FACE_RATIO,
    FREQUENCY,
    FRICTION_SHARE,
    GAIN,
    GAP,
    HARDENING,
    INERTIA,
    LIMIT,
    LOAD_COEFFICIENT,
    LOAD_SHARE,
    LOAD_SIDE,
    OFFSET,
    RIPPLE,
    RIPPLE_PERIODS,
    SCALE,
    SHAFT_INERTIA,
    STRIBECK_EXPONENT,
    STRIBECK_TORQUE,
    STRIBECK_VELOCITY,
    UNBALANCE,
    VELOCITY_DELAY,
    VELOCITY_LAG,
    VISCOUS,
    VISCOUS_DIFFERENCE,
    VISCOUS_SHARE,
    fewest_periods,
    highest_frequency,
    lowest_frequency,
)
from .shaft import hardening_of, mean_slope, reduced_inertia, resonance_of, stiffness_of


def _asymmetric(values: dict[str, float], setting: Setting) -> dict[str, tuple[float, str]]:
    """Levels of each direction, from mean and half difference."""
    c, dc, b, db = (values[n] for n in ("coulomb", "coulomb_difference", "viscous", "viscous_difference"))
    return {
        "coulomb_positive": (c + dc, "N m"),
        "coulomb_negative": (c - dc, "N m"),
        "viscous_positive": (b + db, "N m s/rad"),
        "viscous_negative": (b - db, "N m s/rad"),
    }


def _presliding(values: dict[str, float], setting: Setting) -> dict[str, tuple[float, str]]:
    """Deflection at sliding, and the stiffness at which the bristles then hold the Coulomb torque."""
    deflection = values["bristle_deflection"]
    return {
        "bristle_deflection": (deflection, "rad"),
        "bristle_stiffness": (values["coulomb"] / deflection, "N m/rad"),
    }


def _compliance(values: dict[str, float], setting: Setting) -> dict[str, tuple[float, str]]:
    """Of a shaft that hardens, the stiffness of the line that is nearest to its torque over the log's twists."""
    plain, hard = float(stiffness_of(values)), values[HARDENING.name]
    steeper = mean_slope(hard, setting.shaft) if hard > 0.0 else 1.0
    found = {
        "frequency": (float(resonance_of(values)) * steeper**0.5, "Hz"),
        "stiffness": (plain * steeper, "N m/rad"),
    }
    return found | ({"hardening": (float(hardening_of(values)), "N m/rad^3")} if hard > 0.0 else {})


def _two_mass_start(
    setting: Setting, frequency: float, share: float, ratio: float, side: float, **more: float
) -> dict[str, float]:
    """Start values of a transmission.

    Args:
        setting: sizes of the log.
        frequency: free-free resonance [Hz], clipped to what the log can show.
        share: of the inertia on the load side [1].
        ratio: damping ratio [1].
        side: 0 for sensors on the motor, 1 on the load.
        **more: further parameters.
    """
    start = {
        "frequency": min(max(frequency, lowest_frequency(setting)), highest_frequency(setting)),
        "damping_ratio": ratio,
        "load_share": share,
        "friction_share": 0.5,
        "viscous_share": 0.5,
        "load_side": side,
    }
    return start | more


def _compliance_starts(setting: Setting) -> list[dict[str, float]]:
    """Those that the motion suggests, and two to six resonances, a factor of about 1.8 apart, the sensors on either
    side.
    """
    # Within what a window and the sampling can show, with a margin: a start at a bound has no gradient.
    low, high = 1.5 * lowest_frequency(setting), 0.8 * highest_frequency(setting)
    if not low < high:
        return []
    count = int(np.clip(np.ceil(np.log(high / low) / np.log(1.8)), 2, 6))
    frequencies = np.geomspace(low, high, count)
    plain = [_two_mass_start(setting, float(f), 0.4, 0.05, side) for f in frequencies for side in (0.0, 1.0)]
    return [*(dict(start) for start in setting.springs or ()), *plain]


def _backlash_starts(setting: Setting) -> list[dict[str, float]]:
    """The starts that contacts in the log suggest; else a stiff contact and three widths (motion of 1 to 6 ms)."""
    if setting.contacts:
        return [dict(start) for start in setting.contacts]
    frequency = 0.7 * highest_frequency(setting)
    return [_two_mass_start(setting, frequency, 0.5, 0.2, 0.0, gap=gap * setting.speed) for gap in (1e-3, 2.5e-3, 6e-3)]


def _joined(*more: EffectParameter) -> Callable[[Machine, Values], Machine]:
    """The `apply` of an effect of the transmission: stiffness, damping and shares, and further parameters by path."""

    def apply(machine: Machine, values: Values) -> Machine:
        parameters = (LOAD_SHARE, FRICTION_SHARE, VISCOUS_SHARE, LOAD_SIDE, *more)
        # Critical damping is 2 sqrt(k J_r).
        stiffness = stiffness_of(values)
        damping = 2.0 * values["damping_ratio"] * jnp.sqrt(stiffness * reduced_inertia(values))
        found = {p.path: values[p.name] for p in parameters}
        if HARDENING.name in values:  # else no compliance may be told, and the nominal shaft keeps its own
            found["plant.hardening"] = hardening_of(values)
        return place(machine, found | {"plant.stiffness": stiffness, "plant.damping": damping})

    return apply


# Made once: the functions are compared when compiled programs are looked up.
_JOINED, _JOINED_WITH_BACKLASH = _joined(), _joined(GAP)


def _sines(names: tuple[str, ...], values: dict[str, float], periods: str) -> dict[str, tuple[float, str]]:
    """Amplitude and periods of the largest harmonic.

    Args:
        names: of cosine and sine amplitude of each harmonic in turn.
        values: fitted, by name.
        periods: name of the number of periods of the first harmonic.
    """
    sizes = [float(np.hypot(values[a], values[b])) for a, b in zip(names[::2], names[1::2], strict=True)]
    largest = int(np.argmax(sizes))
    return {"amplitude": (sizes[largest], "N m"), "periods": ((largest + 1) * values[periods], "1/rev")}


def _unbalance(values: dict[str, float], setting: Setting) -> dict[str, tuple[float, str]]:
    """Amplitude of the whole weight, a known one and what the fit adds to it; its angle beside a known one."""
    cosine, sine = (values[name] for name in _names(UNBALANCE))
    whole = complex(sine, cosine) + setting.turning_load
    # Of a weight alone the angle says where the encoder's zero is; beside a known one it may be what is wrong.
    angle = {"phase": (cmath.phase(whole), "rad")} if setting.turning_load else {}
    return {"amplitude": (abs(whole), "N m")} | angle


def _waves(setting: Setting, kind: str, name: str, usual: float) -> list[dict[str, float]]:
    """Starts of what repeats with the position: as the missing torque repeats, else two usual numbers of periods."""
    if kind in setting.waves:
        return [dict(start) for start in setting.waves[kind]]
    fewest = fewest_periods(setting)
    return [{name: max(usual, fewest)}, {name: max(2.0 * usual, 2.0 * fewest)}]


def _names(parameters: tuple[EffectParameter, ...]) -> tuple[str, ...]:
    return tuple(p.name for p in parameters)


def _effect(name: str, parameters: tuple[EffectParameter, ...], **words: Any) -> Effect:
    """An `Effect` of the vocabulary, with the optional terms of the machine that it needs and what it follows."""
    # Optional terms of the compiled machine; effects that are not named here need none.
    features: dict[str, tuple[Feature, ...]] = {
        "stribeck": ("shape",),
        "friction_drift": ("shape",),
        "load_dependent_friction": ("shape",),
        "position_dependent_friction": ("ripple",),
        "unbalance": ("torque",),
        "cogging": ("torque",),
    }
    return Effect(name, parameters, features=features.get(name, ()), follows=_FOLLOWS.get(name, ()), **words)


# Variables that the torque of an effect is a function of; friction always follows the sign of the velocity too. Lags,
# delays, bristles and transmissions depend on the past, an inertia on the acceleration: they have no entry. Nor has a
# factor on the torque: it stands for several wrong numbers, which every model has.
_FOLLOWS: dict[str, tuple[str, ...]] = {
    "coulomb_error": ("velocity",),
    "viscous_error": ("velocity",),
    "stribeck": ("velocity",),
    "asymmetric_friction": ("velocity",),
    "quadratic_drag": ("velocity",),
    "position_dependent_friction": ("velocity", "position"),
    "friction_drift": ("velocity", "time"),
    "load_dependent_friction": ("velocity", "torque"),
    "unbalance": ("position",),
    "cogging": ("position",),
    "torque_saturation": ("torque",),
    "torque_dead_zone": ("torque",),
}


EFFECTS: tuple[Effect, ...] = (
    _effect("coulomb_error", (COULOMB,), report=lambda v, s: {"coulomb": (v["coulomb"], "N m")}),
    _effect("viscous_error", (VISCOUS,)),
    _effect("inertia_error", (INERTIA,)),
    _effect(
        "stribeck",
        (STRIBECK_TORQUE, STRIBECK_VELOCITY, STRIBECK_EXPONENT),
        starts=lambda s: [
            *(
                {"stribeck_torque": 0.3 * s.friction, "stribeck_velocity": factor * s.speed, "stribeck_exponent": 1.5}
                for factor in (0.015, 0.06)  # two valleys: a narrow rise near rest, and a wide one
            ),
            *([dict(s.rise)] if s.rise else []),
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
                # A damping ratio of 0.3 with the stiffness that the friction torque has at this deflection.
                "bristle_damping": 0.6 * float(np.sqrt(s.friction * s.inertia / (factor * s.speed))),
            }
            for factor in (7e-4, 2e-3, 6e-3)  # deflection as motion at top speed [s]
        ],
        report=_presliding,
        structure="bristles",
    ),
    _effect("asymmetric_friction", (COULOMB, COULOMB_DIFFERENCE, VISCOUS, VISCOUS_DIFFERENCE), report=_asymmetric),
    _effect(
        "position_dependent_friction",
        (*RIPPLE, RIPPLE_PERIODS),
        starts=lambda s: _waves(s, "friction", "ripple_periods", 2.0),
        report=lambda v, s: _sines(_names(RIPPLE), v, "ripple_periods"),
    ),
    _effect(
        "friction_drift",
        (DRIFT, DRIFT_TIME),
        starts=lambda s: [{"drift_amplitude": 0.2 * s.friction, "drift_time": f * s.duration} for f in (0.08, 0.35)],
        report=lambda v, s: {"amplitude": (v["drift_amplitude"], "N m"), "time_constant": (v["drift_time"], "s")},
    ),
    _effect(
        "load_dependent_friction",
        (LOAD_COEFFICIENT,),
        report=lambda v, s: {"coefficient": (v["load_coefficient"], "1")},
    ),
    _effect("quadratic_drag", (DRAG,), report=lambda v, s: {"coefficient": (v["drag_coefficient"], "N m s^2/rad^2")}),
    _effect(
        "backlash",
        (GAP, FACE_FREQUENCY, FACE_RATIO, LOAD_SHARE, FRICTION_SHARE, VISCOUS_SHARE),
        apply=_JOINED_WITH_BACKLASH,
        starts=_backlash_starts,
        report=lambda v, s: {"gap": (v["gap"], "rad")},
        structure="transmission",
        fixed=(LOAD_SIDE, SHAFT_INERTIA),
    ),
    _effect(
        "compliance",
        (FREQUENCY, DAMPING_RATIO, LOAD_SHARE, FRICTION_SHARE, VISCOUS_SHARE, HARDENING),
        apply=_JOINED,
        starts=_compliance_starts,
        report=_compliance,
        structure="transmission",
        fixed=(LOAD_SIDE, SHAFT_INERTIA),
    ),
    _effect(
        "unbalance",
        UNBALANCE,
        # From zero, and from the weight that fits the missing torque best: a large one is out of reach from zero.
        starts=lambda s: [{}, *([dict(s.weight)] if s.weight else [])],
        report=_unbalance,
    ),
    _effect(
        "cogging",
        (*COGGING, COGGING_PERIODS),
        starts=lambda s: _waves(s, "torque", "cogging_periods", 6.0),
        report=lambda v, s: _sines(_names(COGGING), v, "cogging_periods"),
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
        # Many starts: the cost is flat where nothing is clipped, and has kinks where samples begin to be.
        starts=lambda s: [{"limit": f * s.torque} for f in (0.97, 0.9, 0.8, 0.65, 0.5, 0.35, 0.2, 0.1, 0.05, 0.025)],
    ),
    _effect(
        "torque_dead_zone",
        (DEAD_ZONE,),
        starts=lambda s: [{"dead_zone": 0.1 * s.friction}],
        report=lambda v, s: {"width": (v["dead_zone"], "N m")},
    ),
    _effect("velocity_bias", (BIAS,), starts=lambda s: [{}, *([{"bias": s.at_rest}] if s.at_rest else [])]),
    _effect("velocity_scale_error", (SCALE,)),
)
"""Every effect that changes the simulation; `velocity_quantisation` is read from the column itself."""


def on_rate_sensor(effect: Effect) -> bool:
    """Whether an effect changes the rate sensor only, so that it does not exist in a log without one."""
    sensor = (BIAS, SCALE, VELOCITY_LAG, VELOCITY_DELAY)
    return bool(effect.parameters) and all(parameter in sensor for parameter in effect.parameters)
