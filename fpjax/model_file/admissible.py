"""What a machine can be: ranges of numbers with their units, friction that takes energy out, what a period can follow.

The one place of these rules. A refusal is an `InputError`; what is possible but unlikely is a sentence for the user.
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
from ..blocks.references import AbstractReference, Chirp, Multisine, Sine, Square, Triangle
from ..blocks.signals import Motion
from ..errors import InputError
from ..simulation.loop import ClosedLoop

UnitName = Callable[[str], str]

# Magnitudes of a number that is not zero, (smallest, largest). Single precision ends at 1e-38 and 3e38, and the
# simulator squares and divides: what lies beyond 1e30 leaves it.
ANYTHING = (1e-30, 1e30)
BY_UNIT = {
    "s": (1e-12, 1e12),
    "Hz": (1e-12, 1e12),
    "kg m^2": (1e-15, 1e15),
    "rad/s": (1e-15, 1e9),
    "rad/s/sqrt(s)": (1e-15, 1e9),
}
_TURN = (1e-15, 2.0 * math.pi)  # angles that are small ones
_FACTOR = (1e-3, 1e3)  # of what is 1 in a machine that is known
_EXPONENT = (1e-2, 1e2)
_LAG = (1e-12, 1e3)
_PHASE = (1e-30, 1e4)  # beyond it the digits that are left say nothing of the angle
_GAIN = (1e-15, 1e15)
BY_KEY = {
    ("simulation", "dt"): (1e-9, 10.0),  # of a drive: 10 us to 10 ms
    # One line a turn is the coarsest encoder; a linear scale coarser than that has no name.
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
    ("transmission", "backlash"): _TURN,  # a gear that is free for a turn is none
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
NYQUIST = 0.5  # of the sample rate: above it a sine is another, slower one
FOLLOWED = 0.1  # of the sample rate: a held signal has lost 18 degrees there


def check_range(section: str, name: str, unit: str, shown: str, number: float, *, divides: bool = False) -> None:
    """Refuse a number of a size that no machine has.

    Args:
        section: as in "[plant]".
        name: of the key.
        unit: in rotary SI.
        shown: the machine's own unit, for the sentence.
        number: finite.
        divides: whether it must be above zero: something is then divided by it, and what single precision takes for
            zero is refused. Elsewhere a tiny number is as good as none.

    Raises:
        InputError: saying the range.
    """
    least, most = BY_KEY.get((section, name), BY_KEY.get((section, f"{name} {unit}"), BY_UNIT.get(unit, ANYTHING)))
    if abs(number) <= most and (abs(number) >= least or not divides):
        return
    unit_shown = f" {shown}" if shown and shown != "1" else ""
    raise InputError(
        f"[{section}] {name} = {number:g}{unit_shown} is too {'small' if abs(number) < least else 'large'}: sizes from "
        f"{least:g} to {most:.4g}{unit_shown} are known here; check its unit."
    )


def check_levels(static: float, coulomb: float, name: UnitName) -> None:
    """Refuse a law that holds less than it rubs [N m], with the machine's units (`Units.name`)."""
    if static < coulomb:
        raise InputError(
            f"[friction] static = {static:g} {name('N m')} must be at least coulomb = {coulomb:g} {name('N m')}: what "
            "holds at rest is not less than what rubs in motion; exchange the two?"
        )


def check_friction(law: AbstractFriction, name: UnitName) -> list[str]:
    """Refuse a law that drives its machine; sentences on one that may.

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
            "drives the machine, the harder the faster it goes."
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
            f"[friction] coulomb = {level:g} {name('N m')} is less than what {named} can take from it: the level is "
            "cut off at zero there, since less would drive the machine."
        )
    return said


def check_learned(parts: Sequence[LearnedTorque], law: AbstractFriction, name: UnitName) -> list[str]:
    """A sentence on a learned law of the velocity that gives the machine more energy than its friction takes.

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
            whole = float(jnp.sign(velocity) * law.level(motion) + law.drag(motion) + part.value(jnp.asarray(velocity)))
            if whole * velocity < -1e-9 * abs(velocity):
                return [
                    f"[learned] the table of the velocity drives the machine: at {velocity:g} {name('rad/s')} it and "
                    f"the friction together are {whole:.3g} {name('N m')}, with the motion; check its sign."
                ]
    return []


def check_actuator(actuator: AbstractActuator) -> list[str]:
    """A sentence on an actuator that lets nothing through.

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
    """Refuse a controller that cannot follow what it is asked to; sentences on one that does nothing, or harm.

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
AGAINST = "turn the controller against its error, so the loop runs away: check their signs."


def _about_transfer(controller: TransferFunction) -> list[str]:
    """Sentences on a transfer function that does nothing, has the wrong sign, or runs away by itself."""
    drive, output = np.asarray(controller.drive), np.asarray(controller.output)
    poles = np.linalg.eigvals(np.asarray(controller.transition))
    through = float(controller.through)
    if not np.any(output) and not through:
        return [f"[controller] numerator = 0: {NOTHING}"]
    said = []
    # Far above its poles a transfer function has the sign of its leading coefficients.
    high = 1e6 * (1.0 + float(np.max(np.abs(poles), initial=0.0)))
    reply = through + float(output @ np.linalg.solve(high * np.eye(drive.size) - controller.transition, drive))
    if reply < 0.0:
        said.append(f"[controller] the leading numerator and denominator {AGAINST}")
    worst = float(np.max(np.real(poles), initial=0.0))
    if worst > 1e-9 * float(np.max(np.abs(poles), initial=0.0)):
        said.append(f"[controller] has a pole at +{worst:.3g} rad/s: it runs away by itself; check the denominator.")
    return said


def check_reference(reference: AbstractReference | None, dt: float) -> list[str]:
    """Refuse a reference that its period cannot show; a sentence on one that it shows badly.

    Args:
        reference: from [reference]; None without one.
        dt: step, or control period when sampled [s].

    Raises:
        InputError: for a frequency at or above half the sample rate.
    """
    fastest = _fastest(reference)
    if fastest * dt >= NYQUIST:
        raise InputError(
            f"[reference] {fastest:g} Hz cannot be followed at [simulation] dt = {dt:g} s: samples show less than "
            f"{NYQUIST / dt:g} Hz; lower the frequency, or write a smaller dt."
        )
    if fastest * dt > FOLLOWED:
        return [
            f"[reference] {fastest:g} Hz has {1.0 / (fastest * dt):.3g} samples a period at dt = {dt:g} s: fewer than "
            f"{1.0 / FOLLOWED:g} show it badly."
        ]
    return []


def _fastest(reference: AbstractReference | None) -> float:
    """The highest frequency that the reference names [Hz]; 0 where it names none."""
    if isinstance(reference, Sine | Triangle | Square):
        return abs(float(reference.frequency))
    if isinstance(reference, Chirp):
        return max(abs(float(reference.start_frequency)), abs(float(reference.end_frequency)))
    if isinstance(reference, Multisine):
        return float(np.max(np.abs(np.asarray(reference.frequencies))))
    return 0.0


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
    """Every rule that needs more than one number; sentences for the user.

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
    """The same rules for parameters that are changed by name; sentences for the user.

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
