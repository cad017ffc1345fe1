"""The parameters of the effects of the vocabulary, with units, bounds and scales that follow the log (`Setting`)."""

from dataclasses import replace
from math import pi

import numpy as np

from ..data.setting import Setting
from ..machine import NO_LIMIT
from .effect import EffectParameter, Size

HIGHEST_RATIO = 0.5  # highest damping ratio of a shaft [1]
LATEST = 30  # samples by which a torque or a reading may be late
HIGHEST_FACE_RATIO = 2.0  # highest damping ratio of the faces of a backlash [1]: contacts may hardly rebound


def _constant(value: float) -> Size:
    """A size that does not depend on the log."""
    return lambda setting: value


def _times(name: str, factor: float) -> Size:
    """A multiple of one of the sizes of the log."""
    return lambda setting: factor * getattr(setting, name)


_ZERO = _constant(0.0)


def fewest_periods(setting: Setting) -> float:
    """Periods of a torque of the position that repeats once within the travel [1/rev]: the fewest that starts have."""
    return 2.0 * pi / max(setting.travel, 1e-9)


def most_periods(setting: Setting) -> float:
    """Most periods of such a torque [1/rev]: 400, or 400 within the travel if that is less than a turn."""
    return 400.0 * max(1.0, fewest_periods(setting))


def lowest_frequency(setting: Setting) -> float:
    """Lowest resonance that a window shows [Hz]: half a period of it within the window."""
    return 0.5 / setting.window


def highest_frequency(setting: Setting) -> float:
    """Highest resonance that the sampling shows [Hz]: a third of the Nyquist frequency."""
    return 1.0 / (6.0 * setting.dt)


def highest_contact(setting: Setting) -> float:
    """Highest contact resonance of a backlash [Hz]: its contacts show even if the oscillation is not resolved."""
    return 2.0 * highest_frequency(setting)


def _amplitude(name: str, path: str) -> EffectParameter:
    """A torque amplitude of either sign [N m], at most twice the largest torque that can have acted."""
    return EffectParameter(name, "N m", _ZERO, _times("effort", -2), _times("effort", 2), _times("friction", 0.2), path)


def _periods(name: str, start: float, least: float, path: str, within: float = 1.0) -> EffectParameter:
    """Number of periods of a torque within a turn [1/rev]; at least `within` of one within the travel."""
    return EffectParameter(
        name,
        "1/rev",
        lambda s: max(start, fewest_periods(s)),
        lambda s: max(least, within * fewest_periods(s)),
        lambda s: most_periods(s),
        _constant(0.05),
        path,
        # A quarter period of phase over the travel: beyond it the gradient has the wrong sign.
        reach=lambda s: 0.25 * fewest_periods(s),
    )


# In the order name, unit, neutral, low, high, scale, path. A real inertia is free up to three times either way.
INERTIA = EffectParameter(
    "inertia",
    "kg m^2",
    lambda s: s.inertia,
    _times("inertia", 1 / 3),
    _times("inertia", 3),
    _times("inertia", 0.2),
    "plant.inertia",
)
# At most the largest commanded torque: with more friction the machine would not move.
COULOMB = EffectParameter(
    "coulomb", "N m", lambda s: s.coulomb, _ZERO, _times("torque", 1), _times("friction", 0.2), "law.coulomb"
)
# torque / speed: all torque is viscous at top speed, for a nominal model without viscous friction.
VISCOUS = EffectParameter(
    "viscous",
    "N m s/rad",
    lambda s: s.viscous,
    _ZERO,
    lambda s: 5 * s.viscous + s.torque / s.speed,
    lambda s: 0.2 * s.viscous + 0.05 * s.friction / s.speed,
    "law.viscous",
)
# Zero of the position against that of a known load that turns, where no sensor gives it: three turns either way.
ORIGIN = EffectParameter("origin", "rad", _ZERO, _constant(-20.0), _constant(20.0), _constant(0.1), "origin")
NOMINAL = (INERTIA, COULOMB, VISCOUS, ORIGIN)

