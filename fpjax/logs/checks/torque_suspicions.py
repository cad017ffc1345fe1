"""Checks of the torque against the motion: exchanged columns, a wrong sign, the model of another machine."""

from collections.abc import Iterator

import numpy as np

from ..arrays import Values
from ..dynamics.derivative import smooth_motion
from ..dynamics.nominal import SIGNIFICANT, Nominal, fit_rigid
from ..log import Log
from .agreement import TOGETHER, travelled
from .suspicion import Expected, Suspicion, unit_of

BEYOND = 4.0  # factor: an inertia that is further off means another unit or another machine, not a cause of a gap
EXPLAINED = 0.5  # share of the motion's variance within windows: with less explained, the fit means nothing
SURE = 8.0  # [standard deviations] of the inertia: a wrong warning about a sign costs more than a missed one
DRIVES = 5.0  # [standard deviations] below zero: friction that drives the machine where its inertia is not told
LARGE = 0.1  # of the torque's rms: the torque of such a friction


def swapped(log: Log, columns: dict[str, Values]) -> Iterator[Suspicion]:
    """Torque and velocity exchanged: a rigid machine explains far more with the columns exchanged."""
    if "velocity" not in columns:
        return
    torque, velocity, position = columns["torque"], columns["velocity"], columns.get("position")
    if position is not None and travelled(velocity, position, log.dt)[1] > TOGETHER:
        return  # it is the rate of the position
    # A weight explains much of what looks like a torque that follows the speed.
    straight = fit_rigid(torque, velocity, None, log.dt, gravity=not log.linear)
    turned = fit_rigid(velocity, torque, None, log.dt)
    if turned is None or not turned.plausible or turned.share < 0.9:
        return
    explained = max(straight.share, 0.0) if straight is not None else 0.0
    # In a short noise-free log much is explained either way: then the residuals are compared, not the shares.
    if turned.share > explained + 0.2 or 1.0 - turned.share < 0.2 * (1.0 - explained):
        yield Suspicion(
            f"torque and velocity look exchanged: with the columns exchanged, inertia and friction "
            f"explain {turned.share:.1%} of the motion, as they are {explained:.1%}.",
            "warn",
            "swapped",
        )


def torque_against_motion(log: Log, columns: dict[str, Values], model: Expected | None) -> Iterator[Suspicion]:
    """Signs and sizes of inertia and friction, beside an unbalance that is fitted too and without the known load."""
    torque, linear = columns["torque"], log.linear
    known = getattr(model, "load", None)
    if known is not None:
        velocity, angle = smooth_motion(columns.get("velocity"), columns.get("position"), log.dt)
        torque = torque - np.asarray(known(velocity, angle, columns["time"] - columns["time"][0]), float)
    found = fit_rigid(torque, columns.get("velocity"), columns.get("position"), log.dt, gravity=not linear)
    if found is None or found.share < EXPLAINED:
        return
    size = float(np.sqrt(np.mean(torque**2)))
    sure = abs(found.inertia) > SURE * found.deviations[0]
    if found.inertia < 0.0 and sure and not _dissipates(found):
        yield Suspicion(
            f"torque and motion have opposite signs (the motion accelerates against the torque: inertia "
            f"{found.inertia:.3g} +- {found.deviations[0]:.2g}): turn the sign of one of them, such as "
            f"--columns torque=NAME*-1.",
            "warn",
            "sign",
        )
    elif not sure and _drives(log, columns, torque, found, size):
        yield Suspicion(
            f"torque and motion have opposite signs (friction would drive the machine: Coulomb {found.coulomb:.3g} +- "
            f"{found.deviations[1]:.2g}, viscous {found.viscous:.3g} +- {found.deviations[2]:.2g}, and on the whole "
            f"the motion gives power to the motor): turn the sign of one of them, such as --columns torque=NAME*-1.",
            "warn",
            "sign",
        )
    elif found.inertia > 0.0 and sure and found.coulomb < -max(0.1 * size, SIGNIFICANT * found.deviations[1]):
        yield Suspicion(
            f"the fitted Coulomb friction is negative ({found.coulomb:.3g}): is there a compensation "
            "torque that the torque column does not include?",
            "warn",
            "compensated",
        )
    elif model is not None:
        yield from _nominal(log, found, model, columns, size, sure=sure)


def against_torque(log: Log, columns: dict[str, Values]) -> str:
    """The one of velocity and position that moves against the torque while the other follows it; "" where none does."""
    velocity, position = (
        fit_rigid(columns["torque"], rate, angle, log.dt, gravity=not log.linear)
        for rate, angle in ((columns["velocity"], None), (None, columns["position"]))
    )
    if velocity is None or position is None:
        return ""
    against = [_against(each) for each in (velocity, position)]
    return "" if against[0] == against[1] else "velocity" if against[0] else "position"


