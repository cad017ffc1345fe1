"""[observer] <-> its block, and the parameters that an observer takes from the rest of the model."""

from collections.abc import Mapping
from typing import Any

from ..blocks.friction.bristles import Bristles
from ..blocks.observers import (
    Absolute,
    AbstractNonlinearity,
    AbstractObserver,
    ClassicalFriedlandPark,
    ExtendedFriedlandPark,
    ExtendedSteepnessCoulomb,
    ExtendedSteepnessViscous,
    HighOrderFeedforward,
    LogCosh,
    ModifiedFriedlandPark,
    NoObserver,
    NovelFriedlandPark,
    Quadratic,
    SteepnessObserver,
)
from ..blocks.plants import AbstractPlant, SeriesTwoMass, TwoMass
from ..errors import InputError
from ..output.json_object import JsonObject, TomlTable
from ..simulation.solvers import get_solver
from ..simulation.stability import safe_steepness
from .block_types import number, numbers
from .body import total_inertia
from .friction import SECTION as FRICTION
from .keys import Key, Units, check_keys, choose, read_number, read_values

OBSERVER_FRACTION = 0.8  # share of the steepness from which on a held compensation overshoots zero speed
_GAIN = Key("gain", "1", "not negative")
_GAINS = (Key("gain_1", "1", "not negative"), Key("gain_2", "1", "not negative"))


def unwritten_gains(controller: TomlTable | None, observer: TomlTable | None) -> tuple[str, ...]:
    """Gains that the file leaves to pole placement, as "observer.gain_1".

    Of a pair both must be left out: where one is written, the other is reported as missing.
    """
    # str(), because the value may not be text yet: a wrong one is refused where the block is built.
    law, kind = str((controller or {}).get("type", "")), str((observer or {}).get("type", ""))
    wanted = {
        "controller": {"pi": ("kp", "ki"), "p": ("kp",)}.get(law, ()),
        "observer": ("gain",) if kind in _SINGLE else ("gain_1", "gain_2") if kind in _DOUBLE else (),
    }
    written = {"controller": controller or {}, "observer": observer or {}}
    return tuple(
        f"{section}.{name}"
        for section, names in wanted.items()
        if not set(names) & set(written[section])
        for name in names
    )


_SINGLE = {
    "cfp": (ClassicalFriedlandPark, ("viscous",)),
    "mfp": (ModifiedFriedlandPark, ("viscous",)),
    "nfp": (NovelFriedlandPark, ("coulomb",)),
    "steepness": (SteepnessObserver, ("coulomb",)),
}
_DOUBLE = {
    "efp": (ExtendedFriedlandPark, ()),
    "efp_steepness_coulomb": (ExtendedSteepnessCoulomb, ("viscous",)),
    "efp_steepness_viscous": (ExtendedSteepnessViscous, ("coulomb",)),
}
_NONLINEARITIES: dict[str, type[AbstractNonlinearity]] = {
    "quadratic": Quadratic,
    "absolute": Absolute,
    "log_cosh": LogCosh,
}
OBSERVERS = ("none", *_SINGLE, *_DOUBLE)
_KNOWN = {
    "coulomb": Key("coulomb", "N m", "not negative"),
    "viscous": Key("viscous", "N m s/rad", "not negative"),
    "inertia": Key("inertia", "kg m^2", "positive"),
    "steepness": Key("steepness", "s/rad", "positive"),
}


def build_observer(
    table: TomlTable | None, units: Units, plant: AbstractPlant, known: Mapping[str, float | None]
) -> AbstractObserver:
    """The observer of [observer].

    Args:
        table: the section.
        units: of the machine.
        plant: for `high_order = true`.
        known: inertia, coulomb, viscous and steepness (None for sign) of the model, for keys that the section does not
            write.

    Raises:
        InputError: for invalid keys or values.
    """
    if table is None:
        return NoObserver()
    name = choose("observer", "type", table.get("type", ""), OBSERVERS)
    if name == "none":
        check_keys("observer", table, ["type"])
        return NoObserver()
    single = name in _SINGLE
    block, takes = _SINGLE[name] if single else _DOUBLE[name]
    gains = ("gain", "nonlinearity") if single else ("gain_1", "gain_2")
    check_keys(
        "observer", table, ["type", *gains, "inertia", *takes, "steepness", "high_order"], f" for type = {name!r}"
    )

    def own(key: str) -> float | None:
        if table.get(key) == "sign" and key == "steepness":
            return None
        return read_number("observer", _KNOWN[key], table[key], units) if key in table else known[key]

    steepness = own("steepness")
    fields: JsonObject = {key: own(key) for key in ("inertia", *takes)}
    if single:
        gain = read_values("observer", table, (_GAIN,), units)["gain"]
        fields["nonlinearity"] = _nonlinearity(table.get("nonlinearity"), gain, steepness)
    else:
        fields |= read_values("observer", table, _GAINS, units)
    if name != "steepness":
        fields["steepness"] = steepness
    observer = block(**fields)
    if "high_order" not in table:
        return observer
    if not isinstance(table["high_order"], bool):
        raise InputError("[observer] high_order must be true or false: write high_order = true, or leave it out.")
    return _high_order(observer, plant) if table["high_order"] else observer


