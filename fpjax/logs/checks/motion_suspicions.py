"""Checks of the motion's columns against each other: the unit of the time, and velocity against position."""

from collections.abc import Iterator

import numpy as np

from ..arrays import Values
from ..log import Log
from ..mending.clock import TIME_UNITS, likely_unit
from .agreement import TOGETHER, one_unit, travelled
from .suspicion import LIKE, Suspicion, pair_of, unit_of
from .torque_suspicions import against_torque

SURELY = 0.99  # correlation of velocity and position over blocks, from which on their ratio is no matter of noise
OTHER_SCALE = 0.05  # of that ratio, from 1: gears and encoders are known better


def unit_of_time(log: Log, columns: dict[str, Values]) -> Iterator[Suspicion]:
    """Stamps in milliseconds that were read as seconds; velocity and position together confirm or refute it."""
    unit = likely_unit(log.dt)
    if unit is None:
        return
    velocity, position = columns.get("velocity"), columns.get("position")
    if velocity is not None and position is not None:
        ratio, together = travelled(velocity, position, log.dt)
        if together > TOGETHER and one_unit(abs(ratio)):
            return  # the velocity is the rate of the position in these seconds: the unit is right
        named = [name for name, size in TIME_UNITS.items() if abs(abs(ratio) * size - 1.0) < LIKE]
        unit = named[0] if named and together > TOGETHER else unit
    yield Suspicion(
        f"its rows are {log.dt:.4g} s apart, which is slow for a control period: is its time in {unit}? "
        f"Then say so with --columns time=NAME:{unit}.",
        "warn",
        "clock",
    )


def position_against_velocity(log: Log, columns: dict[str, Values]) -> Iterator[Suspicion]:
    """Velocity and position in other units, of another sign or scale, or of different axes."""
    velocity, position = columns.get("velocity"), columns.get("position")
    if velocity is None or position is None:
        return
    ratio, together = travelled(velocity, position, log.dt)
    unit = "m" if getattr(log, "linear", False) else "rad"
    if not np.isfinite(ratio) or together < TOGETHER:
        yield Suspicion(
            f"velocity is not the rate of change of position (correlation {together:.2f}): one of them "
            f"belongs to another axis, or has another time.",
            "warn",
            "inconsistent",
        )
        return
    if unit == "rad" and (pair := pair_of(abs(ratio))):
        yield Suspicion(
            f"velocity is {abs(ratio):.3g} x the rate of change of position, as {pair[0]} are beside {pair[1]}: unless "
            f"a gear lies between them give both units, such as --columns "
            f"velocity=NAME:{pair[0]},position=NAME:{pair[1]}.",
            "warn",
            "unit",
        )
        return
    named = unit_of(abs(ratio), linear=unit == "m")
    inverse = unit_of(1.0 / abs(ratio), linear=unit == "m") if ratio else None
    if named:
        yield Suspicion(
            f"velocity looks like {named}: {abs(ratio):.3g} x the rate of change of position; give"
            f" its unit, such as --columns velocity=NAME:{named}.",
            "warn",
            "unit",
        )
    elif inverse and inverse != "rpm":  # no angle is counted in rpm
        angle = inverse.removesuffix("/s")
        yield Suspicion(
            f"position looks like {angle}: its rate of change is {1 / abs(ratio):.3g} x the "
            f"velocity; give its unit, such as --columns position=NAME:{angle}.",
            "warn",
            "unit",
        )
    elif ratio < 0.0:
        wrong = against_torque(log, columns)
        turned = (
            f"it is the {wrong} that goes against the torque, so turn its sign with --columns {wrong}={wrong}*-1."
            if wrong
            else "turn one of them round."
        )
        yield Suspicion(
            f"velocity has the opposite sign of the rate of change of position ({ratio:.3g} x): {turned}",
            "warn",
            "sign",
        )
    elif not one_unit(ratio):
        yield Suspicion(
            f"velocity is {ratio:.3g} x the rate of change of position: check the units of both.",
            "warn",
            "unit",
        )
    elif together > SURELY and abs(ratio - 1.0) > OTHER_SCALE:
        yield Suspicion(
            f"velocity is {ratio:.3g} x the rate of change of position: one of them has a wrong scale, or a gear lies "
            f"between them; correct it, as with --columns velocity=NAME*{1.0 / ratio:.4g}.",
            "warn",
            "scale",
        )