def _against(found: Nominal) -> bool:
    """Whether a motion goes against the torque, by its inertia or, where that tells nothing, by its friction."""
    told = abs(found.inertia) > SIGNIFICANT * found.deviations[0]
    return found.inertia < 0.0 if told else found.coulomb < -SIGNIFICANT * found.deviations[1]


def _drives(log: Log, columns: dict[str, Values], torque: Values, found: Nominal, size: float) -> bool:
    """Whether friction is surely negative, a good part of the torque, and the motor takes power out of the motion.

    Of a motion of one sine an unbalance stands for the inertia, which then tells no sign, but friction does. A fit that
    a spring or a weight bends may find a negative friction too; the motor's work tells it: over a run it is what
    friction takes, but for what the machine gained or gave up in height and speed.
    """
    speed, _ = smooth_motion(columns.get("velocity"), columns.get("position"), log.dt)
    fast = float(np.sqrt(np.mean(speed**2)))
    parts = zip((found.coulomb, fast * found.viscous), (1.0, fast), found.deviations[1:3], strict=True)
    negative = [part < -max(LARGE * size, DRIVES * per * deviation) for part, per, deviation in parts]
    if not any(negative) or _dissipates(found):
        return False
    # the share of the torque's whole work that comes back: 1 where a friction of the wrong sign is all that acts
    work = torque * speed
    return float(np.sum(work)) < -LARGE * float(np.sum(np.abs(work)))


def _dissipates(found: Nominal) -> bool:
    """Whether the fitted friction dissipates power: with a wrong sign of the torque both of its parts were negative.

    An arm whose other joints move needs torques that look like a negative inertia. Its friction then shows that the
    sign is right (as with axis 3 of a KUKA KR300).
    """
    coulomb, viscous = found.deviations[1:3]
    return found.coulomb > SIGNIFICANT * coulomb or (
        found.viscous > SIGNIFICANT * viscous and found.coulomb > -SIGNIFICANT * coulomb
    )


def _nominal(
    log: Log, found: Nominal, model: Expected, columns: dict[str, Values], size: float, *, sure: bool
) -> Iterator[Suspicion]:
    linear = log.linear
    what, unit = ("mass", "kg") if linear else ("inertia", "kg m^2")
    # The log does not tell inertias between those of the forward and of the reverse regression apart: a model whose
    # inertia lies there, with a margin, is not suspected.
    ratio = model.inertia / max(found.inertia, 1e-300)
    between = found.least_inertia / BEYOND < model.inertia < BEYOND * found.most_inertia
    if sure and found.inertia > 0.0 and not (1.0 / BEYOND < ratio < BEYOND or between):
        named = unit_of(ratio, linear=linear)
        level = found.coulomb / model.coulomb if model.coulomb > 0.0 else np.nan
        seen = f"the log's torque and acceleration give {found.inertia:.3g} {unit}, the model has {model.inertia:.3g}"
        if named and (not np.isfinite(level) or 0.5 < level < 2.0):
            column = "velocity" if log.velocity is not None else "position"
            named = named if column == "velocity" else named.removesuffix("/s")
            yield Suspicion(
                f"{column} looks like {named}: {ratio:.3g} x what the model expects ({seen}); give"
                f" its unit, such as --columns {column}={column}:{named}, or correct the model's {what}.",
                "warn",
                "unit",
            )
        else:
            yield Suspicion(
                f"the model may not belong to this log: {seen}, {max(ratio, 1 / ratio):.3g} x "
                f"off; check the unit of the {what} and the scale of the torque.",
                "warn",
                "machine",
            )
        return
    # fast = viscous friction is compared as a torque, at the speed that 5 % of the samples exceed
    velocity, _ = smooth_motion(columns.get("velocity"), columns.get("position"), log.dt)
    fast = float(np.quantile(np.abs(velocity), 0.95))
    for name, unit, here, there, speed in (
        ("coulomb", "N" if linear else "N m", found.coulomb, model.coulomb, 1.0),
        ("viscous", "N s/m" if linear else "N m s/rad", found.viscous, model.viscous, fast),
    ):
        excess = (there - here) * speed
        if there > 0.0 and excess > 2.0 * size and there > 5.0 * max(here, 0.0):
            yield Suspicion(
                f"the model's {name} friction of {there:.3g} {unit} needs more torque than the "
                f"log has (about {max(here, 0.0):.3g} would fit): is it wrong by a factor of ten?",
                "warn",
                "nominal",
            )