def _nonlinearity(word: Any, gain: float, steepness: float | None) -> AbstractNonlinearity:
    if word is None:
        word = "absolute" if steepness is None else "log_cosh"
    choose("observer", "nonlinearity", word, _NONLINEARITIES)
    if word == "log_cosh":
        if steepness is None:
            raise InputError('[observer] nonlinearity = "log_cosh" needs a steepness: write a number, not "sign".')
        return LogCosh(gain, steepness)
    return _NONLINEARITIES[word](gain)  # type: ignore[call-arg]


def _high_order(observer: AbstractObserver, plant: AbstractPlant) -> HighOrderFeedforward:
    if not isinstance(plant, TwoMass | SeriesTwoMass):
        raise InputError('[observer] high_order = true needs [plant] type = "two_mass" or "series_two_mass".')
    return HighOrderFeedforward(observer, plant.motor_inertia, plant.load_inertia, plant.stiffness, plant.damping)


def describe_observer(observer: AbstractObserver) -> JsonObject:
    """The [observer] section; empty without an observer."""
    if isinstance(observer, NoObserver):
        return {}
    if isinstance(observer, HighOrderFeedforward):
        return describe_observer(observer.observer) | {"high_order": True}
    for name, (block, takes) in {**_SINGLE, **_DOUBLE}.items():
        if type(observer) is not block:
            continue
        at: Any = observer
        steepness = getattr(at, "steepness", None)
        table: JsonObject = {"type": name}
        if name in _SINGLE:
            # the steepness belongs to g where g is smooth; the compensation of the same observer has the same one
            shape = at.nonlinearity
            word = next(word for word, kind in _NONLINEARITIES.items() if type(shape) is kind)
            gain = number(getattr(shape, "gain"), "gain")  # noqa: B009 (each has one; their base does not say so)
            table |= {"gain": gain, "nonlinearity": word}
            steepness = getattr(shape, "steepness", steepness)
        else:
            table |= numbers(at, _GAINS)
        table |= {key: number(getattr(at, key), key) for key in ("inertia", *takes)}
        return table | {"steepness": "sign" if steepness is None else number(steepness, "steepness")}
    raise InputError(f"servo.toml cannot hold {type(observer).__name__} in [observer]: keep such a loop in Python.")


def known_to_observer(plant: AbstractPlant) -> dict[str, float | None]:
    """Inertia, Coulomb and viscous friction and steepness of a plant, for an observer; means of both directions."""
    law: Any = plant.friction.law if isinstance(plant.friction, Bristles) else plant.friction

    def mean(name: str) -> float:
        if hasattr(law, name):
            return max(float(getattr(law, name)), 0.0)
        if hasattr(law, f"{name}_positive"):
            return 0.5 * float(getattr(law, f"{name}_positive") + getattr(law, f"{name}_negative"))
        return 0.0

    steepness = getattr(law, "steepness", None)
    return {
        "inertia": total_inertia(plant),
        "coulomb": mean("coulomb"),
        "viscous": mean("viscous"),
        "steepness": None if steepness is None else float(steepness),
    }


def choose_observer_steepness(
    known: dict[str, float | None],
    sections: TomlTable,
    time: TomlTable,
    dt: float,
    units: Units,
    notes: list[str],
) -> None:
    """Choose the steepness of an observer's compensation where the solver is "exact" and the file gives none.

    The plant needs no steepness under this solver, but a compensation by sign(w) would chatter at rest. The choice is
    written to `known` and noted in `notes`.
    """
    observer, coulomb = sections.get("observer") or {}, known["coulomb"]
    written = "steepness" in observer or "steepness" in sections[FRICTION]
    if time["solver"] != "exact" or written or not coulomb or observer.get("type", "none") == "none":
        return
    # A compensation held over a period is one step of Euler's method: it overshoots zero speed once steepness x coulomb
    # x dt / inertia exceeds 2.
    chosen = OBSERVER_FRACTION * safe_steepness(
        float(known["inertia"] or 0.0), coulomb, dt, get_solver("euler"), fraction=1.0
    )
    known["steepness"] = float(f"{chosen:.3g}")
    notes.append(
        f"[observer] steepness is not given: {known['steepness']:g} {units.name('s/rad')} was chosen, "
        f"{100.0 * OBSERVER_FRACTION:.0f} % of what a compensation held over dt = {dt:g} s can follow."
    )
