"""Plausibility of single settings: ranges by unit, friction that only takes energy out, references that dt can follow.

All such rules are here. What is impossible raises an `InputError`; what is possible but unlikely gives a warning, one
sentence for the user. Sizes relative to each other are judged in `proportions`.
"""

import math
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import jax.numpy as jnp
import numpy as np

from ..blocks.actuators import AbstractActuator, Actuator
from ..blocks.controllers import (
    AbstractController,
    Lead,
    Limited,
    PositionLoop,
    Proportional,
    ProportionalIntegral,
    TransferFunction,
)
from ..blocks.friction import AbstractFriction, AbstractStaticFriction
from ..blocks.friction.bristles import Bristles
from ..blocks.friction.general import GeneralFriction
from ..blocks.learned import LearnedTorque
from ..blocks.references import AbstractReference
from ..blocks.signals import Motion
from ..errors import InputError
from ..simulation.input_checks import check_frequency
from ..simulation.loop import ClosedLoop

UnitName = Callable[[str], str]

# (smallest, largest) magnitude of a number that is not zero. Single precision ends at 1e-38 and 3e38, and the simulator
# squares and divides: beyond 1e30 the results are out of its range.
ANYTHING = (1e-30, 1e30)
BY_UNIT = {
    "s": (1e-12, 1e12),
    "Hz": (1e-12, 1e12),
    "kg m^2": (1e-15, 1e15),
    "rad/s": (1e-15, 1e9),
    "rad/s/sqrt(s)": (1e-15, 1e9),
}
_TURN = (1e-15, 2.0 * math.pi)  # [rad] angles that are a part of one turn
_FACTOR = (1e-3, 1e3)  # [1] factors whose nominal value is 1
_EXPONENT = (1e-2, 1e2)  # [1]
_LAG = (1e-12, 1e3)  # [s]
_PHASE = (1e-30, 1e4)  # [rad] in single precision an angle above 1e4 is known to no better than 1e-3
_GAIN = (1e-15, 1e15)
BY_KEY = {
    ("simulation", "dt"): (1e-9, 10.0),  # [s]; drives have 10 us to 10 ms
    # The coarsest possible encoder has one line per turn.
    ("sensor", "position_step"): _TURN,
    ("sensor", "step rad"): _TURN,
    ("sensor", "step rad/s"): (1e-15, 1e6),
    ("sensor", "position_noise"): _TURN,
    ("sensor", "angle_noise"): _TURN,
    ("sensor", "scale"): _FACTOR,
    ("sensor", "lag"): _LAG,
    ("sensor", "filter_time"): _LAG,
    ("actuator", "gain"): _FACTOR,
    ("actuator", "lag"): _LAG,
    ("actuator", "cogging_phase"): _PHASE,
    ("transmission", "backlash"): _TURN,  # with more than a turn of backlash the load is not driven
    ("friction", "bristle_deflection"): _TURN,
    ("friction", "exponent"): _EXPONENT,
    ("friction", "stribeck_exponent"): _EXPONENT,
    ("friction", "bristle_exponent"): _EXPONENT,
    ("observer", "gain"): _GAIN,
    ("observer", "gain_1"): _GAIN,
    ("observer", "gain_2"): _GAIN,
    ("controller", "tracking_time"): _LAG,
    ("feedforward", "lag"): _LAG,
    ("load", "phase"): _PHASE,
    ("reference", "phase"): _PHASE,
    ("reference", "phases"): _PHASE,
}
FOLLOWED = 0.1  # share of the sample rate at which a hold delays a sine by 18 degrees (half a period of the samples)


def check_range(section: str, name: str, unit: str, shown: str, number: float, *, divides: bool = False) -> None:
    """Refuse a number of a magnitude that no machine has.

    Args:
        section: name of the section, without brackets.
        name: name of the key.
        unit: in rotary SI.
        shown: the machine's own unit, for the message.
        number: a finite number.
        divides: whether the number must be positive. Something is then divided by it, so a number that is zero in
            single precision is refused; elsewhere a tiny number has the same effect as zero.

    Raises:
        InputError: naming the range.
    """
    least, most = BY_KEY.get((section, name), BY_KEY.get((section, f"{name} {unit}"), BY_UNIT.get(unit, ANYTHING)))
    if abs(number) <= most and (abs(number) >= least or not divides):
        return
    unit_shown = f" {shown}" if shown and shown != "1" else ""
    raise InputError(
        f"[{section}] {name} = {number:g}{unit_shown} is too {'small' if abs(number) < least else 'large'}: its "
        f"magnitude must be from {least:g} to {most:.4g}{unit_shown}; check its unit."
    )


