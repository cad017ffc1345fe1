"""Plausibility of numbers relative to each other: to the machine, its motion, the run and the control period.

Single numbers are judged in `admissible`. Here nothing is refused, and each finding is a warning: a model may be made
to show exactly such a case.
"""

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any, Protocol, runtime_checkable

import numpy as np

from ..blocks.references import AbstractReference, Chirp, Constant, Multisine, Recorded, Sine, Square, Triangle
from ..output.json_object import TomlTable

# The thresholds are far beyond any sensible design: a warning must mean a wrong unit or a slip, not an unusual machine.
FAR = 1e3  # a torque of this many times the torque for the whole motion comes from a wrong unit
HELPLESS = 100.0  # torque needed, over the torque that gains or limit allow, from which on nothing is followed
NEVER = 100.0  # a speed of this many times the fastest motion is never reached
NYQUIST = 0.5  # share of the sample rate
STEEP = 1e9  # steepness x fastest speed, from which on tanh is a sign function
# Change of the speed within one step, over its error. A loop is unstable from 2 on; this much comes from a wrong unit.
RUNAWAY = 1e9
STIFF = 0.5  # safety factor on the time constant that a solver's step can follow
EXPLICIT = 0.5  # shortest time constant of a spring over dt under exact sticking, which steps springs explicitly

Tables = TomlTable


@runtime_checkable
class Names(Protocol):
    """The part of `keys.Units` that is used here."""

    @property
    def reference(self) -> str:
        """The quantity that the controller follows: "velocity", "position" or "none"."""
        ...

    def name(self, unit: str) -> str:
        """A rotary SI unit in this machine's units."""
        ...


@dataclass(frozen=True)
class FastestMotion:
    """The largest velocity [rad/s] and acceleration [rad/s^2] that a reference asks for."""

    velocity: float
    acceleration: float


# Keys by section that are torques. [friction] coulomb and viscous are not among them: they count as torque needed.
_TORQUES = {
    "actuator": ("offset", "cogging_amplitude", "dead_zone"),
    "friction": ("static", "stribeck_torque", "drift_amplitude", "position_cosine", "position_sine", "offset"),
    "feedforward": ("coulomb",),
    "load": ("amplitude", "cosine", "sine"),
    "learned": ("torque",),
}
_FORWARD = ("inertia", "viscous")  # of [feedforward]: times the reference's acceleration and speed they are torques
# Keys that are velocities of an error, velocities at which an effect shows, and time constants of lags.
_VELOCITIES = {"sensor": ("noise", "bias", "step")}
_NEVER_REACHED = {"friction": ("stribeck_velocity", "stick_velocity"), "feedforward": ("speed",)}
_LAGS = {
    "actuator": ("lag", "delay"),
    "sensor": ("lag", "delay", "filter_time"),
    "feedforward": ("lag",),
    "controller": ("tracking_time",),
}
# Ripples: (section, key of the periods per turn, keys of the harmonics' amplitudes).
_PERIODS = (
    ("actuator", "cogging_periods", ()),
    ("friction", "position_periods", ("position_cosine", "position_sine")),
    ("load", "periods", ("cosine", "sine")),
)