# Half the difference between the directions: level +- difference.
COULOMB_DIFFERENCE = _amplitude("coulomb_difference", "law.coulomb_difference")
VISCOUS_DIFFERENCE = EffectParameter(
    "viscous_difference",
    "N m s/rad",
    _ZERO,
    lambda s: -5 * s.viscous - s.torque / s.speed,
    lambda s: 5 * s.viscous + s.torque / s.speed,
    lambda s: 0.2 * s.viscous + 0.05 * s.friction / s.speed,
    "law.viscous_difference",
)
STRIBECK_TORQUE = EffectParameter(
    "stribeck_torque",
    "N m",
    _ZERO,
    _ZERO,
    _times("torque", 1),
    _times("friction", 0.2),
    "law.stribeck_torque",
)
# From 0.2 % of the top speed, where few samples lie, to half of it, where it would be viscous friction.
STRIBECK_VELOCITY = EffectParameter(
    "stribeck_velocity",
    "rad/s",
    _times("speed", 0.05),
    _times("speed", 0.002),
    _times("speed", 0.5),
    _times("speed", 0.02),
    "law.stribeck_velocity",
)
# Fitted but not reported: 1 (Tustin) and 2 (Gaussian) are the usual forms, and a machine follows neither exactly.
STRIBECK_EXPONENT = EffectParameter(
    "stribeck_exponent",
    "1",
    _constant(1.5),
    _constant(0.4),
    _constant(4.0),
    _constant(0.5),
    "law.stribeck_exponent",
    blur=lambda s: 1.0,
)
# Bristle deflection at sliding: from 0.1 ms to 50 ms of motion at top speed, which a log can resolve.
DEFLECTION = EffectParameter(
    "bristle_deflection",
    "rad",
    _times("speed", 2e-3),
    _times("speed", 1e-4),
    _times("speed", 5e-2),
    _times("speed", 1e-3),
    "plant.friction.deflection",
)
# sqrt(F J / z): stiffness F / z of the bristles at a deflection z of 1 ms at top speed, with the inertia J; twice it is
# critical damping.
BRISTLE_DAMPING = EffectParameter(
    "bristle_damping",
    "N m s/rad",
    _ZERO,
    _ZERO,
    lambda s: 2 * (s.friction * s.inertia / (1e-3 * s.speed)) ** 0.5,
    lambda s: 0.3 * (s.friction * s.inertia / (1e-3 * s.speed)) ** 0.5,
    "plant.friction.damping",
)
# Dahl's exponent: 1 for most materials, below 1 brittle, above 1 ductile; fitted but not reported.
BRISTLE_EXPONENT = EffectParameter(
    "bristle_exponent",
    "1",
    _constant(1.0),
    _constant(0.3),
    _constant(3.0),
    _constant(0.5),
    "plant.friction.exponent",
    blur=lambda s: 1.0,
)
# Cosine and sine amplitudes of three harmonics instead of amplitude and phase: linear, and regular at zero.
RIPPLE = tuple(
    _amplitude(f"ripple_{part}_{order + 1}", f"law.position_{part}.{order}")
    for order in range(3)
    for part in ("cosine", "sine")
)
# From once in two turns, and nine tenths of a period within the travel: one that is 4 % longer than the travel was told
# as a scale of 1.96 of the rate sensor, half of one stands for a Coulomb level. Cogging from 1.5: once is a weight.
RIPPLE_PERIODS = _periods("ripple_periods", 3.0, 0.5, "law.position_periods", within=0.9)
# Extra Coulomb friction at the start, which decays: a machine that warms up.
DRIFT = EffectParameter(
    "drift_amplitude",
    "N m",
    _ZERO,
    _ZERO,
    _times("torque", 1),
    _times("friction", 0.2),
    "law.drift_amplitude",
)
DRIFT_TIME = EffectParameter(
    "drift_time",
    "s",
    _times("duration", 0.25),
    _times("duration", 0.01),
    _times("duration", 2.0),
    _times("duration", 0.1),
    "law.drift_time",
)
# Friction torque over the torque through the gear: efficiencies down to 40 %.
LOAD_COEFFICIENT = EffectParameter(
    "load_coefficient", "1", _ZERO, _ZERO, _constant(0.6), _constant(0.02), "law.load_coefficient"
)
# Bound: twice the drag that takes all torque at top speed.
DRAG = EffectParameter(
    "drag_coefficient",
    "N m s^2/rad^2",
    _ZERO,
    _ZERO,
    lambda s: 2 * s.torque / s.speed**2,
    lambda s: 0.2 * s.friction / s.speed**2,
    "law.drag_coefficient",
)
# A cos + B sin of the position: linear in both, where amplitude and phase would be singular at zero.
UNBALANCE = tuple(_amplitude(f"unbalance_{part}", f"plant.load.parts.1.{part}.0") for part in ("cosine", "sine"))
COGGING = tuple(
    _amplitude(f"cogging_{part}_{order + 1}", f"plant.load.parts.2.{part}.{order}")
    for order in range(2)
    for part in ("cosine", "sine")
)
COGGING_PERIODS = _periods("cogging_periods", 6.0, 1.5, "plant.load.parts.2.periods")
# Added to the command, as in the contract: a torque that the motor gives.
OFFSET = _amplitude("torque", "actuator.offset")
AMPLITUDES = frozenset(
    p.name for p in (COULOMB_DIFFERENCE, STRIBECK_TORQUE, DRIFT, OFFSET, *RIPPLE, *UNBALANCE, *COGGING)
)
"""Torques whose bound is not a property of the machine, but more than the torques of the log could have balanced."""
SHAPES = frozenset(
    p.name
    for p in (STRIBECK_VELOCITY, STRIBECK_EXPONENT, BRISTLE_EXPONENT, RIPPLE_PERIODS, COGGING_PERIODS, DRIFT_TIME)
)
"""Parameters of shape: their effect's size is another parameter, and where that is neutral, these have no influence."""
# Beyond a factor of five the model has another unit than the log, which `inspect` finds.
GAIN = EffectParameter("gain", "1", _constant(1.0), _constant(0.2), _constant(5.0), _constant(0.1), "actuator.gain")


