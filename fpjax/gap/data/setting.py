"""Setting: sizes from the log and the nominal model that give every parameter its bounds, scale and start values."""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace

import numpy as np

from ...blocks.loads import turns_with_position
from ...blocks.position_torque import first_harmonic
from ...logs.arrays import Values
from ...model_file import Model, Units
from ..machine import general_law
from .record import Record
from .torque_noise import TorqueNoise

STRETCH = 40  # [samples] in which a machine may be seen to rest
SLOW = 0.2  # of the top speed: the largest bias that is looked for so
QUIET = 3.0  # standard deviations of the reading's noise within which a level is one
SMALL_FRICTION = 0.02  # of the largest torque: a nominal Coulomb level below it (zero, say) is no scale for friction


@dataclass(frozen=True)
class Setting:
    """Sizes for bounds, scales and start values of parameters.

    Attributes:
        inertia: J [kg m^2] of the nominal model.
        coulomb: k [N m].
        viscous: b [N m s/rad].
        friction: typical friction torque [N m]: the largest of k, the fitted one, a share of the largest torque.
        speed: 95 % quantile of the speed [rad/s].
        torque: largest commanded torque [N m].
        travel: range of the position [rad], of the log that goes furthest.
        duration: of the longest log, or from the start of a recording to its last stretch's end [s].
        dt: control period [s].
        window: length of a window [s].
        effort: largest torque that can have acted [N m]: the largest command plus the nominal inertial torque.
        nominal: parameters of the nominal model by name.
        drag_slope: of the nominal model's quadratic drag at the rms speed [N m s/rad].
        units: of the model file: what its numbers, and those of an answer, are in.
        unknown_origin: whether a known load depends on a position whose zero no sensor measures.
        turning_load: A e^(i phase) [N m] of what a known load holds of A sin(position + phase), where the position is
            measured; else 0.
        at_rest: what a velocity without an encoder beside it reads while the machine rests [rad/s]; 0 where that is not
            told from zero.
        shaft: torque of a transmission's shaft [N m] along a log, shape (samples,), where its stiffness is reported.
        waves: start values by name (amplitudes [N m] and periods per revolution [1/rev]) of a cogging ("torque") and of
            a friction by position ("friction"): as the missing torque repeats with the position, the strongest first.
        weight: values by name of the unbalance that fits the missing torque best; empty where none was fitted.
        rise: likewise of the Stribeck friction, with its Coulomb and viscous levels.
        contacts: start values by name of backlashes, the most likely first; None where they were not searched for,
            empty where no stretch of the log could be used.
        springs: likewise of springs, the sensors on either side.
        torque_noise: what is left of the noise of measured torques, one a log, or none at all.
    """

    inertia: float
    coulomb: float
    viscous: float
    friction: float
    speed: float
    torque: float
    travel: float
    duration: float
    dt: float
    window: float = 0.25
    effort: float = 0.0
    nominal: Mapping[str, float] = field(default_factory=dict)
    drag_slope: float = 0.0
    units: Units = field(default_factory=Units)
    unknown_origin: bool = False
    turning_load: complex = 0.0
    at_rest: float = 0.0
    shaft: Values = field(default_factory=lambda: np.zeros(1), compare=False, repr=False)
    waves: Mapping[str, tuple[Mapping[str, float], ...]] = field(default_factory=dict)
    weight: Mapping[str, float] = field(default_factory=dict)
    rise: Mapping[str, float] = field(default_factory=dict)
    contacts: tuple[Mapping[str, float], ...] | None = None
    springs: tuple[Mapping[str, float], ...] | None = None
    torque_noise: tuple[TorqueNoise, ...] = ()

    @property
    def periods(self) -> tuple[float, ...]:
        """Periods per revolution [1/rev] of the missing torque that `waves` holds, the strongest first."""
        return tuple(start["cogging_periods"] for start in self.waves.get("torque", ()))

    @property
    def damping(self) -> float:
        """Slope of the nominal model's friction at the log's speeds over its inertia [1/s]."""
        return (self.viscous + self.drag_slope) / self.inertia

    @property
    def given_friction(self) -> float:
        """`friction` of the nominal model as given [N m]."""
        return max(self.coulomb, SMALL_FRICTION * self.torque)


def make_setting(records: list[Record], model: Model) -> Setting:
    """Sizes for bounds and starts, from the logs and the nominal model."""
    values = model.nominal
    longest = max(records, key=lambda record: len(record.time))
    torque = max(float(np.max(np.abs(record.torque))) for record in records)
    speed = max(float(np.quantile(np.abs(record.speed), 0.95)) for record in records)
    coulomb, viscous = values.get("coulomb", 0.0), values.get("viscous", 0.0)
    plant = model.loop.plant
    load = plant.load
    rms = float(np.sqrt(np.mean(np.concatenate([record.speed for record in records]) ** 2)))
    return Setting(
        inertia=values["inertia"],
        coulomb=coulomb,
        viscous=viscous,
        friction=max(coulomb, SMALL_FRICTION * torque),
        speed=max(speed, 1e-12),
        torque=torque,
        travel=max(float(np.ptp(record.angle)) for record in records),
        duration=max(float(record.elapsed[-1]) for record in records),
        dt=longest.dt,
        window=longest.samples * longest.dt,
        # Quantiles, not maxima: an outlier in a column would widen every bound.
        effort=torque + values["inertia"] * max(float(np.quantile(np.abs(r.acceleration), 0.99)) for r in records),
        nominal={"inertia": values["inertia"], "coulomb": coulomb, "viscous": viscous},
        drag_slope=drag_slope(model, rms),
        units=replace(model.units, motion="linear") if longest.linear else model.units,
        unknown_origin=longest.integrated and turns_with_position(load),
        turning_load=0.0 if longest.integrated else first_harmonic(load),
        at_rest=reading_at_rest(longest),
    )


def drag_slope(model: Model, speed: float) -> float:
    """Slope of a nominal model's quadratic drag at a speed [rad/s], in N m s/rad."""
    return 2.0 * float(general_law(model.loop.plant.friction)[0].drag_coefficient) * speed


def reading_at_rest(record: Record) -> float:
    """What a velocity without an encoder beside it reads while the machine rests [rad/s]; 0 where it is not known.

    A machine that rests reads one small value again and again, whatever the torque does. Of the short stretches with
    nothing but noise about a level below a share of the top speed it is the level that most of them have, two at least.
    """
    if record.velocity is None or not record.integrated:
        return 0.0
    values, noise = record.velocity.values, record.velocity.noise
    pieces = np.lib.stride_tricks.sliding_window_view(values, STRETCH)[:: STRETCH // 4]
    level = np.mean(pieces, axis=1)
    slow = np.abs(level) < SLOW * np.quantile(np.abs(values), 0.95)
    place = np.flatnonzero(slow & (np.std(pieces, axis=1) < QUIET * noise))
    if len(place) < 2:
        return 0.0
    ordered = np.sort(level[place])
    alike = np.searchsorted(ordered, level[place] + QUIET * noise) - np.searchsorted(
        ordered, level[place] - QUIET * noise
    )
    found = float(level[place[int(np.argmax(alike))]])
    same = place[np.abs(level[place] - found) < QUIET * noise]
    # The pieces overlap: the first and the last of them must not.
    apart = (same[-1] - same[0]) * (STRETCH // 4) >= STRETCH
    return found if apart and abs(found) > QUIET * noise else 0.0