def check_proportions(
    tables: Tables,
    reference: AbstractReference | None,
    dt: float,
    duration: float | None,
    units: Names,
    fastest: float,
) -> list[str]:
    """Warnings for numbers that are out of proportion to the others.

    Args:
        tables: the sections with their numbers, as they are written to a file.
        reference: of the loop; None where it comes from a log.
        dt: step, or control period when sampled [s].
        duration: of the run [s]; None where it comes from a log.
        units: of the machine.
        fastest: time constant that the solver's step can follow [s]; 0 under exact sticking, which takes any damper.
    """
    motion = motion_of(reference, dt, position=units.reference == "position")
    said = [*_about_torques(tables, motion, duration, units), *_about_stiffness(tables, fastest, dt, units)]
    said += _about_gains(tables, dt)
    for section, key, size in _sizes(tables, _LAGS):
        if duration is not None and size > duration:
            said.append(f"[{section}] {key} = {size:g} s is longer than the run ({duration:g} s); check its unit (s).")
    if motion is None or not motion.velocity:
        return said
    speed, unit = motion.velocity, units.name("rad/s")
    for section, key, size in _sizes(tables, _VELOCITIES):
        if section == "sensor" and key == "step" and tables["sensor"].get("type") in ("encoder", "kalman"):
            continue  # an encoder's step is an angle, not a velocity
        if size >= speed:
            said.append(
                f"[{section}] {key} = {size:g} {unit} is no less than the fastest reference, {speed:.3g} {unit}: "
                "it hides the motion; check its unit."
            )
    for section, key, size in _sizes(tables, {"friction": ("steepness",), "observer": ("steepness",)}):
        if size * speed > STEEP:
            said.append(
                f"[{section}] {key} = {size:g} {units.name('s/rad')} smooths over {1.0 / size:.3g} {unit}, far below "
                'any speed of this run, so it acts as a sign function; check it, or write "sign".'
            )
    walk = _size((tables.get("sensor") or {}).get("random_walk"))
    if walk * math.sqrt(duration or 0.0) >= speed:
        said.append(
            f"[sensor] random_walk = {walk:g} {units.name('rad/s/sqrt(s)')} comes to more than the fastest reference, "
            f"{speed:.3g} {unit}, within the run: it hides the motion; check its unit."
        )
    for section, key, size in _sizes(tables, _NEVER_REACHED):
        if size > NEVER * speed:
            said.append(
                f"[{section}] {key} = {size:g} {unit} is never reached: the reference goes up to {speed:.3g} {unit}; "
                "check its unit."
            )
    return [*said, *_about_periods(tables, speed, dt)]


def _sizes(tables: Tables, wanted: Mapping[str, tuple[str, ...]]) -> Iterator[tuple[str, str, float]]:
    """(section, key, largest magnitude) of every wanted number that is written and not zero."""
    for section, keys in wanted.items():
        written = tables.get(section) or {}
        for table in written if isinstance(written, list) else [written]:
            for key in keys:
                if (size := _size(table.get(key))) > 0.0:
                    yield section, key, size


def _size(value: Any) -> float:
    """The largest magnitude of a number or a list; 0 where there is none."""
    numbers = value if isinstance(value, list | tuple) else [value]
    return max((abs(float(each)) for each in numbers if isinstance(each, int | float)), default=0.0)


def motion_of(reference: AbstractReference | None, dt: float, *, position: bool) -> FastestMotion | None:
    """The largest velocity and acceleration of a reference; None without one, or for a block of another class.

    Args:
        reference: velocity [rad/s], or position [rad].
        dt: of a recorded reference's differences [s].
        position: whether it is a position.
    """
    # (amplitude, frequency [Hz]) of sines that bound the reference; a triangle or square by its fundamental alone.
    parts: list[tuple[float, float]] = []
    if isinstance(reference, Recorded):
        values = np.asarray(reference.values, float)
        slope = np.diff(values) / float(reference.interval) if values.size > 1 else np.zeros(1)
        curve = np.diff(slope) / float(reference.interval) if slope.size > 1 else np.zeros(1)
        first, second = (slope, curve) if position else (values, slope)
        return FastestMotion(*(float(np.max(np.abs(each))) for each in (first, second)))
    if isinstance(reference, Sine):
        parts = [(abs(float(reference.amplitude)), float(reference.frequency)), (abs(float(reference.offset)), 0.0)]
    elif isinstance(reference, Triangle | Square):
        parts = [(abs(float(reference.amplitude)), float(reference.frequency))]
    elif isinstance(reference, Constant):
        parts = [(abs(float(reference.amplitude)), 0.0)]
    elif isinstance(reference, Chirp):
        fastest = max(float(reference.start_frequency), float(reference.end_frequency))
        parts = [(abs(float(reference.amplitude)), fastest)]
    elif isinstance(reference, Multisine):
        pairs = zip(np.asarray(reference.amplitudes), np.asarray(reference.frequencies), strict=True)
        parts = [(abs(float(amplitude)), float(frequency)) for amplitude, frequency in pairs]
    else:
        return None
    rates = [(amplitude, 2.0 * math.pi * frequency) for amplitude, frequency in parts]
    first = sum(amplitude * (rate if position else 1.0) for amplitude, rate in rates)
    return FastestMotion(first, sum(amplitude * rate * (rate if position else 1.0) for amplitude, rate in rates))