def _time(name: str, path: str) -> EffectParameter:
    """A lag or dead time, up to `LATEST` samples."""
    return EffectParameter(name, "s", _ZERO, _ZERO, _times("dt", LATEST), _times("dt", 1), path)


ACTUATOR_LAG = _time("actuator_lag", "actuator.lag")
ACTUATOR_DELAY = _time("actuator_delay", "actuator.delay")
TORQUE_LATE = replace(ACTUATOR_DELAY, low=_times("dt", -LATEST), high=_ZERO)
VELOCITY_LAG = _time("velocity_lag", "sensor.lag")
VELOCITY_DELAY = _time("velocity_delay", "sensor.delay")
# The bound of 0.999 of the largest command: a limit that clips nothing has no gradient. A loop without anti-windup may
# ask for a hundred times what its drive gives.
LIMIT = EffectParameter(
    "limit",
    "N m",
    _constant(NO_LIMIT),
    _times("torque", 0.01),
    _times("torque", 0.999),
    _times("torque", 0.1),
    "actuator.limit",
)
DEAD_ZONE = EffectParameter(
    "dead_zone", "N m", _ZERO, _ZERO, _times("torque", 0.8), _times("friction", 0.1), "actuator.dead_zone"
)
# Errors of the rate sensor, in the unit of the velocity.
BIAS = EffectParameter(
    "bias", "rad/s", _ZERO, _times("speed", -0.5), _times("speed", 0.5), _times("speed", 0.02), "sensor.bias"
)
SCALE = EffectParameter("scale", "1", _constant(1.0), _constant(0.2), _constant(5.0), _constant(0.1), "sensor.scale")


