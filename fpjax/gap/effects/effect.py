"""What an effect is: parameters with a neutral value, and how they change the blocks."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from ...blocks.parameters import set_parameters
from ...output.json_object import TomlTable
from ..data.setting import Setting
from ..machine import FEATURES, Feature, Machine, Structure, has_bristles

Values = TomlTable


Size = Callable[[Setting], float]


@dataclass(frozen=True)
class EffectParameter:
    """One number that an effect frees.

    Attributes:
        name: unique in the whole set of effects; effects that share a name share the number.
        unit: SI.
        neutral: value at which the effect is exactly not there.
        low: physical lower bound.
        high: physical upper bound.
        scale: typical size, for the fit's steps.
        path: dotted name of the leaf of `Machine`, "law." standing for the static friction law; "" where the effect's
            `apply` sets it.
        reach: of one step of a fit: beyond it the parameter says another thing than where the step was computed.
        blur: standard deviation that the sampling of a log leaves it, however well a model follows; 0 for none.
    """

    name: str
    unit: str
    neutral: Size
    low: Size
    high: Size
    scale: Size
    path: str = ""
    reach: Size = lambda setting: float("inf")
    blur: Size = lambda setting: 0.0


Report = Callable[[dict[str, float], Setting], dict[str, tuple[float, str]]]


@dataclass(frozen=True)
class Effect:
    """One possible cause of a gap.

    Attributes:
        name: of the vocabulary, or the user's own.
        parameters: what is free when the effect is in.
        apply: (machine, values by parameter name) -> machine; the default sets each parameter's `path`.
        starts: where the fit begins: one dictionary of values (what is missing is neutral) per start.
        report: from the fitted values to the contract's parameters: {name: (value, unit)}; default: as they are.
        structure: what the machine must have for it.
        wide: the nominal parameters lose their tight prior (they are confounded with the effect).
        features: terms of the machine that it changes; all, unless it says less (what is left out costs no time).
        fixed: parameters that a start may set and the fit leaves alone.
        follows: what its torque is a function of, of "velocity", "position", "torque" and "time"; empty where it
            depends on the past or on an acceleration, or where nothing is said.
    """

    name: str
    parameters: tuple[EffectParameter, ...]
    apply: Callable[[Machine, Values], Machine] | None = None
    starts: Callable[[Setting], list[dict[str, float]]] = lambda setting: [{}]
    report: Report | None = None
    structure: Structure = "rigid"
    wide: bool = False
    fixed: tuple[EffectParameter, ...] = ()
    features: tuple[Feature, ...] = FEATURES
    follows: tuple[str, ...] = ()

    def change(self, machine: Machine, values: Values) -> Machine:
        """The machine with this effect at these values; at the neutral ones it is the same machine."""
        if self.apply is not None:
            return self.apply(machine, values)
        return place(machine, {p.path: values[p.name] for p in (*self.parameters, *self.fixed) if p.path})

    def describe(self, values: dict[str, float], setting: Setting) -> dict[str, tuple[float, str]]:
        """The contract's parameters: {name: (value, unit)}."""
        if self.report is not None:
            return self.report(values, setting)
        return {p.name: (values[p.name], p.unit) for p in self.parameters}


def place(machine: Machine, values: TomlTable) -> Machine:
    """The machine with leaves set by dotted name, "law." standing for the static friction law wherever it is."""
    prefix = _prefix(machine)
    return set_parameters(
        machine, {prefix + name[4:] if name.startswith("law.") else name: value for name, value in values.items()}
    )


def leaf(machine: Machine, path: str) -> float | None:
    """The number at a dotted name, "law." standing for the static friction law; None where there is none."""
    names = (_prefix(machine) + path[4:] if path.startswith("law.") else path).split(".")
    at: Any = machine
    for name in names:
        at = (at[int(name)] if int(name) < len(at) else None) if name.isdigit() else getattr(at, name, None)
        if at is None:
            return None
    return float(at)


def _prefix(machine: Machine) -> str:
    return "plant.friction.law." if has_bristles(machine) else "plant.friction."


def free(effects: tuple[Effect, ...]) -> tuple[EffectParameter, ...]:
    """The parameters of several effects, each name once."""
    found: dict[str, EffectParameter] = {}
    for effect in effects:
        for parameter in (*effect.parameters, *effect.fixed):
            found.setdefault(parameter.name, parameter)
    return tuple(found.values())