def _about_torques(tables: Tables, motion: FastestMotion | None, duration: float | None, units: Names) -> list[str]:
    """Warnings for torques relative to the limit, or without a limit to the torque of the motion and of the gains."""
    unit, said = units.name("N m"), []
    limits = [_size((tables.get(section) or {}).get("limit")) for section in ("actuator", "controller")]
    limit = min((each for each in limits if each), default=math.inf)
    needed, command = _needed(tables, motion), _command(tables, motion, duration)
    forward = tables.get("feedforward") or {}
    ahead = [] if motion is None else [
        ("feedforward", key, _size(forward.get(key)) * scale)
        for key, scale in zip(_FORWARD, (motion.acceleration, motion.velocity), strict=True)
    ]  # fmt: skip
    # From here on `most` is the torque above which a warning is due.
    most = limit if math.isfinite(limit) else None
    if motion is not None and motion.velocity:
        given = None if command is None else command + sum(size for _, _, size in ahead) + _size(forward.get("coulomb"))
        if given is not None and needed > HELPLESS * given:
            said.append(
                f"[controller] gives at most {given:.3g} {unit} for an error as large as the reference, whose motion "
                f"needs {needed:.3g} {unit}: it is not followed; check the gains, the inertia and the friction."
            )
        if needed > HELPLESS * limit:
            said.append(
                f"The reference needs {needed:.3g} {unit}, {needed / limit:.3g} times the limit of {limit:g} {unit}: "
                "it is not followed; check the limit, the inertia and the friction."
            )
        if most is None and needed > 0.0:
            most = FAR * max(needed, command or 0.0)
    elif (friction := _size((tables.get("friction") or {}).get("coulomb"))) >= limit:
        said.append(
            f"[friction] coulomb = {friction:g} {unit} is no less than the limit of {limit:g} {unit}: the machine "
            "never moves."
        )
    if most is None:
        return said
    for section, key, size in [*_sizes(tables, _TORQUES), *ahead]:
        if size < most:
            continue
        if math.isfinite(limit):
            what = "no torque passes" if key == "dead_zone" else "the limit cannot hold against it"
            said.append(
                f"[{section}] {key}{_is(section, key, size, unit)} is no less than limit = {limit:g} {unit}: {what}; "
                "check both."
            )
        else:
            said.append(
                f"[{section}] {key}{_is(section, key, size, unit)} is over {FAR:g} times the torque of the reference "
                f"and of the gains ({most / FAR:.3g} {unit}); check its unit."
            )
    return said


def _is(section: str, key: str, size: float, unit: str) -> str:
    forward = section == "feedforward" and key in _FORWARD
    return f" comes to {size:.3g} {unit}, which" if forward else f" = {size:g} {unit}"


def _needed(tables: Tables, motion: FastestMotion | None) -> float:
    """Torque for the reference's acceleration, its speed and the Coulomb friction [N m]."""
    friction, plant = tables.get("friction") or {}, tables.get("plant") or {}
    coulomb = max(_size(friction.get(key)) for key in ("coulomb", "coulomb_positive", "coulomb_negative"))
    if motion is None:
        return coulomb
    inertia = sum(_size(plant.get(key)) for key in ("inertia", "motor_inertia", "load_inertia"))
    viscous = max(_size(friction.get(key)) for key in ("viscous", "viscous_positive", "viscous_negative"))
    drag = (viscous + _size(friction.get("drag_coefficient")) * motion.velocity) * motion.velocity
    return inertia * motion.acceleration + drag + coulomb


def _command(tables: Tables, motion: FastestMotion | None, duration: float | None) -> float | None:
    """Torque of the gains for a velocity error as large as the reference over the whole run [N m]; None if unknown."""
    controller = tables.get("controller") or {}
    gain = {"pi": "kp", "p": "kp", "position_cascade": "kv"}.get(str(controller.get("type")))
    if gain is None or motion is None or duration is None:
        return None
    gains = _size(controller.get(gain)) + duration * _size(controller.get("ki"))
    return _size((tables.get("actuator") or {}).get("gain", 1.0)) * gains * motion.velocity