def check_levels(static: float, coulomb: float, name: UnitName) -> None:
    """Refuse a static level below the Coulomb level [N m]; `name` gives the machine's units (`Units.name`)."""
    if static < coulomb:
        raise InputError(
            f"[friction] static = {static:g} {name('N m')} must be at least coulomb = {coulomb:g} {name('N m')}: "
            "friction at rest is not less than in motion; exchange the two?"
        )


def check_friction(law: AbstractFriction, name: UnitName) -> list[str]:
    """Refuse a friction law that drives its machine; warnings for one that may.

    Args:
        law: from [friction].
        name: a rotary unit -> the machine's (`Units.name`).

    Raises:
        InputError: for a static level below the Coulomb level, or a negative quadratic drag.
    """
    if isinstance(law, Bristles):
        law = law.law
    static, coulomb = _number(law, "static"), _number(law, "coulomb")
    if static is not None and coulomb is not None:
        check_levels(static, coulomb, name)
    if not isinstance(law, GeneralFriction):
        return []
    drag = float(law.drag_coefficient)
    if drag < 0.0:
        raise InputError(
            f"[friction] drag_coefficient = {drag:g} {name('N m s^2/rad^2')} must be zero or more: a negative one "
            "drives the machine, the more the faster it goes."
        )
    said = []
    viscous, difference = float(law.viscous), abs(float(law.viscous_difference))
    if difference > viscous:
        said.append(
            f"[friction] viscous_difference = {difference:g} {name('N m s/rad')} is larger than viscous = {viscous:g}: "
            "in one direction the friction drives the machine; check both."
        )
    pairs = zip(law.position_cosine, law.position_sine, strict=True)
    parts = {
        "coulomb_difference": abs(float(law.coulomb_difference)),
        "the position's harmonics": sum(float(np.hypot(float(c), float(s))) for c, s in pairs),
        "stribeck_torque": max(0.0, -float(law.stribeck_torque)) if law.stribeck_torque is not None else 0.0,
        "drift_amplitude": max(0.0, -float(law.drift_amplitude)) if law.drift_amplitude is not None else 0.0,
    }
    level = float(law.coulomb)
    if sum(parts.values()) > level * (1.0 + 1e-9):
        named = " and ".join(part for part, value in parts.items() if value)
        said.append(
            f"[friction] coulomb = {level:g} {name('N m')} is less than what {named} can subtract from it: where the "
            "level would be negative and drive the machine it is set to zero."
        )
    return said


def check_learned(parts: Sequence[LearnedTorque], law: AbstractFriction, name: UnitName) -> list[str]:
    """A warning for a learned law over the velocity that gives the machine more power than its friction takes.

    Args:
        parts: from [[learned]].
        law: from [friction].
        name: a rotary unit -> the machine's.
    """
    if isinstance(law, Bristles):
        law = law.law
    if not isinstance(law, AbstractStaticFriction):
        return []
    for part in parts:
        if part.of != "velocity":
            continue
        for velocity in (float(point) for point in part.at):
            if velocity == 0.0:
                continue
            motion = Motion(*(jnp.asarray(value) for value in (velocity, 0.0, 0.0, 0.0)))
            # Friction and learned torque together at this velocity: they brake where the sum has the velocity's sign.
            whole = float(jnp.sign(velocity) * law.level(motion) + law.drag(motion) + part.value(jnp.asarray(velocity)))
            if whole * velocity < -1e-9 * abs(velocity):
                return [
                    f"[learned] the table over the velocity drives the machine: at {velocity:g} {name('rad/s')} it and "
                    f"the friction together are {whole:.3g} {name('N m')}, in the direction of motion; check its sign."
                ]
    return []


def check_actuator(actuator: AbstractActuator) -> list[str]:
    """A warning for an actuator whose dead zone is as large as its limit: it delivers no torque.

    Args:
        actuator: from [actuator].
    """
    if not isinstance(actuator, Actuator) or actuator.limit is None or actuator.dead_zone is None:
        return []
    zone, limit = float(actuator.dead_zone), float(actuator.limit)
    if zone < limit:
        return []
    return [f"[actuator] dead_zone = {zone:g} is no less than limit = {limit:g}: no torque passes; check both."]


