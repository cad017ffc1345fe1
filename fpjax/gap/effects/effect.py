"""The definition of an effect: parameters with neutral values, and how they change the blocks of the machine."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from ...blocks.parameters import set_parameters
from ...output.json_object import TomlTable
from ..data.setting import Setting
from ..machine import FEATURES, Feature, Machine, Structure, has_bristles

Values = TomlTable

# A number that depends on the sizes of a log and its nominal model (`Setting`), so that one effect serves any machine.
Size = Callable[[Setting], float]


@dataclass(frozen=True)
class EffectParameter:
    """One parameter that is fitted when an effect is in the model.

    Attributes:
        name: unique over all effects; effects that share a name share the parameter.
        unit: SI.
        neutral: value at which the machine is exactly the one without the effect.
        low: physical lower bound.
        high: physical upper bound.
        scale: typical change, the unit in which the fit steps.
        path: dotted name of the leaf of `Machine` that it sets, "law." standing for the static friction law; "" where
            the effect's `apply` sets it.
        reach: longest change in one step of a fit, beyond which the linearisation of the step no longer holds.
        blur: standard deviation by the sampling of the log alone, however well the model fits; 0 for none.
        plain: whether the lower bound is the law without this detail of its form, and no limit of the search.
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
    plain: bool = False


Report = Callable[[dict[str, float], Setting], dict[str, tuple[float, str]]]


@dataclass(frozen=True)
class Effect:
    """One possible cause of a sim-to-real gap.

    Attributes:
        name: of the vocabulary, or the user's own.
        parameters: fitted when the effect is in the model.
        apply: (machine, values by parameter name) -> machine; the default sets each parameter's `path`.
        starts: start values of the fit, one dictionary for each start; a missing parameter is neutral.
        report: from the fitted values to the reported parameters, {name: (value, unit)}; None: as they are.
        structure: structure of the machine that it needs: "rigid", "bristles" or "transmission".
        features: optional terms of the machine that it changes; terms that no effect needs are not compiled.
        fixed: parameters that a start may set and the fit does not change.
        follows: variables that its torque is a function of, among "velocity", "position", "torque" and "time"; empty
            where the torque depends on the past or on an acceleration, or is not known.
    """

    name: str
    parameters: tuple[EffectParameter, ...]
    apply: Callable[[Machine, Values], Machine] | None = None
    starts: Callable[[Setting], list[dict[str, float]]] = lambda setting: [{}]
    report: Report | None = None
    structure: Structure = "rigid"
    fixed: tuple[EffectParameter, ...] = ()
    features: tuple[Feature, ...] = FEATURES
    follows: tuple[str, ...] = ()

    def change(self, machine: Machine, values: Values) -> Machine:
        """The machine with this effect at these values; at the neutral values, the machine unchanged."""
        if self.apply is not None:
            return self.apply(machine, values)
        return place(machine, {p.path: values[p.name] for p in (*self.parameters, *self.fixed) if p.path})

    def describe(self, values: dict[str, float], setting: Setting) -> dict[str, tuple[float, str]]:
        """The reported parameters: {name: (value, unit)}."""
        if self.report is not None:
            return self.report(values, setting)
        return {p.name: (values[p.name], p.unit) for p in self.parameters}


def place(machine: Machine, values: TomlTable) -> Machine:
    """The machine with leaves set by dotted name, "law." standing for the static friction law wherever it is."""
    # "law." has four characters: what follows is looked up where this machine holds its static law.
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
    """Dotted path of the static friction law, which bristles hold inside them."""
    return "plant.friction.law." if has_bristles(machine) else "plant.friction."


def free(effects: tuple[Effect, ...]) -> tuple[EffectParameter, ...]:
    """The parameters of several effects, free and fixed, each name once."""
    found: dict[str, EffectParameter] = {}
    for effect in effects:
        for parameter in (*effect.parameters, *effect.fixed):
            # The first definition counts: effects that share a name share the object.
            found.setdefault(parameter.name, parameter)
    return tuple(found.values())
