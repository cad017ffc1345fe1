"""The machines of a plan: the nominal model, every effect at its detectable size, and the rivals of a diagnosis."""

from __future__ import annotations

import cmath
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from math import isfinite, nan, pi

import numpy as np

from ..blocks.loads import turns_with_position
from ..blocks.position_torque import first_harmonic
from ..gap.data.setting import SMALL_FRICTION, Setting
from ..gap.effects.effect import Effect
from ..gap.effects.estimate import Estimate
from ..gap.effects.parameters import HARDENING, ORIGIN, UNBALANCE
from ..gap.effects.twins import LogFacts
from ..gap.effects.vocabulary import EFFECTS, on_rate_sensor
from ..gap.fit.candidate import NOMINAL, SPIKE, WIDE
from ..gap.machine import FEATURES, Feature, Structure
from ..gap.simulate.family import Family, Nominal, key_for, make_family
from ..model_file import Model
from ..output.json_object import TomlTable
from .limits import Limits

Values = dict[str, float]
OFFSET = "torque"  # the parameter of a constant torque
START = {"torque_saturation": 1, "actuator_lag": 1, "velocity_lag": 1, "actuator_delay": 0, "velocity_delay": 0}
"""Index of the start value, of an effect's fit, that is its detectable size; for all other effects the middle one."""
WITHOUT_OFFSET = ("constant_torque", "asymmetric_friction")  # a free offset would take these effects' place


@dataclass(frozen=True)
class Variant:
    """One machine: the nominal one with an effect at some size.

    Attributes:
        name: of the effect.
        effect: from the vocabulary; None for the nominal machine.
        structure: the structure that the machine needs.
        values: values other than nominal, by parameter.
    """

    name: str
    effect: Effect | None
    structure: Structure
    values: Mapping[str, float]


@dataclass(frozen=True)
class Shop:
    """Makes machines from variants.

    Attributes:
        model: the nominal model.
        setting: scales for bounds and detectable sizes.
        families: one for each structure that is needed.
        features: by structure, the terms that its machines need; other terms are not compiled.
    """

    model: Model
    setting: Setting
    families: dict[Structure, Family]
    features: Mapping[Structure, tuple[Feature, ...]] = field(default_factory=dict)

    def family(self, structure: Structure) -> Family:
        """The family of a structure, made on first use; where the nominal plant has a spring, all are transmissions."""
        if structure not in self.families:
            loop = self.model.loop
            nominal = Nominal(loop.plant, loop.actuator, loop.sensor)
            features = self.features.get(structure, FEATURES)
            self.families[structure] = make_family((structure, features), nominal, EFFECTS, self.setting)
        return self.families[structure]

    def fitted_to(self, variants: Sequence[Variant]) -> Shop:
        """A shop whose families hold only the terms that these variants need, as compilation takes most of a plan."""
        found: dict[Structure, tuple[Feature, ...]] = {}
        structures: set[Structure] = {variant.structure for variant in variants}
        for structure in structures:
            names = {name for one in variants if one.structure == structure for name in one.values}
            effects = [effect for effect in EFFECTS if names & {p.name for p in (*effect.parameters, *effect.fixed)}]
            wanted = key_for(tuple(effects), self.setting)[1]
            found[structure] = tuple(feature for feature in FEATURES if feature in wanted)
        return replace(self, families={}, features=found)

    def vector(self, variant: Variant) -> np.ndarray:
        """All parameters of a variant's family, shape (parameters,)."""
        family = self.family(variant.structure)
        vector = family.neutral(self.setting)
        for name, value in variant.values.items():
            vector[family.index(name)] = value
        return vector

    def nuisances(self, effect: Effect | None) -> tuple[str, ...]:
        """Parameters of the nominal model that may be wrong beside an effect, those of a known load that turns too."""
        own = set() if effect is None else {p.name for p in effect.parameters}
        offset = () if effect is not None and effect.name in WITHOUT_OFFSET else (OFFSET,)
        load = tuple(p.name for p in UNBALANCE) if self.setting.turning_load else ()
        origin = (ORIGIN.name,) if self.setting.unknown_origin else ()
        return tuple(name for name in (*NOMINAL, *offset, *load, *origin) if name not in own)

    def spreads(self, variant: Variant, names: tuple[str, ...]) -> np.ndarray:
        """Standard deviation of the prior of a variant's parameters, as the diagnosis has it, shape (names,)."""
        family = self.family(variant.structure)
        own = set() if variant.effect is None else {p.name for p in variant.effect.parameters}
        # A known load's error, which is no cause, is as small as that of a number that counts as right.
        errors = {p.name for p in UNBALANCE} - own if self.setting.turning_load else set[str]()

        def spread(name: str) -> float:
            if name in errors:
                return SPIKE * abs(self.setting.turning_load)
            parameter = family.parameters[family.index(name)]
            return WIDE * (parameter.high(self.setting) - parameter.low(self.setting))

        return np.array([spread(name) for name in names])

    def steps(self, family: Family, names: tuple[str, ...]) -> np.ndarray:
        """Small changes of parameters for their tangents, shape (names,)."""
        return np.array([1e-3 * family.parameters[family.index(name)].scale(self.setting) for name in names])

    def effects(self) -> tuple[Effect, ...]:
        """The effects of the vocabulary; without a rate sensor those on its reading are left out."""
        rate = self.model.sensors != "position"
        return tuple(effect for effect in EFFECTS if rate or not on_rate_sensor(effect))

    def facts(self) -> LogFacts:
        """The facts that decide which effects are exact twins in a log of this machine."""
        load, actuator = self.model.loop.plant.load, self.model.loop.actuator
        turning = turns_with_position(load)
        known = turning or bool(self.model.nominal["offset"]) or bool(getattr(actuator, "offset", None))
        return LogFacts(self.model.sensors != "velocity", known, turning, self.setting.nominal)