def _about_gains(tables: Tables, dt: float) -> list[str]:
    """Warnings for gains that are unstable within one step, and for an observer with the inertia of another machine."""
    controller, plant = tables.get("controller") or {}, tables.get("plant") or {}
    inertia = sum(_size(plant.get(key)) for key in ("inertia", "motor_inertia", "load_inertia"))
    found, assumed = [], _size((tables.get("observer") or {}).get("inertia"))
    if assumed and inertia and not 1.0 / FAR < assumed / inertia < FAR:
        found.append(
            f"[observer] inertia = {assumed:g} is {assumed / inertia:.3g} times the plant's, {inertia:g}: its "
            "estimates would not be friction; check its unit."
        )
    for key, power in (("kp", 1), ("kv", 1), ("ki", 2)):
        if controller.get("type") == "position_cascade" and key == "kp":
            continue  # the position gain, in 1/s, is no torque
        # Torque of the gain for a unit error, over one step: kp dt / J, or ki dt^2 / J for the integral.
        turns = _size(controller.get(key)) * dt**power / inertia if inertia else 0.0
        if turns > RUNAWAY:
            found.append(
                f"[controller] {key} = {_size(controller.get(key)):g} changes the speed by {turns:.3g} times its error "
                f"within dt = {dt:g} s: the loop runs away; check the gain, the inertia and their units."
            )
    return found


def _about_stiffness(tables: Tables, fastest: float, dt: float, units: Names) -> list[str]:
    """Warnings for springs and bristles that oscillate, and dampers that settle, faster than a step can follow.

    Exact sticking has no limit for bristles, and hardly any for dampers; it steps a spring like the other solvers.
    """
    explicit = fastest > 0.0
    fastest = STIFF * (fastest if explicit else EXPLICIT * dt)
    plant = tables.get("plant") or {}
    own = _size(plant.get("inertia"))
    share = _size((tables.get("transmission") or {}).get("load_share", 0.5))
    pairs = {
        "plant": (_size(plant.get("motor_inertia")), _size(plant.get("load_inertia"))),
        "transmission": (own * share, own * (1.0 - share)),
    }
    rubbing = own or pairs["plant"][0]
    springs = [(name, "stiffness", _reduced(*pair)) for name, pair in pairs.items()]
    dampers = [(name, "damping", _reduced(*pair)) for name, pair in pairs.items()]
    dampers.append(("friction", "bristle_damping", rubbing))
    if explicit:
        springs += [("friction", key, rubbing) for key in ("stiffness", "bristle_stiffness")]
    said = []
    for section, key, inertia in springs:
        size = _size((tables.get(section) or {}).get(key))
        rate = math.sqrt(size / inertia) if inertia else 0.0
        if rate * fastest > 1.0:
            said.append(
                f"[{section}] {key} = {size:g} {units.name('N m/rad')} resonates at {rate / (2.0 * math.pi):.3g} Hz, "
                f"too fast for dt = {dt:g} s: the run diverges; take smaller steps (substeps) or less stiffness."
            )
    for section, key, inertia in dampers:
        size = _size((tables.get(section) or {}).get(key))
        rate = size / inertia if inertia else 0.0
        if rate * fastest > (1.0 if explicit else RUNAWAY):
            said.append(
                f"[{section}] {key} = {size:g} {units.name('N m s/rad')} has a time constant of {1.0 / rate:.3g} s, "
                f"too short for dt = {dt:g} s; take smaller steps (substeps) or less damping."
            )
    return said


def _reduced(one: float, other: float) -> float:
    """The reduced inertia of two masses on a spring [kg m^2], which sets their resonance."""
    return one * other / (one + other) if one + other else 0.0


def _about_periods(tables: Tables, speed: float, dt: float) -> list[str]:
    """Warnings for ripple whose frequency at the fastest speed is above half the sample rate."""
    said = []
    for section, key, harmonics in _PERIODS:
        written = tables.get(section) or {}
        for table in written if isinstance(written, list) else [written]:
            counts = [len(table[name]) for name in harmonics if isinstance(table.get(name), list | tuple)]
            periods = _size(table.get(key, 1.0 if counts else None)) * max(counts, default=1)
            rate = periods * speed / (2.0 * math.pi)
            if rate * dt >= NYQUIST:
                said.append(
                    f"[{section}] {key} = {_size(table.get(key, 1.0)):g}: at the fastest reference its ripple has "
                    f"{rate:.3g} Hz, but at dt = {dt:g} s it must stay below {NYQUIST / dt:g} Hz; check it, or write a "
                    "smaller dt."
                )
    return said