def _between_samples(setting: Setting) -> float:
    """Standard deviation of a backlash width by sampling [rad].

    A face is met somewhere between two samples: a uniform error of speed x dt, with a standard deviation of that over
    sqrt(12), averaged over the reversals of the log.
    """
    reversals = max(setting.duration / setting.window, 1.0)  # about one reversal for each window
    return setting.speed * setting.dt / (12.0 * reversals) ** 0.5


def largest_gap(setting: Setting) -> float:
    """Largest clearance [rad]: a quarter of the travel, crossed in 50 to 500 ms at top speed; then a load is loose."""
    return float(np.clip(0.25 * setting.travel, 0.05 * setting.speed, 0.5 * setting.speed))


GAP = EffectParameter(
    "gap", "rad", _ZERO, _ZERO, largest_gap, _times("speed", 1e-3), "plant.gap", blur=_between_samples
)
# A resonance that the data can show: at least half a period a window, and at most a third of the Nyquist frequency.
FREQUENCY = EffectParameter(
    "frequency",
    "Hz",
    lambda s: (lowest_frequency(s) * highest_frequency(s)) ** 0.5,
    lambda s: lowest_frequency(s),
    lambda s: highest_frequency(s),
    lambda s: 0.05 * (lowest_frequency(s) * highest_frequency(s)) ** 0.5,
)
# A shaft oscillates. If it could be overdamped, its free start state would be a slow torque that explains anything.
DAMPING_RATIO = EffectParameter("damping_ratio", "1", _constant(0.1), _ZERO, _constant(HIGHEST_RATIO), _constant(0.1))
# Within a backlash both may be larger: stiff faces, and contacts that dissipate.
FACE_FREQUENCY = replace(FREQUENCY, high=highest_contact)
FACE_RATIO = replace(DAMPING_RATIO, high=_constant(HIGHEST_FACE_RATIO))
# Shares of the total inertia, of the Coulomb and of the viscous friction on the load side of the transmission: the
# back-EMF of a motor under a voltage is viscous friction of the motor alone, while carts and gears rub by themselves.
LOAD_SHARE = EffectParameter(
    "load_share", "1", _constant(0.5), _constant(0.05), _constant(0.95), _constant(0.1), "plant.load_share"
)
FRICTION_SHARE = EffectParameter(
    "friction_share", "1", _constant(0.5), _ZERO, _constant(1.0), _constant(0.2), "plant.friction_share"
)
VISCOUS_SHARE = replace(FRICTION_SHARE, name="viscous_share", path="plant.viscous_share")
# The secant stiffness of a shaft grows as 1 + h (k twist)^2: h = c / k^3 of k twist + c twist^3. Under the largest
# command it is ten times that of small twists at most; a shaft that carries next to nothing before is a backlash. (Four
# times was too little on one of five development logs.)
HARDENING = EffectParameter(
    "relative_hardening",
    "1/(N m)^2",
    _ZERO,
    _ZERO,
    lambda s: 1000.0 / s.torque**2,
    lambda s: 3.0 / s.torque**2,
    plain=True,
)
# Which side the sensors are on: 0 motor, 1 load; set by a start, not fitted.
LOAD_SIDE = EffectParameter("load_side", "1", _ZERO, _ZERO, _constant(1.0), _constant(1.0), "sensor.load_side")
# The inertia with which the resonance gives the stiffness: that of a nominal model which has a shaft, so that the shaft
# stays as it is where the inertia was wrong; 0 for the inertia itself, whatever it is.
SHAFT_INERTIA = EffectParameter("shaft_inertia", "kg m^2", _ZERO, _ZERO, lambda s: s.inertia, lambda s: s.inertia)