def check_controller(controller: AbstractController | None, reference: str) -> list[str]:
    """Refuse a controller that cannot follow its reference; warnings for one without effect or of the wrong sign.

    Args:
        controller: from [controller]; None where it is unknown.
        reference: [units] reference.

    Raises:
        InputError: for a position reference on a velocity loop.
    """
    inner = controller
    while isinstance(inner, Limited):
        inner = inner.controller
    if inner is None:
        return []
    if reference == "position" and not inner.follows_position:
        raise InputError(
            '[units] reference = "position" needs a controller that follows a position: write [controller] type = '
            '"position_cascade" with kp and kv, or reference = "velocity".'
        )
    said, velocity_gain = [], "kp"
    if isinstance(inner, PositionLoop):
        velocity_gain = "kv"
        if reference == "velocity":
            said.append(
                '[controller] type = "position_cascade" follows a position, so the reference is taken as one: write '
                '[units] reference = "position".'
            )
        if not float(inner.kp):
            said.append(f"[controller] kp = 0: {NOTHING}")
            return said
        inner = inner.velocity_controller
    names = {
        Proportional: ((velocity_gain, "kp"),),
        ProportionalIntegral: ((velocity_gain, "kp"), ("ki", "ki")),
        Lead: (("gain", "gain"),),
    }.get(type(inner), ())
    if names and not any(float(getattr(inner, field)) for _, field in names):
        return [*said, f"[controller] {' and '.join(word for word, _ in names)} = 0: {NOTHING}"]
    if isinstance(inner, Lead) and min(float(inner.gain), float(inner.gain) * float(inner.zero)) < 0.0:
        said.append(f"[controller] gain = {float(inner.gain):g} and zero = {float(inner.zero):g} {AGAINST}")
    return [*said, *(_about_transfer(inner) if isinstance(inner, TransferFunction) else ())]


NOTHING = "the controller does nothing, so the machine is not driven."
AGAINST = "make the controller act against its error, so the loop runs away: check their signs."


def _about_transfer(controller: TransferFunction) -> list[str]:
    """Warnings for a transfer function that has no effect, the wrong sign, or a pole in the right half plane."""
    drive, output = np.asarray(controller.drive), np.asarray(controller.output)
    poles = np.linalg.eigvals(np.asarray(controller.transition))
    through = float(controller.through)
    if not np.any(output) and not through:
        return [f"[controller] numerator = 0: {NOTHING}"]
    said = []
    # The response C (s I - A)^-1 B + D at a real s far above all poles, where only the leading coefficients count.
    high = 1e6 * (1.0 + float(np.max(np.abs(poles), initial=0.0)))
    reply = through + float(output @ np.linalg.solve(high * np.eye(drive.size) - controller.transition, drive))
    if reply < 0.0:
        said.append(f"[controller] the leading numerator and denominator {AGAINST}")
    worst = float(np.max(np.real(poles), initial=0.0))
    if worst > 1e-9 * float(np.max(np.abs(poles), initial=0.0)):
        said.append(f"[controller] has a pole at +{worst:.3g} rad/s: it is unstable by itself; check the denominator.")
    return said


def check_reference(reference: AbstractReference | None, dt: float) -> list[str]:
    """Refuse a reference above half the sample rate; a warning for one with few samples per period.

    Args:
        reference: from [reference]; None without one.
        dt: step, or control period when sampled [s].

    Raises:
        InputError: for a frequency at or above half the sample rate.
    """
    fastest = 0.0 if reference is None else check_frequency(reference, dt, ("[reference]", "[simulation] dt"))
    if fastest * dt > FOLLOWED:
        return [
            f"[reference] {fastest:g} Hz has {1.0 / (fastest * dt):.3g} samples per period at dt = {dt:g} s: with "
            f"fewer than {1.0 / FOLLOWED:g} the reference is coarse."
        ]
    return []


def _number(block: Any, name: str) -> float | None:
    value = getattr(block, name, None)
    return None if value is None else float(value)


def check_all(
    law: AbstractFriction,
    controller: AbstractController | None,
    reference: AbstractReference | None,
    dt: float,
    units: Any,
    learned: Sequence[LearnedTorque] = (),
    actuator: AbstractActuator | None = None,
) -> list[str]:
    """Apply every rule that needs more than one number; returns warnings for the user.

    Args:
        law: from [friction].
        controller: from [controller]; None where it is unknown.
        reference: from [reference]; None without one.
        dt: step, or control period when sampled [s].
        units: of the machine.
        learned: from [[learned]].
        actuator: from [actuator]; None without one.

    Raises:
        InputError: for invalid input.
    """
    return [
        *check_friction(law, units.name),
        *check_learned(learned, law, units.name),
        *check_controller(controller, units.reference),
        *check_reference(reference, dt),
        *(check_actuator(actuator) if actuator is not None else ()),
    ]


def check_changes(loop: ClosedLoop, changes: Mapping[str, float], name: UnitName) -> list[str]:
    """Apply the same rules to parameters that are changed by name; returns warnings for the user.

    Args:
        loop: after the change.
        changes: values by dotted name.
        name: a rotary unit -> the machine's (`Units.name`).

    Raises:
        InputError: for invalid input.
    """
    for path, number in changes.items():
        section, _, key = path.rpartition(".")
        check_range(section, key, "", "", number)
    return check_friction(loop.plant.friction, name)