def make_shop(model: Model, limits: Limits, torque: float, window: float) -> Shop:
    """A shop with the scales that the diagnosis will find in the log of a run up to these limits.

    Args:
        model: the nominal model.
        limits: of the run.
        torque: largest torque that the run commands [N m].
        window: length of a window [s].
    """
    nominal, load = model.nominal, model.loop.plant.load
    # Without a position in the log the diagnosis integrates the speed, so that its zero is not known.
    integrated = model.sensors == "velocity"
    setting = Setting(
        inertia=nominal["inertia"],
        coulomb=nominal["coulomb"],
        viscous=nominal["viscous"],
        friction=max(nominal["coulomb"], SMALL_FRICTION * torque),
        speed=limits.speed,
        torque=torque,
        travel=limits.travel,
        duration=limits.duration,
        dt=model.dt,
        window=window,
        effort=torque + nominal["inertia"] * limits.acceleration,
        nominal={name: nominal[name] for name in NOMINAL},
        unknown_origin=integrated and turns_with_position(load),
        turning_load=0.0 if integrated else first_harmonic(load),
    )
    return Shop(model, setting, {})


NOMINAL_VARIANT = Variant("nominal", None, "rigid", {})


def detectable(shop: Shop, effect: Effect) -> Variant:
    """An effect at the size that a plan must show.

    That is a usual start value of its fit; where this is the neutral value, one scale of its main parameter, a tenth to
    a fifth of the friction for torques.
    """
    setting = shop.setting
    starts = effect.starts(setting)
    values = dict(starts[START.get(effect.name, len(starts) // 2)])
    sized = [p for p in effect.parameters if not p.name.endswith(("periods", "exponent", "time"))]
    if not any(p.name in values and values[p.name] != p.neutral(setting) for p in sized):
        chosen = next((p for p in sized if p.name.endswith("_difference")), sized[0])
        values[chosen.name] = chosen.neutral(setting) + chosen.scale(setting)
    return Variant(effect.name, effect, effect.structure, values)


def reported(variant: Variant, shop: Shop) -> dict[str, Estimate]:
    """A variant's parameters by the names of `diagnosis.json`, with the units of the shop's model."""
    assert variant.effect is not None
    family = shop.family(variant.structure)
    values = family.neutral_values(shop.setting) | dict(variant.values)
    found = variant.effect.describe(values, shop.setting)
    units = shop.model.units
    return {name: Estimate(value, value, value, units.name(unit)) for name, (value, unit) in found.items()}


def rival(shop: Shop, name: str, told: Mapping[str, float]) -> Variant | None:
    """A machine from the parameters that a diagnosis reports of an effect; None for an effect of the user's own.

    Parameters that are not reported (a phase, a bristle's damping) are as in `detectable`.

    Args:
        shop: of the nominal model.
        name: of the effect.
        told: its reported parameters; NaN for what is not known.
    """
    effect = next((one for one in EFFECTS if one.name == name), None)
    if effect is None:
        return None
    usual = detectable(shop, effect)
    known = {key: value for key, value in told.items() if isfinite(value)}
    values = dict(usual.values) | _values(effect, known, shop)
    clipped = {
        p.name: float(np.clip(values[p.name], p.low(shop.setting), p.high(shop.setting)))
        for p in (*effect.parameters, *effect.fixed)
        if p.name in values
    }
    return Variant(name, effect, effect.structure, clipped)


# Names of parameters in diagnosis.json, by effect, and the names in the fit's families.
RENAMED = {
    "friction_drift": {"amplitude": "drift_amplitude", "time_constant": "drift_time"},
    "load_dependent_friction": {"coefficient": "load_coefficient"},
    "quadratic_drag": {"coefficient": "drag_coefficient"},
    "position_dependent_friction": {"amplitude": "ripple_cosine_1", "periods": "ripple_periods"},
    "cogging": {"amplitude": "cogging_cosine_1", "periods": "cogging_periods"},
    "actuator_lag": {"time_constant": "actuator_lag"},
    "velocity_lag": {"time_constant": "velocity_lag"},
    "actuator_delay": {"delay": "actuator_delay"},
    "velocity_delay": {"delay": "velocity_delay"},
    "torque_dead_zone": {"width": "dead_zone"},
    "presliding": {"bristle_deflection": "bristle_deflection"},
    "compliance": {"frequency": "frequency"},
    "backlash": {"gap": "gap"},
}


def _values(effect: Effect, told: Mapping[str, float], shop: Shop) -> Values:
    """The effect's own parameters from the reported ones."""
    if effect.name == "asymmetric_friction":
        nominal: TomlTable = shop.setting.nominal
        found: Values = {}
        for number in ("coulomb", "viscous"):
            up, down = (told.get(f"{number}_{side}", nominal[number]) for side in ("positive", "negative"))
            found |= {number: 0.5 * (up + down), f"{number}_difference": 0.5 * (up - down)}
        return found
    if effect.name == "unbalance" and "amplitude" in told:
        # The whole weight is reported; its angle too beside a known one, to which the rest is added.
        known = complex(shop.setting.turning_load)
        rest = cmath.rect(told["amplitude"], told.get("phase", 0.5 * pi)) - known
        return {"unbalance_sine": rest.real, "unbalance_cosine": rest.imag}
    names = {p.name for p in (*effect.parameters, *effect.fixed)}
    renamed = {RENAMED.get(effect.name, {}).get(name, name): value for name, value in told.items()}
    found = {name: value for name, value in renamed.items() if name in names}
    if effect.name == "compliance" and "stiffness" in told:
        # A shaft that hardens is planned for by its line, which is what its stiffness and frequency are of.
        found |= _load_share(found, told["stiffness"], shop.setting.inertia) | {HARDENING.name: 0.0}
    return found


def _load_share(found: Values, stiffness: float, inertia: float) -> Values:
    """The load's share s from stiffness = J s (1 - s) (2 pi f)^2: the smaller root, or 1/2 where none is real."""
    product = stiffness / (inertia * (2.0 * np.pi * found.get("frequency", nan)) ** 2)
    if not isfinite(product):
        return {}
    return {"load_share": 0.5 - float(np.sqrt(max(0.25 - product, 0.0)))}
